//! The client's side of the protocol: epochs, ids, credits and the watchdog, without a socket.
//!
//! Inputs are bytes, commands and `now`; outputs are polled: [`Session::poll_transmit`] until it has none, then
//! [`Session::poll_report`]. One epoch at a time is open. Whatever goes wrong in it (a refusal, a wrong count,
//! an echo that differs, silence) ends it: abort on the wire, the queue dropped, a report; nothing moves again before
//! [`Session::open_epoch`]. A new connection only asks for the state.
//!
//! A stop reaches the arm in every state. An abort needs no free number: with one that may not follow the controller
//! stops all the same. It must be answered and obeyed within the watchdog's time, or the connections are closed, which
//! stops the controller by its own rules; what is told is never more than what the controller has said. Epochs that
//! jump by more than [`EPOCH_STEP`](super::EPOCH_STEP) are refused on both sides, so that one wrong message cannot use
//! the count up. What is known of the controller's epoch is known of one connection; what this program opened is
//! remembered beyond it. After a controller's cold start, or with a store from a backup, the next epoch is reached in
//! steps.
//!
//! On the wall clock a heartbeat leaves by itself at [`Session::deadline`]. In lock step there are no deadlines:
//! each heartbeat is asked for, and grants the controller its next 100 ms.

mod echo;
mod flow;
mod limits;
mod receive;
mod timing;

#[cfg(test)]
mod tests;

use super::command::{Command, CommandError, MoveLin, Request, Signal};
use super::framer::Framer;
use super::ids::{CommandId, EPOCH_STEP, Epoch, LAST_NUMBER};
use super::report::{Channel, LinkLoss, Report, StopCause};
use super::time::Time;
use super::wire::Wire;
use flow::Flow;
pub use limits::{LinkLimits, QueueError};
use std::collections::VecDeque;

/// So many steps a new epoch may lie above the controller's: requests that its channel buffers at once.
const MOST_STEPS: u32 = 16;

/// Whose clock runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// The wall clock: heartbeats and watchdog by deadline.
    Wall,
    /// The controller's virtual clock: it runs only as far as heartbeats let it.
    LockStep,
}

/// What the session is doing.
#[derive(Debug)]
enum Phase {
    /// No connection.
    Offline,
    /// Connected, and has asked for the state; and to stop, where it was told to abort before the answer came.
    Greeting { abort: Option<Stopping> },
    /// Knows the controller; no epoch is open.
    Idle,
    /// Has asked for an epoch with this request.
    Opening { epoch: Epoch, request: u32 },
    /// Commands flow.
    Open(Box<Flow>),
    /// Has aborted; waits for standstill.
    Stopping(Stopping),
}

/// An abort on its way.
#[derive(Debug, Clone, Copy)]
struct Stopping {
    /// The epoch that it ended, with the commands of it that were sent and executed.
    ended: Option<Epoch>,
    sent: CommandId,
    done: CommandId,
    refusal_told: bool,
    /// The request, and when it was handed over for sending.
    request: u32,
    asked_at: Option<Time>,
    /// The controller has answered it: it has stopped.
    obeyed: bool,
}

/// One client's session with a controller, over any number of connections.
#[derive(Debug)]
pub struct Session {
    wire: Wire,
    limits: LinkLimits,
    pace: Pace,
    phase: Phase,
    command_framer: Framer,
    state_framer: Framer,
    /// When the message at hand began, by channel.
    begun: [Option<Time>; 2],
    requests: VecDeque<Vec<u8>>,
    reports: VecDeque<Report>,
    /// Boot and programs' checksum of the controller that was last seen.
    identity: Option<(i32, i32)>,
    /// The controller's epoch and the highest that was asked for, on this connection.
    controller_epoch: Epoch,
    asked_epoch: Epoch,
    /// The highest epoch that was ever asked to open, by what this session and its callers know.
    opened_epoch: Epoch,
    /// The last request sent and the last answered, on this connection.
    asked: u32,
    answered: u32,
    /// Heartbeats not yet answered, with the command that each names; in lock step only.
    named: VecDeque<(u32, u32)>,
    last_sequence: Option<u32>,
    /// As last heard.
    moving: bool,
    harmful_on: bool,
    heard: Time,
    next_heartbeat: Time,
    stale: u64,
    /// What a line is to be told, and what the controller was told of it on this connection.
    line: Option<u32>,
    line_told: Option<u32>,
    /// Epochs one after the other of which no command was acknowledged in time.
    unacknowledged: u32,
}

impl Session {
    /// A session that is not connected.
    pub fn new(wire: Wire, limits: LinkLimits, pace: Pace) -> Self {
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
            identity: None,
            controller_epoch: Epoch(0),
            asked_epoch: Epoch(0),
            opened_epoch: Epoch(0),
            asked: 0,
            answered: 0,
            named: VecDeque::new(),
            last_sequence: None,
            moving: false,
            harmful_on: false,
            heard: Time::default(),
            next_heartbeat: Time::default(),
            stale: 0,
            line: None,
            line_told: None,
            unacknowledged: 0,
        }
    }

    /// Both connections stand. Asks for the state; nothing moves.
    pub fn connected(&mut self, now: Time) {
        self.command_framer = Framer::default();
        self.state_framer = Framer::default();
        self.begun = [None; 2];
        self.requests.clear();
        (self.asked, self.answered, self.last_sequence) = (0, 0, None);
        (self.controller_epoch, self.asked_epoch) = (Epoch(0), Epoch(0));
        self.named.clear();
        (self.unacknowledged, self.line_told) = (0, None);
        (self.heard, self.next_heartbeat) = (now, now + self.limits.heartbeat);
        self.phase = Phase::Greeting { abort: None };
        self.ask(Request::State);
    }

    /// A connection failed, or could not be made. What was queued is forgotten. What is left to transmit is an abort,
    /// for a state channel that still stands.
    pub fn disconnected(&mut self, why: LinkLoss) {
        if self.is_connected() {
            self.stop();
        }
        (self.phase, self.harmful_on) = (Phase::Offline, false);
        self.reports.push_back(Report::LinkLost { why });
    }

    /// False where the connections are to be closed, after what is left to transmit.
    pub fn is_connected(&self) -> bool {
        !matches!(self.phase, Phase::Offline)
    }

    /// True while a request has no answer: another report is sure to come.
    pub fn awaits_answer(&self) -> bool {
        self.is_connected() && self.answered < self.asked
    }

    /// The open epoch.
    pub fn epoch(&self) -> Option<Epoch> {
        if let Phase::Open(flow) = &self.phase { Some(flow.epoch()) } else { None }
    }

    /// Messages of ended epochs that were dropped.
    pub fn stale_messages(&self) -> u64 {
        self.stale
    }

    /// Queues one command; its id comes back. [`Command::GetCurrentState`] asks at once and has the id 0.
    ///
    /// # Errors
    /// Where no epoch is open, or the command cannot be executed; the epoch stays open.
    pub fn queue(&mut self, command: Command) -> Result<CommandId, QueueError> {
        match command {
            Command::GetCurrentState => {
                self.greeted()?;
                self.ask(Request::State);
                Ok(CommandId(0))
            }
            Command::MoveLin(point) => self.queue_path(&[point]),
            Command::SetDigin(Signal { number, .. }) if !self.limits.mapped_inputs.contains(number) => {
                self.greeted()?;
                Err(CommandError::InputReadOnly { number }.into())
            }
            other => {
                let (flow, wire, limits) = self.flow()?;
                flow.queue(other, wire, limits)
            }
        }
    }

    /// Queues a path whole; the id of its last point comes back. One bad point refuses all.
    ///
    /// # Errors
    /// As [`Session::queue`], and where base or tool were not set in this epoch.
    pub fn queue_path(&mut self, points: &[MoveLin]) -> Result<CommandId, QueueError> {
        let (flow, wire, limits) = self.flow()?;
        flow.queue_path(points, wire, limits)
    }

    /// The same, of which only so many points are sent until [`Session::permit`] lets more go: who keeps a record of
    /// what the robot may have executed does so before.
    ///
    /// # Errors
    /// As [`Session::queue_path`].
    pub fn queue_path_within(&mut self, points: &[MoveLin], permitted: u32) -> Result<CommandId, QueueError> {
        let (flow, wire, limits) = self.flow()?;
        let last = flow.queue_path(points, wire, limits)?;
        let count = u32::try_from(points.len()).unwrap_or(u32::MAX);
        flow.permit(Some(CommandId((last.0 + 1).saturating_sub(count).saturating_add(permitted) - 1)));
        Ok(last)
    }

    /// Lets commands up to this one be sent; all of them where it is `None`.
    ///
    /// # Errors
    /// Where no epoch is open.
    pub fn permit(&mut self, last: Option<CommandId>) -> Result<(), QueueError> {
        self.flow()?.0.permit(last);
        Ok(())
    }

    /// Asks the controller to begin a new epoch, with neither base nor tool. [`Report::EpochOpened`] follows.
    ///
    /// # Errors
    /// Where no controller has answered yet, or the robot moves or has commands left.
    pub fn open_epoch(&mut self) -> Result<Epoch, QueueError> {
        self.open_epoch_above(Epoch(0))
    }

    /// As [`Session::open_epoch`], with a number above this one too: what an earlier program opened never comes again.
    ///
    /// # Errors
    /// As there.
    pub fn open_epoch_above(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        self.greeted()?;
        let is_busy = match &self.phase {
            Phase::Open(flow) => flow.is_busy(),
            phase => matches!(phase, Phase::Stopping(_)),
        };
        if is_busy || self.moving {
            return Err(QueueError::NotStanding);
        }
        let highest = self.known_epoch().max(self.opened_epoch).max(above);
        let (epoch, steps) = self.steps_to(u64::from(highest.0) + 1)?;
        let mut request = self.asked;
        for step in steps {
            request = self.ask(Request::Reset { next: step });
        }
        if !self.is_connected() {
            return Err(QueueError::NotConnected);
        }
        self.asked_epoch = epoch;
        // An answer that is lost does not say that the controller has not opened it.
        self.opened_epoch = epoch;
        self.phase = Phase::Opening { epoch, request };
        Ok(epoch)
    }

    /// This epoch, and those on the way to it, each no farther than a step above the one before. What lies between was
    /// never open for a command.
    fn steps_to(&self, next: u64) -> Result<(Epoch, Vec<Epoch>), QueueError> {
        let found = self.known_epoch();
        let far = u64::from(MOST_STEPS) * u64::from(EPOCH_STEP);
        let epoch = u32::try_from(next).ok().filter(|epoch| *epoch <= LAST_NUMBER);
        let epoch = epoch.filter(|epoch| u64::from(epoch.saturating_sub(found.0)) <= far);
        let Some(epoch) = epoch else {
            let most = MOST_STEPS * EPOCH_STEP;
            return Err(QueueError::EpochTooFar { next, found, most, above: next.saturating_sub(1) });
        };
        let mut steps = Vec::new();
        let mut reached = found.0;
        while reached < epoch {
            reached = reached.saturating_add(EPOCH_STEP).min(epoch);
            steps.push(Epoch(reached));
        }
        Ok((Epoch(epoch), steps))
    }

    /// The highest epoch that the controller can be in, by what it said and what was asked for.
    fn known_epoch(&self) -> Epoch {
        self.controller_epoch.max(self.asked_epoch)
    }

    /// Ends the epoch: tool off, brake, everything discarded, retract if in contact. [`Report::Standstill`]
    /// follows, or [`Report::LinkLost`] where the controller does not obey. A second call changes nothing.
    ///
    /// # Errors
    /// Where there is no connection; then the controller has stopped by itself.
    pub fn abort(&mut self) -> Result<(), QueueError> {
        if !self.is_connected() {
            return Err(QueueError::NotConnected);
        }
        self.stop();
        Ok(())
    }

    /// Puts an abort on the wire, whatever is going on; where one is under way already it stays at that.
    fn stop(&mut self) {
        if matches!(self.phase, Phase::Stopping(_) | Phase::Greeting { abort: Some(_) }) {
            return;
        }
        let (ended, sent, done) = match &self.phase {
            Phase::Open(flow) => (Some(flow.epoch()), flow.sent(), flow.done()),
            _ => (None, CommandId(0), CommandId(0)),
        };
        // Where no higher number is left the last one stops all the same.
        let next = Epoch(self.known_epoch().0.saturating_add(1).min(LAST_NUMBER));
        let request = self.ask(Request::Abort { next });
        self.asked_epoch = next;
        let stopping = Stopping { ended, sent, done, refusal_told: false, request, asked_at: None, obeyed: false };
        self.phase = match self.phase {
            Phase::Offline => return,
            Phase::Greeting { .. } => Phase::Greeting { abort: Some(stopping) },
            _ => Phase::Stopping(stopping),
        };
    }

    /// The next bytes to send. Requests first: an abort waits for nothing.
    pub fn poll_transmit(&mut self, now: Time) -> Option<(Channel, Vec<u8>)> {
        if let Some(stopping) = self.stopping_mut() {
            stopping.asked_at.get_or_insert(now);
        }
        if let Some(request) = self.requests.pop_front() {
            return Some((Channel::State, request));
        }
        let Phase::Open(flow) = &mut self.phase else { return None };
        flow.send_next(now, &self.limits).map(|bytes| (Channel::Command, bytes))
    }

    /// The next thing to tell.
    pub fn poll_report(&mut self) -> Option<Report> {
        self.reports.pop_front()
    }

    /// Ends the epoch for this cause, where anything of it is left or does harm.
    pub fn interrupt(&mut self, cause: StopCause) {
        if self.is_at_stake() {
            self.fault(Report::Interrupted { cause });
        }
    }

    /// An epoch is open in which commands are left, or tool or water is on.
    fn is_at_stake(&self) -> bool {
        matches!(&self.phase, Phase::Open(flow) if flow.is_busy() || self.harmful_on)
    }

    fn stopping_mut(&mut self) -> Option<&mut Stopping> {
        match &mut self.phase {
            Phase::Stopping(stopping) | Phase::Greeting { abort: Some(stopping) } => Some(stopping),
            _ => None,
        }
    }

    fn greeted(&self) -> Result<(), QueueError> {
        match self.phase {
            Phase::Offline | Phase::Greeting { .. } => Err(QueueError::NotConnected),
            _ => Ok(()),
        }
    }

    fn flow(&mut self) -> Result<(&mut Flow, &Wire, &LinkLimits), QueueError> {
        self.greeted()?;
        match &mut self.phase {
            Phase::Open(flow) => Ok((flow, &self.wire, &self.limits)),
            _ => Err(QueueError::NoEpoch),
        }
    }

    /// The epoch that requests are sent under.
    fn current_epoch(&self) -> Epoch {
        match &self.phase {
            Phase::Open(flow) => flow.epoch(),
            Phase::Stopping(Stopping { ended: Some(ended), .. }) => *ended,
            _ => self.known_epoch(),
        }
    }

    /// What a line is told from now on, as bits of the controller's outputs for it. It is sent at once where a controller answers,
    /// and again on each new connection; nothing moves by it.
    pub fn tell_line(&mut self, bits: u32) {
        self.line = Some(bits);
        if self.greeted().is_ok() {
            self.line_due();
        }
    }

    fn line_due(&mut self) {
        if let Some(bits) = self.line.filter(|_| self.line != self.line_told) {
            self.ask(Request::Line { bits });
            self.line_told = self.line;
        }
    }

    fn ask(&mut self, request: Request) -> u32 {
        // The last one is an abort's: with it the connection ends.
        if self.asked + 1 >= LAST_NUMBER && !matches!(request, Request::Abort { .. }) {
            self.disconnected(LinkLoss::RequestsExhausted { most: LAST_NUMBER });
            return self.asked;
        }
        self.asked = (self.asked + 1).min(LAST_NUMBER);
        let bytes = self.wire.encode_request(self.asked, self.current_epoch(), &request);
        self.requests.push_back(bytes);
        self.asked
    }

    /// Reports what is wrong and ends the epoch.
    fn fault(&mut self, report: Report) {
        self.reports.push_back(report);
        self.stop();
    }
}
