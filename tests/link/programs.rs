//! The programs as they ship, executed: seeded walks of the real client, in every meaning that public documents leave open.

use super::cell::Cell;
use super::walks::{Weak, walk_over};
use panelprep::devices::mock::Programs;
use panelprep::krl::Meaning;
use rayon::prelude::*;
use std::path::Path;

/// Walks in every run of the tests, and in the bench.
const WALKS: u64 = 300;

/// The texts of a folder's programs and data lists.
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

/// The meaning of this walk: each switch by a bit of its seed. RESUME with `$ADVANCE` other than 0 is left out where the
/// programs are known to need it.
pub fn meaning(seed: u64) -> Meaning {
    let bit = |place: u32| seed >> place & 1 == 1;
    Meaning {
        resume_needs_advance_0: bit(0),
        on_fires_at_once: bit(1),
        short_circuit: bit(2),
        aggregate_keeps_rest: bit(3),
        late_triggers: bit(4),
        lone_approximation_waits: bit(5),
        clear_of_unknown_stops: bit(6),
        immediate_reopen_fails: bit(7),
    }
}

/// One walk of the programs: the cell at its end, and what was wrong.
pub fn walk(seed: u64, programs: &Programs, meaning: Meaning) -> (Cell, Result<(), String>) {
    let programs = Programs { meaning, seed, adverse: true, cold_start: seed % 3 == 0, ..programs.clone() };
    let (cell, mut found) = walk_over(seed, &Weak { programs: Some(programs), ..Weak::default() });
    if let Some(fault) = cell.controller.program_faults().first() {
        found = Err(format!("{fault} ({found:?})"));
    }
    if cell.controller.foreign_resets() > 0 {
        found = Err(format!("a foreign program was reset ({found:?})"));
    }
    (cell, found)
}

#[test]
fn no_walk_of_the_shipped_programs_violates_a_rule() {
    let programs = load(&texts("config/kuka"));
    let walks = std::env::var("KRL_WALKS").ok().and_then(|walks| walks.parse().ok()).unwrap_or(WALKS);
    let mask: u64 = std::env::var("KRL_MASK").ok().and_then(|mask| mask.parse().ok()).unwrap_or(u64::MAX);
    let found: Vec<(u64, String)> = (0..walks)
        .into_par_iter()
        .filter_map(|seed| walk(seed, &programs, meaning(seed & mask)).1.err().map(|violation| (seed, violation)))
        .collect();
    for (seed, violation) in found.iter().take(40) {
        println!("{seed}: {violation}");
    }
    assert_eq!(found.len(), 0, "of {walks}");
}
