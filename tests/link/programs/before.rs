//! Faults that a review of the programs found. The earlier programs are stored in `fixtures/kuka_before`. A run with
//! the earlier programs shows each fault; the same run with the shipped programs does not.

use super::super::cell::TOOL_OUTPUT;
use super::raw::{Raw, started};
use super::scenes::is_left_in_contact;
use super::{Undone, load, texts, undo, walk};
use panelprep::devices::mock::{Channel, Controller, Mode, Programs, RobotState};
use panelprep::krl::{Kss, Op, UndocumentedBehaviour, analyse, parse};
use rayon::prelude::*;

const EARLIER_FOLDER: &str = "fixtures/kuka_before";
const SHIPPED_FOLDER: &str = "config/kuka";

/// Loads the earlier programs and the shipped programs, with this variant of undocumented behaviour.
fn both(meaning: UndocumentedBehaviour) -> [Programs; 2] {
    [EARLIER_FOLDER, SHIPPED_FOLDER].map(|folder| {
        let mut programs = load(&texts(folder));
        programs.meaning = meaning;
        programs
    })
}

/// Faults that a random walk shows, each with one variant of a behaviour that public documents leave open: the walk
/// over the earlier programs gives this error.
#[test]
fn random_walks_find_the_faults_before_the_repair() {
    let standard = UndocumentedBehaviour::default();
    let rows: [(&str, UndocumentedBehaviour, u64, &str); 2] = [
        (
            "RESUME with $ADVANCE at 3",
            UndocumentedBehaviour { resume_needs_advance_0: true, ..standard },
            0,
            "RESUME needs $ADVANCE",
        ),
        ("$POS_ACT of a program that is gone", standard, 8, "$POS_ACT has no value"),
    ];
    for (name, meaning, seed, words) in rows {
        let [before, ships] = both(meaning);
        let anew: Option<u64> = std::env::var("KRL_FIND").ok().and_then(|walks| walks.parse().ok());
        if let Some(walks) = anew {
            let shown = |seed: &u64| {
                walk(*seed, &before, meaning).1.is_err_and(|found| found.contains(words))
                    && walk(*seed, &ships, meaning).1.is_ok()
            };
            println!("BEFORE {name}: {:?}", (0..walks).find(shown));
            continue;
        }
        let found = walk(seed, &before, meaning).1.expect_err(name);
        assert!(found.contains(words), "{name}: {found}");
        assert_eq!(walk(seed, &ships, meaning).1, Ok(()), "{name}");
    }
}

/// A client connects and disconnects between two cycles; then a client tries to connect for 10 s. Returns whether it
/// succeeds.
fn can_reconnect(programs: Programs) -> bool {
    let mut controller = started(programs);
    for channel in [Channel::Command, Channel::State] {
        assert!(controller.connect(channel));
        controller.disconnect(channel);
        assert!(!controller.connect(channel), "a lost channel does not open by itself");
    }
    (0..100).any(|_| {
        controller.advance_ms(100);
        [Channel::Command, Channel::State].into_iter().all(|channel| controller.connect(channel))
    })
}

/// In the earlier programs, only the loss of a client that had been detected was handled; a channel with a client that
/// had not been detected stayed closed for ever.
#[test]
fn a_client_that_disconnects_within_a_cycle_closes_no_channel_permanently() {
    for immediate_reopen_fails in [false, true] {
        let meaning = UndocumentedBehaviour { immediate_reopen_fails, ..UndocumentedBehaviour::default() };
        assert_eq!(both(meaning).map(can_reconnect), [false, true], "{immediate_reopen_fails}");
    }
}

/// If another program was stopped by the drives, it stays at the position at which it was stopped.
#[test]
fn a_stopped_foreign_program_keeps_its_position() {
    let resets = |programs: Programs| {
        let mut controller = started(programs);
        controller.select_foreign_program();
        controller.advance_ms(2_000);
        assert_eq!(controller.robot_state(), Some(RobotState::Active));
        controller.switch_drives(false);
        controller.advance_ms(1_000);
        controller.switch_drives(true);
        (controller.foreign_program_resets(), controller.robot_state())
    };
    let [before, ships] = both(UndocumentedBehaviour::default()).map(resets);
    assert_eq!((before.0, ships), (1, (0, Some(RobotState::Stopped))));
}

/// Releases the start key in T2, in contact with the tool on. Returns the time for which the tool's output stayed on,
/// ms.
fn key_in_contact(programs: Programs) -> Option<u64> {
    let mut raw = Raw::opened(programs);
    raw.controller.select_mode(Mode::T2);
    raw.run(200);
    raw.controller.set_start_key(true);
    raw.run(300);
    raw.open();
    raw.command(6, [i32::from(TOOL_OUTPUT), 1], [0.0, 0.0], [0.0; 6]);
    raw.line(30, false, [-40.0, 0.0, -10.0]);
    for point in 0..20 {
        raw.line(29 - point, true, [3.0 * f64::from(point) - 37.0, 0.0, 0.0]);
    }
    let is_on = |controller: &Controller| controller.outputs().get(&TOOL_OUTPUT) == Some(&true);
    let mut waited_ms = 0;
    while raw.int("CELL_DONE") < 10 {
        raw.run(12);
        waited_ms += 12;
        assert!(waited_ms < 3_000, "the path begins: {}", raw.int("CELL_DONE"));
    }
    assert!(is_on(&raw.controller), "in contact, the tool runs");
    raw.controller.set_start_key(false);
    (0..200).find_map(|tick| {
        raw.run(12);
        (!is_on(&raw.controller)).then_some(12 * tick)
    })
}

/// The client continues its heartbeats; only the programs can switch the tool off.
#[test]
fn the_stop_key_in_contact_switches_the_tool_off() {
    let [before, ships] = both(UndocumentedBehaviour::default()).map(key_in_contact);
    assert_eq!(before, None, "the tool of before ran on");
    assert!(ships.is_some_and(|ms| ms <= 100), "{ships:?}");
}

/// At the first start of a controller, no channel has ever been initialised.
#[test]
fn no_channel_is_cleared_before_it_was_initialised() {
    let meaning = UndocumentedBehaviour { clear_of_unknown_stops: true, ..UndocumentedBehaviour::default() };
    let [before, ships] = both(meaning).map(|programs| started(programs).program_faults().to_vec());
    assert!(before.iter().any(|fault| fault.contains("EKI_Clear")), "{before:?}");
    assert_eq!(ships, Vec::<String>::new());
}

/// Every version of KSS on the installation page has the system variables that the programs read.
#[test]
fn every_version_of_the_page_has_the_system_variables() {
    let lacking = |folder: &str, minor: u8| {
        let texts = texts(folder);
        let files: Vec<_> = texts.iter().map(|(name, text)| parse(name, text)).collect();
        let problems = analyse(&files, Some(Kss { major: 8, minor })).problems;
        problems.into_iter().flatten().map(|problem| problem.key).collect::<Vec<_>>()
    };
    assert_eq!(lacking(EARLIER_FOLDER, 3), ["$COULD_START_MOTION"]);
    for minor in 3..=7 {
        assert_eq!(lacking(SHIPPED_FOLDER, minor), Vec::<String>::new(), "8.{minor}");
    }
}

/// Counts the cycles of the submit interpreter in 1.2 s without a client, if each cycle begins as soon as the last one
/// has ended.
#[test]
fn without_a_client_the_submit_interpreter_waits() {
    let cycles = |mut programs: Programs| {
        programs.busy_submit = true;
        let program = programs.program();
        let routine = program.routine("CELL_CYCLE").expect("it is there");
        let first = match program.code[program.routines[routine as usize].start as usize] {
            Op::Statement(index) => index as usize,
            other => panic!("a routine begins with a statement, not with {other:?}"),
        };
        let mut controller = started(programs);
        let before = controller.statement_hits()[first];
        controller.advance_ms(1_200);
        controller.statement_hits()[first] - before
    };
    let [before, ships] = both(UndocumentedBehaviour::default()).map(cycles);
    assert!(before > 500, "{before}");
    assert!((45..=101).contains(&ships), "{ships}");
}

/// A user subroutine sees the axis speed that `set_acc_speed` requested.
#[test]
fn the_axis_speed_of_set_acc_speed_is_applied() {
    let seen = |folder: &str| {
        let mut texts = texts(folder);
        for (name, text) in &mut texts {
            if name == "cell_user.src" {
                *text = text.replace("  WAIT SEC 0.1\n", "  CELL_SEEN=$VEL_AXIS[6]\n");
            } else if name == "cell_config.dat" {
                *text = text.replace("ENDDAT", "DECL GLOBAL INT CELL_SEEN=0\nENDDAT");
            }
        }
        let mut raw = Raw::opened(load(&texts));
        raw.command(8, [0, 0], [0.0, 0.0], [0.0; 6]);
        raw.run(300);
        raw.int("CELL_SEEN")
    };
    assert_eq!([EARLIER_FOLDER, SHIPPED_FOLDER].map(seen), [100, 37]);
}

/// Sends a single blended line in the air; further points are announced, but none is sent.
#[test]
fn a_single_blended_line_starts() {
    let meaning = UndocumentedBehaviour { lone_approximation_waits: true, ..UndocumentedBehaviour::default() };
    let moved = |programs: Programs| {
        let mut raw = Raw::opened(programs);
        raw.line(5, false, [10.0, 0.0, -20.0]);
        raw.run(1_500);
        !raw.has_not_moved() && raw.int("CELL_DONE") == 4
    };
    assert_eq!(both(meaning).map(moved), [false, true]);
}

/// The programs stop a path that ends in contact, and the arm must leave the panel whatever the scheduler does. A stop
/// closes the epoch before it sets its flag. Between these two steps, the earlier robot program left the epoch in
/// contact.
#[test]
fn every_stop_in_contact_is_followed_by_a_retract() {
    let seeds =
        |programs: &Programs| (0..400).into_par_iter().filter(|seed| is_left_in_contact(programs, *seed)).count();
    let [before, ships] = both(UndocumentedBehaviour::default()).map(|programs| seeds(&programs));
    assert!(before > 0, "the programs of before left the tool on the panel in none of 400 runs");
    assert_eq!(ships, 0, "of 400");
}

/// After each line that stops, an output follows. A trigger that fires late must not count the next line.
#[test]
fn a_late_trigger_counts_its_own_motion() {
    let meaning = UndocumentedBehaviour { late_triggers: true, ..UndocumentedBehaviour::default() };
    let is_ahead = |programs: Programs| {
        let mut raw = Raw::opened(programs);
        let first = raw.int("CELL_DONE") + 1;
        for round in 0..40 {
            let x_mm = if round % 2 == 0 { 10.0 } else { 0.0 };
            raw.command(2, [0, 0], [0.0, 0.0], [x_mm, 0.0, -20.0, 0.0, 0.0, 0.0]);
            raw.command(6, [1, 0], [0.0, 0.0], [0.0; 6]);
        }
        let mut is_ahead = false;
        for _ in 0..800 {
            raw.run(12);
            let done = raw.int("CELL_DONE");
            let is_line = done >= first && (done - first) % 2 == 0;
            is_ahead |= is_line && !raw.controller.executed_motions().iter().any(|step| step.id == done);
        }
        assert_eq!(raw.int("CELL_DONE"), first + 79, "all are executed in the end");
        is_ahead
    };
    assert_eq!(both(meaning).map(is_ahead), [true, false]);
}

/// Fixes that are undone one at a time in the shipped programs, so that the other fixes cannot hide the fault.
const UNDONE: [Undone; 2] = [
    Undone {
        name: "another program is reset",
        file: "cell_submit.src",
        ships: "CELL_RESET_DUE=CELL_READY\n",
        before: "CELL_RESET_DUE=TRUE\n",
        meaning: |_| {},
        seed: 14,
    },
    Undone {
        name: "RESUME with $ADVANCE at 3",
        file: "cell_motion.src",
        ships: "    $ADVANCE=0\n    RESUME\n",
        before: "    RESUME\n",
        meaning: |meaning| meaning.resume_needs_advance_0 = true,
        seed: 0,
    },
];

/// For each fix that a walk can show, a random walk fails if only this fix is undone.
#[test]
fn each_repair_that_is_undone_is_detected() {
    let ships = load(&texts(SHIPPED_FOLDER));
    let anew: Option<u64> = std::env::var("KRL_FIND").ok().and_then(|walks| walks.parse().ok());
    for undone in &UNDONE {
        let mut meaning = UndocumentedBehaviour::default();
        (undone.meaning)(&mut meaning);
        let programs = undo(undone);
        if let Some(walks) = anew {
            let found = (0..walks)
                .find(|seed| walk(*seed, &programs, meaning).1.is_err() && walk(*seed, &ships, meaning).1.is_ok());
            println!("UNDONE {}: {found:?}", undone.name);
            continue;
        }
        let found = walk(undone.seed, &programs, meaning).1;
        println!("{}: {found:?}", undone.name);
        assert!(found.is_err(), "{}: undone, and the walk is green", undone.name);
        assert_eq!(walk(undone.seed, &ships, meaning).1, Ok(()), "{}", undone.name);
    }
}
