//! `panelprep calibrate tcp`, `touch` and `verify` with `--live`: poses in which the tool's tip touches a point, and a
//! newly captured picture of the target.
//!
//! For `tcp` and `touch`, the pose is read from the controller each time Enter is pressed. If no controller responds, a
//! person reads it from the pendant. The command causes no motion. For `verify` in a simulated cell, a simulated person
//! has placed the target.

use super::super::args::{CameraName, Tcp, Touch, Verify};
use super::super::boards::Target;
use super::super::{pose_keys, tool as tools, verify};
use crate::cli::args::{Common, Shot};
use crate::cli::fault::{CalibrationFault, Fault};
use crate::cli::flange_pose::FlangePoses;
use crate::cli::output::{Outcome, read_answer_line, write_progress as tell};
use crate::cli::shoot::{find_free_names, opening};
use crate::cli::{disk, live};
use opening::RequestedShot;
use panelprep_base::geometry::{Base, ColorPicture, Flange, KukaPose, Point};
use panelprep_base::number_text::fixed_decimals;
use panelprep_cell::files::{self, ReportedFlange};
use panelprep_service::setup::CellFiles;
use std::path::{Path, PathBuf};

/// Minimum number of poses for the first computation of the TCP.
const MIN_FIRST_POSES: usize = 4;

/// The operator's answer to the question for a pose.
enum PoseAnswer {
    Here(ReportedFlange),
    Axis,
    Done,
}

/// Reads the operator's input: `axis` (if permitted), `done`, or only Enter for a pose.
fn read_pose_answer(poses: &FlangePoses<'_>, may_be_axis: bool) -> Result<PoseAnswer, Fault> {
    loop {
        match read_answer_line()?.as_deref() {
            None | Some("done") => return Ok(PoseAnswer::Done),
            Some("axis") if may_be_axis => return Ok(PoseAnswer::Axis),
            Some("") => {}
            Some(other) => {
                tell(&format!("\"{other}\" is not a valid answer: press Enter alone, or type done"));
                continue;
            }
        }
        let before = poses.now();
        if let Some(flange) = poses.combine_or_ask(before, None)? {
            return Ok(PoseAnswer::Here(flange));
        }
        tell("Press Enter again when the arm is at rest; type done when there are enough poses.");
    }
}

/// Calibrates the tool with poses that are read from the controller now.
///
/// # Errors
/// If writing to the disk fails, or the flange pose is not known; also the errors of the calibration from files.
pub fn tool((args, folder): (&Tcp, &Path), common: &Common) -> Result<Outcome, Fault> {
    let cell = CellFiles::read(&common.paths())?;
    let file = folder.join("poses.toml");
    let mut text = if file.is_file() { disk::read_text(&file)? } else { String::new() };
    let poses = FlangePoses::new(&cell);
    let on_file = |out| Tcp { poses: Some(file.clone()), live: None, out, ..args.clone() };
    let mut table = "poses";
    if !text.is_empty() {
        let (tips, marks) = (text.matches("[[poses]]").count(), text.matches("[[axis]]").count());
        tell(&format!(
            "{}: {tips} poses of the tip and {marks} of the axis already exist and are used; name another folder \
             for another tool",
            file.display()
        ));
    }
    tell(
        "Hold the tip at the same point, each time in another orientation: six or more orientations that differ by 30° \
         or more.",
    );
    loop {
        let number = text.matches(&format!("[[{table}]]")).count() + 1;
        tell(&match table {
            "poses" => format!(
                "Press Enter for pose {number} of the tip; type axis to continue with the tool's axis, or done to end."
            ),
            _ => format!(
                "Hold a mark on the tool's axis, behind the tip, at the same point. Press Enter for pose {number} of \
                 the mark; type done to end."
            ),
        });
        match read_pose_answer(&poses, table == "poses")? {
            PoseAnswer::Done => break,
            PoseAnswer::Axis => table = "axis",
            PoseAnswer::Here(flange) => {
                text += &format!("[[{table}]]\n{}\n", pose_keys(&flange));
                disk::write_durable(&file, &text)?;
                if table == "poses" && number >= MIN_FIRST_POSES {
                    report_tip(tools::run_tcp(&on_file(None), common));
                }
            }
        }
    }
    if text.is_empty() {
        return Err(CalibrationFault::NoPoses.into());
    }
    tools::run_tcp(&on_file(args.out.clone()), common)
}

/// Reports how well the poses so far determine the TCP. If they do not determine it yet, the poses are kept.
fn report_tip(found: Result<Outcome, Fault>) {
    match found {
        Ok(outcome) => {
            let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
            if let (Some(rms_mm), Some(uncertainty_mm)) = (number("rms_mm"), number("uncertainty_mm")) {
                tell(&format!("so far: residuals {rms_mm:.3} mm rms, tip ± {uncertainty_mm:.3} mm (95 %)"));
            }
        }
        Err(fault) => tell(&format!("so far the tip cannot be computed: {fault}")),
    }
}

/// Measures the error at the tool, with touches of the board's corners that are read from the controller now.
///
/// # Errors
/// The errors of [`tool`].
pub fn touch((args, folder): (&Touch, &Path), common: &Common) -> Result<Outcome, Fault> {
    let cell = CellFiles::read(&common.paths())?;
    let Target { board, base_from_board } = Target::read(&args.target, args.board.board().as_ref())?;
    let flange_from_tool = cell.tool_tip()?.value;
    let poses = FlangePoses::new(&cell);
    let mut text = String::new();
    for (index, (column, row)) in board.outer_corners().into_iter().enumerate() {
        let Some(corner) = board.corner(column, row) else { continue };
        let place = (base_from_board * corner).mm;
        let [x, y, z] = [place.x, place.y, place.z].map(|mm| fixed_decimals(mm, 0));
        tell(&format!(
            "Touch the board's inner corner [{column}, {row}] with the tip, at about X {x}, Y {y}, Z {z} mm in the robot's base, and press Enter."
        ));
        let PoseAnswer::Here(flange) = read_pose_answer(&poses, false)? else { break };
        let tip =
            (flange.base_from_flange.to_rigid::<Base, Flange>() * flange_from_tool * Point::at(0.0, 0.0, 0.0)).mm;
        let number = index + 1;
        text += &format!(
            "p{number}_mm = [{:.3}, {:.3}, {:.3}]\np{number}_corner = [{column}, {row}]\n",
            tip.x, tip.y, tip.z
        );
        if let Some(joints) = flange.joints {
            text += &format!("p{number}_axes_deg = {:?}\n", joints.degrees());
        }
    }
    if text.is_empty() {
        return Err(CalibrationFault::NoPoses.into());
    }
    let file = folder.join("touched.toml");
    disk::write_durable(&file, &text)?;
    verify::touch(&Touch { points: Some(file), live: None, ..args.clone() }, common)
}

/// Captures the picture of the target; afterwards the verification is the same as with a file.
///
/// # Errors
/// If the camera delivers no picture, the flange pose is not known, or writing to the disk fails.
pub fn take_target_picture(
    (args, folder): (&Verify, &Path),
    common: &Common,
    progress: &dyn Fn(&str),
) -> Result<Outcome, Fault> {
    let cell = CellFiles::read(&common.paths())?;
    let (image, flange) = match args.camera {
        CameraName::Scanner => (scanner(args, (&cell, folder), progress)?, None),
        CameraName::FlangeCamera => {
            let (image, flange) = flange_camera(args, (&cell, folder), progress)?;
            (image, Some(flange))
        }
    };
    tell(&format!("{}: the picture for the verification", image.display()));
    verify::run(&Verify { image: Some(image), flange, live: None, ..args.clone() }, common, progress)
}

/// Captures a 3D scan, from which the size of the squares is also measured; a simulated scanner delivers its picture of
/// the target.
fn scanner(args: &Verify, (cell, folder): (&CellFiles, &Path), progress: &dyn Fn(&str)) -> Result<PathBuf, Fault> {
    if cell.cell.scanner().is_simulated() {
        let file = find_free_names(folder, "verify_scanner", &["png"]).remove(0);
        let world = live::simulated_cell(&cell.scanner()?.value, args.simulation)?;
        let picture = files::write_gray_png(&world.scanner_target().picture).map_err(Fault::stage)?;
        disk::write(&file, picture)?;
        return Ok(file);
    }
    let file = find_free_names(folder, "verify_scanner", &["pcd"]).remove(0);
    let wanted = RequestedShot { shot: Shot::Scan, simulation: args.simulation };
    let mut opened = opening::scanner(cell, &wanted, progress)?;
    let shot = opened.camera.capture_3d().map_err(Fault::stage)?;
    disk::write(&file, files::write_pcd(&shot.cloud))?;
    Ok(file)
}

/// Captures a picture with the flange camera, and reads the flange pose of the picture.
fn flange_camera(
    args: &Verify,
    (cell, folder): (&CellFiles, &Path),
    progress: &dyn Fn(&str),
) -> Result<(PathBuf, PathBuf), Fault> {
    let names = find_free_names(folder, "verify_flange_camera", &["png", "json"]);
    let (picture, flange) = match cell.cell.flange_camera().is_simulated() {
        true => simulated_picture(args, cell)?,
        false => {
            let wanted = RequestedShot { shot: Shot::Corner, simulation: args.simulation };
            let mut opened = opening::flange_camera(cell, &wanted, progress)?;
            let poses = FlangePoses::new(cell);
            loop {
                let before = poses.now();
                let shot = opened.camera.capture().map_err(Fault::stage)?;
                if let Some(flange) = poses.combine_or_ask(before, shot.base_from_flange)? {
                    break (shot.picture, flange);
                }
            }
        }
    };
    disk::write(&names[0], files::write_color_png(&picture).map_err(Fault::stage)?)?;
    disk::write(&names[1], files::write_reported_flange(&flange))?;
    Ok((names[0].clone(), names[1].clone()))
}

fn simulated_picture(args: &Verify, cell: &CellFiles) -> Result<(ColorPicture, ReportedFlange), Fault> {
    let world = live::simulated_cell(&cell.scanner()?.value, args.simulation)?;
    let target = world.flange_target();
    let base_from_flange = KukaPose::from_rigid(&target.base_from_flange);
    Ok((target.picture.to_color(), ReportedFlange { base_from_flange, joints: None }))
}
