//! The acceptance tests that need no person: a client runs them over the two ports, without a motion.
//!
//! The tests of the two channels cover: names, bytes that are not a document, a second client, the range of epochs,
//! clients that disappear. Each test states what was sent and what the controller reported; if the controller reports
//! nothing, the test is not passed.

use super::super::live;
use super::table::Finding;
use super::trial::{
    ClientInEpoch, NO_PROGRAM_MESSAGE, NO_STATE_MESSAGE, OP_ABORT, OP_RESET, RawClient, STATE_TIMEOUT, TestResult,
    attribute, command, connect, is_stopped, make_finding, no_program_result, open, open_new_epoch, pose,
    program_runs, set_base, shown,
};
use panelprep_base::geometry::KukaPose;
use panelprep_cell::cell::Cell;
use panelprep_kuka::eki::Command;
use panelprep_service::daemon::SingleRobot;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// A function that tests one assumption.
pub(super) type Attempt = fn(&Cell) -> TestResult;

/// Returns the test for a row of the installation page; `None` if only a person can observe the result.
pub(super) fn find_test_for_row(number: u32) -> Option<Attempt> {
    match number {
        1 => Some(check_attribute_order),
        2 => Some(check_no_old_command_remains),
        3 => Some(check_command_is_read_completely),
        5 => Some(check_names_read),
        6 => Some(check_invalid_bytes_have_no_effect),
        7 => Some(check_second_client_refused),
        15 => Some(check_time_unit),
        18 => Some(check_large_numbers_are_decimal),
        27 => Some(check_line_without_frames_is_refused),
        33 => Some(check_epoch_range),
        35 => Some(check_vanished_client),
        39 => Some(check_decimals),
        _ => None,
    }
}

/// Checks that the controller reports the base that was sent. Both texts are compared as numbers, with a smaller
/// tolerance than that of the robot link.
fn check_base_echo(cell: &Cell, x_mm: f64, most_mm: f64) -> TestResult {
    // The connections of earlier tests may not be closed completely yet.
    if RawClient::connect_with_retries(cell).is_none() {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    }
    std::thread::sleep(Duration::from_millis(500));
    let (mut robot, _) = live::robot_alone(cell)?;
    let mut single = match SingleRobot::connect(&mut robot, cell.arm()) {
        Ok(single) => single,
        Err(error) => return make_finding(false, error.to_string()),
    };
    if !single.state().motion_possible {
        return no_program_result();
    }
    let base = KukaPose { x_mm, ..KukaPose::default() };
    match single.set(Command::SetBase(base), cell) {
        Ok(()) => {
            let reported_mm = single.state().active_base.x_mm;
            let evidence = format!("base X {x_mm} mm was sent, {reported_mm} mm was reported back");
            make_finding((reported_mm - x_mm).abs() <= most_mm, evidence)
        }
        Err(error) => make_finding(false, format!("base X {x_mm} mm: {error}")),
    }
}

fn check_decimals(cell: &Cell) -> TestResult {
    check_base_echo(cell, 1.2345, 0.000_01)
}

/// Checks that the six attributes of a frame may be in any order: they are sent in reverse order, and each must be
/// assigned to its own coordinate.
fn check_attribute_order(cell: &Cell) -> TestResult {
    const SENT: &str = "<P C=\"6.0\" B=\"5.0\" A=\"4.0\" Z=\"3.0\" Y=\"2.0\" X=\"1.0\"></P>";
    const EXPECTED: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    const MAX_DIFFERENCE: f64 = 0.001;
    let Some(ClientInEpoch { mut client, epoch, received }) = open_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    if !program_runs(&received) {
        return no_program_result();
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
        format!("sent as C 6, B 5, A 4, Z 3, Y 2, X 1; the state contains X to C: {}", base.join(", ")),
    )
}

/// Checks that no old command remains after the link was cut. Thirty commands are sent at once and the link is cut, so
/// that some of them stay unread. They belong to the epoch that is opened next: an old command would be read with the
/// next command, and would be refused or executed instead of it.
fn check_no_old_command_remains(cell: &Cell) -> TestResult {
    const COMMANDS: i32 = 30;
    let Some((mut first, received)) = RawClient::connect_with_retries(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let epoch = received.state_value("Ep").unwrap_or_default() + 2;
    let old: String = (1..=COMMANDS).map(|id| set_base(id, epoch, &format!("{id}.0"))).collect();
    if first.send_on_command(old.as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    drop(first);
    let Some(ClientInEpoch { mut client, epoch: opened, received }) = open_new_epoch(cell) else {
        return make_finding(false, "no epoch was opened after the link was cut".to_owned());
    };
    // A command that is queued but not executed would end the epoch.
    if !program_runs(&received) {
        return no_program_result();
    }
    let before = received.ack_value("Rx");
    if client.send_on_command(set_base(1, opened, "100.0").as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let after = client.listen(STATE_TIMEOUT, |_| false);
    let numbers = (before, after.ack_value("Rx"), after.ack_value("Err"));
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

/// Checks that a command is read completely: the program executes a command only if all its elements have the same
/// counter.
fn check_command_is_read_completely(cell: &Cell) -> TestResult {
    check_base_echo(cell, 1.0, 0.000_01)
}

fn check_time_unit(cell: &Cell) -> TestResult {
    const WATCH_TIME: Duration = Duration::from_secs(5);
    /// Maximum difference between the two clocks, ms; a state message is due every 100 ms.
    const MAX_DIFFERENCE_MS: i64 = 500;
    /// Minimum number of state messages: half of those that are due.
    const MIN_STATES: i64 = 25;
    let Some((mut client, first)) = RawClient::connect_with_retries(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let begun = Instant::now();
    let last = client.listen(WATCH_TIME, |_| false);
    let passed = begun.elapsed();
    let (Some(from), Some(to)) = (first.state_value("T"), last.state_value("T")) else {
        return make_finding(false, "no state at the end of 5 s".to_owned());
    };
    let passed_ms = i64::try_from(passed.as_millis()).unwrap_or(i64::MAX);
    let states = last.state_value("Seq").zip(first.state_value("Seq")).map_or(0, |(last, first)| last - first);
    let evidence = format!(
        "T counted {} in {passed_ms} ms of this computer (largest difference {MAX_DIFFERENCE_MS}), over {states} \
         states (at least {MIN_STATES})",
        to - from
    );
    // If the link ended early, the times of the two state messages are too close for a comparison.
    if passed < WATCH_TIME || states < MIN_STATES {
        return open(evidence);
    }
    make_finding((to - from - passed_ms).abs() <= MAX_DIFFERENCE_MS, evidence)
}

fn check_large_numbers_are_decimal(cell: &Cell) -> TestResult {
    const SENT: &str = "2000000.0";
    const EXPECTED: &str = "2000000.000000";
    let Some(ClientInEpoch { mut client, epoch, received }) = open_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    if !program_runs(&received) {
        return no_program_result();
    }
    if client.send_on_command(set_base(1, epoch, SENT).as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let state = client.listen(STATE_TIMEOUT, |_| false).state.unwrap_or_default();
    let written = pose(&state, "Base").map_or("nothing", |[x, ..]| x);
    make_finding(written == EXPECTED, format!("base X {SENT} mm was sent, the state contains {written}"))
}

/// Checks that a linear motion without base and tool is refused. It would end at the arm's present pose, at 1 mm/s, so
/// a controller that executes it moves nothing.
fn check_line_without_frames_is_refused(cell: &Cell) -> TestResult {
    const NO_FRAMES: i64 = 6;
    const SPEED_M_S: &str = "0.001";
    let Some(ClientInEpoch { mut client, epoch, received }) = open_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let tip = received.state.as_deref().and_then(|state| pose(state, "Tcp"));
    let (true, Some(tip)) = (program_runs(&received), tip) else {
        return no_program_result();
    };
    if client.send_on_command(command(1, epoch, 2, SPEED_M_S, tip).as_bytes()).is_err() {
        return make_finding(false, "the command channel closed".to_owned());
    }
    let after =
        client.listen(STATE_TIMEOUT, |received| received.ack_value("Err").is_some_and(|refusal| refusal != 0));
    let refusal = after.ack_value("Err").unwrap_or_default();
    make_finding(
        refusal == NO_FRAMES && after.ack_value("ErrId") == Some(1),
        format!(
            "a line without base and tool: Err {refusal} (expected {NO_FRAMES}), and the line ended at the arm's own pose"
        ),
    )
}

/// Checks that both channels are open: each must have sent one of its documents.
fn check_names_read(cell: &Cell) -> TestResult {
    let Some((mut client, _)) = RawClient::connect_with_retries(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let received = client.listen(STATE_TIMEOUT, |received| received.state.is_some() && received.ack.is_some());
    let (Some(state), Some(_)) = (&received.state, &received.ack) else {
        return make_finding(
            false,
            "a state was received, but no acknowledgement on the command channel".to_owned(),
        );
    };
    let boot = attribute(state, "Boot").unwrap_or_default();
    let sum = attribute(state, "Sum").unwrap_or_default();
    make_finding(true, format!("a state and an acknowledgement; boot id {boot}, checksum of the programs {sum}"))
}

/// The effect of bytes that are not a document on one channel.
enum ByteEffect {
    /// The channel was closed, and nothing else changed.
    Closed,
    /// The bytes were skipped: the documents after them were processed.
    Skipped,
    /// Any other effect, described in words.
    Other(String),
    /// The test could not be run.
    NotTried(Finding, &'static str),
}

/// Checks that bytes that are not a document have no effect. Each channel is tested separately, because the effect on
/// one channel says nothing about the other.
fn check_invalid_bytes_have_no_effect(cell: &Cell) -> TestResult {
    let mut all = Vec::new();
    for (name, bytes) in
        [("a prolog", &b"<?xml version=\"1.0\"?>"[..]), ("a byte order mark", b"\xEF\xBB\xBF"), ("NUL", b"\0")]
    {
        for (channel, effect) in
            [("state", observe_effect_on_state(cell, bytes)), ("command", observe_effect_on_command(cell, bytes))]
        {
            all.push(match effect {
                ByteEffect::Closed => format!("{name} closes the {channel} channel"),
                ByteEffect::Skipped => format!("{name} is skipped on the {channel} channel"),
                ByteEffect::Other(what) => {
                    return make_finding(false, format!("{name} on the {channel} channel: {what}"));
                }
                ByteEffect::NotTried(finding, why) => return Ok((finding, why.to_owned())),
            });
        }
    }
    make_finding(true, all.join(", "))
}

/// Returns the effect of these bytes on the state channel: the controller must reply to subsequent requests, or close
/// the channel.
fn observe_effect_on_state(cell: &Cell, bytes: &[u8]) -> ByteEffect {
    let Some(ClientInEpoch { mut client, epoch, .. }) = open_new_epoch(cell) else {
        return ByteEffect::NotTried(Finding::Wrong, NO_STATE_MESSAGE);
    };
    let is_sent = client.send_on_state(bytes).is_ok();
    let asked = client.last_request_id();
    let after = client.listen(STATE_TIMEOUT, |_| false);
    if after.is_state_closed || !is_sent {
        drop(client);
        return observe_effect_of_closing(cell, epoch);
    }
    let (found, done) = (after.state_value("Ep"), after.state_value("Done"));
    if after.has_answered_after(asked) && (found, done) == (Some(epoch), Some(0)) {
        return ByteEffect::Skipped;
    }
    let (found, done, answered) = (shown(found), shown(done), shown(after.state_value("Re")));
    ByteEffect::Other(format!(
        "not closed; Re {answered} (more than {asked} was expected), epoch {found} (expected {epoch}), Done {done}"
    ))
}

/// Returns the effect of these bytes on the command channel: the controller must execute the subsequent command, or
/// close the channel.
fn observe_effect_on_command(cell: &Cell, bytes: &[u8]) -> ByteEffect {
    const BASE_X_MM: f64 = 7.0;
    let Some(ClientInEpoch { mut client, epoch, received }) = open_new_epoch(cell) else {
        return ByteEffect::NotTried(Finding::Wrong, NO_STATE_MESSAGE);
    };
    if !program_runs(&received) {
        return ByteEffect::NotTried(Finding::Open, NO_PROGRAM_MESSAGE);
    }
    let is_sent = client.send_on_command(bytes).is_ok()
        && client.send_on_command(set_base(1, epoch, &format!("{BASE_X_MM:.1}")).as_bytes()).is_ok();
    let after = client.listen(STATE_TIMEOUT, |_| false);
    if after.is_command_closed || !is_sent {
        drop(client);
        return observe_effect_of_closing(cell, epoch);
    }
    let found = (after.state_value("Ep"), after.ack_value("Rx"), after.ack_value("Err"));
    let base_x =
        after.state.as_deref().and_then(|state| pose(state, "Base")).and_then(|[x, ..]| x.parse::<f64>().ok());
    if found == (Some(epoch), Some(1), Some(0)) && base_x.is_some_and(|x_mm| (x_mm - BASE_X_MM).abs() < 0.001) {
        return ByteEffect::Skipped;
    }
    let (ep, rx, err) = (shown(found.0), shown(found.1), shown(found.2));
    ByteEffect::Other(format!(
        "not closed; a base was sent after it: Rx {rx} (expected 1), Err {err}, epoch {ep} (expected {epoch})"
    ))
}

/// Returns the effect after a channel was closed: for the next client, the epoch must be the same and no command
/// executed.
fn observe_effect_of_closing(cell: &Cell, epoch: i64) -> ByteEffect {
    let Some((_, received)) = RawClient::connect_with_retries(cell) else {
        return ByteEffect::Other(format!("the connection was closed; after that, {NO_STATE_MESSAGE}"));
    };
    let (found, done) = (received.state_value("Ep"), received.state_value("Done"));
    if (found, done) == (Some(epoch), Some(0)) {
        return ByteEffect::Closed;
    }
    let (found, done) = (shown(found), shown(done));
    ByteEffect::Other(format!(
        "the connection was closed; after that, epoch {found} (expected {epoch}), Done {done} (expected 0)"
    ))
}

/// The reaction of the controller to a second client of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
enum SecondClient {
    #[strum(serialize = "was served")]
    Served,
    #[strum(serialize = "was kept waiting or closed without an answer")]
    Unanswered,
    #[strum(serialize = "was refused")]
    Refused,
    #[strum(serialize = "could not be tried")]
    NotTried,
}

impl SecondClient {
    /// Connects to a port that already has a client, sends a document and waits for a reply.
    fn observe(cell: &Cell, port: u16, document: &str) -> Self {
        let mut second = match connect(cell, port) {
            Ok(second) => second,
            Err(error) => {
                return match error.kind() {
                    ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset => SecondClient::Refused,
                    // The first client is connected to the same port, so a timeout is not caused by the network.
                    ErrorKind::TimedOut | ErrorKind::WouldBlock => SecondClient::Unanswered,
                    _ => SecondClient::NotTried,
                };
            }
        };
        if second.write_all(document.as_bytes()).is_err() {
            return SecondClient::Unanswered;
        }
        let (begun, mut piece) = (Instant::now(), [0; 64]);
        while begun.elapsed() < STATE_TIMEOUT {
            match second.read(&mut piece) {
                Ok(0) => return SecondClient::Unanswered,
                Ok(_) => return SecondClient::Served,
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(_) => return SecondClient::Unanswered,
            }
        }
        SecondClient::Unanswered
    }
}

/// Checks that a second client is refused. It requests another epoch, and sends a command of the first client's epoch.
/// A controller that obeys would change the epoch, or count the command.
fn check_second_client_refused(cell: &Cell) -> TestResult {
    const WATCH_TIME: Duration = Duration::from_secs(6);
    let Some(ClientInEpoch { client: mut first, epoch, .. }) = open_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let request = format!("<Req Id=\"1\" Ep=\"0\" Op=\"{OP_RESET}\" N1=\"{}\"></Req>", epoch + 2);
    let ports = [(cell.robot().state_port(), request), (cell.robot().command_port(), set_base(1, epoch, "9.0"))];
    // The first client continues to send meanwhile, because otherwise its epoch would end for another reason.
    let second = std::thread::scope(|scope| {
        let others =
            ports.map(|(port, document)| scope.spawn(move || SecondClient::observe(cell, port, &document)));
        first.listen(WATCH_TIME, |_| others.iter().all(std::thread::ScopedJoinHandle::is_finished));
        others.map(|other| other.join().unwrap_or(SecondClient::NotTried))
    });
    let asked = first.last_request_id();
    let after = first.listen(STATE_TIMEOUT, |_| false);
    let (found, rx) = (after.state_value("Ep"), after.ack_value("Rx"));
    let [on_state, on_command]: [&str; 2] = second.map(Into::into);
    let evidence = format!(
        "a second client {on_state} on the state channel, where it requested epoch {}, and {on_command} on the command \
         channel, where it sent a base; then the first client: Re {} (more than {asked} was expected), epoch {} \
         (expected {epoch}), Rx {} (expected 0)",
        epoch + 2,
        shown(after.state_value("Re")),
        shown(found),
        shown(rx)
    );
    if second.contains(&SecondClient::NotTried) {
        return open(evidence);
    }
    let is_undisturbed = after.has_answered_after(asked) && found == Some(epoch) && rx == Some(0);
    make_finding(is_undisturbed && !second.contains(&SecondClient::Served), evidence)
}

/// Checks the range of epoch numbers: the controller must reply to both requests with the maximum number, keep its
/// epoch, and stop only after the abort.
fn check_epoch_range(cell: &Cell) -> TestResult {
    let Some(ClientInEpoch { mut client, epoch, .. }) = open_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let mut all = Vec::new();
    for (name, operation, stops) in [("a reset", OP_RESET, false), ("an abort", OP_ABORT, true)] {
        // The reply to this request must be newer than the reply to the last heartbeat.
        let before = client.last_request_id();
        if client.ask(operation, i32::MAX).is_err() {
            return make_finding(false, format!("the state channel closed at {name}"));
        }
        let after = client.listen(STATE_TIMEOUT, |_| false);
        let (found, stopped) = (after.state_value("Ep"), is_stopped(&after));
        let words = match stopped {
            Some(true) => "stopped",
            Some(false) => "not stopped",
            None => "without a state",
        };
        let evidence = format!(
            "{name} to epoch 2147483647 in epoch {epoch}: Re {} (more than {before} was expected), epoch {}, {words}",
            shown(after.state_value("Re")),
            shown(found)
        );
        if !after.has_answered_after(before) || found != Some(epoch) || stopped != Some(stops) {
            return make_finding(false, evidence);
        }
        all.push(evidence);
    }
    make_finding(true, all.join("; "))
}

/// Checks that clients that disappear do not block a port. Only clients that were connected are counted, because a
/// refused connection says nothing about a client that disappears.
fn check_vanished_client(cell: &Cell) -> TestResult {
    const GROUPS: usize = 10;
    const CLIENTS_IN_GROUP: usize = 10;
    let (mut vanished, mut slowest) = (0, Duration::ZERO);
    for _ in 0..GROUPS {
        let connected = connect_and_vanish(cell, CLIENTS_IN_GROUP);
        vanished += connected;
        if connected < CLIENTS_IN_GROUP {
            return open(format!(
                "only {connected} of {CLIENTS_IN_GROUP} clients could connect within {} s, after {vanished} clients \
                 had disappeared",
                GROUP_TIMEOUT.as_secs()
            ));
        }
        let begun = Instant::now();
        if RawClient::connect_with_retries(cell).is_none() {
            return make_finding(false, format!("after {vanished} clients had disappeared: {NO_STATE_MESSAGE}"));
        }
        slowest = slowest.max(begun.elapsed());
    }
    make_finding(
        true,
        format!(
            "{vanished} clients connected and disconnected immediately; after each {CLIENTS_IN_GROUP} of them the next \
             client was served within {:.1} s",
            slowest.as_secs_f64()
        ),
    )
}

/// Time limit for a group of clients; the controller must open the port again after each client.
const GROUP_TIMEOUT: Duration = Duration::from_secs(30);
/// Delay before the next attempt to connect to a port that is not open again yet.
const PORT_PAUSE: Duration = Duration::from_millis(20);

/// Connects to the command port and closes the connection immediately, until this number of clients was connected or
/// the time limit is reached; returns the number of connected clients.
fn connect_and_vanish(cell: &Cell, wanted: usize) -> usize {
    let (begun, mut connected) = (Instant::now(), 0);
    while connected < wanted && begun.elapsed() < GROUP_TIMEOUT {
        match connect(cell, cell.robot().command_port()) {
            Ok(_) => connected += 1,
            Err(_) => std::thread::sleep(PORT_PAUSE),
        }
    }
    connected
}
