//! Tests that a stop reaches the arm in every phase, regardless of what the controller has reported before.

use super::*;
use crate::eki::MAX_EPOCH_STEP;
use rayon::prelude::*;

/// Maximum time from an abort to the controller's stop, ms.
const STOP_LIMIT_MS: u64 = 500;
/// The values that are tried in each field: the ends of the ranges of all fields, values outside of them, and the ends
/// of a valid epoch step. The epoch is 6 to 8 in these tests.
const TRIED_VALUES: [i64; 9] =
    [i32::MIN as i64, -1, 0, 1, 9, 255, MAX_EPOCH_STEP as i64, MAX_EPOCH_STEP as i64 + 9, i32::MAX as i64];
const ACK_FIELDS: [&str; 6] = ["Rx", "Done", "Free", "Err", "ErrId", "Ep"];
const STATE_FIELDS: [&str; 15] =
    ["T", "Seq", "Re", "Ep", "Boot", "Sum", "Mode", "Flags", "In", "Out", "Done", "Under", "A1", "X", "C"];

/// The phase of the session in which the message arrives.
#[derive(Debug, Clone, Copy)]
enum Stage {
    Greeting,
    Idle,
    Opening,
    Open,
    Busy,
    Stopping,
}

impl Stage {
    const ALL: [Stage; 6] =
        [Stage::Greeting, Stage::Idle, Stage::Opening, Stage::Open, Stage::Busy, Stage::Stopping];

    fn cell(self) -> Cell {
        match self {
            Stage::Greeting => {
                let mut cell = Cell::new();
                cell.session.connected(Time::from_ms(0));
                cell
            }
            Stage::Idle | Stage::Opening => {
                let mut cell = Cell::new();
                cell.session.connected(Time::from_ms(0));
                cell.pass(100);
                if matches!(self, Stage::Opening) {
                    cell.session.open_epoch().expect("connected");
                }
                cell
            }
            Stage::Open => {
                let mut cell = Cell::ready();
                cell.pass(300);
                cell
            }
            Stage::Busy | Stage::Stopping => {
                let mut cell = Cell::ready();
                cell.session.queue_path(&path(200, 2.0)).expect("a good path");
                cell.pass(400);
                if matches!(self, Stage::Stopping) {
                    cell.session.abort().expect("connected");
                }
                cell
            }
        }
    }
}

/// Returns the document with this value in one field.
fn with_value(document: &str, field: &str, value: i64) -> String {
    let start = document.find(&format!(" {field}=\"")).expect("it has the field") + field.len() + 3;
    let end = start + document[start..].find('"').expect("quoted");
    format!("{}{value}{}", &document[..start], &document[end..])
}

impl Cell {
    /// Advances the time; the controller stops by itself if its client is disconnected.
    fn pass_until_stopped(&mut self, ms: u64) {
        for _ in 0..ms / 10 {
            self.pass(10);
            if !self.session.is_connected() {
                self.controller.stop();
                (self.controller.command_bytes, self.controller.state_bytes) = Default::default();
            }
        }
    }

    /// Sends one message with a value that no controller sends, then an abort. Checks that the controller stops within
    /// the time limit, that no further command is executed, and that the session then works as before.
    fn assert_that_a_stop_succeeds(mut self, name: &str, channel: Channel, message: &str) {
        let now = Time::from_ms(self.now_ms);
        match channel {
            Channel::Command => self.session.push_command_bytes(message.as_bytes(), now),
            Channel::State => self.session.push_state_bytes(message.as_bytes(), now),
        }
        // The session refuses the abort only if the connection is closed, which also stops the controller.
        assert_eq!(self.session.abort().is_err(), !self.session.is_connected(), "{name}");
        self.pass_until_stopped(STOP_LIMIT_MS);
        assert!(self.controller.stopped && self.controller.ring.is_empty(), "{name}: it runs on");
        let executed = self.controller.executed.len();
        self.pass_until_stopped(500);
        assert_eq!(self.controller.executed.len(), executed, "{name}: an ended epoch moves");
        for report in &self.reports {
            let Report::Standstill { done } = report else { continue };
            assert!(done.0 as usize <= executed, "{name}: told executed {done}, executed are {executed}");
        }
        let mut tries = 0;
        while self.session.epoch().is_none() {
            tries += 1;
            assert!(tries <= 3, "{name}: no epoch can be opened: {:?}", self.events());
            if !self.session.is_connected() {
                self.controller.answered = 0;
                self.session.connected(Time::from_ms(self.now_ms));
                self.pass_until_stopped(200);
            }
            let opened = self.session.open_epoch();
            assert!(opened.is_ok() || !self.session.is_connected(), "{name}: {opened:?}");
            self.pass_until_stopped(200);
        }
        assert!(self.controller.epoch < 2 * MAX_EPOCH_STEP, "{name}: the count is used up");
        self.session.queue(speed(0.1)).expect("open");
        self.pass_until_stopped(300);
        assert_eq!(self.controller.executed.len(), executed + 1, "{name}");
    }
}

#[test]
fn a_stop_reaches_the_controller_after_any_value_of_any_field_in_any_state() {
    let cases: Vec<(Stage, i64)> =
        Stage::ALL.iter().flat_map(|stage| TRIED_VALUES.map(|value| (*stage, value))).collect();
    cases.into_par_iter().for_each(|(stage, value)| {
        for field in ACK_FIELDS {
            let cell = stage.cell();
            let message = with_value(&cell.controller.ack(), field, value);
            cell.assert_that_a_stop_succeeds(
                &format!("{stage:?}, Ack {field}={value}"),
                Channel::Command,
                &message,
            );
        }
        for field in STATE_FIELDS {
            let mut cell = stage.cell();
            let message = with_value(&cell.controller.next_state(), field, value);
            cell.assert_that_a_stop_succeeds(&format!("{stage:?}, St {field}={value}"), Channel::State, &message);
        }
    });
}

/// Regression test: this message once used up all epoch numbers. The abort must now have a number that leaves at least
/// one higher number.
#[test]
fn the_largest_epoch_number_in_one_message_is_rejected() {
    for message in [Channel::Command, Channel::State] {
        let mut cell = Stage::Busy.cell();
        let now = Time::from_ms(cell.now_ms);
        match message {
            Channel::Command => {
                let ack = with_value(&cell.controller.ack(), "Ep", i64::from(i32::MAX));
                cell.session.push_command_bytes(ack.as_bytes(), now);
            }
            Channel::State => {
                let state = with_value(&cell.controller.next_state(), "Ep", i64::from(i32::MAX));
                cell.session.push_state_bytes(state.as_bytes(), now);
            }
        }
        let (found, known) = (Epoch(LAST_NUMBER), Epoch(7));
        let why = LinkLoss::EpochJump { channel: message, found, known, step: MAX_EPOCH_STEP };
        let left: Vec<_> = std::iter::from_fn(|| cell.session.poll_transmit(now)).collect();
        let [(Channel::State, abort)] = &left[..] else { panic!("{left:?}") };
        assert!(String::from_utf8_lossy(abort).contains("Op=\"11\" N1=\"8\""));
        assert_eq!(cell.session.poll_report(), Some(Report::LinkLost { why }));
        assert!(!cell.session.is_connected());
    }
}

/// A controller with a corrupt epoch counter is refused with an explanation on each connection, and receives no
/// commands.
#[test]
fn a_controller_near_the_largest_epoch_is_refused() {
    let mut cell = Cell::new();
    cell.controller.epoch = LAST_NUMBER;
    for _ in 0..3 {
        cell.controller.answered = 0;
        cell.session.connected(Time::from_ms(cell.now_ms));
        cell.pass(100);
        let why = LinkLoss::EpochTooHigh { found: Epoch(LAST_NUMBER), most: 2_000_000_000 };
        assert_eq!(cell.events().last(), Some(&&Report::LinkLost { why }));
        assert!(cell.session.open_epoch().is_err());
    }
    // A controller with a corrected counter is accepted again.
    (cell.controller.epoch, cell.controller.answered) = (0, 0);
    cell.session.connected(Time::from_ms(cell.now_ms));
    cell.pass(100);
    assert_eq!(cell.session.open_epoch(), Ok(Epoch(1)));
}

#[test]
fn an_abort_that_is_not_answered_ends_the_connection() {
    let mut cell = Stage::Busy.cell();
    cell.controller.is_unresponsive = true;
    cell.session.abort().expect("connected");
    cell.pass(390);
    assert!(cell.session.is_connected());
    cell.pass(30);
    let Some(Report::LinkLost { why: LinkLoss::AbortNotAnswered { waited_ms } }) = cell.events().last() else {
        panic!("{:?}", cell.events())
    };
    assert!((400..=420).contains(waited_ms), "{waited_ms}");
    assert!(!cell.session.is_connected());
}

#[test]
fn an_abort_that_is_not_obeyed_ends_the_connection() {
    let mut cell = Stage::Busy.cell();
    cell.controller.ignores_aborts = true;
    cell.session.abort().expect("connected");
    cell.pass(50);
    assert_eq!(cell.events().last(), Some(&&Report::LinkLost { why: LinkLoss::AbortNotObeyed }));
    assert!(!cell.session.is_connected());
}

/// An abort that is commanded before the controller's first message is sent immediately, and the response is reported.
#[test]
fn an_abort_before_the_first_state_is_sent_at_once() {
    let mut cell = Stage::Greeting.cell();
    cell.session.abort().expect("connected");
    cell.pass(50);
    assert!(cell.controller.stopped);
    assert!(
        matches!(cell.events()[..], [Report::Connected { .. }, Report::Standstill { .. }]),
        "{:?}",
        cell.events()
    );
    // The controller's epoch was not yet known, so the number in the abort did not raise it.
    assert_eq!(cell.session.open_epoch(), Ok(Epoch(7)));
}

/// If a controller was restored from its files, its epoch is far below the cell's. The next epoch is then reached in
/// steps, because no number is used twice. If the cell's store was restored from a backup, the controller's epoch is
/// higher, and the next epoch follows the controller's.
#[test]
fn the_next_epoch_is_above_those_of_cell_and_controller() {
    let mut cell = Stage::Idle.cell();
    let above = 3 * MAX_EPOCH_STEP + 5;
    let opened = cell.session.open_epoch_above(Epoch(above));
    assert_eq!(opened, Ok(Epoch(above + 1)));
    cell.pass(100);
    assert_eq!((cell.controller.epoch, cell.session.epoch()), (above + 1, Some(Epoch(above + 1))));

    let mut cell = Stage::Idle.cell();
    assert_eq!(cell.session.open_epoch_above(Epoch(2)), Ok(Epoch(7)));

    let mut cell = Stage::Idle.cell();
    for above in [LAST_NUMBER, 20 * MAX_EPOCH_STEP] {
        let refused = cell.session.open_epoch_above(Epoch(above));
        assert!(matches!(refused, Err(QueueError::EpochTooFar { .. })), "{refused:?}");
    }
    cell.pass(100);
    assert!(cell.session.is_connected() && cell.session.open_epoch().is_ok(), "nothing is lost by it");
}

/// If water or tool is on and no command is queued, a silent controller ends the epoch, and so does a program that no
/// longer supervises the link.
#[test]
fn silence_ends_the_epoch_while_water_or_tool_is_on() {
    let harmful = |cell: &mut Cell| {
        cell.session.limits.harmful_outputs = 0b10;
        let state = with_value(&cell.controller.next_state(), "Out", 0b10);
        cell.session.push_state_bytes(state.as_bytes(), Time::from_ms(cell.now_ms));
    };
    let mut cell = Stage::Open.cell();
    harmful(&mut cell);
    cell.controller.silent = true;
    cell.pass(420);
    assert!(cell.reports.iter().any(|report| matches!(report, Report::WatchdogExpired { .. })));
    let mut cell = Stage::Open.cell();
    cell.session.interrupt(StopCause::Unattended);
    assert!(cell.session.epoch().is_some(), "nothing is at stake");
    harmful(&mut cell);
    cell.session.interrupt(StopCause::Unattended);
    cell.pass(50);
    assert!(cell.session.epoch().is_none() && cell.controller.stopped);
}

/// If the robot stops an epoch in which no command is queued, it accepts no more commands in this epoch. The client
/// must end the epoch as well.
#[test]
fn an_epoch_that_the_controller_stopped_has_ended() {
    let mut cell = Stage::Open.cell();
    cell.controller.stop();
    cell.pass(200);
    assert!(cell.reports.contains(&Report::Interrupted { cause: StopCause::ByProgram }));
    assert_eq!(cell.session.queue(speed(0.1)), Err(QueueError::NoEpoch));
    assert!(cell.session.open_epoch().is_ok());
}

/// An override other than 100 % during contact ends the epoch, even if the controller continues. Without contact any
/// override is valid.
#[test]
fn another_override_in_contact_ends_the_epoch() {
    let overridden = Report::Interrupted { cause: StopCause::Override };
    for contact in [false, true] {
        let mut cell = Cell::ready();
        let points: Vec<MoveLin> = path(200, 2.0).into_iter().map(|point| MoveLin { contact, ..point }).collect();
        cell.session.queue_path(&points).expect("a good path");
        cell.pass(1_000);
        assert!(!cell.reports.contains(&overridden));
        cell.controller.override_percent = 99;
        cell.pass(300);
        assert_eq!(cell.reports.contains(&overridden), contact, "{:?}", cell.events());
    }
}

/// The reported cause of the stop is the mode switch, or that no robot program was running, or otherwise the robot
/// program itself.
#[test]
fn a_stopped_epoch_states_why() {
    // The flags mean: drives on, no emergency stop, guard closed. With bit 4 a motion is also possible.
    for (mode, flags, cause) in [
        (1, 0b1_0111, StopCause::ModeTurned),
        (4, 0b0_0111, StopCause::NoProgram),
        (4, 0b1_0111, StopCause::ByProgram),
    ] {
        let mut cell = Stage::Open.cell();
        cell.pass(100);
        (cell.controller.mode, cell.controller.flags) = (mode, flags);
        cell.controller.stop();
        cell.pass(200);
        assert!(cell.reports.contains(&Report::Interrupted { cause }), "{cause}: {:?}", cell.events());
    }
}
