//! The programs as they ship, executed: seeded walks of the real client, in every meaning that public documents leave open.

use super::cell::{Cell, setup};
use super::walks::{Weak, walk_over};
use panelprep::devices::mock::{self, Clock, Controller, Programs, RobotState, Setup, Unwired};
use panelprep::krl::Meaning;
use rayon::prelude::*;
use std::path::Path;

/// Walks in every run of the tests, and in the bench.
const WALKS: u64 = 120;

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
    let mut programs = programs.clone();
    (programs.meaning, programs.seed, programs.adverse) = (meaning, seed, true);
    programs.cold_start = seed.is_multiple_of(3);
    let (cell, mut found) = walk_over(seed, &Weak { programs: Some(programs), ..Weak::default() });
    if let Some(fault) = cell.controller.program_faults().first() {
        found = Err(format!("{fault} ({found:?})"));
    }
    if cell.controller.foreign_resets() > 0 {
        found = Err(format!("a foreign program was reset ({found:?})"));
    }
    (cell, found)
}

/// More walks: `KRL_WALKS=5000`. What one looks like at its end: `KRL_SEED=148`. In fewer meanings: `KRL_MASK=0`.
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
    if let Some(seed) = std::env::var("KRL_SEED").ok().and_then(|seed| seed.parse().ok()) {
        let (cell, found) = walk(seed, &programs, meaning(seed & mask));
        let controller = &cell.controller;
        println!("{found:?} {:?} {:?}", controller.robot_state(), controller.program_places());
        for stop in controller.stops().iter().rev().take(3) {
            println!("{stop:?}");
        }
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
}

/// A mend, undone: the file, the text that ships, the text of before, and how the controller is asked to behave.
struct Undone {
    name: &'static str,
    file: &'static str,
    ships: &'static str,
    before: &'static str,
    meaning: fn(&mut Meaning),
    /// Walks that show it.
    seeds: std::ops::Range<u64>,
}

/// The text of before, in the programs that ship.
fn undo(undone: &Undone) -> Programs {
    let mut texts = texts("config/kuka");
    let (_, text) = texts.iter_mut().find(|(name, _)| name == undone.file).expect("a file");
    assert!(text.contains(undone.ships), "{}: {} is not in {}", undone.name, undone.ships, undone.file);
    *text = text.replace(undone.ships, undone.before);
    load(&texts)
}

const UNDONE: [Undone; 6] = [
    Undone {
        name: "another program is reset",
        file: "cell_submit.src",
        ships: "CELL_RESET_DUE=CELL_READY\n",
        before: "CELL_RESET_DUE=TRUE\n",
        meaning: |_| {},
        seeds: 150..151,
    },
    Undone {
        name: "a stop in contact without a retract",
        file: "cell_motion.src",
        ships: "    IF CELL_BEHIND AND (NOT $FLAG[CELL_F_HALT]) THEN\n      CELL_RETRACT=TRUE\n    ENDIF\n",
        before: "",
        meaning: |_| {},
        seeds: 314..315,
    },
    Undone {
        name: "RESUME with $ADVANCE at 3",
        file: "cell_motion.src",
        ships: "    $ADVANCE=0\n    RESUME\n",
        before: "    RESUME\n",
        meaning: |meaning| meaning.resume_needs_advance_0 = true,
        seeds: 0..1,
    },
    Undone {
        name: "$POS_ACT of a program that is gone",
        file: "cell_tell.src",
        ships: "  IF CELL_READY AND (VARSTATE(\"$POS_ACT\")==#INITIALIZED) THEN\n    ; The program may be cancelled right \
                here: zeros then.\n    ON_ERROR_PROCEED\n",
        before: "  IF CELL_READY THEN\n",
        meaning: |_| {},
        seeds: 5..6,
    },
    Undone {
        name: "EKI_Clear of a channel that was never initialised",
        file: "cell_link.src",
        ships: "  IF CELL_CMD_MADE THEN\n    RET=EKI_Clear(\"CELLCMD\")\n  ENDIF\n",
        before: "  RET=EKI_Clear(\"CELLCMD\")\n",
        meaning: |meaning| meaning.clear_of_unknown_stops = true,
        seeds: 0..1,
    },
    Undone {
        name: "a late trigger counts the next motion",
        file: "cell_motion.src",
        ships: "  IF CELL_QR<CELL_QW THEN\n    WAIT SEC 0.06\n  ENDIF\n",
        before: "",
        meaning: |meaning| meaning.late_triggers = true,
        seeds: 198..199,
    },
];

/// Each fault that a reading of the programs found is shown by a walk over the text of before, and by none over the text
/// that ships, in the same meaning.
#[test]
fn each_mend_is_missed_where_it_is_undone() {
    let ships = load(&texts("config/kuka"));
    let mut unseen = Vec::new();
    for undone in &UNDONE {
        let mut meaning = Meaning::default();
        (undone.meaning)(&mut meaning);
        let programs = undo(undone);
        let found = undone
            .seeds
            .clone()
            .into_par_iter()
            .find_map_any(|seed| walk(seed, &programs, meaning).1.err().map(|violation| (seed, violation)));
        println!("{}: {found:?}", undone.name);
        match found {
            None => unseen.push(undone.name),
            Some((seed, _)) => {
                let mended = walk(seed, &ships, meaning).1;
                assert_eq!(mended, Ok(()), "{}: seed {seed} over the text that ships", undone.name);
            }
        }
    }
    assert_eq!(unseen, Vec::<&str>::new(), "undone, and every walk is green");
}

/// A controller with these programs, its channels open.
fn started(programs: Programs) -> Controller {
    let setup = Setup { programs: Some(programs), ..setup(Clock::Free) };
    let mut controller = Controller::new(setup, Box::new(Unwired)).expect("starts");
    controller.advance_ms(600);
    assert_eq!(controller.robot_state(), Some(RobotState::Active));
    controller
}

/// Comes and goes between two cycles; then someone tries for 10 s.
fn comes_back(programs: Programs) -> bool {
    let mut controller = started(programs);
    for channel in [mock::Channel::Command, mock::Channel::State] {
        assert!(controller.connect(channel));
        controller.disconnect(channel);
        assert!(!controller.connect(channel), "a lost channel does not open by itself");
    }
    (0..100).any(|_| {
        controller.advance_ms(100);
        [mock::Channel::Command, mock::Channel::State].into_iter().all(|channel| controller.connect(channel))
    })
}

/// Only a client that was seen was missed, before; a channel whose client nobody saw stayed closed for ever.
#[test]
fn a_client_that_vanishes_within_a_cycle_closes_no_channel_for_good() {
    let ships = "    CELL_LOST( )\n    CELL_OPEN_CMD( )\n    CELL_OPEN_STAT( )\n";
    let before = "    IF CELL_CMD_WAS OR (NOT CELL_CMD_UP) THEN\n      CELL_LOST( )\n      CELL_OPEN_CMD( )\n    ENDIF\n    \
                  IF CELL_STAT_WAS OR (NOT CELL_STAT_UP) THEN\n      CELL_LOST( )\n      CELL_OPEN_STAT( )\n    ENDIF\n";
    let undone = Undone { name: "", file: "cell_link.src", ships, before, meaning: |_| {}, seeds: 0..1 };
    assert!(!comes_back(undo(&undone)), "the text of before");
    for immediate_reopen_fails in [false, true] {
        let mut programs = load(&texts("config/kuka"));
        programs.meaning = Meaning { immediate_reopen_fails, ..Meaning::default() };
        assert!(comes_back(programs), "{immediate_reopen_fails}");
    }
}

/// Someone else's program, stopped by the drives, stands where it was stopped.
#[test]
fn a_foreign_program_is_left_alone() {
    let resets = |programs: Programs| {
        let mut controller = started(programs);
        controller.select_foreign_program();
        controller.advance_ms(2_000);
        assert_eq!(controller.robot_state(), Some(RobotState::Active));
        controller.switch_drives(false);
        controller.advance_ms(1_000);
        controller.switch_drives(true);
        (controller.foreign_resets(), controller.robot_state())
    };
    assert_eq!(resets(load(&texts("config/kuka"))), (0, Some(RobotState::Stopped)));
    assert_eq!(resets(undo(&UNDONE[0])).0, 1, "the text of before");
}
