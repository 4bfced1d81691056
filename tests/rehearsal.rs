//! Tests a rehearsal: simulated cameras and a mock controller in another process, connected by sockets, in real time.

use super::commands::{json, panelprep, taught_and_verified};
use super::wall::Mock;
use panelprep::cell::ProofStage;
use panelprep::record::{ProofsResult, RequestAuthor, RequestSource};
use panelprep::store::{ProofsPage, Store};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Two of the sixteen ports that a controller's firewall opens; no other test uses them.
const PORTS: [u16; 2] = [54_610, 54_611];
/// Ports of the mock controller that executes an integrator's own programs.
const OWN_PROGRAM_PORTS: [u16; 2] = [54_608, 54_609];

fn replaced(file: &Path, changes: &[(&str, &str)]) {
    let mut text = fs::read_to_string(file).expect("there");
    for (from, to) in changes {
        assert!(text.contains(from), "{from}: {text}");
        text = text.replacen(from, to, 1);
    }
    fs::write(file, text).expect("written");
}

/// Runs a whole cycle with the shortest films that allow a verdict. The film holds at the places that were sanded over
/// the sockets.
#[test]
fn a_whole_cycle_by_the_wall_clock_passes_after_abrasion() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (exit, told) = json(folder, "render --seed 3 --reduction 4 --seconds 10 --out cell");
    assert_eq!(exit, 0, "{told}");
    let ports = format!("command_port = {}\nstate_port = {}", PORTS[0], PORTS[1]);
    let robot = format!("kind = \"eki\"\nhost = \"127.0.0.1\"\n{ports}");
    replaced(&folder.join("cell/cell.toml"), &[("kind = \"mock\"", &robot)]);
    let short = "frames_per_second = 5.0\nspray_s = 4.0\nrinse_s = 1.0\ndrain_s = 0.5";
    replaced(&folder.join("cell/recipe.toml"), &[("frames_per_second = 5.0", short)]);
    taught_and_verified(folder);

    let (exit, told) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3");
    // A controller that does not answer may be a real one.
    let refused = told["reasons"][0]["code"].as_str();
    assert_eq!((exit, refused), (2, Some("stage_not_signed")), "no controller yet: {told}");

    // Without `--config`, the mock controller uses the ports in the cell's file.
    let mock = Mock::start_with(folder, "mock-robot --cell cell/cell.toml", PORTS);
    let (exit, told) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3");
    assert_eq!((exit, told["verdict"].as_str()), (0, Some("pass")), "{told}");
    assert!(told["abraded"].as_array().is_some_and(|grids| !grids.is_empty()), "{told}");
    assert!(mock.count_lines("in contact") > 10, "the arm in the other process did it");
}

/// A simulated camera must never be used while a real arm moves, whatever the address of the arm is.
#[test]
fn simulated_cameras_are_refused_with_a_remote_robot() {
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

/// A real controller receives no path in automatic mode before the acceptance tests that the path requires are signed.
#[test]
fn a_path_on_a_real_controller_needs_the_signed_stage() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    assert_eq!(json(folder, "render --seed 3 --reduction 8 --seconds 5 --out cell").0, 0);
    let file = folder.join("cell/cell.toml");
    let shipped = fs::read_to_string(&file).expect("rendered");
    let recorded = shipped.replace("kind = \"simulated\"", "kind = \"recorded\"\nfolder = \".\"");
    assert_eq!(recorded.matches("\"recorded\"").count(), 2, "both cameras");
    let said = |signed: &str, command: &str| {
        let robot = format!("kind = \"eki\"\nhost = \"192.0.2.1\"\nprograms_sum = 1\n{signed}");
        fs::write(&file, recorded.replace("kind = \"mock\"", &robot)).expect("written");
        let (exit, output) = json(folder, &format!("{command} --recipe cell/recipe.toml --cell cell/cell.toml"));
        assert_eq!(exit, 2, "nothing is taught: {output}");
        output["reasons"][0].to_string()
    };
    for (signed, command, needed) in [
        ("", "air-run", "requires a signed stage A"),
        ("", "cycle --on-foam", "requires a signed stage B"),
        ("signed_stage = \"A\"", "cycle --on-foam", "requires a signed stage B"),
        ("signed_stage = \"B\"", "cycle", "requires a signed stage C"),
    ] {
        let words = said(signed, command);
        assert!(words.contains("stage_not_signed") && words.contains(needed), "{signed} {command}: {words}");
    }
    for (stage, signed, command) in [
        (ProofStage::A, "signed_stage = \"A\"", "air-run"),
        (ProofStage::B, "signed_stage = \"B\"", "cycle --on-foam"),
        (ProofStage::C, "signed_stage = \"C\"", "cycle"),
    ] {
        // The stage is written in the cell's file, but the store contains no signed page of these programs.
        assert!(said(signed, command).contains("stage_not_signed"), "{signed} {command}");
        let who = RequestAuthor::from_source(RequestSource::Command);
        for (programs_sum, counts) in [(2, false), (1, true)] {
            let (page_sha256, by) = ("ab".repeat(32), "Ada".to_owned());
            let page = ProofsPage { stage, programs_sum, page_sha256, by, result: ProofsResult::Signed };
            Store::store_proofs_in(&folder.join("cell/store"), &page, who.clone()).expect("stored");
            assert_eq!(!said(signed, command).contains("stage_not_signed"), counts, "{signed} {programs_sum}");
        }
        let words = said(signed, command);
        assert!(!words.contains("signed"), "{signed} {command}: {words}");
    }
    assert!(said("", "air-run --on-foam").contains("an air-run has no contact"));
}

/// An integrator's own programs run together with the shipped ones. Statements that the mock does not execute are
/// listed at the start, and a call that reaches such a statement ends at its line.
#[test]
fn own_programs_are_executed_and_unsupported_lines_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("cell.toml"), include_str!("../config/cell.toml")).expect("written");
    let changes = [
        ("kind = \"mock\" ", "kind = \"eki\" "),
        ("controller = \"programs\"", "host = \"127.0.0.1\""),
        ("54600", &OWN_PROGRAM_PORTS[0].to_string()),
        ("54601", &OWN_PROGRAM_PORTS[1].to_string()),
    ];
    replaced(&folder.join("cell.toml"), &changes);
    // The inputs and outputs are those of the integrator's cell_config.dat.
    let text = fs::read_to_string(folder.join("cell.toml")).expect("there");
    let mut cell: toml_edit::DocumentMut = text.parse().expect("TOML");
    for table in ["outputs", "feedbacks"] {
        let numbers = cell["io"][table].as_table_mut().expect("a table");
        numbers.iter_mut().zip(17..).for_each(|((_, item), number)| *item = toml_edit::value(number));
    }
    fs::write(folder.join("cell.toml"), cell.to_string()).expect("written");
    let own = folder.join("own");
    fs::create_dir(&own).expect("a folder");
    fs::write(own.join("cell_config.dat"), include_str!("../config/kuka/cell_config.dat")).expect("written");
    replaced(&own.join("cell_config.dat"), &[("CELL_USER_N=1", "CELL_USER_N=3"), ("REVISION=1", "REVISION=2")]);
    fs::write(own.join("cell_user.src"), include_str!("../config/kuka/cell_user.src")).expect("written");
    let calls = "      CELL_USER_0( )\n    CASE 1\n      BLOW( )\n    CASE 2\n      ROUND( )\n";
    replaced(&own.join("cell_user.src"), &[("      CELL_USER_0( )\n", calls)]);
    let routines = "\nDEF BLOW( )\n  $OUT[301]=TRUE\n  WAIT SEC 0.05\nEND\n\nDEF ROUND( )\n  WAIT SEC 0\n  \
                    CIRC $POS_ACT,$POS_ACT,CA 90\nEND\n";
    let text = fs::read_to_string(own.join("cell_user.src")).expect("there") + routines;
    let circle = 1 + text[..text.find("CIRC").expect("there")].matches('\n').count();
    // The file has the encoding of a pendant's editor.
    let latin: Vec<u8> = format!("{text}; f\u{fc}r\n").chars().map(|sign| sign as u8).collect();
    fs::write(own.join("cell_user.src"), latin).expect("written");

    let mut mock = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    let mock = mock.args("mock-robot --cell cell.toml --programs own".split(' ')).current_dir(folder);
    let mut mock = Running(mock.stderr(Stdio::piped()).spawn().expect("it starts"));
    let mut lines = BufReader::new(mock.0.stderr.take().expect("piped")).lines().map_while(Result::ok);
    let note = lines.next().expect("a line");
    assert!(note.contains(&format!("own/cell_user.src:{circle}: ")) && note.contains("CIRC"), "{note}");
    assert!(lines.next().is_some_and(|line| line.starts_with("mock controller: ")), "one note alone");
    let call = |index: u8| json(folder, &format!("robot call {index} --cell cell.toml"));
    let (exit, reported) = call(1);
    assert_eq!(exit, 0, "{reported}");
    assert!(lines.any(|line| line.contains("outputs on: ") && line.contains("301")), "its own output");
    let (exit, reported) = call(2);
    assert_eq!(exit, 3, "{reported}");
    let stopped = lines.find(|line| line.contains("the KRL programs stopped")).expect("told");
    assert!(stopped.contains("cell_user.src") && stopped.contains(&circle.to_string()), "{stopped}");
    drop(mock);

    // Code that a controller would refuse is refused with its position in the file, and a folder without programs with
    // the folder's name.
    replaced(&own.join("cell_config.dat"), &[("CELL_USER_N=3", "CELL_USER_N=")]);
    fs::create_dir(folder.join("empty")).expect("a folder");
    let text = fs::read_to_string(own.join("cell_config.dat")).expect("there");
    let line = 1 + text[..text.find("CELL_USER_N=").expect("there")].matches('\n').count();
    let position = format!("own/cell_config.dat:{line}: ");
    for (of, words) in [("own", position.as_str()), ("empty", "empty: has no .src, .sub or .dat file")] {
        let output = panelprep(folder, &format!("mock-robot --cell cell.toml --programs {of}"));
        let reported = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && reported.contains(words), "{reported}");
    }
}

/// A child process that is killed when the test ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
