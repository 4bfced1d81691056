//! Tests a cell whose arm differs from its nominal geometry, from its calibration to a cycle with this arm.

use serde_json::Value;
use std::process::Command;

/// A cell whose arm differs from its nominal geometry is calibrated. A cycle is then as accurate as with an arm without
/// errors, and its recording replays. Without the correction the mount of the 3D camera is refused, because with such
/// an arm the board's squares seem to have another size.
#[test]
fn a_cycle_by_an_arm_that_is_not_as_it_is_drawn() {
    let folder = tempfile::tempdir().expect("a folder");
    let demo = |more: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(["demo", "--json", "--reduction", "4", "--arm-error-mm", "1.2", "--seed", "1", "--out", "arm"])
            .args(more)
            .current_dir(folder.path())
            .output()
            .expect("the program starts");
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        serde_json::from_slice::<Value>(&output.stdout).unwrap_or_else(|error| panic!("{error}: {words}"))
    };
    let uncorrected = demo(&["--uncorrected"]);
    let refused = uncorrected["reasons"].to_string();
    assert!(refused.contains("square_size") && refused.contains("the arm's lengths are wrong"), "{uncorrected}");
    let passed = demo(&["--record", "arm.mcap"]);
    let number = |pointer: &str| passed.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    assert_eq!(passed["verdict"], "pass", "{passed}");
    assert!(number("/verified/tool_mm") < 0.35 && number("/refine/error_max_mm") < 0.3, "{passed}");
    assert!(number("/abrade/0/surface_error_max_mm") < 0.45 && number("/abrade/0/coverage") > 0.99, "{passed}");
    let page = std::fs::read_to_string(folder.path().join("arm/index.html")).expect("a page");
    assert!(page.contains("robot, corrected by robot_correction, and tool"), "the record names the correction");
    let run = |arguments: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(arguments.split_whitespace())
            .current_dir(folder.path())
            .output()
            .expect("the program starts");
        let text =
            [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        (output.status.code(), text)
    };
    let (code, text) = run("replay arm.mcap");
    assert!(code == Some(0) && text.contains("the same as recorded"), "{text}");

    // The verification shows the remaining error in the working volume, with its map.
    let verify = "calibrate verify --cell arm/cell/cell.toml --camera flange-camera --target arm/cell/boards/flange/target.toml \
                  --poses arm/cell/boards/flange/poses.toml --pictures maps";
    let (code, text) = run(verify);
    assert!(code == Some(0) && text.contains("mm rms"), "{text}");
    assert!(folder.path().join("maps/map_flange_camera.svg").exists(), "{text}");

    // Another tool is selected on the pendant: its tip gives no information about the tip of the cell's tool.
    let touch = "calibrate touch --cell arm/cell/cell.toml --target arm/cell/target/scanner.toml \
                 --points arm/cell/target/touched.toml";
    let (code, text) = run(touch);
    assert!(code == Some(0), "{text}");
    let points = folder.path().join("arm/cell/target/touched.toml");
    let right = std::fs::read_to_string(&points).expect("points");
    let (before, after) = right.split_once("p2_mm = [").expect("a second touch");
    let (x_mm, after) = after.split_once(',').expect("a place");
    let x_mm: f64 = x_mm.parse().expect("a number");
    std::fs::write(&points, format!("{before}p2_mm = [{:.3},{after}", x_mm + 8.0)).expect("written");
    let (code, text) = run(touch);
    assert!(
        code == Some(2) && text.contains("touched.toml") && text.contains("p2_mm is") && text.contains("tool"),
        "{text}"
    );

    // A pose without axis angles cannot be corrected. Mounts that were measured with the correction cannot be used
    // without it.
    let pose = "arm/cell/target/flange.json";
    let whole: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join(pose)).expect("a pose")).expect("JSON");
    std::fs::write(folder.path().join(pose), whole["base_from_flange"].to_string()).expect("written");
    let look = "calibrate verify --cell arm/cell/cell.toml --camera flange-camera --target arm/cell/target/flange_camera.toml \
                --image arm/cell/target/flange_camera.png --flange arm/cell/target/flange.json";
    let (code, text) = run(look);
    assert!(code == Some(2) && text.contains("flange.json") && text.contains("axes_deg"), "{text}");
    let cell = folder.path().join("arm/cell/cell.toml");
    let text = std::fs::read_to_string(&cell).expect("a cell");
    std::fs::write(&cell, text.replace("robot_correction = \"robot_correction.toml\"\n", "")).expect("written");
    let (code, text) = run(verify);
    assert!(
        code == Some(2) && text.contains("flange_from_camera.toml: was measured with the correction of the arm"),
        "{text}"
    );
}
