//! Executes the shipped programs in random walks of the real client, with every variant of behaviour that public
//! documents leave open.

mod before;
mod both;
mod coverage;
mod mistakes;
mod raw;
mod scenes;

use super::cell::{Cell, height_mm};
use super::walks::{Weak, walk_over};
pub use coverage::Coverage;
use panelprep::devices::mock::Programs;
use panelprep::krl::UndocumentedBehaviour;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;

/// Number of walks in each test run.
const WALKS: u64 = 2_000;
/// Minimum number of walks for which every statement must be executed.
const MIN_WALKS_FOR_FULL_COVERAGE: u64 = 2_000;

/// Returns the texts of the programs and data lists in a folder.
pub fn texts(folder: &str) -> Vec<(String, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|ending| ending == "src" || ending == "dat") {
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            found.push((name, std::fs::read_to_string(&path).expect("a text")));
        }
    }
    found.sort();
    found
}

pub fn load(texts: &[(String, String)]) -> Programs {
    let named: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    Programs::load(&named).expect("right programs")
}

/// Returns the variant of undocumented behaviour for this walk: each switch is a bit of the seed, so that 1,024 walks
/// cover all combinations.
pub fn behaviour_variant(seed: u64) -> UndocumentedBehaviour {
    let bit = |place: u32| seed >> place & 1 == 1;
    UndocumentedBehaviour {
        resume_needs_advance_0: bit(0),
        on_fires_at_once: bit(1),
        short_circuit: bit(2),
        aggregate_keeps_rest: bit(3),
        late_triggers: bit(4),
        lone_approximation_waits: bit(5),
        clear_of_unknown_stops: bit(6),
        immediate_reopen_fails: bit(7),
        triggers_get_lost: bit(8),
        stops_late: bit(9),
    }
}

/// Runs one walk of the programs; returns the cell at its end, and the first violated requirement.
pub fn walk(seed: u64, programs: &Programs, meaning: UndocumentedBehaviour) -> (Cell, Result<(), String>) {
    let mut programs = programs.clone();
    (programs.meaning, programs.seed, programs.is_adverse_scheduling) = (meaning, seed, true);
    programs.cold_start = seed.is_multiple_of(3);
    // The submit interpreter executes several rounds in one tick.
    programs.busy_submit = seed % 64 == 7;
    programs.uptime_ms = if seed.is_multiple_of(5) { (1 << 31) - 6_000 } else { 0 };
    let (cell, mut found) = walk_over(seed, &Weak { programs: Some(programs), ..Weak::default() });
    if let Some(fault) = cell.controller.program_faults().first() {
        found = Err(format!("{fault} ({found:?})"));
    }
    if cell.controller.foreign_program_resets() > 0 {
        found = Err(format!("a foreign program was reset ({found:?})"));
    }
    (cell, found)
}

/// Runs the walks of these seeds; returns those that violate a requirement, and the executed statements and branches.
pub fn run_walks(seeds: Range<u64>, mask: u64, programs: &Programs) -> (Vec<(u64, String)>, Coverage) {
    let walked = seeds.into_par_iter().map(|seed| {
        let (cell, found) = walk(seed, programs, behaviour_variant(seed & mask));
        let wrong: Vec<(u64, String)> = found.err().map(|violation| (seed, violation)).into_iter().collect();
        (wrong, Coverage::from_controller(&cell.controller))
    });
    let none = || (Vec::new(), Coverage::default());
    let (mut found, covered) = walked.reduce(none, |(mut wrong, covered), (more, other)| {
        wrong.extend(more);
        (wrong, covered.with(&other))
    });
    found.sort();
    (found, covered)
}

/// For more walks, set `KRL_WALKS=20000`; to start at another seed, `KRL_FROM=5000`. To see the end of one walk:
/// `KRL_SEED=148`. With fewer variants of undocumented behaviour: `KRL_MASK=0`.
#[test]
fn no_walk_of_the_shipped_programs_violates_a_rule() {
    let shipped = texts("config/kuka");
    let programs = load(&shipped);
    let walks = std::env::var("KRL_WALKS").ok().and_then(|walks| walks.parse().ok()).unwrap_or(WALKS);
    let mask: u64 = std::env::var("KRL_MASK").ok().and_then(|mask| mask.parse().ok()).unwrap_or(u64::MAX);
    let from = std::env::var("KRL_FROM").ok().and_then(|from| from.parse().ok()).unwrap_or(0);
    let (found, covered) = run_walks(from..walks, mask, &programs);
    let missing = covered.print(&programs, &shipped);
    for (seed, violation) in found.iter().take(40) {
        println!("{seed}: {violation}");
    }
    if let Some(seed) = std::env::var("KRL_SEED").ok().and_then(|seed| seed.parse().ok()) {
        let (cell, found) = walk(seed, &programs, behaviour_variant(seed & mask));
        let controller = &cell.controller;
        println!("{found:?} {:?} {:?}", controller.robot_state(), controller.program_places());
        for stop in controller.program_stops().iter().rev().take(3) {
            println!("{stop:?}");
        }
        for step in controller.executed_motions().iter().rev().take(3) {
            println!("{} ms: {} of epoch {}, contact {}", step.time_ms, step.id, step.epoch, step.contact);
        }
        println!("{:.2} mm above the panel", height_mm(controller));
        for name in [
            "CELL_EP",
            "CELL_OPEN",
            "CELL_STOPPED",
            "CELL_RX",
            "CELL_TAKEN",
            "CELL_DONE",
            "CELL_RUN_EP",
            "CELL_DEAD_EP",
            "CELL_QR",
            "CELL_QW",
            "CELL_BEHIND",
            "CELL_RETRACT",
            "CELL_BELOW",
            "CELL_READY",
            "CELL_RESET_DUE",
            "CELL_ERR",
            "CELL_NAK",
        ] {
            print!("{name} {:?} ", controller.shared(name));
        }
        println!("{:?}", controller.flags());
    }
    assert_eq!(found.len(), 0, "of {walks}");
    assert!(
        walks - from < MIN_WALKS_FOR_FULL_COVERAGE || missing.is_empty(),
        "no walk has executed these: {missing:?}"
    );
}

/// An undone fix: the file, the shipped text, the earlier text, and the variant of the controller's behaviour.
struct Undone {
    name: &'static str,
    file: &'static str,
    ships: &'static str,
    before: &'static str,
    meaning: fn(&mut UndocumentedBehaviour),
    /// The seed of a walk that shows the fault.
    seed: u64,
}

/// Loads the shipped programs with the earlier text of this fix.
fn undo(undone: &Undone) -> Programs {
    let mut texts = texts("config/kuka");
    let (_, text) = texts.iter_mut().find(|(name, _)| name == undone.file).expect("a file");
    assert!(text.contains(undone.ships), "{}: {} is not in {}", undone.name, undone.ships, undone.file);
    *text = text.replace(undone.ships, undone.before);
    load(&texts)
}
