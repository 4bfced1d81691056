//! `panelprep calibrate verify` and `touch`: is the calibration still true?

use super::super::args::Common;
use super::super::disk;
use super::super::fault::Fault;
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::args::{CameraName, Touch, Verify};
use super::sight::Sight;
use super::{date, files, provenance, taught_corner};
use crate::calib::health::{self, Demands, Verification};
use crate::calib::{Board, CalibError, Seen, board_pose};
use crate::cell::{MountedPose, TargetMount};
use crate::files::read_flange;
use crate::geometry::{Base, Board as BoardFrame, Camera, Flange, FlangeCamera, KukaPose, Rigid};
use crate::report;
use crate::store::{Store, calibration_hash};
use crate::verdict::Judgement;
use crate::words::apart;
use serde_json::json;
use std::path::Path;

/// Where a picture puts the board, through the calibrations in use.
struct Looked {
    base_from_board: Rigid<Base, BoardFrame>,
    pnp_rms_px: f64,
    picture_hash: String,
    calibration_hash: String,
}

fn look(args: &Verify, files: &CellFiles, (board, window): (&Board, Option<usize>)) -> Result<Looked, Fault> {
    let (camera, mount_text) = match args.camera {
        CameraName::Scanner => (files.scanner()?, files.base_from_camera()?.text),
        CameraName::FlangeCamera => (files.flange_camera()?, files.flange_from_camera()?.text),
    };
    let sight = Sight::read(&args.image, &camera.value)?;
    let detected = sight.detect(board, window).map_err(Fault::stage)?;
    let (base_from_board, pnp_rms_px) = match args.camera {
        CameraName::Scanner => {
            let pose =
                board_pose::<Camera>(&camera.value, &Seen::Pixels(detected.corners)).map_err(Fault::stage)?;
            (files.base_from_camera()?.value * pose.camera_from_board, pose.rms)
        }
        CameraName::FlangeCamera => {
            let Some(flange) = &args.flange else {
                let message = "--flange is missing: the flange's pose at the picture";
                return Err(Fault::stage(CalibError::Points(message.to_owned())));
            };
            let pose = read_flange(&disk::read(flange)?).map_err(|error| Fault::file(flange, error))?;
            let base_from_flange: Rigid<Base, Flange> = pose.to_rigid();
            let seen = Seen::Pixels(detected.corners);
            let board = board_pose::<FlangeCamera>(&camera.value, &seen).map_err(Fault::stage)?;
            (base_from_flange * files.flange_from_camera()?.value * board.camera_from_board, board.rms)
        }
    };
    let calibration_hash = calibration_hash(&[&camera.text, &mount_text]);
    Ok(Looked { base_from_board, pnp_rms_px, picture_hash: sight.hash, calibration_hash })
}

/// Looks at the target, a board or a taught corner, and compares; with `--learn`, writes where the board is.
///
/// # Errors
/// Where a file is not what it must be, the picture shows no target, or the store does not write.
pub fn run(args: &Verify, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let (board, target_file) = match (&args.recipe, &args.board, &args.target) {
        (Some(recipe), None, None) => return taught_corner::run(args, &files, recipe),
        (None, Some(board), Some(target)) => (super::board(board)?, target),
        _ => {
            let message = "name --board, --square-mm and --target for a board, or --recipe for a taught corner";
            return Err(Fault::stage(CalibError::Points(message.to_owned())));
        }
    };
    let window = args.board.as_ref().and_then(super::window);
    let seen = look(args, &files, (&board, window))?;
    if args.learn {
        return learn(target_file, &seen);
    }
    let known = target(target_file)?;
    let error_mm = health::distance_mm(&known, &seen.base_from_board, &board.corners());
    let verification = verification(&files, subject(args.camera), error_mm, seen.calibration_hash);
    let mut outcome = kept(&files, &verification, args.pictures.as_deref())?;
    outcome.put("pnp_rms_px", json!(seen.pnp_rms_px));
    outcome.put("base_from_board", json!(KukaPose::from_rigid(&seen.base_from_board)));
    Ok(outcome)
}

fn subject(camera: CameraName) -> &'static str {
    match camera {
        CameraName::Scanner => "scanner",
        CameraName::FlangeCamera => "flange_camera",
    }
}

/// A verification of now.
pub fn verification(files: &CellFiles, subject: &str, error_mm: f64, calibration_hash: String) -> Verification {
    Verification {
        subject: subject.to_owned(),
        error_mm,
        limit_mm: files.cell.limits().verify_limit_mm(),
        calibration_hash,
        at_unix_s: date::now_unix_s(),
    }
}

fn learn(target: &Path, seen: &Looked) -> Result<Outcome, Fault> {
    let pose = KukaPose::from_rigid(&seen.base_from_board);
    let mut mounted = MountedPose::<TargetMount>::of(pose);
    mounted.date = date::today();
    mounted.provenance = provenance(vec![seen.picture_hash.clone()], vec![]);
    disk::write(target, mounted.to_toml())?;
    let mut outcome = Outcome::of(&Judgement::of(vec![], vec![]));
    outcome.put("base_from_board", json!(pose));
    outcome.put("pnp_rms_px", json!(seen.pnp_rms_px));
    outcome.say(format!("base_from_board {pose}"));
    outcome.say(format!("{}: written; leave the board where it is", target.display()));
    Ok(outcome)
}

fn target(file: &Path) -> Result<Rigid<Base, BoardFrame>, Fault> {
    let text = disk::read_text(file)?;
    Ok(MountedPose::<TargetMount>::check(&file.display().to_string(), &text)?.rigid())
}

/// Compares touched places with where the corners are known to be.
///
/// # Errors
/// Where a file is not what it must be, a corner is not on the board, or the store does not write.
pub fn touch(args: &Touch, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let board = super::board(&args.board)?;
    let known = target(&args.target)?;
    let points = files::points(&args.points.display().to_string(), &disk::read_text(&args.points)?)?;
    let mut errors_mm = Vec::with_capacity(points.touched.len());
    for touched in &points.touched {
        let (column, row) = touched.corner;
        let Some(corner) = board.corner(column, row) else {
            let message = format!("corner [{column}, {row}] is not on the board");
            return Err(Fault::file(&args.points, CalibError::Points(message)));
        };
        errors_mm.push((known * corner).distance_mm(touched.place));
    }
    let error_mm = errors_mm.iter().copied().fold(0.0, f64::max);
    let verification = verification(&files, "tool", error_mm, calibration_hash(&[&tool_text(&files)?]));
    let mut outcome = kept(&files, &verification, args.pictures.as_deref())?;
    for (touched, error_mm) in points.touched.iter().zip(&errors_mm) {
        let (column, row) = touched.corner;
        outcome.say(format!("  corner [{column}, {row}]: {error_mm:.3} mm"));
    }
    outcome.put("errors_mm", json!(errors_mm));
    Ok(outcome)
}

/// The tool's file as it is: a pointer needs no axis.
fn tool_text(files: &CellFiles) -> Result<String, Fault> {
    match &files.cell.calibration().flange_from_tool {
        Some(file) => disk::read_text(file),
        None => files.flange_from_tool().map(|tool| tool.text),
    }
}

/// Keeps a verification in the store, judges it, and draws the trend.
pub fn kept(files: &CellFiles, verification: &Verification, pictures: Option<&Path>) -> Result<Outcome, Fault> {
    let store = Store::keep_verification_in(files.store_folder(), verification).map_err(Fault::stage)?;
    let (error_mm, limit_mm) = (verification.error_mm, verification.limit_mm);
    let reject = health::beyond(verification, Demands::of(files.cell.limits()));
    let mut outcome = Outcome::of(&Judgement::of(reject.into_iter().collect(), vec![]));
    outcome.put("error_mm", json!(error_mm));
    outcome.put("limit_mm", json!(limit_mm));
    let [off, allowed] = apart(error_mm, limit_mm, 3);
    outcome.say(format!("{}: {off} mm off, allowed are {allowed} mm", verification.subject));
    if let Some(folder) = pictures {
        let all = store.verifications(&verification.subject).map_err(Fault::stage)?;
        let file = folder.join(format!("trend_{}.svg", verification.subject));
        disk::write(&file, report::trend(&verification.subject, &all))?;
        outcome.say(format!("{}: the trend", file.display()));
    }
    Ok(outcome)
}
