//! The client's side of the protocol: epochs, ids, credits and the watchdog, without a socket.
//!
//! Inputs are bytes, commands and `now`; outputs are polled: [`Session::poll_transmit`] until it has none, then
//! [`Session::poll_report`]. One epoch at a time is open. Whatever goes wrong in it (a refusal, a wrong count,
//! an echo that differs, silence) ends it: abort on the wire, the queue dropped, a report; nothing moves again before
//! [`Session::open_epoch`]. A new connection only asks for the state.
//!
//! On the wall clock a heartbeat leaves by itself at [`Session::deadline`]. In lock step there are no deadlines:
//! each heartbeat is asked for, and grants the controller its next 100 ms.

mod echo;
mod flow;
mod receive;
mod timing;

#[cfg(test)]
mod tests;

use super::command::{Command, CommandError, MappedInputs, MoveLin, Request, Signal};
use super::framer::Framer;
use super::report::{Channel, LinkLoss, Report, StopCause};
use super::time::Time;
use super::wire::{CommandId, Epoch, LAST_NUMBER, Wire};
use super::word::{Word, word};
use flow::Flow;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::time::Duration;

/// The limits of a link (`design.md`, "Limits").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkLimits {
    /// Motion sent and not yet executed, at most.
    pub window: Duration,
    /// Commands sent and not yet executed, at most.
    pub window_commands: usize,
    /// Points sent together when a path starts, and kept ahead whatever they last.
    pub min_points: usize,
    /// From heartbeat to heartbeat.
    pub heartbeat: Duration,
    /// Silence after which the epoch is ended, while anything is queued.
    pub watchdog: Duration,
    /// The inputs that can be set.
    pub mapped_inputs: MappedInputs,
}

impl Default for LinkLimits {
    fn default() -> Self {
        LinkLimits {
            window: Duration::from_secs(1),
            window_commands: 50,
            min_points: 5,
            heartbeat: Duration::from_millis(100),
            watchdog: Duration::from_millis(400),
            mapped_inputs: MappedInputs::default(),
        }
    }
}

/// Whose clock runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// The wall clock: heartbeats and watchdog by deadline.
    Wall,
    /// The controller's virtual clock: it runs only as far as heartbeats let it.
    LockStep,
}

/// Why a command was not queued. Nothing of it was sent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum QueueError {
    /// No controller.
    #[error("there is no connection to the controller")]
    NotConnected,
    /// A new epoch would begin on a moving robot.
    #[error("the robot does not stand yet; abort, and wait for its standstill")]
    NotStanding,
    /// No epoch is open.
    #[error("no epoch is open; after a start, a stop or a fault one must be opened first")]
    NoEpoch,
    /// Epochs are used up.
    #[error("epoch {last} is the last that a controller can count; start its programs again")]
    EpochsExhausted {
        /// The last one.
        last: Epoch,
    },
    /// Straight lines need both frames.
    #[error("move_lin needs base and tool set in this epoch; {missing} was not")]
    FramesNotSet {
        /// What is missing.
        #[serde(deserialize_with = "word")]
        missing: Word,
    },
    /// A path without points.
    #[error("the path has no points")]
    EmptyPath,
    /// Too many commands.
    #[error("the epoch would have more than {most} commands; open another")]
    IdsExhausted {
        /// The last id.
        most: u32,
    },
    /// A command that no controller can execute.
    #[error(transparent)]
    Command(#[from] CommandError),
}

/// What the session is doing.
#[derive(Debug)]
enum Phase {
    /// No connection.
    Offline,
    /// Connected, and has asked for the state.
    Greeting,
    /// Knows the controller; no epoch is open.
    Idle,
    /// Has asked for an epoch with this request.
    Opening { epoch: Epoch, request: u32 },
    /// Commands flow.
    Open(Box<Flow>),
    /// Has aborted; waits for standstill in the next epoch.
    Stopping { ended: Option<Epoch>, next: Epoch, done: CommandId, refusal_told: bool },
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
    /// The highest epoch that was seen or asked for.
    last_epoch: Epoch,
    /// The last request sent and the last answered, on this connection.
    asked: u32,
    answered: u32,
    /// Heartbeats not yet answered, with the command that each names; in lock step only.
    named: VecDeque<(u32, u32)>,
    last_sequence: Option<u32>,
    /// As last heard.
    moving: bool,
    heard: Time,
    next_heartbeat: Time,
    stale: u64,
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
            last_epoch: Epoch(0),
            asked: 0,
            answered: 0,
            named: VecDeque::new(),
            last_sequence: None,
            moving: false,
            heard: Time::default(),
            next_heartbeat: Time::default(),
            stale: 0,
        }
    }

    /// Both connections stand. Asks for the state; nothing moves.
    pub fn connected(&mut self, now: Time) {
        self.command_framer = Framer::default();
        self.state_framer = Framer::default();
        self.begun = [None; 2];
        self.requests.clear();
        (self.asked, self.answered, self.last_sequence) = (0, 0, None);
        self.named.clear();
        (self.heard, self.next_heartbeat) = (now, now + self.limits.heartbeat);
        self.phase = Phase::Greeting;
        self.ask(Request::State);
    }

    /// A connection failed, or could not be made. What was queued is forgotten. What is left to transmit is an abort,
    /// for a state channel that still stands.
    pub fn disconnected(&mut self, why: LinkLoss) {
        // Refused only where no controller has answered; then nothing was sent to it either.
        let _ = self.abort();
        self.phase = Phase::Offline;
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
            phase => matches!(phase, Phase::Stopping { .. }),
        };
        if is_busy || self.moving {
            return Err(QueueError::NotStanding);
        }
        self.last_epoch = self.last_epoch.max(above);
        let epoch = self.next_epoch()?;
        let request = self.ask(Request::Reset { next: epoch });
        self.phase = Phase::Opening { epoch, request };
        Ok(epoch)
    }

    /// Ends the epoch: tool off, brake, everything discarded, retract if in contact. [`Report::Standstill`]
    /// follows. A second call changes nothing.
    ///
    /// # Errors
    /// Where no controller has answered yet; then its own watchdog stops it.
    pub fn abort(&mut self) -> Result<(), QueueError> {
        self.greeted()?;
        if matches!(self.phase, Phase::Stopping { .. }) {
            return Ok(());
        }
        let next = self.next_epoch()?;
        let (ended, done) = match &self.phase {
            Phase::Open(flow) => (Some(flow.epoch()), flow.done()),
            _ => (None, CommandId(0)),
        };
        self.ask(Request::Abort { next });
        self.phase = Phase::Stopping { ended, next, done, refusal_told: false };
        Ok(())
    }

    /// The next bytes to send. Requests first: an abort waits for nothing.
    pub fn poll_transmit(&mut self, now: Time) -> Option<(Channel, Vec<u8>)> {
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

    /// Ends the epoch for this cause, where anything of it is left.
    pub fn interrupt(&mut self, cause: StopCause) {
        if matches!(&self.phase, Phase::Open(flow) if flow.is_busy()) {
            self.fault(Report::Interrupted { cause });
        }
    }

    fn greeted(&self) -> Result<(), QueueError> {
        match self.phase {
            Phase::Offline | Phase::Greeting => Err(QueueError::NotConnected),
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

    fn next_epoch(&mut self) -> Result<Epoch, QueueError> {
        if self.last_epoch.0 >= LAST_NUMBER {
            return Err(QueueError::EpochsExhausted { last: self.last_epoch });
        }
        self.last_epoch = Epoch(self.last_epoch.0 + 1);
        Ok(self.last_epoch)
    }

    /// The epoch that requests are sent under.
    fn current_epoch(&self) -> Epoch {
        match &self.phase {
            Phase::Open(flow) => flow.epoch(),
            Phase::Stopping { ended: Some(ended), .. } => *ended,
            _ => self.last_epoch,
        }
    }

    fn ask(&mut self, request: Request) -> u32 {
        if self.asked >= LAST_NUMBER {
            // The connection ends, and by that the epoch on the controller.
            self.phase = Phase::Offline;
            self.reports.push_back(Report::LinkLost { why: LinkLoss::RequestsExhausted { most: LAST_NUMBER } });
            return self.asked;
        }
        self.asked += 1;
        let bytes = self.wire.encode_request(self.asked, self.current_epoch(), &request);
        self.requests.push_back(bytes);
        self.asked
    }

    /// Reports what is wrong and ends the epoch.
    fn fault(&mut self, report: Report) {
        self.reports.push_back(report);
        // Cannot be refused: without a controller that has answered there is no epoch.
        let _ = self.abort();
    }
}
