//! `panelprep calibrate … --live`: takes the pictures itself, says of each whether it shows the board, what they all give so far,
//! and which one to take next. At the end it calibrates by them as the same command does on files.
//!
//! Pictures stay in the folder of `--live`, poses in its `poses.toml`; a session that was broken off goes on where it ended. A
//! person moves the board or the arm and presses Enter, or with `--count` has some seconds for it; with `--move` the arm moves by itself, through the gates of
//! `panelprep robot move-j`.
//!
//! - `looking`: one picture of the target of a verification · `touching`: poses in which the tip touches something

mod looking;
mod moving;
mod session;
mod touching;
mod view;

pub use looking::look;
pub use touching::{tool, touch};

use super::super::args::Common;
use super::super::fault::Fault;
use super::super::flange_pose::FlangePoses;
use super::super::load::CellFiles;
use super::super::outcome::Outcome;
use super::super::output::tell_line as tell;
use super::super::shoot::opening;
use super::args::{CameraName, HandEye, Intrinsics, MountName};
use super::{hand_eye, intrinsics};
use crate::calib::CalibError;
use crate::calib::hand_eye::MIN_STATIONS;
use crate::devices::cameras::BoardView;
use crate::geometry::KukaPose;
use crate::verdict::Verdict;
use session::{Asked, Session};
use std::path::PathBuf;
use view::View;

/// So many pictures are enough for anybody.
const MOST: usize = 60;

/// The lens, by pictures that are taken now.
///
/// # Errors
/// Where the camera does not deliver or the disk refuses; else as the command on files.
pub fn lens(args: &Intrinsics, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let (Some(folder), Some(camera)) = (&args.live.live, args.camera) else { return Err(Fault::NoLiveCamera) };
    let cell = CellFiles::read(common)?;
    let board = super::board(&args.board)?;
    let view = match camera {
        CameraName::Scanner => BoardView::FixedByHand,
        CameraName::FlangeCamera => BoardView::FlangeByHand,
    };
    // A lens that is calibrated anew: only the size of its pictures is taken from the old one.
    let known = match camera {
        CameraName::Scanner => opening::lens(cell.scanner())?,
        CameraName::FlangeCamera => opening::lens(cell.flange_camera())?,
    };
    let mut view = View::open(&cell, (view, &board), (&args.live, known), progress)?;
    let mut session = Session::new((folder, &args.live), &board, super::window(&args.board))?;
    let on_files = |images: Vec<PathBuf>, out: PathBuf| Intrinsics { images, out, pictures: None, ..args.clone() };
    while session.taken() < MOST && session.ask()? == Asked::Take {
        let (picture, _) = view.take()?;
        if session.keep(&picture, None)? && session.found() >= crate::calib::intrinsics::MIN_VIEWS {
            let so_far = on_files(session.pictures(), folder.join("so_far.toml"));
            say_lens(&intrinsics::run(&so_far, &|_| ())?);
        }
    }
    let whole = Intrinsics { pictures: args.pictures.clone(), ..on_files(session.pictures(), args.out.clone()) };
    intrinsics::run(&whole, progress)
}

fn say_lens(outcome: &Outcome) {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    if let (Some(rms_px), Some(coverage)) = (number("rms_px"), number("coverage")) {
        tell(&format!(
            "so far: {verdict}, {rms_px:.3} px rms, corners cover {:.0} % of the picture",
            100.0 * coverage
        ));
    }
    say_reasons(outcome);
    match outcome.json.get("next_picture").and_then(serde_json::Value::as_str) {
        Some(next) => tell(&format!("next: {next}")),
        None => tell("enough: no further picture makes the lens's error smaller by 2 % or more"),
    }
}

fn say_reasons(outcome: &Outcome) {
    let reasons = outcome.json.get("reasons").and_then(serde_json::Value::as_array);
    for reason in reasons.into_iter().flatten().filter_map(|reason| reason["message"].as_str()) {
        tell(&format!("  {reason}"));
    }
}

/// A camera's mount, by pictures and poses that are taken now.
///
/// # Errors
/// As [`lens`], and where the robot does not do what it must.
pub fn mount(args: &HandEye, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let Some(folder) = &args.live.live else { return Err(Fault::NoLiveCamera) };
    let cell = CellFiles::read(common)?;
    let board = super::board(&args.board)?;
    let camera = hand_eye::intrinsics(&args.intrinsics)?.camera;
    let kind = match args.mount {
        MountName::EyeToHand => BoardView::Fixed,
        MountName::EyeInHand => BoardView::Flange,
    };
    let mut session = Session::new((folder, &args.live), &board, super::window(&args.board))?;
    let so_far = || {
        let on_files = HandEye {
            poses: Some(folder.join(session::POSES)),
            images: Some(folder.clone()),
            out: folder.join("so_far.toml"),
            ..args.clone()
        };
        hand_eye::run(&on_files, common, &|_| ())
    };
    if args.r#move {
        moving::run((args, &cell, kind), (&board, camera), &mut session, (&so_far, progress))?;
    } else {
        let mut view = View::open(&cell, (kind, &board), (&args.live, Some(camera)), progress)?;
        let poses = FlangePoses::of(&cell);
        while session.taken() < MOST && session.ask()? == Asked::Take {
            let before = poses.now();
            let (picture, from_camera) = view.take()?;
            let Some(flange) = poses.known_or_asked(before, from_camera)? else { continue };
            if session.keep(&picture, Some(&flange))? && session.found() >= MIN_STATIONS {
                say_mount(&so_far()?);
            }
        }
    }
    if session.found() < MIN_STATIONS {
        let (found, given) = (session.found(), session.taken());
        return Err(Fault::stage(CalibError::TooFewPictures {
            found,
            given,
            needed: MIN_STATIONS,
            first_reason: None,
        }));
    }
    let whole = HandEye { poses: Some(folder.join(session::POSES)), images: Some(folder.clone()), ..args.clone() };
    hand_eye::run(&whole, common, progress)
}

/// Whether another pose is worth taking.
fn say_mount(outcome: &Outcome) -> bool {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    let Some(uncertainty_mm) = number("uncertainty_mm") else {
        say_reasons(outcome);
        return true;
    };
    tell(&format!("so far: {verdict}, ± {uncertainty_mm:.3} mm at the panel (95 %)"));
    say_reasons(outcome);
    let (Some(pose), Some(next_mm)) = (next_pose(outcome), number("next_uncertainty_mm")) else {
        tell("enough: no further pose makes the mount's error smaller");
        return verdict != Verdict::Accept.word();
    };
    let is_worth = next_mm < WORTH * uncertainty_mm && uncertainty_mm > WELL_KNOWN_MM;
    let worth = if is_worth { "next" } else { "enough; the pose that would help most" };
    tell(&format!("{worth}: flange {pose}, for ± {next_mm:.3} mm"));
    is_worth || verdict != Verdict::Accept.word()
}

/// The pose that would help most.
fn next_pose(outcome: &Outcome) -> Option<KukaPose> {
    outcome.json.get("next_pose").and_then(|pose| serde_json::from_value(pose.clone()).ok())
}

/// A pose that leaves more of the error is not worth taking.
const WORTH: f64 = 0.95;
/// Nor is one worth taking below this: the arm comes back to a pose only to about 0.03 mm (data sheet of the KR 6 R700).
const WELL_KNOWN_MM: f64 = 0.02;
