//! `panelprep calibrate hand-eye --image [--points]`: determines a camera's mount from three touched points.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::outcome::Outcome;
use super::super::pictures;
use super::args::{HandEye as Args, MountName};
use super::arm_correction::CorrectionInUse;
use super::board_image::BoardImage;
use super::boards;
use super::mounted::{Mounted, cell, intrinsics};
use super::output::{provenance, write_calibration};
use super::{date, files};
use panelprep_base::geometry::KukaPose;
use panelprep_base::verdict::Judgement;
use panelprep_cell::cell::{FlangeCameraMount, MountedPose, ScannerMount};
use panelprep_service::report;
use panelprep_vision::calib::three_points::{ThreePoints, three_points};
use panelprep_vision::calib::{BoardObservation, CalibError, gate};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Writes the picture of the corners to touch; with `--points`, calibrates and writes the file.
///
/// # Errors
/// If a file is invalid, the picture shows no board, or the points give no frame.
pub fn run(args: &Args, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    match args.mount {
        MountName::EyeToHand => stage::<ScannerMount>(args, common, progress),
        MountName::EyeInHand => stage::<FlangeCameraMount>(args, common, progress),
    }
}

fn stage<A: Mounted>(args: &Args, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let board = boards::board(&args.board)?;
    let camera = intrinsics(&args.intrinsics)?.camera;
    let Some(image) = &args.image else {
        return Err(Fault::stage(CalibError::Points(
            "--image is missing: give the picture of the board".to_owned(),
        )));
    };
    let board_image = BoardImage::read(image, &camera)?;
    let detected =
        board_image.detect_telling(&board, boards::window(&args.board), progress).map_err(Fault::stage)?;
    let read = |file: &PathBuf| -> Result<files::Points, Fault> {
        Ok(files::points(&file.display().to_string(), &disk::read_text(file)?)?)
    };
    let mut points = args.points.as_ref().map(read).transpose()?;
    let arm = CorrectionInUse::load(args.robot.as_deref(), common)?;
    if let (Some(arm), Some(file), Some(points)) = (&arm, &args.points, &mut points) {
        arm.correct_tips(file, points)?;
    }
    let to_touch = match &points {
        Some(points) => points.touched.iter().map(|touched| touched.corner).collect(),
        None => board.corners_to_touch().to_vec(),
    };
    let drawn = report::draw_corners_to_touch(&board_image.color(), &board, &detected.corners, &to_touch)
        .map_err(Fault::stage)?;
    let beside = args.out.parent().unwrap_or(Path::new("")).to_owned();
    let picture = pictures::save(args.pictures.as_ref().unwrap_or(&beside), "corners_to_touch", &drawn)?;
    let Some(points) = points else {
        let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
        outcome.add_line(format!("{}: touch the corners in their order, 1 to 4", picture.display()));
        for (index, (column, row)) in to_touch.iter().enumerate() {
            outcome.add_line(format!("  point {}: p{}_corner = [{column}, {row}]", index + 1, index + 1));
        }
        outcome.add_value("picture", json!(picture));
        outcome.add_value("corners", json!(to_touch));
        return Ok(outcome);
    };
    let seen = BoardObservation::Pixels(detected.corners.clone());
    let found = three_points::<A>(&camera, &board, &seen, &points.touched, points.base_from_flange);
    let found = found.map_err(Fault::stage)?;
    let rough = cell(common)?.as_ref().and_then(A::rough_pose);
    let judgement = gate::three_points(&found, rough.as_ref());
    let mut outcome = build_outcome(&judgement, &found);
    outcome.add_value("picture", json!(picture));
    let mut mounted = MountedPose::<A>::from_pose(KukaPose::from_rigid(&found.to_from_camera));
    mounted.date = date::today_utc();
    mounted.serial = args.serial.clone();
    mounted.robot_correction = arm.map(|arm| arm.hash);
    // Three points have no residual: the file states neither a residual nor an uncertainty.
    mounted.provenance = provenance(vec![board_image.hash.clone()], vec![]);
    let text = mounted.to_toml();
    MountedPose::<A>::check(&args.out.display().to_string(), &text)?;
    write_calibration(&mut outcome, &judgement, &args.out, &text)?;
    Ok(outcome)
}

fn build_outcome<A: Mounted>(judgement: &Judgement, found: &ThreePoints<A>) -> Outcome {
    let mut outcome = Outcome::from_judgement(judgement);
    let pose = KukaPose::from_rigid(&found.to_from_camera);
    outcome.add_value(A::TABLE, json!(pose));
    outcome.add_value("pnp_rms_px", json!(found.pnp_rms_px));
    outcome.add_value("distance_errors_mm", json!(found.distance_errors_mm));
    outcome.add_value("check_mm", json!(found.check_mm));
    outcome.add_line(format!("{} {pose}", A::TABLE));
    let [first, second, third] = found.distance_errors_mm;
    outcome.add_line(format!(
        "corners {:.3} px rms; errors of the distances 1–2 {first:+.3}, 2–3 {second:+.3}, 1–3 {third:+.3} mm",
        found.pnp_rms_px
    ));
    if let Some(check_mm) = found.check_mm {
        outcome.add_line(format!("the fourth point deviates by {check_mm:.3} mm"));
    }
    outcome
}
