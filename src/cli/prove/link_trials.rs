//! Trials of the two channels: names, bytes that are no document, a second client, the epoch's range, clients that
//! vanish. Each states what was sent and what the controller reported about it; silence proves nothing.

use super::proof::Finding;
use super::raw_client::{OP_ABORT, OP_RESET, RawClient, STATE_TIMEOUT, attribute, connect, pose};
use super::trial::{
    InEpoch, NO_PROGRAM_MESSAGE, NO_STATE_MESSAGE, TestResult, in_a_new_epoch, is_stopped, make_finding, open,
    program_runs, set_base, shown,
};
use panelprep_cell::cell::Cell;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// Both channels are open if each has sent a document of its own.
pub(super) fn check_names_read(cell: &Cell) -> TestResult {
    let Some((mut client, _)) = RawClient::patient(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let heard = client.listen(STATE_TIMEOUT, |heard| heard.state.is_some() && heard.ack.is_some());
    let (Some(state), Some(_)) = (&heard.state, &heard.ack) else {
        return make_finding(
            false,
            "a state was received, but no acknowledgement on the command channel".to_owned(),
        );
    };
    let boot = attribute(state, "Boot").unwrap_or_default();
    let sum = attribute(state, "Sum").unwrap_or_default();
    make_finding(true, format!("a state and an acknowledgement; boot id {boot}, checksum of the programs {sum}"))
}

/// What bytes that are no document did on a channel.
enum ByteEffect {
    /// The channel was closed, and nothing else changed.
    Closed,
    /// What was sent after them was read and answered.
    Skipped,
    /// Anything else.
    Other(String),
    /// The trial could not be made.
    NotTried(Finding, &'static str),
}

/// Sends the bytes on each channel by itself: what the one channel does with them shows nothing about the other one.
pub(super) fn what_is_no_document_does_nothing(cell: &Cell) -> TestResult {
    let mut all = Vec::new();
    for (name, bytes) in
        [("a prolog", &b"<?xml version=\"1.0\"?>"[..]), ("a byte order mark", b"\xEF\xBB\xBF"), ("NUL", b"\0")]
    {
        for (channel, effect) in
            [("state", effect_on_state(cell, bytes)), ("command", effect_on_command(cell, bytes))]
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

/// The requests that follow these bytes are answered, or the channel is closed.
fn effect_on_state(cell: &Cell, bytes: &[u8]) -> ByteEffect {
    let Some(InEpoch { mut client, epoch, .. }) = in_a_new_epoch(cell) else {
        return ByteEffect::NotTried(Finding::Wrong, NO_STATE_MESSAGE);
    };
    let is_sent = client.send_on_state(bytes).is_ok();
    let asked = client.last_asked();
    let after = client.listen(STATE_TIMEOUT, |_| false);
    if after.is_state_closed || !is_sent {
        drop(client);
        return effect_of_closing(cell, epoch);
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

/// The command that follows these bytes is executed, or the channel is closed.
fn effect_on_command(cell: &Cell, bytes: &[u8]) -> ByteEffect {
    const BASE_X_MM: f64 = 7.0;
    let Some(InEpoch { mut client, epoch, heard }) = in_a_new_epoch(cell) else {
        return ByteEffect::NotTried(Finding::Wrong, NO_STATE_MESSAGE);
    };
    if !program_runs(&heard) {
        return ByteEffect::NotTried(Finding::Open, NO_PROGRAM_MESSAGE);
    }
    let is_sent = client.send_on_command(bytes).is_ok()
        && client.send_on_command(set_base(1, epoch, &format!("{BASE_X_MM:.1}")).as_bytes()).is_ok();
    let after = client.listen(STATE_TIMEOUT, |_| false);
    if after.is_command_closed || !is_sent {
        drop(client);
        return effect_of_closing(cell, epoch);
    }
    let found = (after.state_value("Ep"), after.ack_value("Rx"), after.ack_value("Err"));
    let base_x =
        after.state.as_deref().and_then(|state| pose(state, "Base")).and_then(|[x, ..]| x.parse::<f64>().ok());
    if found == (Some(epoch), Some(1), Some(0)) && base_x.is_some_and(|x_mm| (x_mm - BASE_X_MM).abs() < 0.001) {
        return ByteEffect::Skipped;
    }
    let (ep, rx, err) = (shown(found.0), shown(found.1), shown(found.2));
    ByteEffect::Other(format!(
        "not closed; a base was sent behind it: Rx {rx} (expected 1), Err {err}, epoch {ep} (expected {epoch})"
    ))
}

/// A channel was closed: the next client finds the same epoch, in which nothing was executed.
fn effect_of_closing(cell: &Cell, epoch: i64) -> ByteEffect {
    let Some((_, heard)) = RawClient::patient(cell) else {
        return ByteEffect::Other(format!("it was closed, and then {NO_STATE_MESSAGE}"));
    };
    let (found, done) = (heard.state_value("Ep"), heard.state_value("Done"));
    if (found, done) == (Some(epoch), Some(0)) {
        return ByteEffect::Closed;
    }
    let (found, done) = (shown(found), shown(done));
    ByteEffect::Other(format!("it was closed, then epoch {found} (expected {epoch}), Done {done} (expected 0)"))
}

/// What happened to a second client of a channel.
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
    /// Connects to a port that has a client, sends a document and waits for an answer.
    fn observe(cell: &Cell, port: u16, document: &str) -> Self {
        let mut second = match connect(cell, port) {
            Ok(second) => second,
            Err(error) => {
                return match error.kind() {
                    ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset => SecondClient::Refused,
                    // The first client is connected to the same port, so the way there is open.
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

/// The second client requests another epoch and sends a command of the first one's epoch: a controller that obeys it
/// would change the epoch, or count the command.
pub(super) fn check_second_client_refused(cell: &Cell) -> TestResult {
    const WATCHED: Duration = Duration::from_secs(6);
    let Some(InEpoch { client: mut first, epoch, .. }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let request = format!("<Req Id=\"1\" Ep=\"0\" Op=\"{OP_RESET}\" N1=\"{}\"></Req>", epoch + 2);
    let ports = [(cell.robot().state_port(), request), (cell.robot().command_port(), set_base(1, epoch, "9.0"))];
    // The first client continues meanwhile: a silent one would lose its epoch by its own fault.
    let second = std::thread::scope(|scope| {
        let others =
            ports.map(|(port, document)| scope.spawn(move || SecondClient::observe(cell, port, &document)));
        first.listen(WATCHED, |_| others.iter().all(std::thread::ScopedJoinHandle::is_finished));
        others.map(|other| other.join().unwrap_or(SecondClient::NotTried))
    });
    let asked = first.last_asked();
    let after = first.listen(STATE_TIMEOUT, |_| false);
    let (found, rx) = (after.state_value("Ep"), after.ack_value("Rx"));
    let [on_state, on_command]: [&str; 2] = second.map(Into::into);
    let evidence = format!(
        "a second client {on_state} on the state channel, where it requested epoch {}, and {on_command} on the command channel, \
         where it sent a base; then the first client: Re {} (more than {asked} was expected), epoch {} (expected {epoch}), Rx {} \
         (expected 0)",
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

/// Both requests are answered, the epoch stays, and only the abort stops it.
pub(super) fn check_epoch_range(cell: &Cell) -> TestResult {
    let Some(InEpoch { mut client, epoch, .. }) = in_a_new_epoch(cell) else {
        return make_finding(false, NO_STATE_MESSAGE.to_owned());
    };
    let mut all = Vec::new();
    for (name, operation, stops) in [("a reset", OP_RESET, false), ("an abort", OP_ABORT, true)] {
        // The answer to this request must be later than the one to the last heartbeat.
        let before = client.last_asked();
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

/// Each client that counts was connected: a refused connection shows nothing about a client that vanishes.
pub(super) fn check_vanished_client(cell: &Cell) -> TestResult {
    const GROUPS: usize = 10;
    const CLIENTS_IN_GROUP: usize = 10;
    let (mut vanished, mut slowest) = (0, Duration::ZERO);
    for _ in 0..GROUPS {
        let connected = connect_and_vanish(cell, CLIENTS_IN_GROUP);
        vanished += connected;
        if connected < CLIENTS_IN_GROUP {
            return open(format!(
                "only {connected} of {CLIENTS_IN_GROUP} clients could connect within {} s, after {vanished} clients that vanished",
                GROUP_TIMEOUT.as_secs()
            ));
        }
        let begun = Instant::now();
        if RawClient::patient(cell).is_none() {
            return make_finding(
                false,
                format!("after {vanished} clients that vanished at once: {NO_STATE_MESSAGE}"),
            );
        }
        slowest = slowest.max(begun.elapsed());
    }
    make_finding(
        true,
        format!(
            "{vanished} clients connected and disconnected immediately; after each {CLIENTS_IN_GROUP} of them the next client was \
             served within {:.1} s",
            slowest.as_secs_f64()
        ),
    )
}

/// Time limit for a group of clients: the controller opens a port again after each of them.
const GROUP_TIMEOUT: Duration = Duration::from_secs(30);
/// Pause before the next attempt at a port that is not open again yet.
const PORT_PAUSE: Duration = Duration::from_millis(20);

/// Connects to the command port and closes the connection at once, until this number of clients was connected or the
/// time is over; returns the number.
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
