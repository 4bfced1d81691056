//! Simulates each fault of the tool's link at waypoints along the whole path, with the program as a user runs it. The
//! mock controller's log gives the time from the fault until the sander is off, or the path leaves the panel by itself,
//! and until the disc is retracted. `cargo bench --bench tool_faults -- [EVERY]`: at every EVERYth waypoint in contact;
//! without a number, every twelfth. Exit code 1 if a target is missed.

#[path = "goal.rs"]
mod goal;

use goal::Figure;
use rayon::prelude::*;
use serde_json::Value;
use std::process::{Command, ExitCode};

/// Maximum time from the fault until the tool's output is off, or until the path leaves the panel, ms.
const MAX_OFF_MS: u64 = 500;
/// The injected faults, and the code with which each must be reported.
const FAULTS: [(&str, &str); 10] = [
    ("link-cut", "tool_link"),
    ("silent", "tool_link"),
    ("late", "tool_link"),
    ("garbage", "tool_link"),
    ("other-id", "tool_link"),
    ("errors", "tool_errors"),
    ("force=12", "force_band"),
    ("force=-12", "force_band or no_contact"),
    ("no-contact", "no_contact"),
    (STUCK, "tool_stuck or no_contact or force_band or tool_stroke"),
];

/// The fault that cannot be detected at once: a tool that is stuck at its expected position differs from a working one
/// only when the surface is no longer at this position.
const STUCK: &str = "stuck";

/// Runs the demo with this injected fault; `None` runs it without a fault.
fn demo(fault: Option<&str>) -> Value {
    let name = fault.unwrap_or("none").replace(['@', '='], "-");
    let folder = std::env::temp_dir().join(format!("panelprep-tool-faults-{}-{name}", std::process::id()));
    let mut command = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    command.args(["demo", "--json", "--seed", "1", "--reduction", "4", "--out"]).arg(&folder);
    if let Some(fault) = fault {
        command.args(["--tool-fault", fault]);
    }
    let output = command.output().expect("the program starts");
    // The result is ignored: a leftover folder is inside of the system's folder for temporary files.
    let _ = std::fs::remove_dir_all(&folder);
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// The result of one run.
struct Row {
    from: u64,
    code: Option<String>,
    off_ms: Option<u64>,
    lifted_ms: Option<u64>,
}

fn row((fault, code): (&str, &str), from: u64) -> Row {
    let result = demo(Some(&format!("{fault}@{from}")));
    let reasons = result["reasons"].as_array().cloned().unwrap_or_default();
    let reported = reasons
        .iter()
        .filter_map(|reason| reason["code"].as_str())
        .find(|reported| code.split(" or ").any(|code| code == *reported));
    let number = |name: &str| result["after_tool_fault"][name].as_u64();
    Row { from, code: reported.map(str::to_owned), off_ms: number("off_ms"), lifted_ms: number("lifted_ms") }
}

fn main() -> ExitCode {
    let every = std::env::args().skip(1).find_map(|argument| argument.parse::<usize>().ok()).unwrap_or(12).max(1);
    let sound = demo(None);
    let passes = sound["abrade"].as_array().cloned().unwrap_or_default();
    let contacts: u64 = passes.iter().filter_map(|pass| pass["waypoints_in_contact"].as_u64()).sum();
    println!("without a fault: {}, {contacts} waypoints in contact; a fault at every {every}th", sound["verdict"]);
    println!(
        "fault        runs  reported by                    sander off ms (median, max)  disc lifted ms (median, max)  missed at"
    );
    let (mut missed, mut longest) = (0, None);
    for fault in FAULTS {
        let places: Vec<u64> = (1..contacts).step_by(every).collect();
        let rows: Vec<Row> = places.par_iter().map(|from| row(fault, *from)).collect();
        missed += line(fault.0, &rows);
        if fault.0 != STUCK {
            // A run without a reported time is treated as later than every limit.
            let ended = rows.iter().map(|row| ended_ms(row).unwrap_or(u64::MAX));
            longest = ended.fold(longest, |longest, ms| Some(longest.unwrap_or(0).max(ms)));
        }
    }
    let found =
        longest.filter(|ms| *ms < u64::MAX).map_or("a run without a time".to_owned(), |ms| format!("{ms} ms"));
    Figure("tool: fault until the sander is off, longest, except \"stuck\"").report(
        &format!("{MAX_OFF_MS} ms"),
        &found,
        longest.is_some_and(|ms| ms <= MAX_OFF_MS),
    );
    println!("{missed} runs missed the target: off within {MAX_OFF_MS} ms and reported with its code");
    if missed == 0 && contacts > 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Returns the time from the fault to the end of the sanding, ms: until the tool was off, or until the path left the
/// panel if this was earlier.
fn ended_ms(row: &Row) -> Option<u64> {
    row.off_ms.or(row.lifted_ms)
}

/// Prints a fault's line; returns the number of runs that missed the target.
fn line(fault: &str, rows: &[Row]) -> usize {
    // A tool that is stuck at its expected position cannot be detected until the surface is no longer at this position;
    // the log does not contain that time.
    let in_time = |row: &Row| fault == STUCK || ended_ms(row).is_some_and(|ms| ms <= MAX_OFF_MS);
    let holds = |row: &&Row| row.code.is_some() && in_time(row);
    let missed: Vec<String> = rows.iter().filter(|row| !holds(row)).map(|row| row.from.to_string()).collect();
    let sorted = |of: fn(&Row) -> Option<u64>| {
        let mut all: Vec<u64> = rows.iter().filter_map(of).collect();
        all.sort_unstable();
        (all.get(all.len() / 2).copied().unwrap_or(0), all.last().copied().unwrap_or(0))
    };
    let (off, lifted) = (sorted(|row| row.off_ms), sorted(|row| row.lifted_ms));
    let mut codes: Vec<&str> = rows.iter().filter_map(|row| row.code.as_deref()).collect();
    codes.sort_unstable();
    codes.dedup();
    println!(
        "{fault:11}  {:4}  {:29}  {:14}, {:11}  {:15}, {:11}  {}",
        rows.len(),
        codes.join(" "),
        off.0,
        off.1,
        lifted.0,
        lifted.1,
        if missed.is_empty() { "-".to_owned() } else { missed.join(" ") }
    );
    missed.len()
}
