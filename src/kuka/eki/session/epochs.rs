//! Opens and ends epochs, and supervises deadlines. A new epoch has a higher number than all earlier epochs, and is
//! reached in steps that the controller accepts. An abort ends the epoch; it is sent before all waiting commands.
//!
//! The deadlines are those of heartbeats and of the watchdog. A connection that sends nothing, or does not obey an
//! abort, is closed. In lock step there are no deadlines, because time advances only with heartbeats.

use super::{ClockMode, PendingAbort, Phase, QueueError, Session};
use crate::eki::command::Request;
use crate::eki::ids::{CommandId, Epoch, LAST_NUMBER, MAX_EPOCH_STEP, Time};
use crate::eki::report::{Channel, LinkLoss, Report, StopCause};
use std::time::Duration;

/// Time without a message after which a connection is closed, with or without queued commands.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(1);

/// Maximum time from the first byte of a message to its last.
const MESSAGE_TIMEOUT: Duration = Duration::from_millis(200);

/// Number of consecutive epochs without an acknowledged command after which the connections are opened again.
const MAX_UNACKNOWLEDGED_EPOCHS: u32 = 2;

/// Maximum number of steps by which the controller is raised to a new epoch: the controller's channel buffers at most
/// this number of requests.
const MAX_EPOCH_STEPS: u32 = 16;

impl Session {
    /// Requests a new epoch from the controller; no base and no tool are set in it. [`Report::EpochOpened`] follows.
    ///
    /// # Errors
    /// If no controller has replied yet, or the robot moves or has commands left.
    pub fn open_epoch(&mut self) -> Result<Epoch, QueueError> {
        self.open_epoch_above(Epoch(0))
    }

    /// Opens an epoch like [`Session::open_epoch`], with a number higher than `above`. So an epoch that an earlier run
    /// of the program has opened is never used again.
    ///
    /// # Errors
    /// The errors of [`Session::open_epoch`].
    pub fn open_epoch_above(&mut self, above: Epoch) -> Result<Epoch, QueueError> {
        self.require_greeting()?;
        let is_busy = match &self.phase {
            Phase::Open(flow) => flow.is_busy(),
            phase => matches!(phase, Phase::Stopping(_)),
        };
        // If a new epoch began now, the session would not know which commands the arm still executes, and would not
        // supervise the rest of the motion.
        if is_busy || self.moving {
            return Err(QueueError::NotStanding);
        }
        // The new epoch is higher than all three numbers. If a number were used again, a delayed command of the old
        // epoch could become valid.
        let highest = self.highest_known_epoch().max(self.opened_epoch).max(above);
        let (epoch, steps) = self.epoch_steps(u64::from(highest.0) + 1)?;
        let mut request = self.asked;
        for step in steps {
            request = self.number_request(Request::Reset { next: step });
        }
        if !self.is_connected() {
            return Err(QueueError::NotConnected);
        }
        self.asked_epoch = epoch;
        // If the response is lost, the controller may still have opened the epoch.
        self.opened_epoch = epoch;
        self.phase = Phase::Opening { epoch, request };
        Ok(epoch)
    }

    /// Returns the epoch `next`, and the intermediate epochs that lead to it, each at most one step above the previous
    /// one. No commands are sent in the intermediate epochs.
    fn epoch_steps(&self, next: u64) -> Result<(Epoch, Vec<Epoch>), QueueError> {
        let found = self.highest_known_epoch();
        let far = u64::from(MAX_EPOCH_STEPS) * u64::from(MAX_EPOCH_STEP);
        let epoch = u32::try_from(next).ok().filter(|epoch| *epoch <= LAST_NUMBER);
        let epoch = epoch.filter(|epoch| u64::from(epoch.saturating_sub(found.0)) <= far);
        let Some(epoch) = epoch else {
            let most = MAX_EPOCH_STEPS * MAX_EPOCH_STEP;
            return Err(QueueError::EpochTooFar { next, found, most, above: next.saturating_sub(1) });
        };
        let mut steps = Vec::new();
        let mut reached = found.0;
        while reached < epoch {
            reached = reached.saturating_add(MAX_EPOCH_STEP).min(epoch);
            steps.push(Epoch(reached));
        }
        Ok((Epoch(epoch), steps))
    }

    /// Returns the highest epoch in which the controller can be, according to its reports and to the requests of this
    /// session.
    pub(super) fn highest_known_epoch(&self) -> Epoch {
        self.controller_epoch.max(self.asked_epoch)
    }

    /// Ends the epoch: the controller switches the tool off, brakes, discards the queued commands, and retracts if the
    /// tool is in contact. [`Report::Standstill`] follows, or [`Report::LinkLost`] if the controller does not obey. A
    /// second call has no effect.
    ///
    /// # Errors
    /// If there is no connection; in this case the controller has stopped by itself.
    pub fn abort(&mut self) -> Result<(), QueueError> {
        if !self.is_connected() {
            return Err(QueueError::NotConnected);
        }
        self.stop();
        Ok(())
    }

    /// Ends the epoch immediately if an epoch is open or being opened, or if the robot moves. Otherwise there is
    /// nothing to stop, and repeated calls use no epoch numbers.
    pub fn stop_now(&mut self) {
        let is_at_work = self.moving || matches!(self.phase, Phase::Open(_) | Phase::Opening { .. });
        if is_at_work && self.is_connected() {
            self.stop();
        }
    }

    /// Sends an abort in any phase of the session, unless an abort is already in progress.
    pub(super) fn stop(&mut self) {
        // A second abort would begin another epoch, and the standstill of the first abort would never be reported.
        if matches!(self.phase, Phase::Stopping(_) | Phase::Greeting { abort: Some(_) }) {
            return;
        }
        let (ended, sent, done) = match &self.phase {
            Phase::Open(flow) => (Some(flow.epoch()), flow.last_sent(), flow.last_executed()),
            _ => (None, CommandId(0), CommandId(0)),
        };
        // If no higher number is available, an abort with the last number also stops the controller.
        let next = Epoch(self.highest_known_epoch().0.saturating_add(1).min(LAST_NUMBER));
        let request = self.number_request(Request::Abort { next });
        self.asked_epoch = next;
        let stopping =
            PendingAbort { ended, sent, done, is_refusal_reported: false, request, asked_at: None, obeyed: false };
        self.phase = match self.phase {
            Phase::Offline => return,
            Phase::Greeting { .. } => Phase::Greeting { abort: Some(stopping) },
            _ => Phase::Stopping(stopping),
        };
    }

    /// Ends the epoch for this cause if commands remain, or if tool or water is on.
    pub fn interrupt(&mut self, cause: StopCause) {
        if self.has_open_work() {
            self.report_fault(Report::Interrupted { cause });
        }
    }

    /// Returns whether the open epoch has remaining commands, or tool or water is on.
    fn has_open_work(&self) -> bool {
        matches!(&self.phase, Phase::Open(flow) if flow.is_busy() || self.harmful_on)
    }

    /// Reports the fault and ends the epoch.
    pub(super) fn report_fault(&mut self, report: Report) {
        // The fault is reported before the stop that it causes, so that the cycle records the fault as the reason.
        self.reports.push_back(report);
        self.stop();
    }
}

impl Session {
    /// Sends a heartbeat now, if a controller has replied. In lock step the heartbeat permits the controller to run for
    /// the next 100 ms.
    pub fn heartbeat(&mut self, now: Time) {
        if self.require_greeting().is_err() {
            return;
        }
        // The outputs are sent before the heartbeat. In lock step a heartbeat that waits for commands would delay the
        // outputs.
        self.send_due_line_signals();
        let last_sent = if let Phase::Open(flow) = &self.phase { flow.last_sent().0 } else { 0 };
        let request = self.number_request(Request::Heartbeat { last_sent });
        if self.pace == ClockMode::LockStep && last_sent > 0 {
            self.heartbeat_commands.push_back((request, last_sent));
        }
        self.next_heartbeat = now + self.limits.heartbeat;
    }

    /// Returns the time at which [`Session::time_passed`] must be called next; `None` in lock step or without a
    /// connection.
    pub fn deadline(&self) -> Option<Time> {
        if self.pace == ClockMode::LockStep || !self.is_connected() {
            return None;
        }
        let silence = self.last_received + SILENCE_TIMEOUT;
        let watchdog = self.watchdog().map(|(_, at)| at).into_iter().chain(self.abort_deadline()).min();
        let heartbeat = (!self.is_waiting_for_greeting()).then_some(self.next_heartbeat);
        let unfinished = self.begun.iter().flatten().map(|&begun| begun + MESSAGE_TIMEOUT);
        [heartbeat, Some(silence), watchdog].into_iter().flatten().chain(unfinished).min()
    }

    /// Performs the tasks that are due: sends heartbeats, evaluates the watchdog, and closes a connection that sends
    /// nothing.
    pub fn time_passed(&mut self, now: Time) {
        if self.pace == ClockMode::LockStep || !self.is_connected() {
            return;
        }
        if let Some((channel, _)) = self.watchdog().filter(|&(_, at)| now >= at) {
            let silence = match (&self.phase, channel) {
                (Phase::Open(flow), Channel::Command) => {
                    flow.oldest_unreceived().map_or(Duration::ZERO, |at| now.since(at))
                }
                _ => now.since(self.last_received),
            };
            // The watchdog is reported before a fault of the connection, because the arm may move while the controller
            // sends nothing.
            self.report_fault(Report::WatchdogExpired { channel, silence });
            if channel == Channel::Command {
                self.unacknowledged += 1;
            }
            // After a disturbance, half a message may remain in the controller's memory and swallow all messages that
            // follow.
            if self.unacknowledged >= MAX_UNACKNOWLEDGED_EPOCHS {
                return self.disconnected(LinkLoss::NotAcknowledged { epochs: self.unacknowledged });
            }
        }
        if let Some(at) = self.abort_deadline().filter(|at| now >= *at) {
            let waited = self.limits.watchdog + now.since(at);
            let waited_ms = u64::try_from(waited.as_millis()).unwrap_or(u64::MAX);
            self.disconnected(LinkLoss::AbortNotAnswered { waited_ms });
        } else if let Some((channel, waited)) = self.overdue_message(now) {
            let waited_ms = u64::try_from(waited.as_millis()).unwrap_or(u64::MAX);
            self.disconnected(LinkLoss::Unfinished { channel, waited_ms });
        } else if now.since(self.last_received) >= SILENCE_TIMEOUT {
            let silence_ms = u64::try_from(now.since(self.last_received).as_millis()).unwrap_or(u64::MAX);
            self.disconnected(LinkLoss::Silent { channel: Channel::State, silence_ms });
        } else if now >= self.next_heartbeat && !self.is_waiting_for_greeting() {
            self.heartbeat(now);
        }
    }

    /// Returns the channel on which a message has not ended within its time limit, and the time since its first byte.
    fn overdue_message(&self, now: Time) -> Option<(Channel, Duration)> {
        let waited =
            |begun: Option<Time>| begun.map(|begun| now.since(begun)).filter(|waited| *waited >= MESSAGE_TIMEOUT);
        let channels = [Channel::Command, Channel::State].into_iter().zip(self.begun);
        channels.filter_map(|(channel, begun)| Some((channel, waited(begun)?))).next()
    }

    /// Returns the deadline for the controller's response to a pending abort.
    fn abort_deadline(&self) -> Option<Time> {
        let (Phase::Stopping(stopping) | Phase::Greeting { abort: Some(stopping) }) = &self.phase else {
            return None;
        };
        stopping.asked_at.filter(|_| !stopping.obeyed).map(|at| at + self.limits.watchdog)
    }

    /// Returns the earliest time at which the watchdog of a channel expires, and the channel.
    fn watchdog(&self) -> Option<(Channel, Time)> {
        let Phase::Open(flow) = &self.phase else { return None };
        let state = (Channel::State, self.last_received + self.limits.watchdog);
        let unreceived = flow.oldest_unreceived().map(|at| (Channel::Command, at + self.limits.watchdog));
        // The watchdog applies only while something can move or is switched on. Between cycles a slow controller is not
        // a reason to stop.
        let both = [self.has_open_work().then_some(state), unreceived];
        both.into_iter().flatten().min_by_key(|&(_, at)| at)
    }
}
