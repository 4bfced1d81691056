//! `panelprep calibrate verify` and `touch`: verify whether a calibration is still valid.
//!
//! With `--poses`, the remaining error over the working volume is measured: the flange camera captures one fixed board
//! from many poses, and each picture gives the pose of the board through arm, mount and lens. The remaining error at a
//! pose is the distance of the board's farthest corner from its known position.
//!
//! With `--recipe`, the target of the flange camera is a taught corner at its nominal position. The corner in the
//! picture is compared with its expected position, in mm perpendicular to the viewing direction. This verifies mount,
//! lens and arm together, but no error along the viewing direction.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::{CalibrationFault, Fault};
use super::super::load::{self, flange_file};
use super::super::output::Outcome;
use super::args::{BoardArgs, CameraName, Touch, Verify};
use super::arm_correction::{self, CorrectionInUse};
use super::boards::{self, BoardImage, Target};
use super::files;
use super::output::{self, provenance, store_and_judge, verification};
use panelprep_base::geometry::statistics::rms;
use panelprep_base::geometry::{Base, Camera, Flange, FlangeCamera, KukaPose, Rigid};
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::{BoardSize, MountedPose, TargetMount};
use panelprep_service::report::{self, RemainingError};
use panelprep_service::setup::{self, CellFiles};
use panelprep_store::store::calibration_hash;
use panelprep_vision::calib::health::{self, BoardMeasurement};
use panelprep_vision::calib::{Board, BoardObservation, BoardPose, CalibError, board_pose};
use panelprep_vision::locate::corner::find_taught;
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;

/// The pose of a board, measured in a picture with the calibrations in use.
struct BoardCheck {
    measurement: BoardMeasurement,
    /// The pose of the board from the 3D camera's own points, if there are any, and by how much this board is farther
    /// away than the one in the picture, mm.
    pose_from_points: Option<(Rigid<Base, panelprep_base::geometry::Board>, f64)>,
    /// Whether the file contains points, in which the board should also be found.
    has_cloud: bool,
    /// The reason if the board is in a part of the picture in which the lens is not calibrated.
    outside_lens: Option<Reason>,
    picture_hash: String,
    calibration_hash: String,
}

impl BoardCheck {
    /// Returns a reason if the board is not found in the points of a scan: then the scan does not verify how panels are
    /// located.
    fn no_points_reason(&self) -> Option<Reason> {
        let message = "too few 3D points on the board, so the scan does not verify how panels are located: light the \
                       board uniformly, clean the board, or move the board nearer, then scan again";
        (self.has_cloud && self.pose_from_points.is_none()).then(|| Reason::new("no_points", message))
    }
}

fn measure_board(
    args: &Verify,
    files: &CellFiles,
    (board, window): (&Board, Option<usize>),
    progress: &dyn Fn(&str),
) -> Result<BoardCheck, Fault> {
    let (camera, mount_text) = match args.camera {
        CameraName::Scanner => (files.scanner()?, files.base_from_camera()?.text),
        CameraName::FlangeCamera => (files.flange_camera()?, files.flange_from_camera()?.text),
    };
    let base_from_flange = match (args.camera, &args.flange) {
        (CameraName::Scanner, _) => None,
        (CameraName::FlangeCamera, Some(file)) => Some(flange_file(files, file)?.to_rigid::<Base, Flange>()),
        (CameraName::FlangeCamera, None) => {
            let message = "--flange is missing: give the flange's pose at the picture";
            return Err(Fault::stage(CalibError::Points(message.to_owned())));
        }
    };
    let Some(image) = &args.image else {
        return Err(Fault::stage(CalibError::Points(
            "--image is missing: give the picture of the board".to_owned(),
        )));
    };
    let board_image = BoardImage::read(image, &camera.value)?;
    let detected = board_image.detect_and_report(board, window, progress).map_err(Fault::stage)?;
    let measured = board_image.measured((&camera.value, &camera.scan_errors), &detected);
    let measured_square_mm = measured.as_ref().and_then(|seen| seen.square_mm(board));
    let seen = detected.corners;
    let outside = health::lens_extent_refusal(&camera.extent, seen.iter().map(|(_, pixel)| *pixel));
    let (mut by_points, has_cloud) = (None, board_image.cloud().is_some());
    let (base_from_board, pnp_rms_px) = match base_from_flange {
        None => {
            let pose =
                board_pose::<Camera>(&camera.value, &BoardObservation::Pixels(seen)).map_err(Fault::stage)?;
            if let Some(points) = measured.and_then(|points| board_pose(&camera.value, &points).ok()) {
                let away_mm = |pose: &BoardPose<Camera>| (pose.camera_from_board * board.centre()).mm.coords.norm();
                let base_from_board = files.base_from_camera()?.value * points.camera_from_board;
                by_points = Some((base_from_board, away_mm(&points) - away_mm(&pose)));
            }
            (files.base_from_camera()?.value * pose.camera_from_board, pose.rms)
        }
        Some(base_from_flange) => {
            let pose =
                board_pose::<FlangeCamera>(&camera.value, &BoardObservation::Pixels(seen)).map_err(Fault::stage)?;
            (base_from_flange * files.flange_from_camera()?.value * pose.camera_from_board, pose.rms)
        }
    };
    let texts = [camera.text.as_str(), mount_text.as_str()];
    // The robot correction has no influence on a fixed camera with a fixed board.
    let calibration_hash = match args.camera {
        CameraName::Scanner => calibration_hash(&texts),
        CameraName::FlangeCamera => files.hash_with_arm(&texts),
    };
    let look = BoardMeasurement { base_from_board, pnp_rms_px, measured_square_mm };
    Ok(BoardCheck {
        measurement: look,
        pose_from_points: by_points,
        has_cloud,
        outside_lens: outside,
        picture_hash: board_image.hash,
        calibration_hash,
    })
}

/// Measures the target (a board or a taught corner) in the picture, and compares it with its known pose. With
/// `--learn`, writes the pose of the board to the target file.
///
/// # Errors
/// If a file is invalid, the picture shows no target, or the store cannot be written.
pub fn run(args: &Verify, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let wrong = |message: &str| Err(Fault::stage(CalibError::Points(message.to_owned())));
    let file = match (&args.recipe, &args.target) {
        (Some(recipe), None) => return run_on_taught_corner(args, &files, recipe),
        (None, Some(file)) => file,
        _ => return wrong("give --target for a board, or --recipe for a taught corner"),
    };
    let window = args.board.subpix.map(|half_window_px| half_window_px as usize);
    let named = args.board.board();
    if args.learn {
        let Some(named) = &named else {
            return wrong("--learn writes the kind of board into the target file: give --board and --square-mm");
        };
        let board = boards::parse_board(named)?;
        let seen = measure_board(args, &files, (&board, window), progress)?;
        return write_target((file, files.cell.limits().verify_limit_mm()), &board, named, &seen);
    }
    let target = Target::read(file, named.as_ref())?;
    if let Some(poses) = &args.poses {
        return run_over_volume(args, (&files, poses), &target, progress);
    }
    let seen = measure_board(args, &files, (&target.board, window), progress)?;
    let off_mm = |found| health::distance_mm(&target.base_from_board, found, &target.board.corners());
    // Panels are located with the points, so the points of the board must be verified as well.
    let points_mm = seen.pose_from_points.as_ref().map(|(by_points, _)| off_mm(by_points));
    let by_picture_mm = off_mm(&seen.measurement.base_from_board);
    let error_mm =
        points_mm.map_or(by_picture_mm, |mm| if mm > by_picture_mm || mm.is_nan() { mm } else { by_picture_mm });
    let implausible = health::uninformative_measurement(&target.base_from_board, &seen.measurement, &target.board);
    let implausible = seen.outside_lens.clone().or(implausible).or_else(|| seen.no_points_reason());
    let mut outcome = match implausible {
        Some(reason) => refused(reason, error_mm, files.cell.limits().verify_limit_mm()),
        None => {
            let verification = verification(&files, subject(args.camera), error_mm, seen.calibration_hash);
            store_and_judge(&files, &verification, args.pictures.as_deref())?
        }
    };
    outcome.add_value("pnp_rms_px", json!(seen.measurement.pnp_rms_px));
    outcome.add_value("base_from_board", json!(KukaPose::from_rigid(&seen.measurement.base_from_board)));
    if let Some((_, farther_mm)) = seen.pose_from_points {
        outcome.add_value("points_error_mm", json!(points_mm));
        outcome.add_value("points_farther_mm", json!(farther_mm));
        outcome.add_line(format!(
            "by the 3D camera's points, the board is {farther_mm:+.3} mm farther away than by its picture; if this \
             difference is large, run `panelprep calibrate scanner` and measure the board's squares"
        ));
    }
    Ok(outcome)
}

/// Returns the outcome of a measurement that does not verify the calibration; it is not stored.
fn refused(reason: Reason, error_mm: f64, limit_mm: f64) -> Outcome {
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![reason], vec![]));
    outcome.add_value("error_mm", json!(error_mm));
    outcome.add_value("limit_mm", json!(limit_mm));
    outcome
}

fn subject(camera: CameraName) -> &'static str {
    match camera {
        CameraName::Scanner => "scanner",
        CameraName::FlangeCamera => "flange_camera",
    }
}

fn write_target(
    (target, limit_mm): (&Path, f64),
    board: &Board,
    named: &BoardArgs,
    seen: &BoardCheck,
) -> Result<Outcome, Fault> {
    let apart =
        seen.pose_from_points.as_ref().and_then(|(_, farther_mm)| health::depth_differs(*farther_mm, limit_mm));
    let refused = seen.outside_lens.clone().or_else(|| health::board_mismatch(&seen.measurement, board)).or(apart);
    let refused = refused.or_else(|| seen.no_points_reason());
    if let Some(reason) = refused {
        return Ok(Outcome::from_judgement(&Judgement::new(vec![reason], vec![])));
    }
    let pose = KukaPose::from_rigid(&seen.measurement.base_from_board);
    let mut mounted = MountedPose::<TargetMount>::from_pose(pose);
    mounted.board = Some(BoardSize { board: named.board.clone(), square_mm: board.square_mm() });
    mounted.date = output::today_utc();
    mounted.provenance = provenance(vec![seen.picture_hash.clone()], vec![]);
    disk::write_durable(target, mounted.to_toml())?;
    let mut outcome = Outcome::from_judgement(&Judgement::new(vec![], vec![]));
    outcome.add_value("base_from_board", json!(pose));
    outcome.add_value("pnp_rms_px", json!(seen.measurement.pnp_rms_px));
    outcome.add_line(format!("base_from_board {pose}"));
    outcome.add_line(format!("{}: written; do not move the board", target.display()));
    Ok(outcome)
}

/// Compares touched positions with the known positions of the corners.
///
/// # Errors
/// If a file is invalid, a corner is not on the board, or the store cannot be written.
pub fn touch(args: &Touch, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let Target { board, base_from_board: known } = Target::read(&args.target, args.board.board().as_ref())?;
    let file = args.points.as_ref().ok_or(CalibrationFault::NoPoses)?;
    let mut points = files::points(&file.display().to_string(), &disk::read_text(file)?)?;
    let tool = files.tool_tip()?;
    arm_correction::place_tips_by_axes(&files, &tool.value, (file, &mut points))?;
    let mut errors_mm = Vec::with_capacity(points.touched.len());
    let mut corners = Vec::with_capacity(points.touched.len());
    for touched in &points.touched {
        let (column, row) = touched.corner;
        let Some(corner) = board.corner(column, row) else {
            let message = format!("corner [{column}, {row}] is not on the board");
            return Err(Fault::file_fault(file, CalibError::Points(message)));
        };
        errors_mm.push((known * corner).distance_mm(touched.place));
        corners.push((corner, touched.place));
    }
    let error_mm = errors_mm.iter().copied().fold(0.0, f64::max);
    let verification = verification(&files, "tool", error_mm, files.hash_with_arm(&[&tool.text]));
    let mut outcome = store_and_judge(&files, &verification, args.pictures.as_deref())?;
    if let Some(folder) = &args.pictures {
        let left = points.touched.iter().zip(&errors_mm).map(|(touched, error_mm)| RemainingError {
            name: format!("corner [{}, {}]", touched.corner.0, touched.corner.1),
            place: touched.place,
            error_mm: *error_mm,
        });
        let file = folder.join("map_tool.svg");
        let limit_mm = files.cell.limits().verify_limit_mm();
        disk::write(&file, report::error_map("touches of known corners", &left.collect::<Vec<_>>(), limit_mm))?;
        outcome.add_line(format!("{}: map of the remaining error at each corner", file.display()));
    }
    for (touched, error_mm) in points.touched.iter().zip(&errors_mm) {
        let (column, row) = touched.corner;
        outcome.add_line(format!("  corner [{column}, {row}]: {error_mm:.3} mm"));
    }
    outcome.add_value("errors_mm", json!(errors_mm));
    if let Some(square_mm) = health::square_size_from_touches(&board, &corners) {
        outcome.add_value("square_mm", json!(square_mm));
        outcome.add_line(format!(
            "  side of the board's squares by the touches: {square_mm:.2} mm, stated {} mm; if the values differ, measure the board \
             before you correct the tool",
            board.square_mm()
        ));
    }
    Ok(outcome)
}

/// Minimum number of pictures for a measurement over the volume.
const MIN_PICTURES: usize = 3;

/// Evaluates all pictures, and stores the largest error as a verification.
///
/// # Errors
/// If a file is invalid, too few pictures show the board, or the store cannot be written.
fn run_over_volume(
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
    let rms_mm = rms(left.iter().map(|one| one.error_mm));
    let verification = output::verification(files, "flange_camera", worst_mm, calibration_hash);
    let mut outcome = output::store_and_judge(files, &verification, args.pictures.as_deref())?;
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

/// Measures the first taught corner in the picture, and compares it with its expected position.
///
/// # Errors
/// If a file is invalid, no corner was taught, the picture shows no corner, or the store cannot be written.
fn run_on_taught_corner(args: &Verify, files: &CellFiles, recipe_file: &Path) -> Result<Outcome, Fault> {
    let wrong = |message: &str| Fault::stage(CalibError::Points(message.to_owned()));
    if args.camera != CameraName::FlangeCamera {
        return Err(wrong(
            "--recipe verifies the flange camera by a taught corner; verify the scanner with a board",
        ));
    }
    let Some(flange) = &args.flange else {
        return Err(wrong("--flange is missing: give the flange's pose at the picture"));
    };
    let recipe = load::read_recipe(recipe_file)?;
    let taught = setup::taught(files, recipe_file, &recipe)?;
    let (camera, mount) = (files.flange_camera()?, files.flange_from_camera()?);
    let Some(image) = &args.image else { return Err(wrong("--image is missing: give the picture of the corner")) };
    let (image, flange) = (std::slice::from_ref(image), std::slice::from_ref(flange));
    let shots = load::corner_shots(files, image, flange, &camera.value)?;
    let (Some(shot), Some(corner)) = (shots.first(), taught.corners.first()) else {
        return Err(wrong("no corner of this panel was taught; teach a corner with --corner and --flange"));
    };
    let base_from_flange: Rigid<Base, Flange> = shot.base_from_flange.to_rigid();
    let panel_from_camera = taught.panel.nominal_pose.inverse() * base_from_flange * mount.value;
    let in_camera = panel_from_camera.inverse() * corner.point;
    let Some(expected) = camera.value.project(in_camera) else {
        return Err(wrong(
            "the taught corner lies behind the camera; name the flange's pose at this picture with --flange",
        ));
    };
    let found = find_taught(&shot.picture.to_gray(), (recipe.corner(), 0), &camera.value, in_camera);
    let found = found.map_err(Fault::stage)?.corner_px;
    if let Some(reason) = health::lens_extent_refusal(&camera.extent, [found]) {
        return Ok(Outcome::from_judgement(&Judgement::new(vec![reason], vec![])));
    }
    let (px_per_mm, _) = camera.value.px_per_mm_at(in_camera.mm.z);
    let error_px = found.distance_px(expected);
    let hash = files.hash_with_arm(&[&camera.text, &mount.text]);
    let verification = output::verification(files, "flange_camera", error_px / px_per_mm, hash);
    let mut outcome = output::store_and_judge(files, &verification, args.pictures.as_deref())?;
    outcome.add_value("error_px", json!(error_px));
    Ok(outcome)
}
