//! The client's side of the protocol: epochs, ids, credits and the watchdog, without a socket.
//!
//! Inputs are bytes, commands and `now`. Outputs are polled: [`Session::poll_transmit`] until it returns `None`, then
//! [`Session::poll_report`]. One epoch at a time is open. Any fault ends the epoch: a refusal, a wrong command number,
//! a different echo, or a channel that sends nothing. The session then sends an abort, empties the queue and reports
//! the fault. Nothing moves again before [`Session::open_epoch`]. On a new connection the session only requests the
//! state.
//!
//! A stop reaches the arm in every phase. The controller obeys an abort even if the epoch number in the abort is not a
//! valid successor. The controller must respond to the abort and stop within the watchdog's time; otherwise the
//! connections are closed, and the controller stops by itself. A report never states more progress than the controller
//! has reported. Epochs that increase by more than [`MAX_EPOCH_STEP`](super::MAX_EPOCH_STEP) are refused on both sides,
//! so that one wrong message cannot exhaust the counter. The controller's epoch is known only while the connection
//! lasts; the epochs that this program opened are remembered longer. After a cold start of the controller, or if the
//! store was restored from a backup, the next epoch is reached in steps.
//!
//! On the wall clock a heartbeat is sent automatically at [`Session::deadline`]. In lock step there are no deadlines:
//! the caller requests each heartbeat, which permits the controller to run for the next 100 ms.

mod echo;
mod epochs;
mod flow;
mod receive;
#[cfg(test)]
mod tests;

use super::command::{Command, CommandError, MoveLin, Request, Signal};
use super::framer::Framer;
use super::ids::{CommandId, Epoch, LAST_NUMBER, Time};
use super::report::{Channel, LinkLoss, Report};
use super::schema::DecodeError;
use super::wire::Wire;
use flow::CommandFlow;
pub use flow::{LinkLimits, QueueError};
use std::collections::VecDeque;

/// The clock on which a session runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockMode {
    /// The wall clock: heartbeats and watchdog follow deadlines.
    Wall,
    /// The virtual clock of the controller, which heartbeats advance.
    LockStep,
}

/// The phase of the session.
#[derive(Debug)]
enum Phase {
    /// The controller is not connected.
    Offline,
    /// Connected; the state was requested. `abort` is set if an abort was commanded before the first reply.
    Greeting { abort: Option<PendingAbort> },
    /// The controller has replied; no epoch is open.
    Idle,
    /// The session has requested an epoch and waits for the controller; `request` is the number of the request.
    Opening { epoch: Epoch, request: u32 },
    /// An epoch is open; commands can be queued.
    Open(Box<CommandFlow>),
    /// An abort was sent; the session waits for standstill.
    Stopping(PendingAbort),
}

/// An abort that was sent and is not completed.
#[derive(Debug, Clone, Copy)]
struct PendingAbort {
    /// The epoch that the abort ended, and the numbers of the commands that were sent and executed in it.
    ended: Option<Epoch>,
    sent: CommandId,
    done: CommandId,
    is_refusal_reported: bool,
    /// The number of the abort request, and the time at which it was sent.
    request: u32,
    asked_at: Option<Time>,
    /// Whether the controller has responded to the abort and has stopped.
    obeyed: bool,
}

/// Returns why a connection ended before the first message of the controller. If the controller closed it, another
/// client is connected. A message of the other channel means that the ports are exchanged.
fn connection_end_cause(why: LinkLoss) -> LinkLoss {
    match why {
        LinkLoss::Closed { channel } => LinkLoss::Occupied { channel },
        LinkLoss::Message { channel, error: DecodeError::Root { found, .. } }
            if ["Ack", "St"].contains(&found.as_str()) =>
        {
            LinkLoss::PortsExchanged { channel }
        }
        other => other,
    }
}

/// One client's session with a controller, over any number of connections.
#[derive(Debug)]
pub struct Session {
    wire: Wire,
    limits: LinkLimits,
    pace: ClockMode,
    phase: Phase,
    command_framer: Framer,
    state_framer: Framer,
    /// The time at which the unfinished message of each channel began.
    begun: [Option<Time>; 2],
    requests: VecDeque<Vec<u8>>,
    reports: VecDeque<Report>,
    /// Whether the last state of an open epoch was in the mode AUT or EXT.
    was_automatic: bool,
    /// The boot id of the last connected controller, and the checksum of its programs.
    identity: Option<(i32, i32)>,
    /// The controller's epoch and the highest requested one, on this connection.
    controller_epoch: Epoch,
    asked_epoch: Epoch,
    /// The highest epoch that was ever requested by this session, or that its caller has passed.
    opened_epoch: Epoch,
    /// The numbers of the last request sent and of the last request answered on this connection.
    asked: u32,
    answered: u32,
    /// The numbers of the unanswered heartbeats, each with the last sent command that the heartbeat contains; only in
    /// lock step.
    heartbeat_commands: VecDeque<(u32, u32)>,
    last_sequence: Option<u32>,
    /// Whether the arm moves, according to the last state message.
    moving: bool,
    harmful_on: bool,
    last_received: Time,
    next_heartbeat: Time,
    stale_messages: u64,
    /// The commanded outputs to a production line, and those that were already sent on this connection.
    line: Option<u32>,
    sent_line: Option<u32>,
    /// Number of consecutive epochs in which no command was acknowledged in time.
    unacknowledged: u32,
}

impl Session {
    /// Creates a session that is not connected.
    pub fn new(wire: Wire, limits: LinkLimits, pace: ClockMode) -> Self {
        Session {
            wire,
            limits,
            pace,
            phase: Phase::Offline,
            command_framer: Framer::default(),
            state_framer: Framer::default(),
            begun: [None; 2],
            requests: VecDeque::new(),
            reports: VecDeque::new(),
            was_automatic: false,
            identity: None,
            controller_epoch: Epoch(0),
            asked_epoch: Epoch(0),
            opened_epoch: Epoch(0),
            asked: 0,
            answered: 0,
            heartbeat_commands: VecDeque::new(),
            last_sequence: None,
            moving: false,
            harmful_on: false,
            last_received: Time::default(),
            next_heartbeat: Time::default(),
            stale_messages: 0,
            line: None,
            sent_line: None,
            unacknowledged: 0,
        }
    }

    /// Starts the session on two open connections. The state is requested; nothing moves.
    pub fn connected(&mut self, now: Time) {
        self.command_framer = Framer::default();
        self.state_framer = Framer::default();
        self.begun = [None; 2];
        self.requests.clear();
        (self.asked, self.answered, self.last_sequence) = (0, 0, None);
        (self.controller_epoch, self.asked_epoch) = (Epoch(0), Epoch(0));
        self.heartbeat_commands.clear();
        (self.unacknowledged, self.sent_line) = (0, None);
        (self.last_received, self.next_heartbeat) = (now, now + self.limits.heartbeat);
        self.phase = Phase::Greeting { abort: None };
        self.number_request(Request::State);
    }

    /// Processes the failure of a connection, or of an attempt to connect. Queued commands are discarded. A pending
    /// abort is still sent, because the state channel may still be connected.
    pub fn disconnected(&mut self, why: LinkLoss) {
        let why = if self.is_waiting_for_greeting() { connection_end_cause(why) } else { why };
        if self.is_connected() {
            self.stop();
        }
        (self.phase, self.harmful_on) = (Phase::Offline, false);
        self.reports.push_back(Report::LinkLost { why });
    }

    /// Returns whether the connections are in use. If false, the caller sends the remaining bytes and closes the
    /// connections.
    pub fn is_connected(&self) -> bool {
        !matches!(self.phase, Phase::Offline)
    }

    /// Returns whether a request is unanswered, so that another report will follow.
    pub fn awaits_answer(&self) -> bool {
        self.is_connected() && self.answered < self.asked
    }

    /// Returns the open epoch; `None` if no epoch is open.
    pub fn epoch(&self) -> Option<Epoch> {
        if let Phase::Open(flow) = &self.phase { Some(flow.epoch()) } else { None }
    }

    /// Returns the number of messages of ended epochs that were dropped.
    pub fn stale_messages(&self) -> u64 {
        self.stale_messages
    }

    /// Returns the next bytes to send. Requests are returned before commands, so that no command delays an abort.
    pub fn poll_transmit(&mut self, now: Time) -> Option<(Channel, Vec<u8>)> {
        if let Some(stopping) = self.stopping_mut() {
            stopping.asked_at.get_or_insert(now);
        }
        if let Some(request) = self.requests.pop_front() {
            return Some((Channel::State, request));
        }
        let Phase::Open(flow) = &mut self.phase else { return None };
        flow.next_command_bytes(now, &self.limits).map(|bytes| (Channel::Command, bytes))
    }

    /// Returns the next report.
    pub fn poll_report(&mut self) -> Option<Report> {
        self.reports.pop_front()
    }

    fn stopping_mut(&mut self) -> Option<&mut PendingAbort> {
        match &mut self.phase {
            Phase::Stopping(stopping) | Phase::Greeting { abort: Some(stopping) } => Some(stopping),
            _ => None,
        }
    }

    fn require_greeting(&self) -> Result<(), QueueError> {
        match self.phase {
            Phase::Offline | Phase::Greeting { .. } => Err(QueueError::NotConnected),
            _ => Ok(()),
        }
    }

    /// Returns the epoch number that requests contain.
    fn current_epoch(&self) -> Epoch {
        match &self.phase {
            Phase::Open(flow) => flow.epoch(),
            Phase::Stopping(PendingAbort { ended: Some(ended), .. }) => *ended,
            _ => self.highest_known_epoch(),
        }
    }

    /// Sets the outputs to a production line, as bits. They are sent immediately if a controller has replied, and again
    /// on each new connection. They move nothing.
    pub fn set_line_signals(&mut self, bits: u32) {
        self.line = Some(bits);
        if self.require_greeting().is_ok() {
            self.send_due_line_signals();
        }
    }

    fn send_due_line_signals(&mut self) {
        if let Some(bits) = self.line.filter(|_| self.line != self.sent_line) {
            self.number_request(Request::Line { bits });
            self.sent_line = self.line;
        }
    }

    fn number_request(&mut self, request: Request) -> u32 {
        // The last request number is reserved for an abort. Any other request that needs this number ends the
        // connection.
        if self.asked + 1 >= LAST_NUMBER && !matches!(request, Request::Abort { .. }) {
            self.disconnected(LinkLoss::RequestsExhausted { most: LAST_NUMBER });
            return self.asked;
        }
        self.asked = (self.asked + 1).min(LAST_NUMBER);
        let bytes = self.wire.encode_request(self.asked, self.current_epoch(), &request);
        self.requests.push_back(bytes);
        self.asked
    }
}

impl Session {
    /// Queues one command and returns its id. [`Command::GetCurrentState`] is requested immediately and has the id 0.
    ///
    /// # Errors
    /// If no epoch is open, or the command cannot be executed; the epoch stays open.
    pub fn queue(&mut self, command: Command) -> Result<CommandId, QueueError> {
        match command {
            Command::GetCurrentState => {
                self.require_greeting()?;
                self.number_request(Request::State);
                Ok(CommandId(0))
            }
            Command::MoveLin(point) => self.queue_path(&[point]),
            // The command is refused here with a message that states what to do. The controller would only stop the
            // program.
            Command::SetDigin(Signal { number, .. }) if !self.limits.mapped_inputs.contains(number) => {
                self.require_greeting()?;
                Err(CommandError::InputReadOnly { number }.into())
            }
            other => {
                let (flow, wire, limits) = self.open_flow()?;
                flow.queue(other, wire, limits)
            }
        }
    }

    /// Queues a whole path and returns the id of its last point. If one point is invalid, the whole path is refused.
    ///
    /// # Errors
    /// The errors of [`Session::queue`], and if base or tool were not set in this epoch.
    pub fn queue_path(&mut self, points: &[MoveLin]) -> Result<CommandId, QueueError> {
        let (flow, wire, limits) = self.open_flow()?;
        flow.queue_path(points, wire, limits)
    }

    /// Queues a whole path like [`Session::queue_path`], but sends only the first `permitted` points until
    /// [`Session::permit_commands`] permits more. So a client can record which points the robot may execute before they
    /// are sent.
    ///
    /// # Errors
    /// The errors of [`Session::queue_path`].
    pub fn queue_path_within(&mut self, points: &[MoveLin], permitted: u32) -> Result<CommandId, QueueError> {
        let (flow, wire, limits) = self.open_flow()?;
        let last = flow.queue_path(points, wire, limits)?;
        let count = u32::try_from(points.len()).unwrap_or(u32::MAX);
        flow.permit_up_to(Some(CommandId((last.0 + 1).saturating_sub(count).saturating_add(permitted) - 1)));
        Ok(last)
    }

    /// Permits the session to send commands up to this one; `None` permits all commands.
    ///
    /// # Errors
    /// If no epoch is open.
    pub fn permit_commands(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.open_flow()?.0.permit_up_to(last);
        Ok(())
    }

    fn open_flow(&mut self) -> Result<(&mut CommandFlow, &Wire, &LinkLimits), QueueError> {
        self.require_greeting()?;
        match &mut self.phase {
            Phase::Open(flow) => Ok((flow, &self.wire, &self.limits)),
            _ => Err(QueueError::NoEpoch),
        }
    }
}
