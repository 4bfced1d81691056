//! `panelprep calibrate verify` and `touch`: check whether the calibration is still valid.

use super::super::args::Common;
use super::super::disk;
use super::super::fault::{CalibrationFault, Fault};
use super::super::load::{CellFiles, flange_file};
use super::super::outcome::Outcome;
use super::args::{BoardArgs, CameraName, Touch, Verify};
use super::board_image::BoardImage;
use super::boards;
use super::output::provenance;
use super::over_volume;
use super::target::Target;
use super::verification::{store_and_judge, verification};
use super::{date, files, taught_corner, tips};
use panelprep_base::geometry::{Base, Camera, Flange, FlangeCamera, KukaPose, Rigid};
use panelprep_base::verdict::{Judgement, Reason};
use panelprep_cell::cell::{BoardSize, MountedPose, TargetMount};
use panelprep_service::report::{self, RemainingError};
use panelprep_store::store::calibration_hash;
use panelprep_vision::calib::health::{self, BoardMeasurement};
use panelprep_vision::calib::{Board, BoardObservation, BoardPose, CalibError, board_pose};
use serde_json::json;
use std::path::Path;

/// The measurement from a picture of the board, through the calibrations in use.
struct BoardCheck {
    measurement: BoardMeasurement,
    /// The board's pose from the 3D camera's own points, if there are any, and how much farther away than in the
    /// picture they place the board, mm.
    pose_from_points: Option<(Rigid<Base, panelprep_base::geometry::Board>, f64)>,
    /// Whether the picture was taken with points, which should also show the board.
    has_cloud: bool,
    /// The reason why no measurement is allowed at the board's position in the picture.
    outside_lens: Option<Reason>,
    picture_hash: String,
    calibration_hash: String,
}

impl BoardCheck {
    /// If the board is not found in a scan's points, the scan gives no evidence about how panels are located.
    fn discard_points(&self) -> Option<Reason> {
        let message = "too few 3D points on the board, so the scan does not verify how panels are located: light the board \
                       evenly, clean the board, or move the board nearer, then scan again";
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
    let detected = board_image.detect_telling(board, window, progress).map_err(Fault::stage)?;
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
    // For a fixed camera and a fixed board, the robot's correction has no influence.
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

/// Measures the target, a board or a taught corner, in the picture and compares it with the known pose; with
/// `--learn`, writes the board's pose.
///
/// # Errors
/// If a file is invalid, the picture shows no target, or the store cannot be written.
pub fn run(args: &Verify, common: &Common, progress: &dyn Fn(&str)) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let wrong = |message: &str| Err(Fault::stage(CalibError::Points(message.to_owned())));
    let file = match (&args.recipe, &args.target) {
        (Some(recipe), None) => return taught_corner::run(args, &files, recipe),
        (None, Some(file)) => file,
        _ => return wrong("give --target for a board, or --recipe for a taught corner"),
    };
    let window = args.board.subpix.map(|half_window_px| half_window_px as usize);
    let named = args.board.board();
    if args.learn {
        let Some(named) = &named else {
            return wrong("--learn writes the kind of board into the target file: give --board and --square-mm");
        };
        let board = boards::board(named)?;
        let seen = measure_board(args, &files, (&board, window), progress)?;
        return write_target((file, files.cell.limits().verify_limit_mm()), &board, named, &seen);
    }
    let target = Target::read(file, named.as_ref())?;
    if let Some(poses) = &args.poses {
        return over_volume::run(args, (&files, poses), &target, progress);
    }
    let seen = measure_board(args, &files, (&target.board, window), progress)?;
    let off_mm = |found| health::distance_mm(&target.base_from_board, found, &target.board.corners());
    // The panel is located with points: the points of the board must be right as well.
    let points_mm = seen.pose_from_points.as_ref().map(|(by_points, _)| off_mm(by_points));
    let by_picture_mm = off_mm(&seen.measurement.base_from_board);
    let error_mm =
        points_mm.map_or(by_picture_mm, |mm| if mm > by_picture_mm || mm.is_nan() { mm } else { by_picture_mm });
    let implausible = health::uninformative_measurement(&target.base_from_board, &seen.measurement, &target.board);
    let implausible = seen.outside_lens.clone().or(implausible).or_else(|| seen.discard_points());
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
            "by the 3D camera's points, the board is {farther_mm:+.3} mm farther away than by its picture; if this difference is large, \
             run `panelprep calibrate scanner` and measure the board's squares"
        ));
    }
    Ok(outcome)
}

/// Returns the outcome of a measurement that gives no evidence about the calibration and is not stored.
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
    let refused = refused.or_else(|| seen.discard_points());
    if let Some(reason) = refused {
        return Ok(Outcome::from_judgement(&Judgement::new(vec![reason], vec![])));
    }
    let pose = KukaPose::from_rigid(&seen.measurement.base_from_board);
    let mut mounted = MountedPose::<TargetMount>::from_pose(pose);
    mounted.board = Some(BoardSize { board: named.board.clone(), square_mm: board.square_mm() });
    mounted.date = date::today_utc();
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
    let files = CellFiles::read(common)?;
    let Target { board, base_from_board: known } = Target::read(&args.target, args.board.board().as_ref())?;
    let file = args.points.as_ref().ok_or(CalibrationFault::NoPoses)?;
    let mut points = files::points(&file.display().to_string(), &disk::read_text(file)?)?;
    let tool = files.tool_tip()?;
    tips::place_tips_by_axes(&files, &tool.value, (file, &mut points))?;
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
