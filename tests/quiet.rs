//! Tests what a command prints if its output is not read, and that it prints nothing twice.

use super::commands::{json, taught_and_verified};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// Runs a command whose standard output, and also standard error if `both` is set, has no reader. Returns its exit code
/// and the text that it printed nevertheless.
fn unread(folder: &Path, arguments: &str, both: bool) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    command.args(arguments.split_whitespace()).current_dir(folder).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    drop(child.stdout.take());
    if both {
        drop(child.stderr.take());
    }
    let output = child.wait_with_output().expect("it ends");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_reader_that_closes_its_end_ends_no_command() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("cell.toml"), include_str!("../config/cell.toml")).expect("written");
    for (arguments, code) in [
        ("check cell.toml", 0),
        ("check cell.toml --json", 0),
        ("check missing.toml", 2),
        ("check missing.toml --json", 2),
        ("doctor --cell cell.toml", 1),
        ("--help", 0),
        ("render --reduction 8 --seconds 5 --out cell", 0),
    ] {
        let (exit, said) = unread(folder, arguments, false);
        assert!(!said.contains("panicked") && !said.contains("Broken pipe"), "{arguments}: {said}");
        assert_eq!(exit, Some(code), "{arguments}: {said}");
        assert_eq!(unread(folder, arguments, true).0, Some(code), "{arguments}, no stream is read");
    }
    // A full disk is not treated like a reader that has closed the pipe.
    let full = fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let mut command = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    let output = command.args(["check", "cell.toml"]).current_dir(folder).stdout(full).output().expect("it ends");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("cannot be written"), "{output:?}");
}

/// A mock controller on other ports than those in the cell's file is refused, because the cell would not find it.
#[test]
fn a_mock_on_other_ports_than_its_cell_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let text =
        include_str!("../config/cell.toml").replace("kind = \"mock\"", "kind = \"eki\"\nhost = \"127.0.0.1\"");
    let text = text.replace("command_port = 54600", "command_port = 54607");
    fs::write(folder.join("cell.toml"), text).expect("written");
    let kuka = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/kuka");
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["mock-robot", "--cell", "cell.toml", "--config"])
        .arg(kuka)
        .current_dir(folder)
        .output()
        .expect("it ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("54600 and 54601") && said.contains("54607 and 54601"), "{said}");
}

/// For a cell without calibrations, the message names the command that creates them.
#[test]
fn the_shipped_cell_names_the_commands_that_complete_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::create_dir(folder.join("config")).expect("a folder");
    fs::write(folder.join("config/cell.toml"), include_str!("../config/cell.toml")).expect("written");
    for arguments in ["run", "cycle --recipe recipe.toml", "air-run --recipe recipe.toml"] {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(arguments.split_whitespace())
            .current_dir(folder)
            .output()
            .expect("it ends");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains("scanner.toml, which does not exist") && said.contains("`panelprep demo`"), "{said}");
    }
    let (exit, reported) = json(folder, "check config/cell.toml");
    let warnings = reported["files"][0]["warnings"].as_array().expect("warnings");
    assert_eq!((exit, warnings.len()), (0, 1), "one sentence for all of them: {reported}");
    let keys = warnings[0]["key"].as_str().expect("keys");
    assert!(warnings[0]["line"].as_u64() > Some(1) && keys.starts_with("calibration.scanner, "), "{reported}");
    // If the check is for a cycle, each missing calibration is a problem, and the command that creates them is named
    // once.
    let (exit, reported) = json(folder, "check --for cycle config/cell.toml");
    let errors = reported["files"][0]["errors"].as_array().expect("errors");
    assert_eq!((exit, errors.len()), (1, keys.split(", ").count()), "{reported}");
    assert_eq!(reported.to_string().matches("`panelprep demo`").count(), 1, "{reported}");
    assert_eq!(json(folder, "check --for robot config/cell.toml").0, 0);
    // Every file with a decimal comma is refused with a message that shows the correction.
    fs::write(folder.join("comma.toml"), "[limits]\ntool_error_mm = 0,8\n").expect("written");
    let (_, reported) = json(folder, "check comma.toml --for files");
    let message = reported["files"][0]["errors"][0]["message"].as_str().unwrap_or_default().to_owned();
    assert_eq!(message, "found 0,8; a number has a decimal point: write 0.8", "{reported}");
}

#[test]
fn an_air_run_states_each_state_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    assert_eq!(json(folder, "render --seed 3 --scene clean --reduction 4 --seconds 5 --out cell").0, 0);
    taught_and_verified(folder);
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args("air-run --cell cell/cell.toml --recipe cell/recipe.toml --seed 3 --scene clean".split_whitespace())
        .current_dir(folder)
        .output()
        .expect("it ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("locating the panel") && !said.contains("execute, locate"), "{said}");
    assert_eq!(said.matches("starting").count(), 1, "{said}");
}
