//! Tests calibrations that capture their own pictures, as a person at the terminal uses them.

use super::commands::{json, start_program};
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Runs a command with these lines as answers; returns its exit code, its JSON object and its printed text.
fn run_with_answers(folder: &Path, command: &str, lines: &str) -> (i32, Value, String) {
    let mut child = start_program(folder, command);
    child.stdin.take().expect("its input").write_all(lines.as_bytes()).expect("it listens");
    let ended = child.wait_with_output().expect("it ends");
    let told = String::from_utf8_lossy(&ended.stderr).into_owned();
    let found = serde_json::from_slice(&ended.stdout).unwrap_or(Value::Null);
    (ended.status.code().unwrap_or(-1), found, told)
}

const LENS: &str = "calibrate intrinsics --live shots --camera flange-camera --board 9x6 --square-mm 25 \
                    --cell cell/cell.toml --out lens.toml";

/// Calibrates a lens from pictures, each captured when Enter is pressed, in two sessions; then calibrates both mounts,
/// with the arm moving automatically.
#[test]
fn a_cell_is_calibrated_by_newly_captured_pictures() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (exit, reported) = json(folder, "render --seed 3 --reduction 2 --seconds 5 --out cell");
    assert_eq!(exit, 0, "{reported}");

    let (exit, _, reported) =
        run_with_answers(folder, "calibrate intrinsics --live shots --board 9x6 --square-mm 25 --out a.toml", "");
    assert!(exit == 2 && reported.contains("--camera scanner or --camera flange-camera"), "{reported}");
    // There are too few pictures, and the terminal is closed: the command gives a verdict, and the pictures remain.
    let (exit, found, reported) = run_with_answers(folder, LENS, "\n\n\n");
    assert!(exit == 1 && found["reasons"].to_string().contains("too_few_pictures"), "{exit} {found} {reported}");
    assert!(reported.contains("board_0003.png: board found, 54 of 54 corners"), "{reported}");
    let (exit, found, reported) = run_with_answers(folder, LENS, &"\n".repeat(7));
    assert!(reported.contains("3 pictures already exist, 3 of them show the board"), "{reported}");
    assert!(reported.contains("next: the board in the") && reported.contains("so far:"), "{reported}");
    assert!(exit < 2 && found["rms_px"].as_f64() < Some(0.1), "{found}");
    assert_eq!(found["images"].as_array().map(Vec::len), Some(10), "{found}");
    assert!(folder.join("lens.toml").is_file());

    // Options that do not belong together are refused, and a picture that was never captured is reported.
    let hand_eye = "calibrate hand-eye --live none --mount eye-in-hand --board 9x6 --square-mm 25 --cell cell/cell.toml \
                    --intrinsics cell/flange_camera.toml --out m.toml";
    let (exit, _, reported) = run_with_answers(folder, &format!("{hand_eye} --camera scanner"), "");
    assert!(exit == 2 && reported.contains("--camera"), "{reported}");
    let (exit, _, reported) = run_with_answers(folder, &format!("{LENS} --move"), "");
    assert!(exit == 2 && reported.contains("--move"), "{reported}");
    let (exit, found, reported) = run_with_answers(folder, hand_eye, "done\n");
    assert!(exit == 2 && format!("{found}{reported}").contains("0 of 0 pictures"), "{found} {reported}");

    for (mount, lens, file) in
        [("eye-in-hand", "flange_camera", "flange_from_camera"), ("eye-to-hand", "scanner", "base_from_camera")]
    {
        let command = format!(
            "calibrate hand-eye --live {mount} --move --mount {mount} --board 9x6 --square-mm 25 --cell cell/cell.toml \
             --intrinsics cell/{lens}.toml --out {file}.toml"
        );
        let (exit, found, reported) = run_with_answers(folder, &command, "\n");
        assert!(exit < 2 && reported.contains("The arm will move by itself"), "{exit} {found} {reported}");
        assert!(reported.contains("so far:") && found["uncertainty_mm"].as_f64() < Some(0.3), "{found} {reported}");
        // The mount of the 3D camera is computed from its own points, in shots that the session captured; the pictures
        // of these shots are used as a check.
        let shots = std::fs::read_dir(folder.join(mount)).expect("a folder").flatten();
        let has_points = shots.filter(|file| file.path().extension().is_some_and(|ending| ending == "pcd")).count();
        let apart_mm = found["second"]["apart_mm"].as_f64();
        assert_eq!(
            (mount == "eye-to-hand", mount == "eye-to-hand"),
            (has_points >= 8, apart_mm.is_some()),
            "{found}"
        );
        assert!(apart_mm.is_none_or(|mm| mm < 0.5), "{found}");
        // The cell's file was written with the true mounts.
        let number = |file: &str, key: &str| {
            let text = std::fs::read_to_string(folder.join(file)).expect("written");
            let value: toml::Table = text.parse().expect("TOML");
            value[&*file_table(file)][key].as_float().expect("a number")
        };
        for key in ["x_mm", "y_mm", "z_mm"] {
            let (ours, true_mm) = (number(&format!("{file}.toml"), key), number(&format!("cell/{file}.toml"), key));
            assert!((ours - true_mm).abs() < 1.0, "{mount} {key}: {ours} {true_mm}");
        }
    }
}

/// Calibrates a tool by poses that a person reads from the pendant, because no controller answers. An answer that is
/// not a pose is not stored.
#[test]
fn a_tool_is_calibrated_by_poses_from_the_pendant() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (exit, reported) = json(folder, "render --seed 3 --reduction 8 --seconds 5 --boards --out cell");
    assert_eq!(exit, 0, "{reported}");
    let poses: toml::Table =
        std::fs::read_to_string(folder.join("cell/boards/tip.toml")).expect("written").parse().expect("TOML");
    let typed = |table: &str| -> String {
        let one = |pose: &toml::Value| {
            let number = |key: &str| pose["base_from_flange"][key].as_float().expect("a number").to_string();
            let numbers = ["x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"].map(number);
            format!("\n{}\n", numbers.join(","))
        };
        poses[table].as_array().expect("poses").iter().map(one).collect()
    };
    let tcp = "calibrate tcp --live tip --cell cell/cell.toml --out tool.toml";
    let (exit, _, reported) = run_with_answers(folder, tcp, "doen\ndone\n");
    assert!(exit == 2 && reported.contains("\"doen\" is not a valid answer"), "{reported}");
    let lines = format!("{}axis\n{}done\n", typed("poses"), typed("axis"));
    let (exit, found, reported) = run_with_answers(folder, tcp, &lines);
    assert_eq!((exit, found["axis_measured"].as_bool()), (0, Some(true)), "{found} {reported}");
    assert!(reported.contains("so far: ") && reported.contains("Enter the flange's pose"), "{reported}");
    let off_mm = (found["flange_from_tool"]["z_mm"].as_f64().expect("a number") - 120.0).abs();
    assert!(off_mm < 0.1, "the simulated tool is 120 mm long: {found}");
    let (exit, _, reported) = run_with_answers(folder, tcp, "done\n");
    assert!(exit == 0 && reported.contains("5 poses of the tip and 2 of the axis already exist"), "{reported}");
}

fn file_table(file: &str) -> String {
    Path::new(file).file_stem().map_or(String::new(), |stem| stem.to_string_lossy().into_owned())
}
