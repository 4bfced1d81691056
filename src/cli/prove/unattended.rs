//! Tests that a client can do without a person: over the two ports, without a motion.

use super::super::fault::Fault;
use super::super::live;
use super::proof::Finding;
use super::raw_client::{Heard, OP_ABORT, OP_RESET, RawClient, STATE_TIMEOUT, attribute, connect, pose};
use crate::cell::Cell;
use crate::daemon::SingleRobot;
use crate::eki::Command;
use crate::geometry::KukaPose;
use std::io::Read;
use std::time::{Duration, Instant};

type TestResult = Result<(Finding, String), Fault>;

/// A test of a row.
pub(super) type Attempt = fn(&Cell) -> TestResult;

/// The test for a row of the installation page; `None` if a person must look.
pub(super) fn for_row(number: u32) -> Option<Attempt> {
    match number {
        1 => Some(a_frame_comes_in_any_order),
        2 => Some(no_old_command_is_left),
        3 => Some(a_command_is_read_whole),
        5 => Some(check_names_read),
        6 => Some(an_invalid_document_is_ignored),
        7 => Some(check_second_client_refused),
        15 => Some(time_is_in_ms),
        18 => Some(large_numbers_are_decimal),
        27 => Some(a_line_without_frames_is_refused),
        33 => Some(check_epoch_range),
        35 => Some(check_vanished_client),
        39 => Some(check_decimals),
        _ => None,
    }
}

fn make_finding(right: bool, evidence: String) -> TestResult {
    Ok((if right { Finding::Proven } else { Finding::Wrong }, evidence))
}

/// The kind of controller that answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ControllerKind {
    /// A real controller, by its boot id.
    Real,
    /// A mock controller: it proves nothing.
    Mock,
    /// Nothing answers, so that the kind is not known.
    Unknown,
}

impl ControllerKind {
    /// Combines two results: returns the one that permits less.
    pub fn combine(self, other: Self) -> Self {
        match (self, other) {
            (ControllerKind::Mock, _) | (_, ControllerKind::Mock) => ControllerKind::Mock,
            (ControllerKind::Real, ControllerKind::Real) => ControllerKind::Real,
            _ => ControllerKind::Unknown,
        }
    }
}

/// Determines the kind of controller that answers now.
pub(super) fn controller(cell: &Cell) -> Result<ControllerKind, Fault> {
    let (mut robot, _) = live::robot_alone(cell)?;
    Ok(match SingleRobot::connect(&mut robot, cell.arm()) {
        Ok(single) if single.state().is_simulated() => ControllerKind::Mock,
        Ok(_) => ControllerKind::Real,
        Err(_) => ControllerKind::Unknown,
    })
}

const NO_STATE_MESSAGE: &str =
    "no state within 10 s; is the submit interpreter running, and is no other client connected?";

fn check_names_read(cell: &Cell) -> TestResult {
    match RawClient::patient(cell).and_then(|(_, heard)| heard.state) {
        Some(state) => {
            let boot = attribute(&state, "Boot").unwrap_or_default();
            let sum = attribute(&state, "Sum").unwrap_or_default();
            make_finding(true, format!("both channels are open; boot id {boot}, checksum of the programs {sum}"))
        }
        None => make_finding(false, NO_STATE_MESSAGE.to_owned()),
    }
}

fn check_second_client_refused(cell: &Cell) -> TestResult {
    let Some((mut first, _)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let second = connect(cell, cell.robot().state_port());
    let heard = second.map(|mut second| {
        let mut piece = [0; 64];
        (0..50).any(|_| matches!(second.read(&mut piece), Ok(count) if count > 0))
    });
    let undisturbed = first.listen(STATE_TIMEOUT, |_| false).state.is_some();
    let what = match &heard {
        Ok(true) => "was served",
        Ok(false) => "was kept waiting or closed without an answer",
        Err(_) => "was refused",
    };
    let evidence = format!(
        "the second client {what}, the first client {}",
        if undisturbed { "continued undisturbed" } else { "received nothing more" }
    );
    make_finding(undisturbed && !matches!(heard, Ok(true)), evidence)
}

fn check_epoch_range(cell: &Cell) -> TestResult {
    let Some((mut client, heard)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let before = heard.state_value("Ep").unwrap_or_default();
    for operation in [OP_RESET, OP_ABORT] {
        if client.ask(operation, i32::MAX).is_err() {
            return make_finding(false, "the state channel closed".to_owned());
        }
        let Some(after) = client.listen(STATE_TIMEOUT, |_| false).state_value("Ep") else {
            return make_finding(false, "no state after the request".to_owned());
        };
        if after != before {
            return make_finding(
                false,
                format!("operation {operation} with 2147483647: the epoch changed from {before} to {after}"),
            );
        }
    }
    make_finding(true, format!("a reset and an abort requested the epoch 2147483647: the epoch stayed {before}"))
}

fn check_vanished_client(cell: &Cell) -> TestResult {
    const CLIENT_COUNT: usize = 100;
    let mut slowest = Duration::ZERO;
    for time in 1..=CLIENT_COUNT {
        // While the controller opens the port again, the connection is refused, which serves this test as well.
        drop(connect(cell, cell.robot().command_port()));
        if time % 10 == 0 {
            let begun = Instant::now();
            if RawClient::patient(cell).is_none() {
                return make_finding(
                    false,
                    format!("after {time} clients that vanished at once: {NO_STATE_MESSAGE}"),
                );
            }
            slowest = slowest.max(begun.elapsed());
        }
    }
    make_finding(
        true,
        format!(
            "{CLIENT_COUNT} clients disconnected immediately; the next client was served within {:.1} s",
            slowest.as_secs_f64()
        ),
    )
}

/// Checks that the base comes back as it was sent: both texts are compared as numbers, with a smaller tolerance
/// than the link's own.
fn check_base_echo(cell: &Cell, x_mm: f64, most_mm: f64) -> TestResult {
    // The connections of earlier tests may still be closing.
    if RawClient::patient(cell).is_none() {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    }
    std::thread::sleep(Duration::from_millis(500));
    let (mut robot, _) = live::robot_alone(cell)?;
    let mut single = match SingleRobot::connect(&mut robot, cell.arm()) {
        Ok(single) => single,
        Err(error) => return make_finding(false, error.to_string()),
    };
    if !single.state().motion_possible {
        return open();
    }
    let base = KukaPose { x_mm, ..KukaPose::default() };
    match single.set(Command::SetBase(base), cell) {
        Ok(()) => {
            let told_mm = single.state().active_base.x_mm;
            let evidence = format!("base X {x_mm} mm was sent, {told_mm} mm was reported back");
            make_finding((told_mm - x_mm).abs() <= most_mm, evidence)
        }
        Err(error) => make_finding(false, format!("base X {x_mm} mm: {error}")),
    }
}

fn check_decimals(cell: &Cell) -> TestResult {
    check_base_echo(cell, 1.2345, 0.000_01)
}

/// The evidence of a trial that needs the robot program, which executes the commands.
fn open() -> TestResult {
    let words = "the robot program does not run: select cell_motion, in T1 hold Start, and prove again";
    Ok((Finding::Open, words.to_owned()))
}

/// The bit of `Flags` that states that a motion is possible.
const MOTION_POSSIBLE: i64 = 16;

/// Returns whether the robot program runs, which executes the commands.
fn program_runs(heard: &Heard) -> bool {
    heard.state_value("Flags").is_some_and(|flags| flags & MOTION_POSSIBLE != 0)
}

/// Time in which an epoch that was requested is open, and the program has taken its frames back.
const EPOCH_TIMEOUT: Duration = Duration::from_millis(500);

/// Returns a command that sets the base, which moves nothing.
fn set_base(id: i32, epoch: i64, x: &str) -> String {
    command(id, epoch, 3, "0.0", [x, "0.0", "0.0", "0.0", "0.0", "0.0"])
}

/// Returns a command; `speed_m_s` is its `R2`.
fn command(id: i32, epoch: i64, operation: i32, speed_m_s: &str, [x, y, z, a, b, c]: [&str; 6]) -> String {
    format!(
        "<Cmd Id=\"{id}\" Ep=\"{epoch}\" Op=\"{operation}\" N1=\"0\" N2=\"0\" R1=\"0.0\" R2=\"{speed_m_s}\"><P X=\"{x}\" Y=\"{y}\" \
         Z=\"{z}\" A=\"{a}\" B=\"{b}\" C=\"{c}\"></P></Cmd>"
    )
}

/// A client in a new epoch.
struct InEpoch {
    client: RawClient,
    epoch: i64,
    /// The newest state in it.
    heard: Heard,
}

/// Connects and opens the epoch after the next one; `None` if the controller does not report it in time.
fn in_a_new_epoch(cell: &Cell) -> Option<InEpoch> {
    let (mut client, heard) = RawClient::patient(cell)?;
    let epoch = heard.state_value("Ep")? + 2;
    client.ask(OP_RESET, i32::try_from(epoch).ok()?).ok()?;
    let heard = client.listen(EPOCH_TIMEOUT, |_| false);
    (heard.state_value("Ep") == Some(epoch)).then_some(InEpoch { client, epoch, heard })
}

/// The six attributes in reverse: each must still reach its own coordinate.
fn a_frame_comes_in_any_order(cell: &Cell) -> TestResult {
    const SENT: &str = "<P C=\"6.0\" B=\"5.0\" A=\"4.0\" Z=\"3.0\" Y=\"2.0\" X=\"1.0\"></P>";
    const EXPECTED: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    const MAX_DIFFERENCE: f64 = 0.001;
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    if !program_runs(&heard) {
        return open();
    }
    let head = format!("<Cmd Id=\"1\" Ep=\"{epoch}\" Op=\"3\" N1=\"0\" N2=\"0\" R1=\"0.0\" R2=\"0.0\">");
    if client.send_on_command(format!("{head}{SENT}</Cmd>").as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let base = pose(&state, "Base").unwrap_or_default();
    let is_right = base.iter().zip(EXPECTED).all(|(text, expected)| {
        text.parse::<f64>().is_ok_and(|number| (number - expected).abs() <= MAX_DIFFERENCE)
    });
    make_finding(
        is_right,
        format!("sent as C 6, B 5, A 4, Z 3, Y 2, X 1; the state has X to C {}", base.join(", ")),
    )
}

/// Thirty commands are written at once and the link is cut, so that entries stay unread. They belong to the epoch that
/// is opened next: an old entry would be read with the next command, and would be refused or executed in its place.
fn no_old_command_is_left(cell: &Cell) -> TestResult {
    const COMMANDS: i32 = 30;
    let Some((mut first, heard)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let epoch = heard.state_value("Ep").unwrap_or_default() + 2;
    let old: String = (1..=COMMANDS).map(|id| set_base(id, epoch, &format!("{id}.0"))).collect();
    if first.send_on_command(old.as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    drop(first);
    let Some(InEpoch { mut client, epoch: opened, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, "no epoch was opened after the link was cut".to_owned());
    };
    // A command that is queued and not executed would end the epoch.
    if !program_runs(&heard) {
        return open();
    }
    let before = heard.ack_value("Rx");
    if client.send_on_command(set_base(1, opened, "100.0").as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |_| false);
    let numbers = (before, after.ack_value("Rx"), after.ack_value("Err"));
    let shown = |number: Option<i64>| number.map_or("nothing".to_owned(), |number| number.to_string());
    make_finding(
        opened == epoch && numbers == (Some(0), Some(1), Some(0)),
        format!(
            "{COMMANDS} commands of epoch {epoch} were cut off; in epoch {opened}: Rx {}, after one new command Rx {}, Err {}",
            shown(numbers.0),
            shown(numbers.1),
            shown(numbers.2)
        ),
    )
}

/// The program takes a command only if all its elements have the same counter.
fn a_command_is_read_whole(cell: &Cell) -> TestResult {
    check_base_echo(cell, 1.0, 0.000_01)
}

fn an_invalid_document_is_ignored(cell: &Cell) -> TestResult {
    let mut reported = Vec::new();
    for (name, bytes) in
        [("a prolog", &b"<?xml version=\"1.0\"?>"[..]), ("a byte order mark", b"\xEF\xBB\xBF"), ("NUL", b"\0")]
    {
        let Some((mut client, heard)) = RawClient::patient(cell) else {
            return make_finding(false, format!("before {name}: {NO_STATE_MESSAGE}"));
        };
        let before = (heard.state_value("Ep"), heard.state_value("Done"));
        let is_sent = client.send_on_state(bytes).is_ok() && client.send_on_command(bytes).is_ok();
        let from = i64::from(client.last_asked());
        let after = client.listen(STATE_TIMEOUT, |_| false);
        let is_closed = after.is_state_closed || after.is_command_closed;
        // A request that was sent after these bytes is answered: they were skipped.
        let is_skipped = after.state_value("Re").is_some_and(|read| read > from);
        let changed = after.state.is_some() && (after.state_value("Ep"), after.state_value("Done")) != before;
        if !is_sent || changed || !(is_closed || is_skipped) {
            return make_finding(
                false,
                format!("{name}: neither skipped nor the channel closed, or the state changed"),
            );
        }
        reported.push(format!("{name}: {}", if is_closed { "closes the channel" } else { "is skipped" }));
    }
    make_finding(true, reported.join(", "))
}

fn time_is_in_ms(cell: &Cell) -> TestResult {
    const WATCHED: Duration = Duration::from_secs(5);
    /// A state comes every 100 ms.
    const MAX_DIFFERENCE_MS: i64 = 500;
    let Some((mut client, first)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let begun = Instant::now();
    let last = client.listen(WATCHED, |_| false);
    let (Some(from), Some(to)) = (first.state_value("T"), last.state_value("T")) else {
        return make_finding(false, "no state at the end of 5 s".to_owned());
    };
    let passed_ms = i64::try_from(begun.elapsed().as_millis()).unwrap_or(i64::MAX);
    let counted = to - from;
    make_finding(
        (counted - passed_ms).abs() <= MAX_DIFFERENCE_MS,
        format!("T counted {counted} in {passed_ms} ms of this computer (largest difference {MAX_DIFFERENCE_MS})"),
    )
}

fn large_numbers_are_decimal(cell: &Cell) -> TestResult {
    const SENT: &str = "2000000.0";
    const EXPECTED: &str = "2000000.000000";
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    if !program_runs(&heard) {
        return open();
    }
    if client.send_on_command(set_base(1, epoch, SENT).as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let written = pose(&state, "Base").map_or("nothing", |[x, ..]| x);
    make_finding(written == EXPECTED, format!("base X {SENT} mm was sent, the state contains {written}"))
}

/// The line goes to the pose at which the arm is, at 1 mm/s: a controller that executes it moves nothing.
fn a_line_without_frames_is_refused(cell: &Cell) -> TestResult {
    const NO_FRAMES: i64 = 6;
    const SPEED_M_S: &str = "0.001";
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let tip = heard.state.as_deref().and_then(|state| pose(state, "Tcp"));
    let (true, Some(tip)) = (program_runs(&heard), tip) else {
        return open();
    };
    if client.send_on_command(command(1, epoch, 2, SPEED_M_S, tip).as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |heard| heard.ack_value("Err").is_some_and(|refusal| refusal != 0));
    let refusal = after.ack_value("Err").unwrap_or_default();
    make_finding(
        refusal == NO_FRAMES && after.ack_value("ErrId") == Some(1),
        format!(
            "a line without base and tool: Err {refusal} (expected {NO_FRAMES}), and it led to where the arm was"
        ),
    )
}
