//! `panelprep calibrate … --live`: calibrations that capture their own pictures. For each picture the command reports
//! whether it shows the board, the result from all pictures so far, and which picture to capture next. At the end it
//! calibrates with these pictures, as the same command does with files.
//!
//! The pictures stay in the folder of `--live`, and the poses in its `poses.toml`; an interrupted session can be
//! continued. For the mount of the 3D camera, 3D scans are captured, because its mount is computed from its own points.
//! A person moves the board or the arm and presses Enter; with `--count` the person has a few seconds for each pose.
//! With `--move` the arm moves automatically, with the checks of `panelprep robot move-j`.

mod moving;
mod session;
mod touching;

pub use touching::{take_target_picture, tool, touch};

use super::super::args::Common;
use super::super::fault::{CalibrationFault, Fault};
use super::super::flange_pose::FlangePoses;
use super::super::output::Outcome;
use super::args::{CameraName, HandEye, Intrinsics, MountName};
use super::{arm_correction, boards, hand_eye, intrinsics};
use panelprep_devices::cameras::BoardView;
use panelprep_service::setup::{CellFiles, cameras};
use panelprep_vision::calib::CalibError;
use panelprep_vision::calib::hand_eye::MIN_STATIONS;
use session::{CalibrationCamera, OperatorChoice, Session, report_lens, report_mount};
use std::path::PathBuf;

/// Maximum number of pictures in one session, which is sufficient for any lens.
const MAX_PICTURES: usize = 60;

/// Calibrates the lens with newly captured pictures.
///
/// # Errors
/// If the camera delivers no picture, or writing to the disk fails; also the errors of the calibration from files.
pub fn lens(args: &Intrinsics, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let (Some(folder), Some(camera)) = (&args.live.live, args.camera) else {
        return Err(CalibrationFault::NoLiveCamera.into());
    };
    let cell = CellFiles::read(&common.paths())?;
    let named = boards::board_from_option(&args.board)?;
    let board = boards::parse_board(&named)?;
    let view = match camera {
        CameraName::Scanner => BoardView::HandHeldForFixed,
        CameraName::FlangeCamera => BoardView::HandHeldForFlange,
    };
    // Only the picture size is used from the old calibration, because the lens is being calibrated again.
    let known = match camera {
        CameraName::Scanner => cameras::lens(cell.scanner())?,
        CameraName::FlangeCamera => cameras::lens(cell.flange_camera())?,
    };
    let mut view = CalibrationCamera::open(&cell, (view, &board), (&args.live, known), progress)?;
    let mut session = Session::new((folder, &args.live), (&board, boards::window(&named)), None)?;
    let on_files = |images: Vec<PathBuf>, out: PathBuf| Intrinsics { images, out, pictures: None, ..args.clone() };
    while session.picture_count() < MAX_PICTURES && session.ask_for_picture()? == OperatorChoice::Take {
        let (taken, _) = view.capture()?;
        if session.store_picture(&taken, None)?
            && session.board_picture_count() >= panelprep_vision::calib::intrinsics::MIN_VIEWS
        {
            let so_far = on_files(session.pictures(), folder.join("so_far.toml"));
            report_lens(&intrinsics::run(&so_far, &|_| ())?);
        }
    }
    let whole = Intrinsics { pictures: args.pictures.clone(), ..on_files(session.pictures(), args.out.clone()) };
    intrinsics::run(&whole, progress)
}

/// Calibrates the mount of a camera with newly captured pictures and poses.
///
/// # Errors
/// The errors of [`lens`], and if the robot does not execute a motion.
pub fn mount(args: &HandEye, common: &Common, progress: &(dyn Fn(&str) + Sync)) -> Result<Outcome, Fault> {
    let Some(folder) = &args.live.live else { return Err(CalibrationFault::NoLiveCamera.into()) };
    let cell = CellFiles::read(&common.paths())?;
    let board = boards::parse_board(&args.board)?;
    let camera = arm_correction::read_intrinsics(&args.intrinsics)?.camera;
    let kind = match args.mount {
        MountName::EyeToHand => BoardView::Fixed,
        MountName::EyeInHand => BoardView::Flange,
    };
    let mut session = Session::new((folder, &args.live), (&board, boards::window(&args.board)), Some(camera))?;
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
        let mut view = CalibrationCamera::open(&cell, (kind, &board), (&args.live, Some(camera)), progress)?;
        let poses = FlangePoses::new(&cell);
        while session.picture_count() < MAX_PICTURES && session.ask_for_picture()? == OperatorChoice::Take {
            let before = poses.now();
            let (taken, from_camera) = view.capture()?;
            let Some(flange) = poses.combine_or_ask(before, from_camera)? else { continue };
            if session.store_picture(&taken, Some(&flange))? && session.board_picture_count() >= MIN_STATIONS {
                report_mount(&so_far()?);
            }
        }
    }
    if session.board_picture_count() < MIN_STATIONS {
        let (found, given) = (session.board_picture_count(), session.picture_count());
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
