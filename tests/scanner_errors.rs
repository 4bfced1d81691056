//! Tests `panelprep calibrate scanner` as a user runs it: a 3D camera with distorted scans locates the panel at its
//! true pose after the camera's errors were measured.

use super::commands::{TEACH, json};
use super::goal::Figure;
use panelprep::geometry::{Base, KukaPose, Panel, Point, Rigid};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn place(value: &Value) -> Rigid<Base, Panel> {
    serde_json::from_value::<KukaPose>(value.clone()).expect("a pose").to_rigid()
}

/// Teaches and locates the panel. Returns the maximum distance of the panel's points from their true positions, mm, and
/// the result.
fn located_point_error_mm(folder: &Path) -> (f64, Value) {
    let _ = fs::remove_dir_all(folder.join("cell/store"));
    let (exit, taught) = json(folder, TEACH);
    assert_eq!(exit, 0, "{taught}");
    let (exit, found) = json(folder, "locate --cell cell/cell.toml --recipe cell/recipe.toml --scan cell/scan.pcd");
    assert_eq!(exit, 0, "{found}");
    let truth = fs::read_to_string(folder.join("cell/truth/truth.json")).expect("the truth");
    let truth: Value = serde_json::from_str(&truth).expect("JSON");
    let [found_pose, true_pose] = [&found, &truth].map(|of| place(&of["base_from_panel"]));
    let off_mm = |y: f64, z: f64| {
        let point = Point::<Panel>::at(550.0, y, z);
        (found_pose * point).distance_mm(true_pose * point)
    };
    let corners = [(-170.0, 240.0), (170.0, 240.0), (-170.0, 480.0), (170.0, 480.0)];
    (corners.into_iter().map(|(y, z)| off_mm(y, z)).fold(0.0, f64::max), found)
}

#[test]
fn the_errors_of_a_3d_camera_are_corrected_by_scans_of_a_board() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let render = "render --seed 3 --reduction 4 --seconds 5 --board-scans 12 --scanner-error-mm 2 --out cell";
    assert_eq!(json(folder, render).0, 0);
    let (before_mm, found) = located_point_error_mm(folder);
    assert!(found["scanner_errors"].as_str().expect("words").starts_with("not measured"), "{found}");
    let scans: Vec<String> = (1..=12).map(|index| format!("cell/boards/scanner/{index:02}.pcd")).collect();
    let calibrate =
        "calibrate scanner --intrinsics cell/scanner.toml --board 8x6 --square-mm 30 --out cell/scanner.toml";
    let (exit, measured) = json(folder, &format!("{calibrate} --pictures found {}", scans.join(" ")));
    let picture =
        panelprep::files::read_color(&fs::read(folder.join("found/scanner_errors.png")).expect("written"))
            .expect("a picture");
    let shares = [[213, 94, 0], [0, 114, 178], [150, 150, 150]].map(|color: [u8; 3]| {
        picture.rgb.iter().filter(|rgb| **rgb == color).count() as f64 / picture.rgb.len() as f64
    });
    assert!(
        shares[2] > 0.05 && shares[0] + shares[1] > 0.01,
        "corners without a board, and places beyond the scale's ends: {shares:?}"
    );
    let left_out = &measured["left_out"];
    let mm = |name: &str| left_out[name].as_f64().expect("a length");
    assert!(exit <= 1 && mm("corrected_mm") < 0.6 * mm("plain_mm"), "{measured}");
    let (after_mm, found) = located_point_error_mm(folder);
    let before = Figure("calib: farthest corner of the panel before `calibrate scanner`, scans bent by 2 mm");
    before.report("–", &format!("{before_mm:.3} mm"), true);
    let after = Figure("calib: farthest corner after it");
    after.report("0.7 of before", &format!("{after_mm:.3} mm"), after_mm < 0.7 * before_mm);
    assert!(found["scanner_errors"].as_str().expect("words").starts_with("measured"), "{found}");
    assert!(after_mm < 0.7 * before_mm, "{before_mm} {after_mm}");
    assert!(after_mm < found["uncertainty_mm"].as_f64().expect("stated"), "{after_mm} {found}");
    let (exit, reported) = json(folder, "check cell/scanner.toml");
    assert_eq!(exit, 0, "{reported}");
    assert!(reported.to_string().contains("measurement errors of the camera"), "{reported}");
}

/// Seven scans give a verdict, and a picture without depth gives an error.
#[test]
fn too_few_scans_give_a_verdict_and_a_picture_gives_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    assert_eq!(json(folder, "render --seed 3 --reduction 4 --seconds 5 --board-scans 7 --out cell").0, 0);
    let calibrate =
        "calibrate scanner --intrinsics cell/scanner.toml --board 8x6 --square-mm 30 --out cell/new.toml";
    let scans: Vec<String> = (1..=7).map(|index| format!("cell/boards/scanner/{index:02}.pcd")).collect();
    let (exit, told) = json(folder, &format!("{calibrate} {}", scans.join(" ")));
    assert_eq!((exit, told["verdict"].as_str()), (1, Some("reject")), "{told}");
    assert_eq!(told["reasons"][0]["code"], "scanner_places");
    assert!(!folder.join("cell/new.toml").exists());
    let (exit, told) = json(folder, &format!("{calibrate} cell/taught_corner.png"));
    assert_eq!(exit, 2, "{told}");
}
