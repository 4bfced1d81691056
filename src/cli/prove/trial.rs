//! Building blocks of this program's acceptance tests: the result of a test, a client in a new epoch, commands that
//! move nothing, and a client of the controller's two ports that can send what the robot link never sends.

use super::super::fault::Fault;
use super::table::Finding;
use panelprep_cell::cell::Cell;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// Maximum time in which a controller makes its channels available again after any disturbance.
const RECONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for a state message; one is due every 100 ms.
pub(super) const STATE_TIMEOUT: Duration = Duration::from_millis(1_500);
/// Interval between two heartbeats; a controller stops the queued commands after 400 ms without a message.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(100);
/// Maximum waiting time of one read.
const READ_TIMEOUT: Duration = Duration::from_millis(20);
/// Operation numbers of requests on the state channel.
const OP_HEARTBEAT: i32 = 10;
pub(super) const OP_ABORT: i32 = 11;
pub(super) const OP_RESET: i32 = 12;

/// Connects to a port of the controller.
pub(super) fn connect(cell: &Cell, port: u16) -> std::io::Result<TcpStream> {
    let address = (cell.robot().host(), port).to_socket_addrs()?.next();
    let address = address.ok_or_else(|| std::io::Error::other("no such host"))?;
    let stream = TcpStream::connect_timeout(&address, Duration::from_secs(1))?;
    stream.set_read_timeout(Some(READ_TIMEOUT))?;
    Ok(stream)
}

/// A connection to one channel, and the bytes that were received after the last complete document.
struct RawChannel {
    stream: TcpStream,
    text: Vec<u8>,
    is_closed: bool,
}

impl RawChannel {
    fn new(stream: TcpStream) -> Self {
        RawChannel { stream, text: Vec::new(), is_closed: false }
    }

    /// Reads the available bytes; returns the newest complete document with this tag, without its end tag.
    fn read(&mut self, tag: &str) -> Option<String> {
        let mut piece = [0; 4_096];
        match self.stream.read(&mut piece) {
            Ok(0) => self.is_closed = true,
            Ok(count) => self.text.extend_from_slice(&piece[..count]),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => self.is_closed = true,
        }
        let text = String::from_utf8_lossy(&self.text).into_owned();
        let close = format!("</{tag}>");
        let end = text.rfind(&close)?;
        let start = text[..end].rfind(&format!("<{tag} "))?;
        self.text = text.as_bytes()[end + close.len()..].to_vec();
        Some(text[start..end].to_owned())
    }
}

/// The data that a client has received: the newest state message and acknowledgement, and which channels were closed.
#[derive(Debug, Default)]
pub(super) struct ReceivedData {
    pub(super) state: Option<String>,
    pub(super) ack: Option<String>,
    pub(super) is_command_closed: bool,
    pub(super) is_state_closed: bool,
}

impl ReceivedData {
    /// Returns an integer attribute of the newest state message.
    pub(super) fn state_value(&self, name: &str) -> Option<i64> {
        attribute(self.state.as_deref()?, name)?.parse().ok()
    }

    /// Returns whether the controller has replied to a request that was sent after this one: `Re` is the number of the
    /// last request that the controller has read.
    pub(super) fn has_answered_after(&self, request: i32) -> bool {
        self.state_value("Re").is_some_and(|answered| answered > i64::from(request))
    }

    /// Returns an integer attribute of the newest acknowledgement.
    pub(super) fn ack_value(&self, name: &str) -> Option<i64> {
        attribute(self.ack.as_deref()?, name)?.parse().ok()
    }
}

/// A client of both channels of the controller that can send any bytes.
pub(super) struct RawClient {
    command: RawChannel,
    state: RawChannel,
    /// The number of the last request.
    asked: i32,
}

impl RawClient {
    /// Tries to connect until the controller sends a state message; `None` if it sends none within the time limit.
    pub(super) fn connect_with_retries(cell: &Cell) -> Option<(RawClient, ReceivedData)> {
        let begun = Instant::now();
        while begun.elapsed() < RECONNECT_TIMEOUT {
            let both = (connect(cell, cell.robot().command_port()), connect(cell, cell.robot().state_port()));
            if let (Ok(command), Ok(state)) = both {
                let [command, state] = [command, state].map(RawChannel::new);
                let mut client = RawClient { command, state, asked: 0 };
                let received = client.listen(STATE_TIMEOUT, |received| received.state.is_some());
                if received.state.is_some() {
                    return Some((client, received));
                }
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        None
    }

    /// Returns the number of the last request; a controller that has read it reports this number in `Re`.
    pub(super) fn last_request_id(&self) -> i32 {
        self.asked
    }

    /// Receives data for this time, or until `is_enough` returns true, and sends heartbeats meanwhile.
    pub(super) fn listen(&mut self, timeout: Duration, is_enough: impl Fn(&ReceivedData) -> bool) -> ReceivedData {
        let (begun, mut beat) = (Instant::now(), None::<Instant>);
        let mut received = ReceivedData::default();
        while begun.elapsed() < timeout && !is_enough(&received) && !received.is_state_closed {
            if beat.is_none_or(|at| at.elapsed() >= HEARTBEAT_INTERVAL) {
                beat = Some(Instant::now());
                #[expect(
                    clippy::let_underscore_must_use,
                    reason = "an error is reported by the next read, because the channel is then closed"
                )]
                let _ = self.ask(OP_HEARTBEAT, 0);
            }
            received.state = self.state.read("St").or(received.state);
            received.ack = self.command.read("Ack").or(received.ack);
            received.is_state_closed = self.state.is_closed;
            received.is_command_closed = self.command.is_closed;
        }
        received
    }

    /// Sends a request on the state channel.
    pub(super) fn ask(&mut self, operation: i32, number: i32) -> std::io::Result<()> {
        self.asked += 1;
        let request = format!("<Req Id=\"{}\" Ep=\"0\" Op=\"{operation}\" N1=\"{number}\"></Req>", self.asked);
        self.state.stream.write_all(request.as_bytes())
    }

    /// Sends bytes on the state channel.
    pub(super) fn send_on_state(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.state.stream.write_all(bytes)
    }

    /// Sends bytes on the command channel.
    pub(super) fn send_on_command(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.command.stream.write_all(bytes)
    }
}

/// Returns the value of an attribute in a document; if several elements have the attribute, the first value.
pub(super) fn attribute<'t>(document: &'t str, name: &str) -> Option<&'t str> {
    document.split(&format!(" {name}=\"")).nth(1)?.split('"').next()
}

/// Returns the six numbers of a pose in a document, as texts.
pub(super) fn pose<'t>(document: &'t str, element: &str) -> Option<[&'t str; 6]> {
    let inside = document.split(&format!("<{element}")).nth(1)?;
    let [x, y, z, a, b, c] = ["X", "Y", "Z", "A", "B", "C"].map(|name| attribute(inside, name));
    Some([x?, y?, z?, a?, b?, c?])
}

/// The result of a test of this program, with the evidence: what was sent and what was reported.
pub(super) type TestResult = Result<(Finding, String), Fault>;

/// The evidence of a test in which the controller did not respond.
pub(super) const NO_STATE_MESSAGE: &str = "no state message was received within 10 s: check that the submit \
                                           interpreter is running and that no other client is connected";

/// The evidence of a test that needs the robot program, if the robot program does not run.
pub(super) const NO_PROGRAM_MESSAGE: &str =
    "the robot program is not running: select cell_motion, hold Start in T1, and run the test again";

/// The bit of the attribute `Flags` for "motion possible".
const MOTION_POSSIBLE_BIT: i64 = 16;
/// The bit of the attribute `Flags` for "the program has stopped the epoch".
const STOPPED_BIT: i64 = 128;
/// Maximum time from the request for an epoch until it is open and the program has reset base and tool.
const EPOCH_TIMEOUT: Duration = Duration::from_millis(500);

pub(super) fn make_finding(right: bool, evidence: String) -> TestResult {
    Ok((if right { Finding::Proven } else { Finding::Wrong }, evidence))
}

/// Returns the result "open": the test showed neither the expected effect nor another one.
pub(super) fn open(evidence: impl Into<String>) -> TestResult {
    Ok((Finding::Open, evidence.into()))
}

/// Returns the result of a test that needs the robot program, if the robot program does not run.
pub(super) fn no_program_result() -> TestResult {
    open(NO_PROGRAM_MESSAGE)
}

/// Returns whether the robot program runs, which executes the commands.
pub(super) fn program_runs(received: &ReceivedData) -> bool {
    received.state_value("Flags").is_some_and(|flags| flags & MOTION_POSSIBLE_BIT != 0)
}

/// Returns whether the controller reports that it has stopped the epoch; `None` if no state message was received.
pub(super) fn is_stopped(received: &ReceivedData) -> Option<bool> {
    received.state_value("Flags").map(|flags| flags & STOPPED_BIT != 0)
}

/// Formats a number for the evidence.
pub(super) fn shown(number: Option<i64>) -> String {
    number.map_or("nothing".to_owned(), |number| number.to_string())
}

/// Returns the document of a command that sets the base, which moves nothing.
pub(super) fn set_base(id: i32, epoch: i64, x: &str) -> String {
    command(id, epoch, 3, "0.0", [x, "0.0", "0.0", "0.0", "0.0", "0.0"])
}

/// Returns the document of a command; `speed_m_s` is its attribute `R2`.
pub(super) fn command(
    id: i32,
    epoch: i64,
    operation: i32,
    speed_m_s: &str,
    [x, y, z, a, b, c]: [&str; 6],
) -> String {
    format!(
        "<Cmd Id=\"{id}\" Ep=\"{epoch}\" Op=\"{operation}\" N1=\"0\" N2=\"0\" R1=\"0.0\" R2=\"{speed_m_s}\"><P \
         X=\"{x}\" Y=\"{y}\" Z=\"{z}\" A=\"{a}\" B=\"{b}\" C=\"{c}\"></P></Cmd>"
    )
}

/// A client in a newly opened epoch.
pub(super) struct ClientInEpoch {
    pub(super) client: RawClient,
    pub(super) epoch: i64,
    /// The newest data that were received in this epoch.
    pub(super) received: ReceivedData,
}

/// Connects and opens an epoch two above the controller's epoch; `None` if the controller does not report it in time.
pub(super) fn open_new_epoch(cell: &Cell) -> Option<ClientInEpoch> {
    let (mut client, received) = RawClient::connect_with_retries(cell)?;
    let epoch = received.state_value("Ep")? + 2;
    client.ask(OP_RESET, i32::try_from(epoch).ok()?).ok()?;
    let received = client.listen(EPOCH_TIMEOUT, |_| false);
    (received.state_value("Ep") == Some(epoch)).then_some(ClientInEpoch { client, epoch, received })
}
