//! `panelprep calibrate verify --poses`: measures the remaining error over the working volume.
//!
//! The camera on the flange looks at one fixed board from many poses. Each picture gives the board's pose through arm,
//! mount and lens. The distance of the board's farthest corner from its known position is the remaining error at this
//! pose.

use super::super::disk;
use super::super::fault::Fault;
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::args::{CameraName, Verify};
use super::arm_correction::CorrectionInUse;
use super::board_image::BoardImage;
use super::files;
use super::target::Target;
use super::verification;
use panelprep_base::geometry::FlangeCamera;
use panelprep_service::report::{self, RemainingError};
use panelprep_vision::calib::health::{self, BoardMeasurement};
use panelprep_vision::calib::{BoardObservation, CalibError, board_pose};
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;

/// Minimum number of pictures for a measurement over the volume.
const MIN_PICTURES: usize = 3;

/// Evaluates every picture, and stores the worst result as a verification.
///
/// # Errors
/// If a file is invalid, too few pictures show the board, or the store cannot be written.
pub fn run(
    args: &Verify,
    (files, poses_file): (&CellFiles, &Path),
    target: &Target,
    progress: &dyn Fn(&str),
) -> Result<Outcome, Fault> {
    if args.camera != CameraName::FlangeCamera {
        let message =
            "--poses is for the camera on the flange: the fixed camera sees a board at rest from one position only";
        return Err(Fault::stage(CalibError::Points(message.to_owned())));
    }
    let folder = poses_file.parent().unwrap_or(Path::new("."));
    let is_there = |image: &str| folder.join(image).is_file();
    let name = poses_file.display().to_string();
    let poses = files::picture_poses(&name, &disk::read_text(poses_file)?, &is_there)?;
    progress(&format!("{name}: searching for the board in {} pictures", poses.len()));
    let (lens, mount) = (files.flange_camera()?, files.flange_from_camera()?);
    let arm = CorrectionInUse::from_cell(files);
    let window = args.board.subpix.map(|half_window_px| half_window_px as usize);
    let look = |pose: &files::PicturePose| -> Result<Result<RemainingError, (String, String)>, Fault> {
        let aside = |why: String| Ok(Err((pose.image.clone(), why)));
        let base_from_flange = match &arm {
            None => pose.base_from_flange,
            Some(arm) => arm.flange((poses_file, &pose.image), pose.base_from_flange, pose.joints.as_ref())?,
        };
        let board_image = BoardImage::read(&folder.join(&pose.image), &lens.value)?;
        let detected = match board_image.detect(&target.board, window) {
            Ok(detected) => detected,
            Err(error) => return aside(error.to_string()),
        };
        if let Some(reason) =
            health::lens_extent_refusal(&lens.extent, detected.corners.iter().map(|(_, pixel)| *pixel))
        {
            return aside(reason.message);
        }
        let found = match board_pose::<FlangeCamera>(&lens.value, &BoardObservation::Pixels(detected.corners)) {
            Ok(found) => found,
            Err(error) => return aside(error.to_string()),
        };
        let base_from_board = base_from_flange * mount.value * found.camera_from_board;
        let look = BoardMeasurement { base_from_board, pnp_rms_px: found.rms, measured_square_mm: None };
        if let Some(reason) = health::uninformative_measurement(&target.base_from_board, &look, &target.board) {
            return aside(reason.message);
        }
        let error_mm = health::distance_mm(&target.base_from_board, &base_from_board, &target.board.corners());
        Ok(Ok(RemainingError { name: pose.image.clone(), place: base_from_flange.origin(), error_mm }))
    };
    let all: Vec<Result<RemainingError, (String, String)>> =
        poses.par_iter().map(look).collect::<Result<_, Fault>>()?;
    let (mut left, mut aside) = (Vec::new(), Vec::new());
    for one in all {
        match one {
            Ok(one) => left.push(one),
            Err(reason) => aside.push(reason),
        }
    }
    if left.len() < MIN_PICTURES {
        let first_reason = aside.first().map(|(image, why)| format!("{image}: {why}"));
        let (found, given) = (left.len(), poses.len());
        let error = CalibError::TooFewPictures { found, given, needed: MIN_PICTURES, first_reason };
        return Err(Fault::stage(error));
    }
    record_verification(args, files, (&left, &aside), files.hash_with_arm(&[&lens.text, &mount.text]))
}

fn record_verification(
    args: &Verify,
    files: &CellFiles,
    (left, aside): (&[RemainingError], &[(String, String)]),
    calibration_hash: String,
) -> Result<Outcome, Fault> {
    let worst_mm = left.iter().map(|one| one.error_mm).fold(0.0, f64::max);
    let rms_mm = (left.iter().map(|one| one.error_mm.powi(2)).sum::<f64>() / left.len() as f64).sqrt();
    let verification = verification::verification(files, "flange_camera", worst_mm, calibration_hash);
    let mut outcome = verification::store_and_judge(files, &verification, args.pictures.as_deref())?;
    outcome.add_value("rms_mm", json!(rms_mm));
    let places = left.iter().map(|one| {
        let place = one.place.mm;
        json!({"file": one.name, "flange_mm": [place.x, place.y, place.z], "error_mm": one.error_mm})
    });
    outcome.add_value("left", places.collect());
    outcome.add_value(
        "set_aside",
        aside.iter().map(|(file, reason)| json!({"file": file, "reason": reason})).collect(),
    );
    outcome
        .add_line(format!("{} pictures: remaining error {rms_mm:.3} mm rms, {worst_mm:.3} mm at most", left.len()));
    for one in left {
        let place = one.place.mm;
        let (name, mm) = (&one.name, one.error_mm);
        outcome.add_line(format!(
            "  {name}: {mm:.3} mm, the flange at ({:.0}, {:.0}, {:.0}) mm",
            place.x, place.y, place.z
        ));
    }
    aside.iter().for_each(|(file, reason)| outcome.add_line(format!("excluded: {file}: {reason}")));
    if let Some(folder) = &args.pictures {
        let file = folder.join("map_flange_camera.svg");
        let limit_mm = files.cell.limits().verify_limit_mm();
        let title = "remaining error at the board, by the flange's position";
        disk::write(&file, report::error_map(title, left, limit_mm))?;
        outcome.add_line(format!("{}: the map", file.display()));
    }
    Ok(outcome)
}
