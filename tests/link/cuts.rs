//! Cuts the connection at every waypoint and at every message of a path, on each side. After the end of an epoch the
//! robot must not execute its commands, and the pad must be off the surface within half a second.

use super::cell::{Blind, Cell, Side, height_mm, pass, setup};
use super::oracles::Oracles;
use panelprep::devices::mock::{Clock, Fault};
use panelprep::eki::{Channel, CommandId, Report};

const POINTS: usize = 40;
const SPEED_M_S: f64 = 0.1;
/// Maximum time from the cut until the pad is off the surface, ms.
const MAX_LEAVE_TIME_MS: u64 = 500;
/// Minimum height at which the pad is treated as off the surface, mm: more than the maximum compression of a pad.
const MIN_OFF_HEIGHT_MM: f64 = 2.0;

#[derive(Debug, Clone, Copy)]
enum Cut {
    Closed(Channel, Side, bool),
    /// The cable is unplugged permanently.
    Silent,
}

const CUTS: [Cut; 9] = [
    Cut::Closed(Channel::Command, Side::Client, true),
    Cut::Closed(Channel::Command, Side::Client, false),
    Cut::Closed(Channel::Command, Side::Robot, true),
    Cut::Closed(Channel::Command, Side::Robot, false),
    Cut::Closed(Channel::State, Side::Client, true),
    Cut::Closed(Channel::State, Side::Client, false),
    Cut::Closed(Channel::State, Side::Robot, true),
    Cut::Closed(Channel::State, Side::Robot, false),
    Cut::Silent,
];

/// Returns a cell in the middle of a path in contact, with oracles that check all requirements.
fn cell_in_contact() -> (Cell, Oracles, CommandId) {
    let mut cell = Cell::ready(setup(Clock::Free), SPEED_M_S);
    cell.delay_ms = (2, 2);
    let mut oracles = Oracles::new(2);
    let epoch = cell.session.epoch().expect("open");
    oracles.before(epoch, CommandId(3));
    let points = pass(POINTS, 3.0, true);
    let last = cell.session.queue_path(&points).expect("a good path");
    oracles.queued(epoch, last, &points, SPEED_M_S);
    (cell, oracles, last)
}

/// Cuts the connection and checks the next three seconds, including motions that are executed after the cut.
fn cut_and_judge(cut: Cut, mut cell: Cell, mut oracles: Oracles, at: &str) {
    let ended = cell.session.epoch();
    let cut_ms = cell.now_ms;
    let touches = |cell: &Cell| height_mm(&cell.controller) < MIN_OFF_HEIGHT_MM;
    match cut {
        Cut::Closed(channel, side, loses) => cell.cut(channel, side, loses),
        Cut::Silent => cell.controller.apply_fault(Fault::Unplug { for_ms: None }),
    }
    while cell.now_ms < cut_ms + 3_000 {
        cell.step(cut_ms + 3_000, &mut oracles);
        assert_eq!(oracles.violation, None, "{cut:?} {at}");
        let is_late = cell.now_ms > cut_ms + MAX_LEAVE_TIME_MS;
        assert!(!(is_late && touches(&cell)), "{cut:?} {at}: on the panel after {} ms", cell.now_ms - cut_ms);
    }
    let after = cell.executed().iter().filter(|step| step.time_ms > cut_ms + MAX_LEAVE_TIME_MS).count();
    assert_eq!(after, 0, "{cut:?} {at}: executed after the cut");
    assert_ne!(cell.session.epoch(), ended, "{cut:?} {at}: the epoch is still open");
    // If the cable is intact, the client is connected again and has moved nothing.
    let is_back = cell.session.is_connected() && cell.session.epoch().is_none();
    assert!(is_back || matches!(cut, Cut::Silent), "{cut:?} {at}: not connected again");
}

#[test]
fn a_link_cut_at_any_waypoint_never_moves_an_ended_epoch() {
    for cut in CUTS {
        for point in 0..POINTS {
            let (mut cell, mut oracles, _) = cell_in_contact();
            while cell.executed().len() < point {
                cell.step(u64::MAX, &mut oracles);
            }
            cut_and_judge(cut, cell, oracles, &format!("at point {point}"));
        }
    }
}

#[test]
fn a_link_cut_at_any_message_never_moves_an_ended_epoch() {
    let (mut whole, _, last) = cell_in_contact();
    let before = whole.messages;
    assert!(whole.until(10_000, |report| *report == Report::PathDone { last }), "the path uncut");
    let messages = whole.messages - before;
    assert!(messages > 100, "{messages} messages");
    for cut in CUTS {
        for message in 0..messages {
            let (mut cell, mut oracles, _) = cell_in_contact();
            while cell.messages - before < message {
                cell.step(u64::MAX, &mut oracles);
            }
            cut_and_judge(cut, cell, oracles, &format!("at message {message} of {messages}"));
        }
    }
}

/// If the connection is cut between the last point and its report, the path is not reported as executed, and the state
/// contains the number of executed points.
#[test]
fn a_path_whose_end_was_not_reported_is_not_reported_as_done() {
    let (mut cell, _, last) = cell_in_contact();
    while cell.executed().len() < POINTS {
        cell.step(u64::MAX, &mut Blind);
    }
    cell.cut(Channel::Command, Side::Robot, true);
    cell.cut(Channel::State, Side::Robot, true);
    assert!(!cell.until(3_000, |report| *report == Report::PathDone { last }));
    assert!(cell.session.is_connected() && cell.session.epoch().is_none());
}
