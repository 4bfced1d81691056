//! Tests inputs that the commands refuse with a message: wrong files, wrong panels, scans that cannot be taught.

use super::{LOCATE, REFINE, TEACH, VERIFY, fixture, json, keep, rendered};
use serde_json::Value;
use std::path::Path;

/// Each invalid input is refused, with words that its message must contain. Everything that was created before the
/// fault is kept.
#[test]
fn bad_input_is_refused_with_file_and_reason() {
    let folder = rendered("clean");
    let folder = folder.path();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("written");
    let read = |name: &str| std::fs::read(folder.join(name)).expect("read");
    let scan = read("cell/scan.pcd");
    write("short.pcd", &scan[..scan.len() / 2]);
    let text = String::from_utf8(read("cell/recipe.toml")).expect("UTF-8");
    write("cell/misspelt.toml", text.replace("box_min_mm", "box_min_cm").as_bytes());
    write("cell/half.toml", text.replace("box_min_mm = [465.0, -240.0,", "box_min_mm = [465.0, 60.0,").as_bytes());
    write("cell/nan.toml", text.replace("rows = 4", "rows = nan").as_bytes());
    let cell = String::from_utf8(read("cell/cell.toml")).expect("UTF-8");
    write("cell/uncalibrated.toml", cell.replace("base_from_camera =", "# base_from_camera =").as_bytes());
    std::fs::create_dir_all(folder.join("empty")).expect("a folder");
    write("empty/clip.csv", b"file,time_s,phase\n");
    std::fs::create_dir_all(folder.join("gap")).expect("a folder");
    write("gap/clip.csv", b"file,time_s,phase\n00001.jpg,0,wet\n");
    write("pose.json", br#"{"x_mm": 1}"#);
    std::fs::copy(fixture("shot_ascii.pcd"), folder.join("small.pcd")).expect("copied");

    let teach =
        |cell: &str, recipe: &str, scan: &str| format!("teach --cell {cell} --recipe {recipe} --scan {scan}");
    let (cell, recipe) = ("cell/cell.toml", "cell/recipe.toml");
    let clip = |clip: &str| format!("inspect --cell {cell} --recipe {recipe} --clip {clip}");
    let cases = [
        (LOCATE.to_owned(), vec!["no store found in cell/store", "panelprep teach"]),
        (teach(cell, recipe, "cell/missing.pcd"), vec!["cell/missing.pcd", "No such file"]),
        (teach(cell, recipe, "short.pcd"), vec!["short.pcd"]),
        (teach(cell, recipe, "small.pcd"), vec!["small.pcd", "40×30", "486×300"]),
        (
            TEACH.replace("cell/recipe.toml", "cell/half.toml"),
            vec!["the scan has no point in the search box there, but the box contains a connected part with"],
        ),
        (teach(cell, recipe, "cell/cell.toml"), vec!["cell/cell.toml"]),
        (
            teach(cell, "cell/misspelt.toml", "cell/scan.pcd"),
            vec!["misspelt.toml:", "locate.box_min_cm", "box_min_mm"],
        ),
        (teach(cell, "cell/nan.toml", "cell/scan.pcd"), vec!["nan.toml:", "region.rows", "1 to 50"]),
        (teach("cell/uncalibrated.toml", recipe, "cell/scan.pcd"), vec!["uncalibrated.toml", "base_from_camera"]),
        (format!("{TEACH} --flange pose.json"), vec!["1 --corner and 2 --flange"]),
        (clip("nowhere"), vec!["nowhere/clip.csv"]),
        (clip("empty"), vec!["empty/clip.csv", "empty"]),
        (clip("gap"), vec!["gap/00001.jpg", "No such file"]),
        (format!("{} --located pose.json", clip("cell/clip")), vec!["pose.json", "missing field"]),
        (VERIFY[0].replace("5x4", "5"), vec!["--board 5: valid: a chessboard"]),
        (
            VERIFY[0].replace("--square-mm 40", "--square-mm -40"),
            vec!["the side of a square is -40 mm (limits 0.5 to 500 mm)"],
        ),
        ("render --out cell/clip".to_owned(), vec!["cell/clip", "not written by"]),
    ];
    for (arguments, words) in &cases[..1] {
        refuses(folder, arguments, words);
    }
    assert!(!folder.join("cell/store").exists(), "a command that reads makes no store");
    assert_eq!(json(folder, TEACH).0, 0);
    for (arguments, words) in &cases[1..] {
        refuses(folder, arguments, words);
    }
    let (exit, plan) = json(folder, &format!("plan --cell {cell} --recipe {recipe} --grids r9c1 --out none.json"));
    assert_eq!(exit, 2, "{plan}");
    assert!(!folder.join("none.json").exists(), "nothing is half written");
}

fn refuses(folder: &Path, arguments: &str, words: &[&str]) {
    let (exit, object) = json(folder, arguments);
    let message = object["reasons"][0]["message"].as_str().unwrap_or_default().to_owned();
    assert_eq!(exit, 2, "{arguments}: {object}");
    for word in words {
        assert!(message.contains(word), "{arguments}\n  says: {message}\n  which lacks: {word}");
    }
}

/// `look` shows a scan. `teach` reports all reasons why it cannot be taught at once. A cell that runs cycles requires a
/// taught corner.
#[test]
fn a_scan_and_the_reasons_against_teaching_it_are_shown() {
    let folder = rendered("clean");
    let folder = folder.path();
    let (exit, output) = json(folder, "look --scan cell/taught_scan.pcd --pictures seen");
    assert_eq!((exit, output["verdict"].as_str()), (0, Some("accept")), "{output}");
    let share = output["missing_share"].as_f64().unwrap_or(f64::NAN);
    assert!(share > 0.01 && share < 0.9 && folder.join("seen/scan.png").is_file(), "{output}");
    let (exit, output) = json(folder, "look --scan cell/recipe.toml --pictures seen");
    assert_eq!(exit, 2, "{output}");

    let recipe = std::fs::read_to_string(folder.join("cell/recipe.toml")).expect("the recipe");
    let begin = recipe.find("corners_px = ").expect("a region");
    let end = begin + recipe[begin..].find('\n').expect("a line");
    let wrong = "corners_px = [[2, 2], [400, 60], [480, 290], [100, 310]]";
    let wrong = format!("{}{wrong}{}", &recipe[..begin], &recipe[end..]);
    std::fs::write(folder.join("cell/wrong.toml"), wrong).expect("written");
    let (exit, output) = json(folder, &format!("{} --pictures wrong", TEACH.replace("recipe.toml", "wrong.toml")));
    let message = output["reasons"][0]["message"].as_str().unwrap_or_default();
    for words in [
        "corner 1 of the region, (2, 2) px, is not on",
        "corner 3 of",
        "corner 4 of the region, (100, 310) px, lies outside",
    ] {
        assert!(exit == 2 && message.contains(words), "{words}: {output}");
    }
    assert!(folder.join("wrong/taught_region.png").is_file());
    // Two pictures without a corner: both are reported.
    let corners = "--corner cell/target/flange_camera.png --flange cell/target/flange.json \
                   --corner cell/target/flange_camera.png --flange cell/target/flange.json";
    let teach =
        "teach --cell cell/cell.toml --recipe cell/recipe.toml --scan cell/taught_scan.pcd --pictures wrong";
    let (exit, output) = json(folder, &format!("{teach} {corners}"));
    let message = output["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && message.matches("flange_camera.png: ").count() == 2, "{output}");
    assert!(folder.join("wrong/taught_corner_2.png").is_file());
    let (exit, output) = json(folder, teach);
    let message = output["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && message.contains("no corner picture was given"), "{output}");
    assert!(!folder.join("cell/store").exists(), "nothing was kept");
}

#[test]
fn a_missing_or_wrong_panel_is_rejected_with_a_reason() {
    for scene in ["no-panel", "wrong-panel"] {
        let folder = rendered(scene);
        assert_eq!(json(folder.path(), TEACH).0, 0);
        let (exit, located) = json(folder.path(), LOCATE);
        assert_eq!((exit, located["verdict"].as_str()), (1, Some("reject")), "{scene}: {located}");
        let reasons = located["reasons"].as_array().expect("reasons");
        assert!(
            reasons.iter().all(|reason| reason["message"].as_str().is_some_and(|text| text.len() > 20)),
            "{located}"
        );
        assert!(!reasons.is_empty());
        // A rejected result cannot be used by the next command.
        keep(folder.path(), "located.json", &located);
        let (exit, refined) = json(folder.path(), REFINE);
        assert_eq!((exit, &refined["verdict"]), (2, &Value::Null), "{scene}: {refined}");
    }
}
