//! A rehearsal: simulated cameras and a mock controller in another process, by the wall clock and over sockets.

use super::commands::{json, taught_and_verified};
use super::wall::Mock;
use std::fs;
use std::path::Path;
use std::process::Command;

/// Of the sixteen that a controller's firewall leaves open; no other test has them.
const PORTS: [u16; 2] = [54_610, 54_611];

fn replaced(file: &Path, changes: &[(&str, &str)]) {
    let mut text = fs::read_to_string(file).expect("there");
    for (from, to) in changes {
        assert!(text.contains(from), "{from}: {text}");
        text = text.replacen(from, to, 1);
    }
    fs::write(file, text).expect("written");
}

/// The smallest films that a verdict can be made of: what is sanded over the sockets holds its film afterwards.
#[test]
fn a_whole_cycle_by_the_wall_clock_passes_after_abrasion() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (exit, told) = json(folder, "render --seed 3 --reduction 4 --seconds 10 --out cell");
    assert_eq!(exit, 0, "{told}");
    let ports = format!("command_port = {}\nstate_port = {}", PORTS[0], PORTS[1]);
    let robot = format!("kind = \"eki\"\nhost = \"127.0.0.1\"\n{ports}");
    replaced(&folder.join("cell/cell.toml"), &[("kind = \"mock\"", &robot)]);
    let short = "frames_per_second = 2.0\nspray_s = 4.0\nrinse_s = 1.0\ndrain_s = 0.5";
    replaced(&folder.join("cell/recipe.toml"), &[("frames_per_second = 5.0", short)]);
    taught_and_verified(folder);

    let (exit, told) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3");
    assert_eq!((exit, told["state"].as_str()), (3, Some("stopped")), "no controller yet: {told}");

    // No --config: on the ports of the cell's file.
    let mock = Mock::start_with(folder, "mock-robot --cell cell/cell.toml", PORTS);
    let (exit, told) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3");
    assert_eq!((exit, told["verdict"].as_str()), (0, Some("pass")), "{told}");
    assert!(told["abraded"].as_array().is_some_and(|grids| !grids.is_empty()), "{told}");
    assert!(mock.told("in contact") > 10, "the arm in the other process did it");
}

/// A simulated camera must never look on while a real arm moves, whatever its address looks like.
#[test]
fn simulated_cameras_beside_a_robot_elsewhere_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    assert_eq!(json(folder, "render --seed 3 --reduction 8 --seconds 5 --out cell").0, 0);
    let elsewhere = "kind = \"eki\"\nhost = \"172.31.1.147\"";
    replaced(&folder.join("cell/cell.toml"), &[("kind = \"mock\"", elsewhere)]);
    for command in ["cycle --recipe cell/recipe.toml", "air-run --recipe cell/recipe.toml", "run"] {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(format!("{command} --cell cell/cell.toml").split_whitespace())
            .current_dir(folder)
            .output()
            .expect("it starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{command}: {said}");
        assert!(said.contains("scanner.kind: found \"simulated\"") && said.contains("172.31.1.147"), "{said}");
    }
    let (exit, told) = json(folder, "check cell/cell.toml");
    assert_eq!((exit, &told["files"][0]["ok"]), (1, &serde_json::Value::Bool(false)), "{told}");
}
