//! The calibrations of the tool.
//!
//! - `panelprep calibrate tcp`: determines the TCP and the axis of the tool.
//! - `panelprep calibrate force`: determines payload and force zero of a compliant tool, or verifies them.
//! - `panelprep calibrate removal`: determines the removal of the disc from measured depths on test coupons.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::{CalibrationFault, Fault};
use super::super::output::Outcome;
use super::args::{Force, Removal, Tcp};
use super::arm_correction::CorrectionInUse;
use super::files;
use super::output::{self, provenance, write_calibration};
use panelprep_base::geometry::{Base, Flange, Joints, KukaPose, Rigid, Tool, Vector};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cell::{MountedPose, RemovalCalibration, ToolMount};
use panelprep_cell::files::content_hash;
use panelprep_cell::force::{SensorLoad, down_cosine};
use panelprep_service::setup::{self, CellFiles, NO_AXES, clock::now_unix_s};
use panelprep_store::store::Store;
use panelprep_toolpath::removal::coupons::{Coupon, CouponTool};
use panelprep_toolpath::removal::fit::{CouponFit, fit};
use panelprep_toolpath::removal::gate as removal_gate;
use panelprep_toolpath::removal::model::MM2_PER_M2;
use panelprep_toolpath::removal::pad::PadWithDisc;
use panelprep_toolpath::removal::power::Power;
use panelprep_toolpath::removal::speed::Orbit;
use panelprep_toolpath::removal::table::read_coupons;
use panelprep_vision::calib::force::{AttitudeReading, calibrate, largest_error_n, verification_limits};
use panelprep_vision::calib::health::{self, TOOL_FORCE, Verification};
use panelprep_vision::calib::tool::{flange_from_tool, tool_axis, tool_point};
use panelprep_vision::calib::{gate, readings};
use serde_json::{Value, json};
use std::path::Path;

/// Calibrates the TCP and the axis of the tool, and writes the file if `--out` names one.
///
/// # Errors
/// If the poses file has problems, or its poses do not determine a TCP.
pub fn run_tcp(args: &Tcp, common: &Common) -> Result<Outcome, Fault> {
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
    // Without a measured axis, the Z axis of the flange is written, and the file states that the axis was not measured.
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
        mounted.date = output::today_utc();
        mounted.robot_correction = arm.as_ref().map(|arm| arm.hash.clone());
        mounted.rms_mm = Some(point.rms_mm);
        mounted.uncertainty_mm = Some(point.uncertainty_mm);
        mounted.axis_measured = Some(axis.is_some());
        mounted.provenance = provenance(vec![content_hash(text.as_bytes())], point.residuals_mm.clone());
        let text = mounted.to_toml();
        // The values of a rejected tool may be outside of the limits of the file format, so they are not checked here;
        // the verdict states the reasons.
        if judgement.verdict != Verdict::Reject {
            MountedPose::<ToolMount>::check(&out.display().to_string(), &text)?;
        }
        write_calibration(&mut outcome, &judgement, out, &text)?;
    }
    Ok(outcome)
}

/// Determines payload and zero, or with `--verify` compares them with the cell's file and stores the result.
///
/// # Errors
/// If the file of measurements has problems or does not determine the values, the axis of the tool is not known, or
/// with `--verify` the cell has no compliant tool.
pub fn run_force(args: &Force, common: &Common) -> Result<Outcome, Fault> {
    let text = disk::read_text(&args.readings)?;
    let cell = CellFiles::read(&common.paths())?;
    let flange_from_tool = cell.flange_from_tool()?.value;
    let readings = read(&args.readings.display().to_string(), &text, flange_from_tool)?;
    if args.verify { verify(&cell, &readings) } else { measure(&cell, (&args.readings, &readings)) }
}

fn read(name: &str, text: &str, flange_from_tool: Rigid<Flange, Tool>) -> Result<Vec<AttitudeReading>, Fault> {
    let readings = files::force_readings(name, text)?.into_iter();
    let at = |flange: Rigid<Base, Flange>| down_cosine(&(flange * flange_from_tool));
    Ok(readings.map(|(flange, force_n)| AttitudeReading { downwards: at(flange), force_n }).collect())
}

fn measure(files: &CellFiles, (file, readings): (&Path, &[AttitudeReading])) -> Result<Outcome, Fault> {
    let found = calibrate(readings).map_err(|error| Fault::file_fault(file, error))?;
    let SensorLoad { payload_kg, zero_n } = found.weight;
    let known = found.check_uncertainty(files.cell.tool().compliant());
    let mut outcome = Outcome::from_judgement(&Judgement::from_checks([&known]));
    outcome.add_checks(&[known]);
    outcome.add_value("payload_kg", json!(payload_kg));
    outcome.add_value("payload_95_kg", json!(found.payload_95_kg));
    outcome.add_value("zero_n", json!(zero_n));
    outcome.add_value("zero_95_n", json!(found.zero_95_n));
    outcome.add_value("rms_n", json!(found.rms_n));
    outcome.add_line(format!(
        "payload {payload_kg:.3} ± {:.3} kg, zero {zero_n:.2} ± {:.2} N (95 %)",
        found.payload_95_kg, found.zero_95_n
    ));
    outcome.add_line(format!("{} readings, residuals {:.2} N rms", found.readings, found.rms_n));
    outcome.add_line(format!(
        "write payload_kg = {payload_kg:.3} and zero_n = {zero_n:.2} into [tool] of the cell's file, then verify with --verify"
    ));
    Ok(outcome)
}

fn verify(files: &CellFiles, readings: &[AttitudeReading]) -> Result<Outcome, Fault> {
    let tool = files.cell.tool().compliant().ok_or(CalibrationFault::SpringTool)?;
    let error_n = largest_error_n(readings, tool).ok_or(CalibrationFault::NoReadings)?;
    let demands = verification_limits(files.cell.limits(), tool);
    let verification = Verification {
        subject: TOOL_FORCE.to_owned(),
        error: error_n,
        limit: demands.limit,
        calibration_hash: setup::force_hash(tool),
        at_unix_s: now_unix_s(),
        struck: None,
    };
    let (_, number) = Store::store_verification_in(files.store_folder(), &verification).map_err(Fault::stage)?;
    let reject = health::exceeded_limit_reason(&verification, demands);
    let mut outcome = Outcome::from_judgement(&Judgement::new(reject.into_iter().collect(), vec![]));
    outcome.add_value("error_n", json!(error_n));
    outcome.add_value("limit_n", json!(demands.limit));
    outcome.add_value("number", json!(number));
    let [off, allowed] = distinguishable_texts(error_n, demands.limit, 2);
    outcome.add_line(format!(
        "force without contact: deviation {off} N (limit {allowed} N); stored as verification number {number}"
    ));
    Ok(outcome)
}

/// Fits the model, reports how well it predicts left-out coupons, and writes it.
///
/// # Errors
/// If the file of coupons has problems (each with its line and column), or writing to the disk fails.
pub fn run_removal(args: &Removal) -> Result<Outcome, Fault> {
    let bytes = disk::read(&args.coupons)?;
    let coupons = read_coupons(&bytes).map_err(|error| Fault::file_fault(&args.coupons, error))?;
    let tool = CouponTool {
        pad: PadWithDisc { radius_mm: args.disc_diameter_mm / 2.0, stiffness_n_mm3: args.pad_n_mm3 },
        orbit: Orbit { diameter_mm: args.orbit_mm, speed_rev_min: args.orbit_rev_min },
    };
    let found = match fit(&coupons, &tool) {
        Ok(found) => found,
        Err(error) => return Ok(refused(error.to_string(), args)),
    };
    let checks = removal_gate::checks(&found, &coupons);
    let judgement = Judgement::from_checks(&checks);
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_checks(&checks);
    report_result(&mut outcome, &found, &coupons);
    let left_out = found.left_out_coupons.iter().map(|one| one.map_or(f64::NAN, |one| 100.0 * one.deviation.abs()));
    let residuals = if found.left_out_coupons.iter().all(Option::is_some) { left_out.collect() } else { vec![] };
    let made = provenance(vec![content_hash(&bytes)], residuals);
    let counts = (coupons.len(), found.discs.map_or(0, |discs| discs.count));
    let text =
        RemovalCalibration::to_text(&numbers(&found, (&coupons, &tool)), counts, (output::today_utc(), &made));
    RemovalCalibration::check(&args.out.display().to_string(), &text)?;
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

/// Returns the outcome for coupons that do not determine a removal model.
fn refused(message: String, args: &Removal) -> Outcome {
    let judgement = Judgement::new(vec![Reason::new("no_model", message)], vec![]);
    let mut outcome = Outcome::from_judgement(&judgement);
    outcome.add_value("preston_mm2_per_n", Value::Null);
    outcome.add_line(format!("{}: not written", args.out.display()));
    outcome
}

/// Returns the values of the removal file with their keys.
fn numbers(found: &CouponFit, (coupons, tool): (&[Coupon], &CouponTool)) -> Vec<(&'static str, f64)> {
    let force_n =
        |of: fn(f64, f64) -> f64| coupons.iter().map(|coupon| coupon.force_n).reduce(of).unwrap_or(f64::NAN);
    let [k, b] = [0, 1].map(|index| found.covariance[(index, index)].sqrt());
    let correlation = if k * b > 0.0 { found.covariance[(0, 1)] / (k * b) } else { 0.0 };
    let law = found.powers.force.map_or_else(Vec::new, |power| {
        vec![("force_power", power.value), ("force_power_uncertainty", power.uncertainty)]
    });
    let discs = found.discs.map(|discs| ("disc_deviation_percent", 100.0 * discs.deviation));
    let always = [
        ("preston_mm2_per_n", found.preston_mm2_per_n),
        ("preston_deviation_percent", 100.0 * k),
        ("wear_per_m2", found.decay_per_mm2 * MM2_PER_M2),
        ("wear_deviation_per_m2", b * MM2_PER_M2),
        ("correlation", correlation.clamp(-1.0, 1.0)),
        ("coupon_deviation_percent", 100.0 * found.coupon_deviation),
        ("left_out_percent", 100.0 * found.cross_validation_rms()),
        ("least_force_n", force_n(f64::min)),
        ("most_force_n", force_n(f64::max)),
        ("pad_n_mm3", tool.pad.stiffness_n_mm3),
        ("orbit_mm", tool.orbit.diameter_mm),
        ("orbit_rev_min", tool.orbit.speed_rev_min),
    ];
    always.into_iter().chain(law).chain(discs).collect()
}

fn describe_power(power: Option<Power>) -> String {
    power.map_or("(unknown)".to_owned(), |power| {
        format!("{} ± {}", fixed_decimals(power.value, 2), fixed_decimals(power.uncertainty, 2))
    })
}

fn report_result(outcome: &mut Outcome, found: &CouponFit, coupons: &[Coupon]) {
    let known_percent = 100.0 * found.relative_preston_error_95(0.0);
    let [wear, wear_95] = [found.decay_per_mm2, found.decay_95_per_mm2()].map(|per_mm2| per_mm2 * MM2_PER_M2);
    outcome.add_value("preston_mm2_per_n", json!(found.preston_mm2_per_n));
    outcome.add_value("preston_uncertainty_percent", json!(known_percent));
    outcome.add_value("wear_per_m2", json!(wear));
    outcome.add_value("wear_uncertainty_per_m2", json!(wear_95));
    outcome.add_value("coupon_deviation_percent", json!(100.0 * found.coupon_deviation));
    outcome.add_value("left_out_percent", json!(100.0 * found.cross_validation_rms()));
    let power = |power: Power| json!({"value": power.value, "uncertainty": power.uncertainty});
    outcome.add_value("power", power(found.power));
    outcome.add_value("force_power", json!(found.powers.force.map(power)));
    outcome.add_value("passes_power", json!(found.powers.passes.map(power)));
    outcome.add_value("discs", json!(found.discs.map(|discs| discs.count)));
    outcome.add_value("disc_deviation_percent", json!(found.discs.map(|discs| 100.0 * discs.deviation)));
    outcome.add_line(format!(
        "Preston's coefficient k of a new disc: {:.3e} mm²/N ± {} % (95 %)",
        found.preston_mm2_per_n,
        fixed_decimals(known_percent, 1)
    ));
    outcome.add_line(format!(
        "wear: ln k falls by {} ± {} for each square metre that the disc has swept",
        fixed_decimals(wear, 2),
        fixed_decimals(wear_95, 2)
    ));
    outcome.add_line(format!(
        "{} measured places, {} % rms from the model; held-out places: {} % rms from the prediction",
        coupons.len(),
        fixed_decimals(100.0 * found.coupon_deviation, 1),
        fixed_decimals(100.0 * found.cross_validation_rms(), 1)
    ));
    outcome.add_line(match found.discs {
        Some(discs) => {
            format!("{} discs, which differ by {} % (σ)", discs.count, fixed_decimals(100.0 * discs.deviation, 1))
        }
        None => "the scatter from disc to disc is not known".to_owned(),
    });
    outcome.add_line(format!(
        "exponents of the depth: {} for the force, {} for the number of passes",
        describe_power(found.powers.force),
        describe_power(found.powers.passes)
    ));
    outcome.add_line("coupon            line   measured µm     predicted µm   off %".to_owned());
    let mut rows = Vec::with_capacity(coupons.len());
    for (coupon, one) in coupons.iter().zip(&found.left_out_coupons) {
        let foretold = one.map(|one| (one.predicted_um, 100.0 * one.deviation, one.is_outlier));
        let (by_others, off, mark) =
            foretold.map_or(("none".to_owned(), "–".to_owned(), ""), |(um, off, is_out)| {
                (
                    fixed_decimals(um, 1).to_string(),
                    fixed_decimals(off, 1).to_string(),
                    if is_out { "   outlier" } else { "" },
                )
            });
        outcome.add_line(format!(
            "{:16}  {:4}   {:11}   {by_others:>16}   {off:>5}{mark}",
            coupon.name,
            coupon.line,
            fixed_decimals(coupon.depth_um, 1)
        ));
        rows.push(json!({
            "coupon": coupon.name, "line": coupon.line, "depth_um": coupon.depth_um,
            "foretold_um": one.map(|one| one.predicted_um), "interval_um": one.map(|one| one.interval_um),
            "off_percent": one.map(|one| 100.0 * one.deviation), "outlier": one.map(|one| one.is_outlier),
        }));
    }
    outcome.add_value("coupons", json!(rows));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::render_boards::FORCE_TEXT;
    use panelprep_base::geometry::KukaPose;
    use panelprep_cell::cell::Cell;

    /// The cell file in the repository states the tool values that `make demo` measures, so that a cycle can run on
    /// this cell after the demo.
    #[test]
    fn the_simulated_cell_states_what_the_demo_measures() {
        let flange_from_tool = KukaPose { z_mm: panelprep_sim::TOOL_LENGTH_MM, ..KukaPose::default() }.to_rigid();
        let readings = read("force.toml", FORCE_TEXT, flange_from_tool).unwrap_or_else(|fault| panic!("{fault}"));
        let found = calibrate(&readings).unwrap_or_else(|error| panic!("{error}")).weight;
        let cell =
            Cell::check("cell.toml", include_str!("../../../config/cell.toml")).unwrap_or_else(|p| panic!("{p}"));
        let stated = cell.tool().compliant().expect("compliant");
        let written = [found.payload_kg, found.zero_n].map(|number| format!("{number:.3}"));
        assert_eq!(written, [stated.payload_kg, stated.zero_n].map(|number| format!("{number:.3}")));
    }
}
