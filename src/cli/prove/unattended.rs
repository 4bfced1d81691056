//! Tests that a client can do without a person: over the two ports, without a motion.

use super::super::fault::Fault;
use super::super::live;
use super::proof::Finding;
use crate::cell::Cell;
use crate::daemon::Single;
use crate::eki::Command;
use crate::geometry::KukaPose;
use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

type Tried = Result<(Finding, String), Fault>;

/// The test for a row of the installation page; `None` if a person must look.
pub(super) fn for_row(number: u32) -> Option<fn(&Cell) -> Tried> {
    match number {
        5 => Some(names_are_read),
        7 => Some(second_client_is_kept_out),
        33 => Some(the_epoch_is_not_used_up),
        35 => Some(a_vanishing_client_is_missed_by_nobody),
        39 => Some(decimals_are_kept),
        _ => None,
    }
}

/// A controller makes its channels available again within this time, whatever happened to them.
const RECONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for a state; states come every 100 ms.
const STATE_TIMEOUT: Duration = Duration::from_millis(1_500);

fn found(right: bool, evidence: String) -> Tried {
    Ok((if right { Finding::Proven } else { Finding::Wrong }, evidence))
}

fn connect(cell: &Cell, port: u16) -> std::io::Result<TcpStream> {
    let address = (cell.robot().host(), port).to_socket_addrs()?.next();
    let address = address.ok_or_else(|| std::io::Error::other("no such host"))?;
    let stream = TcpStream::connect_timeout(&address, Duration::from_secs(1))?;
    stream.set_read_timeout(Some(Duration::from_millis(200)))?;
    Ok(stream)
}

/// A client of both channels.
struct Client {
    command: TcpStream,
    state: TcpStream,
}

impl Client {
    /// Connects again and again until the controller reports a state; `None` if it does not report one in time.
    fn patient(cell: &Cell) -> Option<(Client, String)> {
        let begun = Instant::now();
        while begun.elapsed() < RECONNECT_TIMEOUT {
            let both = (connect(cell, cell.robot().command_port()), connect(cell, cell.robot().state_port()));
            if let (Ok(command), Ok(state)) = both {
                let mut client = Client { command, state };
                if let Some(state) = client.read_state() {
                    return Some((client, state));
                }
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        None
    }

    /// Returns the newest complete state that arrives within `STATE_TIMEOUT`.
    fn read_state(&mut self) -> Option<String> {
        let (begun, mut text) = (Instant::now(), Vec::new());
        let mut piece = [0; 4_096];
        while begun.elapsed() < STATE_TIMEOUT {
            match self.state.read(&mut piece) {
                Ok(0) => break,
                Ok(count) => text.extend_from_slice(&piece[..count]),
                Err(_) => {}
            }
            // The data of both channels is read, so that neither fills up.
            #[expect(clippy::let_underscore_must_use, reason = "without it the try after it takes longer")]
            let _ = self.command.set_read_timeout(Some(Duration::from_millis(1)));
            #[expect(clippy::let_underscore_must_use, reason = "what cannot be read now is read by the next try")]
            let _ = self.command.read(&mut piece);
        }
        let text = String::from_utf8_lossy(&text).into_owned();
        let end = text.rfind("</St>")?;
        let start = text[..end].rfind("<St ")?;
        Some(text[start..end].to_owned())
    }

    fn ask(&mut self, operation: i32, number: i32) -> std::io::Result<()> {
        let request = format!("<Req Id=\"1\" Ep=\"0\" Op=\"{operation}\" N1=\"{number}\"></Req>");
        self.state.write_all(request.as_bytes())
    }
}

fn attribute<'t>(state: &'t str, name: &str) -> Option<&'t str> {
    state.split(&format!(" {name}=\"")).nth(1)?.split('"').next()
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
    match Client::patient(cell) {
        Some((_, state)) => {
            let boot = attribute(&state, "Boot").unwrap_or_default();
            let sum = attribute(&state, "Sum").unwrap_or_default();
            found(true, format!("both channels are open; boot id {boot}, checksum of the programs {sum}"))
        }
        None => found(false, SILENT.to_owned()),
    }
}

fn second_client_is_kept_out(cell: &Cell) -> Tried {
    let Some((mut first, _)) = Client::patient(cell) else { return found(false, SILENT.to_owned()) };
    let second = connect(cell, cell.robot().state_port());
    let heard = second.map(|mut second| {
        let mut piece = [0; 64];
        (0..5).any(|_| matches!(second.read(&mut piece), Ok(count) if count > 0))
    });
    let undisturbed = first.read_state().is_some();
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
    let Some((mut client, state)) = Client::patient(cell) else { return found(false, SILENT.to_owned()) };
    let before = attribute(&state, "Ep").unwrap_or_default().to_owned();
    for operation in [12, 11] {
        if client.ask(operation, i32::MAX).is_err() {
            return found(false, "the state channel closed".to_owned());
        }
        let Some(after) = client.read_state() else { return found(false, "no state after the request".to_owned()) };
        let after = attribute(&after, "Ep").unwrap_or_default();
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
    const TIMES: usize = 20;
    let mut slowest = Duration::ZERO;
    for time in 1..=TIMES {
        // While the controller opens the port again, the connection is refused, which serves this test as well.
        drop(connect(cell, cell.robot().command_port()));
        if time % 10 == 0 {
            let begun = Instant::now();
            if Client::patient(cell).is_none() {
                return found(false, format!("after {time} clients that disconnected immediately: {SILENT}"));
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
    if Client::patient(cell).is_none() {
        return found(false, SILENT.to_owned());
    }
    std::thread::sleep(Duration::from_millis(500));
    let (mut robot, _) = live::robot_alone(cell)?;
    let mut single = match Single::connect(&mut robot, cell.arm()) {
        Ok(single) => single,
        Err(error) => return found(false, error.to_string()),
    };
    let base = KukaPose { x_mm, ..KukaPose::default() };
    match single.set(Command::SetBase(base)) {
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
