//! `panelprep calibrate tcp`: determines the tool's point and axis.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::{CalibrationFault, Fault};
use super::super::load::NO_AXES;
use super::super::outcome::Outcome;
use super::args::Tcp as Args;
use super::arm_correction::CorrectionInUse;
use super::output::{provenance, write_calibration};
use super::{date, files};
use panelprep_base::geometry::{Joints, KukaPose, Vector};
use panelprep_base::verdict::Verdict;
use panelprep_cell::cell::{MountedPose, ToolMount};
use panelprep_cell::files::content_hash;
use panelprep_vision::calib::tool::{flange_from_tool, tool_axis, tool_point};
use panelprep_vision::calib::{gate, readings};
use serde_json::json;

/// Calibrates; writes the file if `--out` names one.
///
/// # Errors
/// If the poses file has problems, or its poses do not determine a tool.
pub fn run(args: &Args, common: &Common) -> Result<Outcome, Fault> {
    let file = args.poses.as_ref().ok_or(CalibrationFault::NoPoses)?;
    let text = disk::read_text(file)?;
    let arm = CorrectionInUse::load(args.robot.as_deref(), common)?;
    let true_flange = |reported, joints: Option<&Joints>| match &arm {
        None => Ok(reported),
        Some(arm) => arm.true_flange(reported, joints).ok_or_else(|| NO_AXES.to_owned()),
    };
    let poses = files::tool_poses(&file.display().to_string(), &text, &true_flange)?;
    let point = tool_point(&poses.tip).map_err(|error| Fault::file_fault(file, error))?;
    let axis = poses.axis.as_ref().map(|touch| tool_axis(&point, touch)).transpose();
    let axis = axis.map_err(|error| Fault::file_fault(file, error))?;
    let judgement = gate::tool(&point, axis.as_ref(), &readings::tip_readings(&poses.tip));
    // Without an axis, the flange's own axis is written, and the file states that it was not measured.
    let along = axis.as_ref().map_or(Vector::new(nalgebra::Vector3::z()), |axis| axis.axis);
    let pose = KukaPose::from_rigid(&flange_from_tool(point.tip, along));
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_value("flange_from_tool", json!(pose));
    outcome.add_value("rms_mm", json!(point.rms_mm));
    outcome.add_value("uncertainty_mm", json!(point.uncertainty_mm));
    outcome.add_value("residuals_mm", json!(point.residuals_mm));
    outcome.add_value("axis_measured", json!(axis.is_some()));
    outcome.add_value("axis_residuals_deg", json!(axis.as_ref().map(|axis| &axis.residuals_deg)));
    outcome.add_line(format!("flange_from_tool {pose}"));
    outcome.add_line(format!("residuals {:.3} mm rms, tip ± {:.3} mm (95 %)", point.rms_mm, point.uncertainty_mm));
    for (index, residual_mm) in point.residuals_mm.iter().enumerate() {
        outcome.add_line(format!("  pose {}: {residual_mm:.3} mm", index + 1));
    }
    if let Some(out) = &args.out {
        let mut mounted = MountedPose::<ToolMount>::from_pose(pose);
        mounted.date = date::today_utc();
        mounted.robot_correction = arm.as_ref().map(|arm| arm.hash.clone());
        mounted.rms_mm = Some(point.rms_mm);
        mounted.uncertainty_mm = Some(point.uncertainty_mm);
        mounted.axis_measured = Some(axis.is_some());
        mounted.provenance = provenance(vec![content_hash(text.as_bytes())], point.residuals_mm.clone());
        let text = mounted.to_toml();
        // A rejected tool may have numbers that no file allows: its reasons state what is wrong.
        if judgement.verdict != Verdict::Reject {
            MountedPose::<ToolMount>::check(&out.display().to_string(), &text)?;
        }
        write_calibration(&mut outcome, &judgement, out, &text)?;
    }
    Ok(outcome)
}
