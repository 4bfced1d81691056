//! Deadlines: heartbeats, the watchdog, and closing a connection that is silent or does not obey an abort. There
//! are no deadlines in lock step, in which time passes only by heartbeats.

use super::{ClockMode, Phase, Session};
use crate::eki::command::Request;
use crate::eki::report::{Channel, LinkLoss, Report};
use crate::eki::time::Time;
use std::time::Duration;

/// Duration of silence after which a connection is closed, with or without queued commands.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(1);

/// Time limit of a message from its first byte to its last; a slower message is not accepted.
const MESSAGE_TIMEOUT: Duration = Duration::from_millis(200);

/// The connections are made anew if the controller acknowledges no command in this number of consecutive epochs.
const MAX_UNACKNOWLEDGED: u32 = 2;

impl Session {
    /// Sends a heartbeat now, if a controller has answered; in lock step the heartbeat grants the controller its
    /// next 100 ms.
    pub fn heartbeat(&mut self, now: Time) {
        if self.require_greeting().is_err() {
            return;
        }
        // The outputs are sent before the heartbeat: in lock step a heartbeat that waits for commands would delay
        // them.
        self.line_due();
        let last_sent = if let Phase::Open(flow) = &self.phase { flow.last_sent().0 } else { 0 };
        let request = self.number_request(Request::Heartbeat { last_sent });
        if self.pace == ClockMode::LockStep && last_sent > 0 {
            self.heartbeat_commands.push_back((request, last_sent));
        }
        self.next_heartbeat = now + self.limits.heartbeat;
    }

    /// When [`Session::time_passed`] has something to do; never in lock step.
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

    /// Performs the tasks that are due: heartbeat, watchdog, closing a silent connection.
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
            // Checked before the other deadlines of a silent controller, since an arm may be moving behind this one.
            self.report_fault(Report::WatchdogExpired { channel, silence });
            if channel == Channel::Command {
                self.unacknowledged += 1;
            }
            // Half a message that a disturbance left in the controller's memory absorbs all messages that follow
            // it.
            if self.unacknowledged >= MAX_UNACKNOWLEDGED {
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

    /// Finds a message that should have ended by now.
    fn overdue_message(&self, now: Time) -> Option<(Channel, Duration)> {
        let waited =
            |begun: Option<Time>| begun.map(|begun| now.since(begun)).filter(|waited| *waited >= MESSAGE_TIMEOUT);
        let channels = [Channel::Command, Channel::State].into_iter().zip(self.begun);
        channels.filter_map(|(channel, begun)| Some((channel, waited(begun)?))).next()
    }

    /// Returns when a pending abort must have been answered.
    fn abort_deadline(&self) -> Option<Time> {
        let (Phase::Stopping(stopping) | Phase::Greeting { abort: Some(stopping) }) = &self.phase else {
            return None;
        };
        stopping.asked_at.filter(|_| !stopping.obeyed).map(|at| at + self.limits.watchdog)
    }

    /// Returns the earliest moment at which a silence is too long, and the channel.
    fn watchdog(&self) -> Option<(Channel, Time)> {
        let Phase::Open(flow) = &self.phase else { return None };
        let state = (Channel::State, self.last_received + self.limits.watchdog);
        let unreceived = flow.oldest_unreceived().map(|at| (Channel::Command, at + self.limits.watchdog));
        // Silence matters only while something can move or run; between cycles a slow controller is not a reason to
        // stop.
        let both = [self.has_open_work().then_some(state), unreceived];
        both.into_iter().flatten().min_by_key(|&(_, at)| at)
    }
}
