//! Tests `panelprep new cell` and `new recipe` as a user runs them: with options, and with answers on the terminal.

use super::commands::json;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

const CELL: &str = "new cell --yes --no-search";

/// Returns what `check` reports for a file, and whether the file is sufficient for a cycle.
fn check(folder: &Path, files: &str) -> (i32, String) {
    let (exit, told) = json(folder, &format!("check {files}"));
    (exit, told.to_string())
}

#[test]
fn each_kind_of_cell_is_written_as_check_accepts_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let cases = [
        ("--scanner simulated --flange-camera simulated --robot mock", "simulated", "simulated", "mock"),
        (
            "--scanner zivid --scanner-serial 2127A0F3 --flange-camera simulated --robot mock",
            "zivid",
            "simulated",
            "mock",
        ),
        (
            "--scanner zivid --flange-camera-serial 22/1 --robot eki --host 172.31.1.147 --park-deg -90,-100,110,0,60,0 \
             --box-max-mm 700,400,800",
            "zivid",
            "gige",
            "eki",
        ),
        ("--scanner zivid --flange-camera-address 192.168.70.20 --host krc", "zivid", "gige", "eki"),
        ("", "simulated", "simulated", "mock"),
    ];
    for (index, (options, scanner, flange_camera, robot)) in cases.into_iter().enumerate() {
        let file = format!("cells/{index}.toml");
        let (exit, output) = json(folder, &format!("{CELL} {options} --out {file}"));
        assert_eq!((exit, output["file"].as_str()), (0, Some(file.as_str())), "{options}: {output}");
        let (exit, checked) = check(folder, &file);
        assert_eq!(exit, 0, "{options}: {checked}");
        let text = fs::read_to_string(folder.join(&file)).expect("written");
        let cell: toml::Table = text.parse().expect("TOML");
        for (table, kind) in [("scanner", scanner), ("flange_camera", flange_camera), ("robot", robot)] {
            assert_eq!(cell[table]["kind"].as_str(), Some(kind), "{options}: {text}");
        }
        // The file is intended for people: it contains the explanations of the sample files.
        assert!(text.matches('#').count() > 20 && !text.contains("../target/demo"), "{text}");
        let to_check = output["to_check"].as_array().expect("a list").len();
        assert_eq!(
            (to_check > 0, text.matches("# TO CHECK").count()),
            (robot == "eki", to_check),
            "{options}: {output}"
        );
    }
    let real = fs::read_to_string(folder.join("cells/2.toml")).expect("written");
    let cell: toml::Table = real.parse().expect("TOML");
    assert_eq!(cell["robot"]["host"].as_str(), Some("172.31.1.147"));
    assert_eq!(cell["flange_camera"]["serial"].as_str(), Some("22/1"));
    assert_eq!(cell["store"].as_str(), Some("/var/lib/panelprep"));
    assert_eq!(cell["poses"]["park"]["a2_deg"].as_float(), Some(-100.0), "as answered");
    assert_eq!(cell["limits"]["box_max_mm"].to_string(), "[700.0, 400.0, 800.0]");
    // The obstacles of another cell, and values that only a person may state, are not copied.
    assert!(["rough", "arm", "keep_out"].iter().all(|table| cell.get(*table).is_none()), "{real}");
    assert!(cell["limits"].get("tool_error_mm").is_none() && real.contains("# tool_error_mm = "), "{real}");
    let by_address: toml::Table =
        fs::read_to_string(folder.join("cells/3.toml")).expect("written").parse().expect("TOML");
    assert!(by_address["flange_camera"].get("serial").is_none() && by_address["scanner"].get("serial").is_none());
}

#[test]
fn no_file_is_overwritten_and_a_wrong_answer_writes_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    for (command, words) in [
        (
            format!("{CELL} --robot eki --out a.toml"),
            "the controller's address on its KLI network has no answer: give --host",
        ),
        (format!("{CELL} --robot eki --host a..b --out a.toml"), "--host \\\"a..b\\\": robot.host: "),
        (format!("{CELL} --flange-camera gige --out a.toml"), "--flange-camera-serial"),
        ("new recipe --yes --out a.toml".to_owned(), "--panel"),
        (
            "new recipe --yes --panel p --rows many --out a.toml".to_owned(),
            "--rows \\\"many\\\": valid: a whole number from 1 to 50",
        ),
        ("new recipe --yes --panel p --rows 0 --out a.toml".to_owned(), "--rows"),
        ("new recipe --yes --panel p --rows 2.5 --out a.toml".to_owned(), "--rows"),
    ] {
        let (exit, reported) = json(folder, &command);
        assert!(exit == 2 && reported.to_string().contains(words), "{command}: {reported}");
        assert!(!folder.join("a.toml").exists(), "{command}");
    }
    fs::write(folder.join("mine.toml"), "mine").expect("written");
    for command in [format!("{CELL} --out mine.toml"), "new recipe --yes --panel p --out mine.toml".to_owned()] {
        let (exit, reported) = json(folder, &command);
        assert!(
            exit == 2 && reported.to_string().contains("mine.toml already exists and is not overwritten"),
            "{reported}"
        );
        assert_eq!(fs::read_to_string(folder.join("mine.toml")).expect("there"), "mine");
    }
}

#[test]
fn a_recipe_has_the_answers_and_the_samples_comments() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args([
            "new",
            "recipe",
            "--yes",
            "--panel",
            "wing \"left\"",
            "--rows",
            "3",
            "--columns",
            "5",
            "--out",
            "wing.toml",
        ])
        .args([
            "--corners-px",
            "10,20 310.5,20 310,220 10,220",
            "--box-min-mm",
            "-100,-200,50",
            "--disc-diameter-mm",
            "50",
        ])
        .args(["--box-max-mm", "900 300 700"])
        .current_dir(folder)
        .output()
        .expect("it starts");
    assert!(output.status.success(), "{output:?}");
    let text = fs::read_to_string(folder.join("wing.toml")).expect("written");
    let recipe: toml::Table = text.parse().expect("TOML");
    assert_eq!(recipe["panel"].as_str(), Some("wing \"left\""));
    let region = recipe["region"].to_string();
    assert!(region.contains("310.5") && region.contains("rows = 3") && region.contains("columns = 5"), "{region}");
    assert_eq!(recipe["locate"]["box_min_mm"].to_string(), "[-100.0, -200.0, 50.0]");
    assert_eq!(recipe["locate"]["box_max_mm"].to_string(), "[900.0, 300.0, 700.0]");
    assert_eq!(recipe["path"]["disc_diameter_mm"].as_float(), Some(50.0));
    assert!(text.contains("# grids are r1c1 … r3c5 from the first corner"), "{text}");
    assert!(text.contains("# in the taught scan's picture"), "{text}");
    let sample = include_str!("../config/panels/example.toml");
    assert_eq!(text.lines().count(), sample.lines().count(), "line by line the sample");
    let (exit, reported) = check(folder, "wing.toml");
    assert_eq!(exit, 0, "{reported}");
}

/// A recipe contains a force if and only if the cell's tool controls its force.
#[test]
fn a_recipe_for_a_compliant_tool_has_its_force() {
    let folder = tempfile::tempdir().expect("a folder");
    let written = |cell: &str, options: &[&str]| {
        fs::write(folder.path().join("cell.toml"), cell).expect("written");
        let _ = fs::remove_file(folder.path().join("door.toml"));
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(["new", "recipe", "--yes", "--cell", "cell.toml", "--panel", "door", "--out", "door.toml"])
            .args(options)
            .current_dir(folder.path())
            .output()
            .expect("it starts");
        assert!(output.status.success(), "{output:?}");
        let text = fs::read_to_string(folder.path().join("door.toml")).expect("written");
        text.parse::<toml::Table>().expect("TOML")["path"].get("force_n").and_then(toml::Value::as_float)
    };
    let (compliant, spring) = ("[tool]\nkind = \"simulated\"\n", "[tool]\nkind = \"spring\"\n");
    assert_eq!(written(compliant, &[]), Some(20.0), "what is proposed");
    assert_eq!(written(compliant, &["--force-n", "12"]), Some(12.0));
    assert_eq!(written(spring, &[]), None);
    for (cell, force_n, words) in [
        (compliant, "500", "exceeds [tool] max_force_n"),
        (compliant, "-3", "path.force_n: found -3"),
        (spring, "12", "the cell's [tool] is a spring"),
    ] {
        fs::write(folder.path().join("cell.toml"), cell).expect("written");
        let command = format!("new recipe --yes --cell cell.toml --panel door --out no.toml --force-n {force_n}");
        let output = super::commands::panelprep(folder.path(), &command);
        let reported = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && reported.contains(words), "{force_n}: {reported}");
        assert!(!folder.path().join("no.toml").exists());
    }
}

/// Returns the questions and messages that `new cell` prints to a person who gives these answers.
fn printed_questions(folder: &Path, options: &str, answers: &str) -> String {
    let mut child = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args("new cell --no-search --out cell.toml".split(' ').chain(options.split_whitespace()))
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    child.stdin.take().expect("piped").write_all(answers.as_bytes()).expect("typed");
    let output = child.wait_with_output().expect("it ends");
    let asked = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{asked}");
    asked
}

/// An answer that the cell cannot have is refused immediately, and only this question is asked again; the other answers
/// remain.
#[test]
fn an_answer_that_the_cell_cannot_have_is_asked_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let cameras = "simulated\nzivid\nsimulated\ngige\n221600123\n";
    let motion = "0,0,0,0,0,0\n-90,-300,120,0,60,0\n-90,-100,110,0,60,0\n900,-450,50\n\n0.2,-0.4,0\n0.7,0.4,0.9\n\n800,400,900\n";
    let asked = printed_questions(folder, "--robot eki --host 172.31.1.147", &format!("{cameras}{motion}\n"));
    for (words, times) in [
        ("the fixed 3D camera: simulated or zivid [zivid]", 2),
        ("\"simulated\": scanner.kind: found \"simulated\"", 1),
        ("\"simulated\": flange_camera.kind: found \"simulated\"", 1),
        ("\"0,0,0,0,0,0\": all axes at 0 is not a park pose", 1),
        ("\"-90,-300,120,0,60,0\": poses.park.a2_deg: found -300", 1),
        ("limits.box_max_mm: ", 2),
        ("are these metres?", 1),
        ("minimum corner of the box", 3),
        ("the store's folder", 1),
    ] {
        assert_eq!(asked.matches(words).count(), times, "{words}: {asked}");
    }
    let (exit, output) = check(folder, "cell.toml");
    assert_eq!(exit, 0, "{output}");
    let text = fs::read_to_string(folder.join("cell.toml")).expect("written");
    let cell: toml::Table = text.parse().expect("TOML");
    assert_eq!(cell["poses"]["park"]["a2_deg"].as_float(), Some(-100.0));
    assert_eq!(cell["limits"]["box_min_mm"].to_string(), "[250.0, -450.0, 50.0]", "as proposed");
    assert_eq!(cell["limits"]["box_max_mm"].to_string(), "[800.0, 400.0, 900.0]");
    // The poses that the following pages of the manual use are prepared, to be filled in.
    assert!(text.contains("# [poses.ready]") && text.contains("# [poses.verify]"), "{text}");
    // Given as options, the same values are refused with the option's name.
    let real = "--robot eki --host 172.31.1.147 --scanner zivid --flange-camera-serial 1";
    for (given, words) in [
        ("--scanner simulated --robot eki --host 172.31.1.147", "--scanner \"simulated\": scanner.kind: found"),
        ("--scanner zivid --flange-camera simulated --robot eki --host krc", "--flange-camera \"simulated\": "),
        (&format!("{real} --park-deg 0,0,0,0,0,0"), "--park-deg \"0,0,0,0,0,0\": all axes at 0"),
        (&format!("{real} --box-max-mm 1,2,3"), "--box-max-mm \"1,2,3\": limits.box_max_mm: "),
    ] {
        let (exit, output) = json(folder, &format!("{CELL} {given} --out no.toml"));
        let output = output["reasons"].to_string().replace("\\\"", "\"");
        assert!(exit == 2 && output.contains(words), "{given}: {output}");
        assert!(!folder.join("no.toml").exists());
    }
    // A controller on this machine is a mock controller, so the cameras may be simulated.
    let (exit, output) = json(folder, &format!("{CELL} --robot eki --host 127.0.0.1 --out here.toml"));
    assert_eq!(exit, 0, "{output}");
}

/// On the terminal, an empty line accepts the proposal, and after a wrong answer the question is repeated.
#[test]
fn answers_are_read_from_the_terminal() {
    let folder = tempfile::tempdir().expect("a folder");
    let asked = printed_questions(folder.path(), "", "\nkinect\nzivid\ngige\n221600123\n\n");
    assert!(asked.contains("the fixed 3D camera: simulated or zivid [simulated]"), "{asked}");
    assert!(asked.contains("\"kinect\": valid: simulated or zivid"), "{asked}");
    let text = fs::read_to_string(folder.path().join("cell.toml")).expect("written");
    let cell: toml::Table = text.parse().expect("TOML");
    let kind = |table: &str| cell[table]["kind"].as_str().map(str::to_owned);
    assert_eq!(
        ["scanner", "flange_camera", "robot"].map(kind),
        ["zivid", "gige", "mock"].map(|kind| Some(kind.to_owned()))
    );
    assert_eq!(
        (cell["flange_camera"]["serial"].as_str(), cell["store"].as_str()),
        (Some("221600123"), Some("store"))
    );
}

/// An option that would not be used is refused, because a user would expect its value in the file.
#[test]
fn options_of_another_kind_are_refused_by_both_names() {
    let folder = tempfile::tempdir().expect("a folder");
    let simulated = "--scanner simulated --flange-camera simulated --robot mock";
    for (given, words) in [
        ("--host 9.9.9.9", ["--host \"9.9.9.9\"", "--robot mock was chosen"]),
        ("--park-deg nonsense", ["--park-deg \"nonsense\"", "choose --robot eki"]),
        ("--box-min-mm nonsense", ["--box-min-mm", "--robot eki"]),
        ("--box-max-mm 1,2,3", ["--box-max-mm", "--robot eki"]),
        ("--scanner-serial 12", ["--scanner-serial \"12\"", "--scanner simulated was chosen"]),
        ("--flange-camera-serial 12", ["--flange-camera-serial", "--flange-camera gige"]),
        ("--flange-camera-address 10.0.0.9", ["--flange-camera-address", "--flange-camera gige"]),
    ] {
        let (exit, told) = json(folder.path(), &format!("{CELL} {simulated} {given} --out no.toml"));
        let told = told["reasons"].to_string().replace("\\\"", "\"");
        assert!(exit == 2 && words.iter().all(|words| told.contains(words)), "{given}: {told}");
        assert!(!folder.path().join("no.toml").exists());
    }
}
