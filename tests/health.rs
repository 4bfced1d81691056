//! Tests that a cycle starts only with verified calibrations: not without a verification, and not with a verification
//! that is old, failed, or of other files.

use super::commands::{TEACH, VERIFY, json, rendered};
use panelprep::calib::health::Verification;
use panelprep::store::Store;
use serde_json::Value;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

const CYCLE: &str = "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3";
const TOUCH: &str =
    "calibrate touch --cell cell/cell.toml --board 5x4 --square-mm 40 --target cell/target/scanner.toml";

fn codes(told: &Value) -> Vec<&str> {
    told["reasons"].as_array().expect("reasons").iter().filter_map(|reason| reason["code"].as_str()).collect()
}

/// Checks that neither a cycle nor an air-run starts, with these reasons, that nothing is written to the journal, and
/// that nothing moves.
fn expect_refused(folder: &Path, expected: &[&str]) {
    let before = journal(folder);
    for command in [CYCLE.to_owned(), CYCLE.replace("cycle --cell", "air-run --cell")] {
        let (exit, told) = json(folder, &command);
        assert_eq!(
            (exit, told["verdict"].as_str(), codes(&told)),
            (1, Some("reject"), expected.to_vec()),
            "{told}"
        );
        assert!(told["cycle_id"].is_null() && told["report"].is_null(), "{told}");
    }
    assert_eq!(journal(folder), before);
}

fn journal(folder: &Path) -> usize {
    Store::open(&folder.join("cell/store")).expect("a store").journal().expect("whole").len()
}

fn replace(folder: &Path, file: &str, from: &str, to: &str) {
    let file = folder.join(file);
    let text = std::fs::read_to_string(&file).expect("there");
    assert!(text.contains(from), "{text}");
    std::fs::write(file, text.replace(from, to)).expect("written");
}

#[test]
fn a_cycle_starts_only_on_verified_calibrations() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    expect_refused(folder, &["not_verified", "not_verified"]);
    let (exit, output) = json(folder, VERIFY[0]);
    assert_eq!((exit, output["verdict"].as_str()), (0, Some("accept")), "{output}");
    let error_mm = output["error_mm"].as_f64().unwrap_or(f64::NAN);
    assert!(
        error_mm > 0.02 && error_mm < 0.5 && output["limit_mm"] == 0.8,
        "the mount is 0.1 mm, 0.01° off: {output}"
    );
    expect_refused(folder, &["not_verified"]);

    // A picture of the taught corner, captured at the pose of teaching, also verifies the flange camera.
    let corner = "calibrate verify --cell cell/cell.toml --camera flange-camera --recipe cell/recipe.toml \
                  --image cell/taught_corner.png --flange cell/taught_flange.json";
    let (exit, output) = json(folder, corner);
    assert!(exit == 0 && output["error_mm"].as_f64().is_some_and(|mm| mm < 0.01), "{output}");
    assert_eq!(json(folder, VERIFY[1]).0, 0);

    // The tool touches 2 mm beside the points, like a tool that was displaced by a collision.
    let (exit, output) = json(folder, &format!("{TOUCH} --points cell/target/touched.toml"));
    let errors = output["errors_mm"].as_array().map(Vec::len);
    assert!(exit == 0 && errors == Some(4) && output["error_mm"].as_f64().is_some_and(|mm| mm < 0.2), "{output}");
    let points = std::fs::read_to_string(folder.join("cell/target/touched.toml")).expect("there");
    let (head, tail) = points.split_once("p4_mm = [").expect("a fourth point");
    let (x, rest) = tail.split_once(',').expect("three numbers");
    let x = x.parse::<f64>().expect("a number") + 2.0;
    std::fs::write(folder.join("bumped.toml"), format!("{head}p4_mm = [{x},{rest}")).expect("written");
    let (exit, output) = json(folder, &format!("{TOUCH} --points bumped.toml --pictures pictures"));
    assert_eq!((exit, codes(&output)), (1, vec!["verification_limit"]), "{output}");
    let trend = std::fs::read_to_string(folder.join("pictures/trend_tool.svg")).expect("a trend");
    assert_eq!(trend.matches("<circle").count(), 2);
    expect_refused(folder, &["verification_limit"]);
    assert_eq!(json(folder, &format!("{TOUCH} --points cell/target/touched.toml")).0, 0);

    // A cycle also does not start with a stricter limit, with other files, or with a verification of the day before
    // yesterday.
    let (rendered, strict) =
        ("verify_limit_mm = 0.8", format!("verify_limit_mm = {:?}", (error_mm / 2.0).max(0.05)));
    replace(folder, "cell/cell.toml", rendered, &strict);
    let (_, output) = json(folder, CYCLE);
    assert!(codes(&output).contains(&"verification_limit"), "{output}");
    replace(folder, "cell/cell.toml", &strict, rendered);
    replace(folder, "cell/scanner.toml", "[camera]", "# calibrated again\n[camera]");
    expect_refused(folder, &["verification_other"]);
    replace(folder, "cell/scanner.toml", "# calibrated again\n[camera]", "[camera]");
    let store = folder.join("cell/store");
    let last =
        Store::open(&store).expect("a store").newest_verification("scanner").expect("read").expect("verified");
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_secs() as i64;
    let old = Verification { at_unix_s: now - 48 * 3600, ..last };
    Store::store_verification_in(&store, &old).expect("kept");
    expect_refused(folder, &["verification_old"]);
}

/// If a board is farther from its stated position than a collision could move it, its verification is refused and not
/// stored. A stored verification can be struck out: it stays in the store with the person and the reason, and no older
/// verification replaces it.
#[test]
fn a_useless_verification_is_refused_or_struck_out() {
    let folder = rendered("good");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    // The file states which board it is, so the command does not need this option.
    let look = VERIFY[0].replace("--board 5x4 --square-mm 40", "");
    let (exit, output) = json(folder, &look);
    assert_eq!((exit, output["number"].as_i64()), (0, Some(1)), "{output}");
    let file = "cell/target/scanner.toml";
    replace(folder, file, "square_mm = 40.0", "square_mm = 30.0");
    let (exit, output) = json(folder, &look);
    assert_eq!((exit, codes(&output)), (1, vec!["implausible"]), "{output}");
    assert!(output["error_mm"].as_f64().is_some_and(|mm| mm > 150.0), "{output}");
    replace(folder, file, "square_mm = 30.0", "square_mm = 40.0");
    replace(folder, file, "board = \"5x4\"", "board = \"4x5\"");
    assert_eq!(codes(&json(folder, &look).1), ["implausible"]);
    replace(folder, file, "board = \"4x5\"\nsquare_mm = 40.0\n", "");
    let (exit, output) = json(folder, &look);
    let message = output["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && message.contains("square_mm"), "{output}");
    let history =
        |folder: &Path| json(folder, "calibrate history --cell cell/cell.toml").1["verifications"].clone();
    assert_eq!(history(folder).as_array().map(Vec::len), Some(1), "nothing was kept of them");

    assert_eq!(json(folder, VERIFY[1]).0, 0);
    let strike = "calibrate strike 1 --cell cell/cell.toml --by inspector --why moved";
    assert_eq!(json(folder, strike).0, 0);
    expect_refused(folder, &["verification_struck"]);
    let kept = history(folder);
    assert_eq!(
        (&kept[0]["struck"]["by"], &kept[0]["struck"]["why"]),
        (&"inspector".into(), &"moved".into()),
        "{kept}"
    );
    assert!(kept[1]["struck"].is_null() && kept[0]["error_mm"].as_f64().is_some_and(|mm| mm < 0.5), "{kept}");
    let (exit, output) = json(folder, strike);
    let message = output["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && message.contains("already struck out, by inspector"), "{output}");
    assert_eq!(json(folder, &strike.replace("strike 1", "strike 9")).0, 2);
}

/// An input without a target is an error, and the store contains no verification from this input.
#[test]
fn a_verification_without_its_target_is_refused() {
    let folder = rendered("good");
    let folder = folder.path();
    for (arguments, words) in [
        (VERIFY[1].replace("--flange cell/target/flange.json", ""), "--flange is missing"),
        (VERIFY[0].replace("--target cell/target/scanner.toml", ""), "--target for a board"),
        (VERIFY[0].replace("scanner.png", "flange_camera.png"), "the camera's calibration is for"),
        (VERIFY[0].replace("--board 5x4", "--board 7x6"), "the target file states --board 5x4 --square-mm 40"),
        (VERIFY[0].replace("--square-mm 40", "--square-mm 30"), "the command states --board 5x4 --square-mm 30"),
        (VERIFY[0].replace("--board 5x4", "--board 4x5"), "the command states --board 4x5"),
        (format!("{} --points cell/target/touched.toml", TOUCH.replace("40", "30")), "the command states"),
        (format!("{TOUCH} --points cell/target/flange.json"), "flange.json"),
        (
            "calibrate verify --cell cell/cell.toml --camera scanner --recipe cell/recipe.toml --image x.png"
                .to_owned(),
            "verify the scanner with a board",
        ),
    ] {
        let (exit, told) = json(folder, &arguments);
        let message = told["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(exit == 2 && message.contains(words), "{arguments}: {told}");
    }
    assert!(!folder.join("cell/store").exists(), "nothing is kept");
}
