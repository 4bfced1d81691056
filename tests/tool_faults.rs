//! Tests faults of the simulated compliant tool in contact, with the program as a user runs it. The sander is switched
//! off in time, the cycle is held with the tool's own reason, and the page states which grids were touched. `make
//! bench-tool-faults` injects every fault along the whole path.

use super::commands::json;
use serde_json::Value;
use std::fs;

/// Maximum time from the fault until the tool's output is off, ms.
const MAX_SWITCH_OFF_MS: u64 = 500;

fn codes(result: &Value) -> Vec<&str> {
    let reasons = result["reasons"].as_array().expect("a list");
    reasons.iter().filter_map(|reason| reason["code"].as_str()).collect()
}

#[test]
fn a_tool_that_fails_in_contact_is_off_in_time_and_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let faults = [
        ("silent@40", "tool_link"),
        ("force=-12@3", "no_contact"),
        ("force=12@60", "force_band"),
        ("no-contact@90", "no_contact"),
    ];
    for (fault, code) in faults {
        let name = fault.replace(['@', '='], "_");
        let (exit, result) =
            json(folder.path(), &format!("demo --seed 1 --reduction 4 --tool-fault {fault} --out {name}"));
        assert_eq!((exit, result["verdict"].as_str()), (3, Some("aborted")), "{fault}: {}", result["reasons"]);
        assert!(codes(&result).contains(&code), "{fault}: {:?}", codes(&result));
        let after = &result["after_tool_fault"];
        let off_ms = after["off_ms"].as_u64().expect("the sander was on and is off");
        assert!(off_ms > 0 && off_ms <= MAX_SWITCH_OFF_MS, "{fault}: {after}");
        assert!(after["lifted_ms"].as_u64().is_some_and(|lifted| lifted >= off_ms), "{fault}: {after}");
        assert!(!codes(&result).contains(&"waypoints"), "{fault}: {}", result["reasons"]);
        let part = |reason: &&Value| reason["code"] == "part";
        let part = result["reasons"].as_array().and_then(|all| all.iter().find(part)).expect("how far it came");
        let page = fs::read_to_string(folder.path().join(&name).join("index.html")).expect("a page");
        assert!(page.contains(part["message"].as_str().expect("words")), "{fault}: the page says so: {part}");
    }
}

/// The message for a wrong fault name states the valid form, and a fault requires a compliant tool.
#[test]
fn a_fault_needs_a_name_and_a_simulated_tool() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = |arguments: &str| super::commands::panelprep(folder.path(), arguments);
    let told = run("demo --tool-fault mute@3 --out a");
    let text = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(!told.status.success() && text.contains("silent@40") && text.contains("mute@3"), "{text}");
    let told = run("demo --tool spring --tool-fault silent@3 --reduction 4 --out b");
    let text = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(!told.status.success() && text.contains("--tool-fault needs"), "{text}");
}
