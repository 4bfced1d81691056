//! Tests that a client can do without a person: over the two ports, without a motion.

use super::super::fault::Fault;
use super::super::live;
use super::proof::Finding;
use super::raw_client::{Heard, OP_ABORT, OP_RESET, RawClient, STATE_TIMEOUT, attribute, connect, pose};
use crate::cell::Cell;
use crate::daemon::Single;
use crate::eki::Command;
use crate::geometry::KukaPose;
use std::io::Read;
use std::time::{Duration, Instant};

type Tried = Result<(Finding, String), Fault>;

/// A test of a row.
pub(super) type Attempt = fn(&Cell) -> Tried;

/// The test for a row of the installation page; `None` if a person must look.
pub(super) fn for_row(number: u32) -> Option<Attempt> {
    match number {
        1 => Some(a_frame_comes_in_any_order),
        2 => Some(no_old_command_is_left),
        3 => Some(a_command_is_read_whole),
        5 => Some(names_are_read),
        6 => Some(what_is_no_document_does_nothing),
        7 => Some(second_client_is_kept_out),
        15 => Some(time_is_in_ms),
        18 => Some(large_numbers_are_decimal),
        27 => Some(a_line_without_frames_is_refused),
        33 => Some(the_epoch_is_not_used_up),
        35 => Some(a_vanishing_client_is_missed_by_nobody),
        39 => Some(decimals_are_kept),
        _ => None,
    }
}

fn found(right: bool, evidence: String) -> Tried {
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
    pub fn and(self, other: Self) -> Self {
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
    Ok(match Single::connect(&mut robot, cell.arm()) {
        Ok(single) if single.state().is_of_mock() => ControllerKind::Mock,
        Ok(_) => ControllerKind::Real,
        Err(_) => ControllerKind::Unknown,
    })
}

const SILENT: &str = "no state within 10 s; is the submit interpreter running, and is no other client connected?";

fn names_are_read(cell: &Cell) -> Tried {
    match RawClient::patient(cell).and_then(|(_, heard)| heard.state) {
        Some(state) => {
            let boot = attribute(&state, "Boot").unwrap_or_default();
            let sum = attribute(&state, "Sum").unwrap_or_default();
            found(true, format!("both channels are open; boot id {boot}, checksum of the programs {sum}"))
        }
        None => found(false, SILENT.to_owned()),
    }
}

fn second_client_is_kept_out(cell: &Cell) -> Tried {
    let Some((mut first, _)) = RawClient::patient(cell) else { return found(false, SILENT.to_owned()) };
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
    found(undisturbed && !matches!(heard, Ok(true)), evidence)
}

fn the_epoch_is_not_used_up(cell: &Cell) -> Tried {
    let Some((mut client, heard)) = RawClient::patient(cell) else { return found(false, SILENT.to_owned()) };
    let before = heard.of_state("Ep").unwrap_or_default();
    for operation in [OP_RESET, OP_ABORT] {
        if client.ask(operation, i32::MAX).is_err() {
            return found(false, "the state channel closed".to_owned());
        }
        let Some(after) = client.listen(STATE_TIMEOUT, |_| false).of_state("Ep") else {
            return found(false, "no state after the request".to_owned());
        };
        if after != before {
            return found(
                false,
                format!("operation {operation} with 2147483647: the epoch changed from {before} to {after}"),
            );
        }
    }
    found(true, format!("a reset and an abort requested the epoch 2147483647: the epoch stayed {before}"))
}

fn a_vanishing_client_is_missed_by_nobody(cell: &Cell) -> Tried {
    const TIMES: usize = 100;
    let mut slowest = Duration::ZERO;
    for time in 1..=TIMES {
        // While the controller opens the port again, the connection is refused, which serves this test as well.
        drop(connect(cell, cell.robot().command_port()));
        if time % 10 == 0 {
            let begun = Instant::now();
            if RawClient::patient(cell).is_none() {
                return found(false, format!("after {time} clients that vanished at once: {SILENT}"));
            }
            slowest = slowest.max(begun.elapsed());
        }
    }
    found(
        true,
        format!(
            "{TIMES} clients disconnected immediately; the next client was served within {:.1} s",
            slowest.as_secs_f64()
        ),
    )
}

/// Checks that the base comes back as it was sent: both texts are compared as numbers, with a smaller tolerance
/// than the link's own.
fn base_comes_back(cell: &Cell, x_mm: f64, most_mm: f64) -> Tried {
    // The connections of earlier tests may still be closing.
    if RawClient::patient(cell).is_none() {
        return found(false, SILENT.to_owned());
    }
    std::thread::sleep(Duration::from_millis(500));
    let (mut robot, _) = live::robot_alone(cell)?;
    let mut single = match Single::connect(&mut robot, cell.arm()) {
        Ok(single) => single,
        Err(error) => return found(false, error.to_string()),
    };
    if !single.state().motion_possible {
        return open();
    }
    let base = KukaPose { x_mm, ..KukaPose::default() };
    match single.set(Command::SetBase(base), cell) {
        Ok(()) => {
            let told_mm = single.state().active_base.x_mm;
            let evidence = format!("base X {x_mm} mm was sent, {told_mm} mm was reported back");
            found((told_mm - x_mm).abs() <= most_mm, evidence)
        }
        Err(error) => found(false, format!("base X {x_mm} mm: {error}")),
    }
}

fn decimals_are_kept(cell: &Cell) -> Tried {
    base_comes_back(cell, 1.2345, 0.000_01)
}

/// The evidence of a trial that needs the robot program, which executes the commands.
fn open() -> Tried {
    let words = "the robot program does not run: select cell_motion, in T1 hold Start, and prove again";
    Ok((Finding::Open, words.to_owned()))
}

/// The bit of `Flags` that states that a motion is possible.
const MOTION_POSSIBLE: i64 = 16;

/// Returns whether the robot program runs, which executes the commands.
fn program_runs(heard: &Heard) -> bool {
    heard.of_state("Flags").is_some_and(|flags| flags & MOTION_POSSIBLE != 0)
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
    let epoch = heard.of_state("Ep")? + 2;
    client.ask(OP_RESET, i32::try_from(epoch).ok()?).ok()?;
    let heard = client.listen(EPOCH_TIMEOUT, |_| false);
    (heard.of_state("Ep") == Some(epoch)).then_some(InEpoch { client, epoch, heard })
}

/// The six attributes in reverse: each must still reach its own coordinate.
fn a_frame_comes_in_any_order(cell: &Cell) -> Tried {
    const SENT: &str = "<P C=\"6.0\" B=\"5.0\" A=\"4.0\" Z=\"3.0\" Y=\"2.0\" X=\"1.0\"></P>";
    const EXPECTED: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    const MAX_DIFFERENCE: f64 = 0.001;
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return found(false, SILENT.to_owned());
    };
    if !program_runs(&heard) {
        return open();
    }
    let head = format!("<Cmd Id=\"1\" Ep=\"{epoch}\" Op=\"3\" N1=\"0\" N2=\"0\" R1=\"0.0\" R2=\"0.0\">");
    if client.send_on_command(format!("{head}{SENT}</Cmd>").as_bytes()).is_err() {
        return found(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let base = pose(&state, "Base").unwrap_or_default();
    let is_right = base.iter().zip(EXPECTED).all(|(text, expected)| {
        text.parse::<f64>().is_ok_and(|number| (number - expected).abs() <= MAX_DIFFERENCE)
    });
    found(is_right, format!("sent as C 6, B 5, A 4, Z 3, Y 2, X 1; the state has X to C {}", base.join(", ")))
}

/// Thirty commands are written at once and the link is cut, so that entries stay unread. They belong to the epoch that
/// is opened next: an old entry would be read with the next command, and would be refused or executed in its place.
fn no_old_command_is_left(cell: &Cell) -> Tried {
    const COMMANDS: i32 = 30;
    let Some((mut first, heard)) = RawClient::patient(cell) else { return found(false, SILENT.to_owned()) };
    let epoch = heard.of_state("Ep").unwrap_or_default() + 2;
    let old: String = (1..=COMMANDS).map(|id| set_base(id, epoch, &format!("{id}.0"))).collect();
    if first.send_on_command(old.as_bytes()).is_err() {
        return found(false, "the command channel closed".to_owned());
    }
    drop(first);
    let Some(InEpoch { mut client, epoch: opened, heard }) = in_a_new_epoch(cell) else {
        return found(false, "no epoch was opened after the link was cut".to_owned());
    };
    // A command that is queued and not executed would end the epoch.
    if !program_runs(&heard) {
        return open();
    }
    let before = heard.of_ack("Rx");
    if client.send_on_command(set_base(1, opened, "100.0").as_bytes()).is_err() {
        return found(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |_| false);
    let numbers = (before, after.of_ack("Rx"), after.of_ack("Err"));
    let shown = |number: Option<i64>| number.map_or("nothing".to_owned(), |number| number.to_string());
    found(
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
fn a_command_is_read_whole(cell: &Cell) -> Tried {
    base_comes_back(cell, 1.0, 0.000_01)
}

fn what_is_no_document_does_nothing(cell: &Cell) -> Tried {
    let mut told = Vec::new();
    for (name, bytes) in
        [("a prolog", &b"<?xml version=\"1.0\"?>"[..]), ("a byte order mark", b"\xEF\xBB\xBF"), ("NUL", b"\0")]
    {
        let Some((mut client, heard)) = RawClient::patient(cell) else {
            return found(false, format!("before {name}: {SILENT}"));
        };
        let before = (heard.of_state("Ep"), heard.of_state("Done"));
        let is_sent = client.send_on_state(bytes).is_ok() && client.send_on_command(bytes).is_ok();
        let from = i64::from(client.last_asked());
        let after = client.listen(STATE_TIMEOUT, |_| false);
        let is_closed = after.is_state_closed || after.is_command_closed;
        // A request that was sent after these bytes is answered: they were skipped.
        let is_skipped = after.of_state("Re").is_some_and(|read| read > from);
        let changed = after.state.is_some() && (after.of_state("Ep"), after.of_state("Done")) != before;
        if !is_sent || changed || !(is_closed || is_skipped) {
            return found(false, format!("{name}: neither skipped nor the channel closed, or the state changed"));
        }
        told.push(format!("{name}: {}", if is_closed { "closes the channel" } else { "is skipped" }));
    }
    found(true, told.join(", "))
}

fn time_is_in_ms(cell: &Cell) -> Tried {
    const WATCHED: Duration = Duration::from_secs(5);
    /// A state comes every 100 ms.
    const MAX_DIFFERENCE_MS: i64 = 500;
    let Some((mut client, first)) = RawClient::patient(cell) else { return found(false, SILENT.to_owned()) };
    let begun = Instant::now();
    let last = client.listen(WATCHED, |_| false);
    let (Some(from), Some(to)) = (first.of_state("T"), last.of_state("T")) else {
        return found(false, "no state at the end of 5 s".to_owned());
    };
    let passed_ms = i64::try_from(begun.elapsed().as_millis()).unwrap_or(i64::MAX);
    let counted = to - from;
    found(
        (counted - passed_ms).abs() <= MAX_DIFFERENCE_MS,
        format!("T counted {counted} in {passed_ms} ms of this computer (largest difference {MAX_DIFFERENCE_MS})"),
    )
}

fn large_numbers_are_decimal(cell: &Cell) -> Tried {
    const SENT: &str = "2000000.0";
    const EXPECTED: &str = "2000000.000000";
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return found(false, SILENT.to_owned());
    };
    if !program_runs(&heard) {
        return open();
    }
    if client.send_on_command(set_base(1, epoch, SENT).as_bytes()).is_err() {
        return found(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let written = pose(&state, "Base").map_or("nothing", |[x, ..]| x);
    found(written == EXPECTED, format!("base X {SENT} mm was sent, the state contains {written}"))
}

/// The line goes to the pose at which the arm is, at 1 mm/s: a controller that executes it moves nothing.
fn a_line_without_frames_is_refused(cell: &Cell) -> Tried {
    const NO_FRAMES: i64 = 6;
    const SPEED_M_S: &str = "0.001";
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return found(false, SILENT.to_owned());
    };
    let tip = heard.state.as_deref().and_then(|state| pose(state, "Tcp"));
    let (true, Some(tip)) = (program_runs(&heard), tip) else {
        return open();
    };
    if client.send_on_command(command(1, epoch, 2, SPEED_M_S, tip).as_bytes()).is_err() {
        return found(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |heard| heard.of_ack("Err").is_some_and(|refusal| refusal != 0));
    let refusal = after.of_ack("Err").unwrap_or_default();
    found(
        refusal == NO_FRAMES && after.of_ack("ErrId") == Some(1),
        format!(
            "a line without base and tool: Err {refusal} (expected {NO_FRAMES}), and it led to where the arm was"
        ),
    )
}
