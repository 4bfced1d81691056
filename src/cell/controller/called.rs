//! Compares what the controller's programs call with what is there: the cell's own subroutines, and the calls in
//! KUKA's program of the submit interpreter.

use super::difference::Differences;
use super::names::{CONFIG, SUBMIT, USER};
use super::stated::{DataList, Number};
use super::sum::text_sum;
use panelprep_kuka::krl::{StatedCall, StatedRoutine, parse};
use std::collections::BTreeSet;

/// The routine by which `cell_motion.src` calls a subroutine.
const DISPATCHER: &str = "CELL_USER_CALL";
/// The name of the number of subroutines.
const COUNT: &str = "CELL_USER_N";
/// The name of the value that states the sum of the text.
const REVISION: &str = "CELL_USER_REVISION";
/// Maximum number of cases that one message lists.
const MAX_LISTED: usize = 8;

/// Compares the cell's own subroutines with their number and with the sum of their text in the data list.
pub(super) fn subroutines(text: &str, config: Option<&DataList>, found: &mut Differences) {
    match parse(USER, text).stated_routine(DISPATCHER) {
        None => {
            let message = "is not there: cell_motion calls each subroutine by this routine, and the controller would \
                           not select the program; write `GLOBAL DEF CELL_USER_CALL(N:IN)`, as in this program's own file";
            found.note(USER, 1, DISPATCHER, message);
        }
        Some(routine) => {
            dispatcher(&routine, found);
            if let Some(count) = config.and_then(|config| config.get(COUNT)) {
                cases(&routine, count, found);
            }
        }
    }
    let Some(stated) = config.and_then(|config| config.get(REVISION)) else { return };
    let computed = text_sum(text);
    if stated.value != computed as f64 {
        let message = format!(
            "is {}, and the text of {USER} has the sum {computed}: it was edited, or is another file; write {computed}, \
             so that the sum that the controller reports follows from it",
            stated.value
        );
        found.note(CONFIG, stated.line, REVISION, message);
    }
}

fn dispatcher(routine: &StatedRoutine, found: &mut Differences) {
    if !routine.global {
        let message = "is not GLOBAL: cell_motion would not find it; write `GLOBAL DEF CELL_USER_CALL(N:IN)`";
        found.note(USER, routine.line, DISPATCHER, message);
    }
    if routine.parameters != 1 {
        let message = format!("has {} arguments, and cell_motion gives it one: N:IN", routine.parameters);
        found.note(USER, routine.line, DISPATCHER, message);
    }
    for switch in routine.switches.iter().filter(|switch| !switch.is_on_first_parameter) {
        let message = "does not decide by the first parameter of CELL_USER_CALL, which is the index that the PC calls: \
                       another subroutine, or none, would be executed and reported; write SWITCH with that parameter";
        found.note(USER, switch.line, "SWITCH", message);
    }
}

/// Compares the cases with the number of subroutines: each index below it needs its own case.
fn cases(routine: &StatedRoutine, count: Number, found: &mut Differences) {
    let Some(counted) = count.as_integer().filter(|count| (0..=1_000).contains(count)) else { return };
    let stated: BTreeSet<i32> = routine.cases.iter().map(|case| case.value).collect();
    let missing: Vec<i32> = (0..counted).filter(|index| !stated.contains(index)).collect();
    if !missing.is_empty() {
        let mut listed: Vec<String> = missing.iter().take(MAX_LISTED).map(i32::to_string).collect();
        if missing.len() > MAX_LISTED {
            listed.push(format!("{} more", missing.len() - MAX_LISTED));
        }
        let message = format!(
            "has no CASE {}, and {COUNT} of {CONFIG} (line {}) counts {counted}: such a call would do nothing and be \
             reported as executed; add the cases, or lower the number",
            listed.join(", "),
            count.line
        );
        found.note(USER, routine.line, DISPATCHER, message);
    }
    for case in &routine.cases {
        let key = format!("CASE {}", case.value);
        if !(0..counted).contains(&case.value) {
            let message = format!(
                "is never called: {COUNT} of {CONFIG} (line {}) counts {counted}, from 0; raise it, or remove the case",
                count.line
            );
            found.note(USER, case.line, key, message);
        } else if case.is_empty {
            let message = "does nothing, and a call would be reported as executed; call a subroutine there";
            found.note(USER, case.line, key, message);
        }
    }
}

/// Names each further call: both routines are called once, in the main routine.
fn further_calls(main: &[StatedCall], others: &[StatedCall], found: &mut Differences) {
    for (name, effect) in [
        ("CELL_INIT", "each call ends the epoch and closes the channels"),
        ("CELL_CYCLE", "the link would have two cycles in one of the loop"),
    ] {
        for call in main.iter().filter(|call| call.name == name).skip(1) {
            found.note(SUBMIT, call.line, name, format!("is called a second time: {effect}; remove this call"));
        }
        for call in others.iter().filter(|call| call.name == name) {
            let message = format!("is called outside of the main routine: {effect}; remove this call");
            found.note(SUBMIT, call.line, name, message);
        }
    }
}

/// Checks that the program of the submit interpreter calls the programs' beginning once, and their cycle in its loop.
pub(super) fn submit(text: &str, found: &mut Differences) {
    let file = parse(SUBMIT, text);
    let calls = file.main_calls();
    further_calls(&calls, &file.other_calls(), found);
    let first = |name: &str| calls.iter().find(|call: &&StatedCall| call.name == name);
    let (begins, cycles) = (first("CELL_INIT"), first("CELL_CYCLE"));
    match begins {
        None => {
            let message =
                "is not called: the channels would not be opened; write CELL_INIT( ) into the fold USER INIT";
            found.note(SUBMIT, 1, "CELL_INIT", message);
        }
        Some(call) if call.in_loop || cycles.is_some_and(|cycle| cycle.line < call.line) => {
            let message = "is called in the loop or behind CELL_CYCLE( ): each call ends the epoch and closes the \
                           channels; write it into the fold USER INIT, before LOOP";
            found.note(SUBMIT, call.line, "CELL_INIT", message);
        }
        Some(_) => {}
    }
    match cycles {
        None => {
            let message = "is not called: no command is read and no stop is received; write CELL_CYCLE( ) into the fold \
                           USER PLC";
            found.note(SUBMIT, 1, "CELL_CYCLE", message);
        }
        Some(call) if !call.in_loop => {
            let message = "is called outside of the loop, so once only: after that no stop is received; write it into the \
                           fold USER PLC, between LOOP and ENDLOOP";
            found.note(SUBMIT, call.line, "CELL_CYCLE", message);
        }
        Some(_) => {}
    }
}
