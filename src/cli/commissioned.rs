//! The demo's cell with an arm that differs from its nominal geometry. It is calibrated as an engineer does it:
//! first the arm with pictures of boards and with touches, then both cameras and the tool with the corrected poses.

use super::args::{Common, Demo, real_arm};
use super::calibrate::{self, args as asked};
use super::disk;
use super::fault::Fault;
use super::render_boards;
use super::rendered::RenderedFiles;
use panelprep_base::verdict::Verdict;
use panelprep_vision::calib::CalibError;
use serde_json::json;
use std::path::{Path, PathBuf};

const CORRECTION: &str = "robot_correction.toml";
const NAMED: &str = "flange_from_tool = \"flange_from_tool.toml\"\n";

/// Renders boards, calibrates, and enters the correction in the cell's file unless `--uncorrected` is given.
///
/// # Errors
/// If a calibration is rejected.
pub fn calibrate(args: &Demo, rendered: &RenderedFiles, progress: &dyn Fn(&str)) -> Result<(), Fault> {
    progress("rendering boards for the calibration of the arm");
    let arm = real_arm(args.seed, args.arm_error_mm);
    render_boards::write(args.seed, args.reduction as usize, (arm.as_ref(), rendered))?;
    let common = rendered.common_arguments();
    let robot = (!args.uncorrected).then(|| rendered.file_path(CORRECTION));
    if let Some(out) = &robot {
        progress("calibrating the arm");
        run_calibration(asked::CalibrationTask::Robot(arm_arguments(rendered, out.clone())), &common, out)?;
    }
    // An arm that needs no correction has no correction file.
    let robot = robot.filter(|file| file.exists());
    progress("calibrating cameras and tool");
    let [scanner, flange_camera] =
        ["base_from_camera.toml", "flange_from_camera.toml"].map(|name| rendered.file_path(name));
    for (mount, folder, lens, out) in [
        (asked::MountName::EyeToHand, "fixed", "scanner.toml", scanner),
        (asked::MountName::EyeInHand, "flange", "flange_camera.toml", flange_camera),
    ] {
        let what = asked::CalibrationTask::HandEye(asked::HandEye {
            mount,
            board: board(),
            intrinsics: rendered.file_path(lens),
            image: None,
            points: None,
            poses: Some(rendered.file_path(&format!("boards/{folder}/poses.toml"))),
            robot: robot.clone(),
            images: Some(rendered.file_path(&format!("boards/{folder}"))),
            at_mm: None,
            serial: None,
            out: out.clone(),
            pictures: None,
            r#move: false,
            live: asked::LiveArgs::without_live(),
        });
        run_calibration(what, &common, &out)?;
    }
    let (poses, out) = (rendered.file_path("boards/tip.toml"), rendered.file_path("flange_from_tool.toml"));
    run_calibration(
        asked::CalibrationTask::Tcp(asked::Tcp {
            poses: Some(poses),
            live: None,
            robot: robot.clone(),
            out: Some(out.clone()),
        }),
        &common,
        &out,
    )?;
    if robot.is_some() {
        let cell = disk::read_text(&common.cell)?;
        let named = cell.replace(NAMED, &format!("{NAMED}robot_correction = \"{CORRECTION}\"\n"));
        disk::write(&common.cell, named)?;
    }
    // The poses of the boards are learned as this cell sees them: no one measures a robot's base from outside.
    for camera in [asked::CameraName::Scanner, asked::CameraName::FlangeCamera] {
        let look = asked::Verify { learn: true, ..rendered.verification(camera) };
        let target = look.target.clone().unwrap_or_default();
        run_calibration(asked::CalibrationTask::Verify(look), &common, &target)?;
    }
    Ok(())
}

fn board() -> asked::BoardArgs {
    asked::BoardArgs { board: "9x6".to_owned(), square_mm: Some(25.0), subpix: None }
}

fn arm_arguments(rendered: &RenderedFiles, out: PathBuf) -> asked::Robot {
    asked::Robot {
        board: board(),
        eye_to_hand: Some(rendered.file_path("boards/fixed/poses.toml")),
        scanner_lens: Some(rendered.file_path("scanner.toml")),
        eye_in_hand: Some(rendered.file_path("boards/flange/poses.toml")),
        flange_camera_lens: Some(rendered.file_path("flange_camera.toml")),
        touches: Some(rendered.file_path("boards/touches.toml")),
        out,
    }
}

/// Runs a calibration; a calibration that is rejected ends the demo.
fn run_calibration(what: asked::CalibrationTask, common: &Common, out: &Path) -> Result<(), Fault> {
    let outcome = calibrate::run(&asked::Calibrate { what }, common, &|_| {})?;
    if outcome.json.get("verdict") == Some(&json!(Verdict::Reject)) {
        let message = format!("{} is refused: {}", out.display(), outcome.lines.join("; "));
        return Err(Fault::stage(CalibError::Points(message)));
    }
    Ok(())
}
