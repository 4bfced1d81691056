//! Tests `panelprep calibrate robot` as a user runs it: with rendered boards, axis angles, and touched corners, for an
//! arm that differs from its nominal geometry.

use crate::boards::Side;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep::calib::Board;
use panelprep::calib::arm_errors::{ARM_PARAMETER_COUNT, base_from_flange, prior_std};
use panelprep::cell::{Arm, Cell, CorrectionNumbers, FlangeCameraMount, Intrinsics, RobotCorrection, ScannerMount};
use panelprep::files::write_gray_png;
use panelprep::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep::path::{Kinematics, reach};
use panelprep::sim::{BoardCell, BoardPrint, BoardShot, RobotNoise};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

const BOARD: &str = "--board 9x6 --square-mm 25";
const POSES: usize = 13;
/// Maximum number of random poses; the arm reaches one in twelve of them.
const MAX_DRAWS: usize = 400;
const TIP_MM: [f64; 3] = [2.0, -3.0, 140.0];

/// Runs the program; returns its exit code, its JSON object and its error output.
fn panelprep(folder: &Path, arguments: &str) -> (i32, Value, String) {
    let command = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(format!("{arguments} --json").split_whitespace())
        .current_dir(folder)
        .output();
    let output = command.expect("the program starts");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let words = String::from_utf8(output.stderr).expect("UTF-8");
    let object = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{arguments}: {error}: {text}{words}"));
    (output.status.code().expect("an exit code"), object, words)
}

/// Returns an arm with errors up to the usual size, and its error parameters.
fn wrong_arm(seed: u64) -> (Arm, [f64; ARM_PARAMETER_COUNT]) {
    let arm = Cell::check("cell.toml", "").unwrap_or_else(|problems| panic!("{problems}")).arm().clone();
    let mut random = Pcg64::seed_from_u64(seed);
    let errors = std::array::from_fn(|index| match index {
        30 | 31 => prior_std()[index],
        _ => (2.0 * random.random::<f64>() - 1.0) * prior_std()[index],
    });
    (arm, errors)
}

/// Returns the axis angles of the arm at this pose, according to the nominal geometry.
fn nominal_axes(arm: &Arm, pose: &Rigid<Base, Flange>) -> Option<Joints> {
    reach::postures(&Kinematics::new(arm), pose, Point::at(0.0, 0.0, 0.0)).into_iter().next()
}

fn list(joints: &Joints) -> String {
    let all: Vec<String> = joints.degrees().iter().map(|deg| format!("{deg:?}")).collect();
    format!("[{}]", all.join(", "))
}

/// Saves pictures of one camera with the axis angles of each picture, captured at the true poses of the arm.
fn save_pictures<A: Side>(
    folder: &Path,
    cell: &BoardCell,
    (arm, errors): (&Arm, &[f64; ARM_PARAMETER_COUNT]),
    (name, is_on_flange): (&str, bool),
) {
    let (camera, truth) = (A::camera(cell), *A::truth(cell).isometry());
    std::fs::create_dir(folder.join(name)).expect("a folder");
    let mut poses = String::new();
    let mut shots = Vec::new();
    for shot in A::shots(cell, MAX_DRAWS) {
        let Some(joints) = nominal_axes(arm, &shot.base_from_flange) else { continue };
        let (drawn, seen) = (*shot.base_from_flange.isometry(), *shot.camera_from_board.isometry());
        let real = *base_from_flange(arm.geometry(), &joints, errors).isometry();
        // The pose of the board according to the shot, and the camera's view of the board from the true pose of the
        // arm.
        let real_seen = match is_on_flange {
            true => (real * truth).inverse() * (drawn * truth * seen),
            false => truth.inverse() * real * (drawn.inverse() * truth * seen),
        };
        shots.push(BoardShot { camera_from_board: Rigid::from_isometry_unchecked(real_seen), ..shot });
        let _ = write!(poses, "[[poses]]\nimage = \"{:02}.png\"\naxes_deg = {}\n", shot.index, list(&joints));
        if shots.len() == POSES {
            break;
        }
    }
    assert_eq!(shots.len(), POSES, "the arm reaches so many poses");
    shots.par_iter().for_each(|shot| {
        let png = write_gray_png(&cell.picture(&camera, shot)).expect("a picture");
        std::fs::write(folder.join(name).join(format!("{:02}.png", shot.index)), png).expect("written");
    });
    std::fs::write(folder.join(name).join("poses.toml"), poses).expect("written");
    std::fs::write(folder.join(format!("{name}.toml")), Intrinsics::from_camera(camera).to_toml())
        .expect("written");
}

/// Returns measurements in which the real arm touches corners of the fixed board, each with another orientation of the
/// tool.
fn touch_measurements(cell: &BoardCell, (arm, errors): (&Arm, &[f64; ARM_PARAMETER_COUNT])) -> String {
    let board = Board::parse("9x6", 25.0).expect("a board");
    let tip = Point::<Flange>::at(TIP_MM[0], TIP_MM[1], TIP_MM[2]);
    let mut text = String::new();
    for (index, (column, row)) in [(0, 0), (8, 0), (8, 5), (0, 5), (4, 2), (2, 4)].into_iter().enumerate() {
        let corner = (cell.base_from_board() * board.corner(column, row).expect("a corner")).mm.coords;
        // The tool has another tilt and rotation each time, as far as the arm allows.
        let turns = (0..200).map(|draw| {
            let angle = 1.7 * index as f64 + 0.9 * f64::from(draw);
            UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI)
                * UnitQuaternion::from_scaled_axis(Vector3::new(0.5 * angle.cos(), 0.5 * angle.sin(), 0.0))
                * UnitQuaternion::from_scaled_axis(Vector3::z() * 2.3 * angle)
        });
        let touched = turns.into_iter().find_map(|turn| {
            let (mut aim, mut joints) = (corner, Joints::default());
            for _ in 0..6 {
                let flange = Isometry3::from_parts(Translation3::from(aim - turn * tip.mm.coords), turn);
                joints = nominal_axes(arm, &Rigid::from_isometry_unchecked(flange))?;
                aim += corner - (base_from_flange(arm.geometry(), &joints, errors) * tip).mm.coords;
            }
            Some(joints)
        });
        let joints = touched.expect("in reach");
        let _ = write!(text, "[[touches]]\ncorner = [{column}, {row}]\naxes_deg = {}\n", list(&joints));
    }
    text
}

/// From pictures of both cameras, axis angles and touched corners, the calibration computes the correction, its
/// residual, the error of the tip, and the next pose. `check` accepts the file, and a mount calibrated with the
/// correction fits better.
#[test]
fn an_arm_is_calibrated_from_pictures_axes_and_touched_corners() {
    let still = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };
    let cell = BoardCell::new(5, BoardPrint::chessboard(9, 6, 25.0), still).with_reduction(2);
    let (arm, errors) = wrong_arm(8);
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    save_pictures::<ScannerMount>(folder, &cell, (&arm, &errors), ("fixed", false));
    save_pictures::<FlangeCameraMount>(folder, &cell, (&arm, &errors), ("flange", true));
    std::fs::write(folder.join("touches.toml"), touch_measurements(&cell, (&arm, &errors))).expect("written");
    let robot = format!(
        "calibrate robot {BOARD} --eye-to-hand fixed/poses.toml --scanner-lens fixed.toml --eye-in-hand flange/poses.toml \
         --flange-camera-lens flange.toml --touches touches.toml --out robot.toml"
    );
    let (exit, found, words) = panelprep(folder, &robot);
    assert!(exit <= 1 && found["verdict"] != "reject", "{found} {words}");
    let number = |pointer: &str| found.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let (before, after) = (number("/residual_left_out_before_mm"), number("/residual_left_out_mm"));
    assert!(before > 0.15 && after < 0.5 * before, "{before} {after}");
    assert_eq!(found["kind"], "geometry");
    let tip = [0, 1, 2].map(|axis| number(&format!("/tip_mm/{axis}")) - TIP_MM[axis]);
    assert!(Vector3::from(tip).norm() < 0.3, "the tip is off by {tip:?} mm");
    let (median, worst) = (number("/tip_uncertainty_mm/median"), number("/tip_uncertainty_mm/worst"));
    assert!(median > 0.02 && median <= worst && worst < 1.0, "{median} {worst}");
    let next = &found["next_pose"];
    assert!(
        next["board"].is_string() && next["axes_deg"].as_array().is_some_and(|axes| axes.len() == 6),
        "{found}"
    );
    assert!(next["improves_share"].as_f64().is_some_and(|share| share < 1.0), "{next}");
    assert!(found["enough"].is_boolean(), "{found}");

    let text = std::fs::read_to_string(folder.join("robot.toml")).expect("written");
    let file = RobotCorrection::check("robot.toml", &text).unwrap_or_else(|problems| panic!("{problems}"));
    assert!(matches!(file.numbers, CorrectionNumbers::Geometry(_)), "{file:?}");
    assert_eq!(panelprep(folder, "check robot.toml").0, 0);

    let mount = format!(
        "calibrate hand-eye --mount eye-to-hand {BOARD} --intrinsics fixed.toml --images fixed --poses both.toml --out mount.toml"
    );
    // Hand-eye calibration also requires the controller's poses, which are those of the nominal arm.
    let poses = std::fs::read_to_string(folder.join("fixed/poses.toml")).expect("written");
    std::fs::write(folder.join("both.toml"), with_flange(&poses, &arm)).expect("written");
    let rms = |arguments: &str| panelprep(folder, arguments).1["rms_mm"].as_f64().expect("a mount");
    let (plain, corrected) = (rms(&mount), rms(&format!("{mount} --robot robot.toml")));
    assert!(corrected < 0.6 * plain, "{plain} mm without, {corrected} mm with the correction");
}

/// A corner that the board does not have, and a corner of a camera that is not calibrated, are reported with the file.
#[test]
fn a_touch_of_an_unknown_corner_or_camera_is_reported() {
    let still = RobotNoise { shift_mm: 0.0, turn_deg: 0.0 };
    let cell = BoardCell::new(5, BoardPrint::chessboard(9, 6, 25.0), still).with_reduction(3);
    let (arm, errors) = wrong_arm(8);
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    save_pictures::<ScannerMount>(folder, &cell, (&arm, &errors), ("fixed", false));
    let robot = format!(
        "calibrate robot {BOARD} --eye-to-hand fixed/poses.toml --scanner-lens fixed.toml --touches t.toml --out robot.toml"
    );
    let poses = std::fs::read_to_string(folder.join("fixed/poses.toml")).expect("written");
    let image = poses.lines().nth(1).expect("a picture").replace("image = \"", "image = \"fixed/");
    for (touch, told) in [
        ("corner = [0, 0]".to_owned(), "give --eye-in-hand"),
        (format!("corner = [9, 0]\n{image}"), "corner = [9, 0] is not on the board of 9×6 corners"),
    ] {
        std::fs::write(folder.join("t.toml"), format!("[[touches]]\n{touch}\naxes_deg = [0, -90, 90, 0, 30, 0]\n"))
            .expect("written");
        let (exit, found, words) = panelprep(folder, &robot);
        let all = format!("{found}{words}");
        assert!(exit == 2 && all.contains(told) && all.contains("t.toml"), "{exit} {all}");
    }
}

/// Adds the flange poses of the nominal arm to the poses file, beside the axis angles.
fn with_flange(poses: &str, arm: &Arm) -> String {
    let line = |line: &str| {
        let Some(list) = line.strip_prefix("axes_deg = [") else { return format!("{line}\n") };
        let all: Vec<f64> = list.trim_end_matches(']').split(", ").map(|n| n.parse().expect("a number")).collect();
        let joints = Joints::from(<[f64; 6]>::try_from(all).expect("six axes"));
        let flange = base_from_flange(arm.geometry(), &joints, &[0.0; ARM_PARAMETER_COUNT]);
        let panelprep::geometry::KukaPose { x_mm, y_mm, z_mm, a_deg, b_deg, c_deg } =
            panelprep::geometry::KukaPose::from_rigid(&flange);
        format!(
            "{line}\nbase_from_flange = {{ x_mm = {x_mm:?}, y_mm = {y_mm:?}, z_mm = {z_mm:?}, a_deg = {a_deg:?}, b_deg = \
             {b_deg:?}, c_deg = {c_deg:?} }}\n"
        )
    };
    poses.lines().map(line).collect()
}
