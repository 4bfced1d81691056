//! Tests the calibration commands from files to files: lens, mounts, tool, verification.

use super::files::{BOARD, panelprep, pose_text, save, save_shots, small_cell, write};
use crate::boards::{self, GOOD_ROBOT};
use panelprep::cell::Intrinsics;
use panelprep::files::write_pcd;
use panelprep::geometry::{Flange, GrayPicture, KukaPose, PinholeCamera, Point};
use panelprep::sim::BoardCell;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Saves pictures of the fixed camera with their poses and the true lens in a folder.
fn folder_of_poses(cell: &BoardCell, count: usize) -> (tempfile::TempDir, Vec<String>) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("board")).expect("a folder");
    let mut poses = Vec::new();
    for shot in cell.fixed_shots(count) {
        let name = format!("{:02}.png", shot.index);
        save(&folder.path().join("board"), &name, &cell.picture(&cell.scanner(), &shot));
        let pose = pose_text(&KukaPose::from_rigid(&shot.base_from_flange));
        poses.push(format!("[[poses]]\nimage = \"{name}\"\nbase_from_flange = {pose}\n"));
    }
    write(folder.path(), "lens.toml", Intrinsics::from_camera(cell.scanner()).to_toml());
    (folder, poses)
}

/// Calibrates lens and mount and verifies them, from pictures to files. Then each wrong input is reported, and no file
/// is written.
#[test]
fn commands_calibrate_verify_and_refuse() {
    let cell = boards::cell(3, GOOD_ROBOT);
    let (folder, poses) = folder_of_poses(&cell, 8);
    let folder = folder.path();
    write(folder, "poses.toml", poses.concat());
    let images = (0..8).fold(String::new(), |mut list, index| {
        let _ = write!(list, " board/{index:02}.png");
        list
    });
    let (exit, found, words) =
        panelprep(folder, &format!("intrinsics {BOARD} --out own.toml --pictures pictures{images}"));
    assert!(exit <= 1 && found["verdict"] != "reject", "{found}");
    let number = |object: &Value, key: &str| object[key].as_f64().unwrap_or(f64::NAN);
    assert!((number(&found, "fx_px") / cell.scanner().fx_px - 1.0).abs() < 0.004, "{found}");
    assert!(words.contains("corners: 8 of 8"), "progress is reported: {words}");
    assert!(folder.join("pictures/residuals.png").is_file());
    let own = std::fs::read_to_string(folder.join("own.toml")).expect("written");
    let own = Intrinsics::check("own.toml", &own).expect("right");
    assert_eq!((own.provenance.pictures.len(), own.provenance.residuals.len()), (8, 8));
    assert!(own.date.is_some() && own.provenance.program.is_some_and(|program| program.starts_with("panelprep ")));

    let many = format!("hand-eye --mount eye-to-hand {BOARD} --intrinsics lens.toml --images board --poses");
    let (exit, found, _) = panelprep(folder, &format!("{many} poses.toml --out base_from_camera.toml"));
    assert!(exit <= 1 && found["verdict"] != "reject", "{found}");
    let pose: KukaPose = serde_json::from_value(found["base_from_camera"].clone()).expect("a pose");
    let error_mm = pose.to_rigid().distance_at_mm(cell.base_from_camera(), cell.panel_middle());
    assert!(error_mm < 0.1 && number(&found, "uncertainty_mm") < 0.2, "{error_mm} mm, {found}");
    assert_eq!(found["residuals"].as_array().map(Vec::len), Some(8));

    verify(folder);

    let right = KukaPose::from_rigid(&cell.fixed_shots(4)[3].base_from_flange);
    let mistyped = KukaPose { b_deg: right.b_deg + 2.0, ..right };
    let mistyped = format!("[[poses]]\nimage = \"03.png\"\nbase_from_flange = {}\n", pose_text(&mistyped));
    let wrong = poses.iter().enumerate().map(|(i, pose)| if i == 3 { &*mistyped } else { &**pose });
    write(folder, "wrong.toml", wrong.collect::<String>());
    let (exit, found, _) = panelprep(folder, &format!("{many} wrong.toml --out wrong_out.toml"));
    let reasons = found["reasons"].to_string();
    assert!(exit == 1 && reasons.contains("03.png is") && reasons.contains("b_deg"), "{reasons}");
    write(folder, "missing.toml", poses.concat().replace("05.png", "55.png"));
    let (exit, _, words) = panelprep(folder, &format!("{many} missing.toml --out wrong_out.toml"));
    assert!(
        exit == 2 && words.contains("55.png is not in the folder") && words.contains("missing.toml:"),
        "{words}"
    );
    save(folder, "small.png", &GrayPicture::uniform(640, 480, 90));
    let (exit, _, words) = panelprep(folder, &format!("intrinsics {BOARD} --out wrong_out.toml{images} small.png"));
    assert!(exit == 2 && words.contains("small.png has 640 × 480"), "{words}");
    let (exit, _, words) =
        panelprep(folder, "intrinsics --board 7x6 --square-mm 25 --out wrong_out.toml board/00.png small.png");
    assert!(exit == 2 && !words.is_empty(), "{words}");
    assert!(!folder.join("wrong_out.toml").exists(), "nothing is written");
}

/// Teaches the board's pose from a picture, verifies the camera with the board, and refuses a displaced camera.
fn verify(folder: &Path) {
    let cell =
        "store = \"store\"\n[calibration]\nscanner = \"lens.toml\"\nbase_from_camera = \"base_from_camera.toml\"\n";
    write(folder, "cell.toml", cell);
    let look = |more: &str| {
        let arguments = "verify --cell cell.toml --camera scanner --target target.toml --pictures pictures";
        panelprep(folder, &format!("{arguments} {BOARD} {more}"))
    };
    let (exit, found, _) = look("--image board/00.png --learn");
    assert_eq!(exit, 0, "{found}");
    let (exit, found, _) = look("--image board/00.png");
    assert!(exit == 0 && found["error_mm"].as_f64().is_some_and(|error| error < 1e-6), "{found}");
    // The camera was displaced by 3 mm.
    let mount = std::fs::read_to_string(folder.join("base_from_camera.toml")).expect("there");
    let x_mm = mount.lines().find_map(|line| line.strip_prefix("x_mm = ")).expect("a place");
    let bumped = format!("x_mm = {:?}", x_mm.parse::<f64>().expect("a number") + 3.0);
    write(folder, "base_from_camera.toml", mount.replace(&format!("x_mm = {x_mm}"), &bumped));
    let (exit, found, _) = look("--image board/00.png");
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("verification_limit")), "{found}");
    // A picture of the board in another pose is refused.
    let (exit, found, _) = look("--image board/01.png");
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("implausible")), "{found}");
    let trend = std::fs::read_to_string(folder.join("pictures/trend_scanner.svg")).expect("a trend");
    assert_eq!(trend.matches("<circle").count(), 2);
}

/// Calibrates with three points on the command line and with the 3D camera's own shot as the picture: first only the
/// picture is captured, then the mount is calibrated.
#[test]
fn three_points_from_files() {
    let cell = boards::cell(4, GOOD_ROBOT);
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let shot = cell.fixed_shots(1)[0];
    write(folder, "shot.pcd", write_pcd(&cell.scan(&shot, 0.05)));
    write(folder, "lens.toml", Intrinsics::from_camera(cell.scanner()).to_toml());
    let three =
        format!("hand-eye --mount eye-to-hand {BOARD} --intrinsics lens.toml --image shot.pcd --out mount.toml");
    let (exit, found, _) = panelprep(folder, &three);
    assert!(
        exit == 0 && folder.join("corners_to_touch.png").is_file() && !folder.join("mount.toml").exists(),
        "{found}"
    );
    let board = boards::board();
    let corners = board.corners_to_touch();
    let places: Vec<Point<_>> = corners.iter().filter_map(|&(c, r)| board.corner(c, r)).collect();
    let touched = cell.touch_points(&(cell.base_from_camera() * shot.camera_from_board), &places, 0.05);
    let points: String =
        touched.iter().zip(corners).enumerate().fold(String::new(), |mut text, (index, (p, (c, r)))| {
            let (n, [x, y, z]) = (index + 1, [p.mm.x, p.mm.y, p.mm.z]);
            let _ = writeln!(text, "p{n}_mm = [{x:?}, {y:?}, {z:?}]\np{n}_corner = [{c}, {r}]");
            text
        });
    write(folder, "points.toml", &points);
    let (exit, found, _) = panelprep(folder, &format!("{three} --points points.toml"));
    assert!(exit == 0 && folder.join("mount.toml").is_file(), "{found}");
    let pose: KukaPose = serde_json::from_value(found["base_from_camera"].clone()).expect("a pose");
    let error_mm = pose.to_rigid().distance_at_mm(cell.base_from_camera(), cell.panel_middle());
    assert!(
        error_mm < 0.5 && found["distance_errors_mm"].as_array().map(Vec::len) == Some(3),
        "{error_mm}: {found}"
    );
}

/// If the 3D camera measured the board, its own points give a second mount. Wrong intrinsics are detected by the
/// distance between the two mounts.
#[test]
fn the_3d_camera_s_own_points_give_a_second_mount() {
    let cell = small_cell();
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let poses = save_shots(&cell, 8, |name, shot| {
        let name = format!("{name}.pcd");
        write(folder, &name, write_pcd(&cell.scan(shot, 0.03)));
        name
    });
    write(folder, "poses.toml", poses);
    write(folder, "lens.toml", Intrinsics::from_camera(cell.scanner()).to_toml());
    let command =
        "hand-eye --mount eye-to-hand --board 5x4 --square-mm 40 --images . --poses poses.toml --out m.toml";
    let (exit, found, _) = panelprep(folder, &format!("{command} --intrinsics lens.toml"));
    assert!(exit <= 1 && found["verdict"] != "reject", "{found}");
    let pose: KukaPose = serde_json::from_value(found["second"]["base_from_camera"].clone()).expect("a pose");
    let error_mm = pose.to_rigid().distance_at_mm(cell.base_from_camera(), cell.panel_middle());
    assert!(error_mm < 0.15, "{error_mm} mm: {found}");
    assert!(found["second"]["apart_mm"].as_f64().is_some_and(|mm| mm < 0.3), "{found}");
    assert!(!found["reasons"].to_string().contains("second_result"), "{found}");

    let other = PinholeCamera {
        fx_px: cell.scanner().fx_px * 1.004,
        fy_px: cell.scanner().fy_px * 1.004,
        ..cell.scanner()
    };
    write(folder, "other.toml", Intrinsics::from_camera(other).to_toml());
    let (exit, found, _) = panelprep(folder, &format!("{command} --intrinsics other.toml"));
    // The motions of the robot are sufficient to detect the error.
    let reasons = found["reasons"].to_string();
    assert!(
        exit == 1 && (reasons.contains("second_result") || reasons.contains("focal_length_differs")),
        "{found}"
    );
}

/// Calibrates the tool's point and axis from a poses file. Expected value, calculated by hand: the tip is 150 mm from
/// the flange along its Z axis.
#[test]
fn a_tool_from_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let held = |out_mm: f64, a_deg: f64, b_deg: f64, c_deg: f64| {
        let turned = KukaPose { a_deg, b_deg, c_deg, ..KukaPose::default() };
        let tip = turned.to_rigid::<Flange, Flange>() * Point::at(0.0, 0.0, out_mm);
        let pose = KukaPose { x_mm: 600.0 - tip.mm.x, y_mm: -tip.mm.y, z_mm: 200.0 - tip.mm.z, ..turned };
        format!("base_from_flange = {}\n", pose_text(&pose))
    };
    let angles = [(0.0, 0.0, 180.0), (30.0, 25.0, 180.0), (-40.0, 0.0, 150.0), (90.0, -20.0, 200.0)];
    let tip: String = angles.iter().map(|&(a, b, c)| format!("[[poses]]\n{}", held(150.0, a, b, c))).collect();
    write(folder, "tip.toml", &tip);
    let (exit, found, _) = panelprep(folder, "tcp --poses tip.toml --out tool.toml");
    assert_eq!((exit, found["reasons"][0]["code"].as_str()), (1, Some("no_axis")), "{found}");
    write(folder, "axis.toml", format!("{tip}[[axis]]\n{}", held(90.0, 10.0, 5.0, 170.0)));
    let (exit, found, _) = panelprep(folder, "tcp --poses axis.toml --out tool.toml");
    assert_eq!(exit, 0, "{found}");
    let pose: KukaPose = serde_json::from_value(found["flange_from_tool"].clone()).expect("a pose");
    assert!((pose.z_mm - 150.0).abs() < 1e-6 && pose.x_mm.abs() < 1e-6, "{pose}");
    let text = std::fs::read_to_string(folder.join("tool.toml")).expect("written");
    assert!(text.contains("axis_measured = true") && text.contains("uncertainty_mm = "), "{text}");
}
