//! Receives messages: divides the bytes into documents, decodes them, and processes them according to the session's
//! phase.

use super::flow::{CommandFlow, LatePoint};
use super::{PendingAbort, Phase, Session};
use crate::eki::framer::Framer;
use crate::eki::ids::{CommandId, Epoch, LAST_NUMBER, MAX_EPOCH, MAX_EPOCH_STEP, Time};
use crate::eki::report::{Channel, LinkLoss, Report, SequenceError, StopCause};
use crate::eki::state::{Ack, CONTACT_OVERRIDE_PERCENT, Mode, State};

impl Session {
    /// Processes bytes from the command channel.
    pub fn push_command_bytes(&mut self, bytes: &[u8], now: Time) {
        self.command_framer.push(bytes);
        let mut has_ended = false;
        while self.is_connected() {
            match self.command_framer.next_document() {
                Ok(None) => {
                    self.begun[0] = message_start(self.begun[0], &self.command_framer, has_ended, now);
                    return;
                }
                Ok(Some(document)) => match self.wire.decode_ack(&document) {
                    Ok(ack) => self.process_ack(&ack, now),
                    Err(error) => self.disconnected(LinkLoss::Message { channel: Channel::Command, error }),
                },
                Err(error) => self.disconnected(LinkLoss::Frame { channel: Channel::Command, error }),
            }
            has_ended = true;
        }
    }

    /// Processes bytes from the state channel.
    pub fn push_state_bytes(&mut self, bytes: &[u8], now: Time) {
        self.state_framer.push(bytes);
        let mut has_ended = false;
        while self.is_connected() {
            match self.state_framer.next_document() {
                Ok(None) => {
                    self.begun[1] = message_start(self.begun[1], &self.state_framer, has_ended, now);
                    return self.check_pace(now);
                }
                Ok(Some(document)) => match self.wire.decode_state(&document) {
                    Ok(state) => {
                        self.last_received = now;
                        self.process_state(state, now);
                    }
                    Err(error) => self.disconnected(LinkLoss::Message { channel: Channel::State, error }),
                },
                Err(error) => self.disconnected(LinkLoss::Frame { channel: Channel::State, error }),
            }
            has_ended = true;
        }
    }

    fn process_ack(&mut self, ack: &Ack, now: Time) {
        if !self.is_waiting_for_greeting() && !self.is_plausible_epoch(Channel::Command, ack.epoch) {
            return;
        }
        match &mut self.phase {
            Phase::Open(flow) if ack.epoch == flow.epoch() => {
                match flow.acknowledge(ack, now) {
                    Err(error) => return self.report_fault(Report::SequenceError(error)),
                    Ok(()) => self.report_progress(),
                }
                // If the controller receives commands again, no half message is left in its memory.
                if ack.received > CommandId(0) {
                    self.unacknowledged = 0;
                }
                if let Some((id, refusal)) = ack.refused {
                    self.report_fault(Report::Refused { id, refusal });
                    if let Phase::Stopping(stopping) = &mut self.phase {
                        stopping.is_refusal_reported = true;
                    }
                }
            }
            // The acknowledgement with the reason of the stop may arrive after the state that shows the stop.
            Phase::Stopping(stopping) if Some(ack.epoch) == stopping.ended => {
                let new_refusal = ack.refused.filter(|_| !stopping.is_refusal_reported);
                stopping.is_refusal_reported |= new_refusal.is_some();
                let wrong = stopping.record_executed(ack.done).err();
                self.reports.extend(wrong.map(Report::SequenceError));
                self.reports.extend(new_refusal.map(|(id, refusal)| Report::Refused { id, refusal }));
            }
            Phase::Open(flow) if ack.epoch > flow.epoch() => {
                let error = SequenceError::Epoch { found: ack.epoch, ours: flow.epoch() };
                // The abort needs an epoch number above the epoch of the other client.
                self.asked_epoch = self.asked_epoch.max(ack.epoch);
                self.report_fault(Report::SequenceError(error));
            }
            // After an abort, acknowledgements of the ended epoch may still be in transit. They are only counted.
            _ => self.stale_messages += u64::from(ack.epoch < self.highest_known_epoch()),
        }
    }

    /// Returns whether the controller can be in this epoch, according to its reports on this connection. Otherwise
    /// reports the epoch as implausible; the message must then be ignored.
    fn is_plausible_epoch(&mut self, channel: Channel, found: Epoch) -> bool {
        let known = self.highest_known_epoch();
        // States arrive in order, but an acknowledgement may belong to a previous epoch.
        let goes_back = channel == Channel::State && found < self.controller_epoch;
        let follows = found.0 <= known.0.saturating_add(MAX_EPOCH_STEP) && !goes_back;
        if !follows {
            self.disconnected(LinkLoss::EpochJump { channel, found, known, step: MAX_EPOCH_STEP });
        }
        follows
    }

    fn process_state(&mut self, state: State, now: Time) {
        let identity = (state.boot, state.programs_checksum);
        if self.identity.is_some_and(|known| known != identity) {
            // The controller counts from zero again after a restart. The client continues its own count, so that no
            // number belongs to two epochs.
            (self.last_sequence, self.controller_epoch, self.asked_epoch) = (None, Epoch(0), Epoch(0));
            self.reports.push_back(Report::Rebooted { state: Box::new(state) });
        }
        let is_new = self.identity.replace(identity) != Some(identity);
        if is_new || self.is_waiting_for_greeting() {
            if state.epoch.0 > MAX_EPOCH {
                let why = LinkLoss::EpochTooHigh { found: state.epoch, most: MAX_EPOCH };
                return self.disconnected(why);
            }
        } else if !self.is_plausible_epoch(Channel::State, state.epoch) {
            return;
        }
        if is_new && !self.is_waiting_for_greeting() {
            // If the controller has not really restarted, it must not continue the commands of the client's epoch.
            self.controller_epoch = state.epoch;
            self.stop();
        }
        self.moving = state.moving;
        if matches!(self.phase, Phase::Open(_)) && !state.stopped {
            self.was_automatic = matches!(state.mode, Mode::Automatic | Mode::External);
        }
        self.harmful_on = state.outputs & self.limits.harmful_outputs != 0;
        if let Phase::Greeting { abort } = self.phase {
            // Before the reply to this client's first request, a state message may be a reply to the previous client.
            if state.answered != self.asked {
                return;
            }
            self.record_counts(&state);
            self.controller_epoch = state.epoch;
            self.phase = abort.map_or(Phase::Idle, Phase::Stopping);
            self.reports.push_back(Report::Connected { state: Box::new(state) });
            return self.process_in_phase(&state, now);
        }
        if let Err(error) = self.check_counts(&state) {
            self.report_fault(Report::SequenceError(error));
        }
        self.record_counts(&state);
        self.controller_epoch = state.epoch;
        self.process_in_phase(&state, now);
        self.reports.push_back(Report::State(Box::new(state)));
    }

    pub(super) fn is_waiting_for_greeting(&self) -> bool {
        matches!(self.phase, Phase::Greeting { .. })
    }

    fn check_counts(&self, state: &State) -> Result<(), SequenceError> {
        if let Some(last) = self.last_sequence
            && state.sequence != last.wrapping_add(1) & LAST_NUMBER
        {
            return Err(SequenceError::State { last, found: state.sequence });
        }
        if state.answered < self.answered || state.answered > self.asked {
            return Err(SequenceError::Answer { found: state.answered, first: self.answered, last: self.asked });
        }
        Ok(())
    }

    fn record_counts(&mut self, state: &State) {
        self.last_sequence = Some(state.sequence);
        self.answered = state.answered.clamp(self.answered, self.asked);
        // In lock step the controller replies to a heartbeat only after it has received the commands that the heartbeat
        // names.
        while let Some((_, last_sent)) =
            self.heartbeat_commands.pop_front_if(|(request, _)| *request <= self.answered)
        {
            if let Phase::Open(flow) = &mut self.phase {
                flow.acknowledge_up_to(CommandId(last_sent));
            }
        }
    }

    fn process_in_phase(&mut self, state: &State, now: Time) {
        match &mut self.phase {
            Phase::Opening { epoch, .. } if state.epoch == *epoch => {
                let epoch = *epoch;
                self.phase = Phase::Open(Box::new(CommandFlow::new(epoch)));
                self.reports.push_back(Report::EpochOpened { epoch });
            }
            Phase::Opening { epoch, request } if state.answered >= *request => {
                self.reports.push_back(Report::EpochNotOpened { asked: *epoch, found: state.epoch });
                // The controller did not accept the requested number. The next request must be above the controller's
                // actual epoch.
                self.asked_epoch = self.controller_epoch;
                self.phase = Phase::Idle;
            }
            Phase::Stopping(_) => self.process_stopping_state(state),
            Phase::Open(flow) if state.epoch == flow.epoch() => match flow.accept_state(state, now) {
                Err(report) => self.report_fault(report),
                Ok(()) => {
                    self.report_progress();
                    self.check_interlocks(state);
                }
            },
            // The controller is in another epoch than the client, and the state channel delivers no delayed messages.
            Phase::Open(flow) => {
                let error = SequenceError::Epoch { found: state.epoch, ours: flow.epoch() };
                self.report_fault(Report::SequenceError(error));
            }
            _ => {}
        }
    }

    /// Processes a state message while an abort is in progress.
    fn process_stopping_state(&mut self, state: &State) {
        let (asked, Phase::Stopping(stopping)) = (self.asked, &mut self.phase) else { return };
        if stopping.ended == Some(state.epoch)
            && let Err(error) = stopping.record_executed(state.done)
        {
            self.reports.push_back(Report::SequenceError(error));
        }
        if !(stopping.request..=asked).contains(&state.answered) {
            return;
        }
        // In the ended epoch the state reports the stop; in the next epoch no command has started.
        if stopping.ended == Some(state.epoch) && !state.stopped {
            // The controller has responded to the abort, but has neither stopped nor begun the next epoch. As a last
            // resort the connection is closed; the controller's own watchdog then stops the robot.
            return self.disconnected(LinkLoss::AbortNotObeyed);
        }
        stopping.obeyed = true;
        if !state.moving {
            let done = stopping.done;
            self.reports.push_back(Report::Standstill { done });
            self.phase = Phase::Idle;
        }
    }

    /// Checks whether the robot is much slower than planned. Without contact this is only reported. In contact it ends
    /// the epoch, because the disc has stayed at one place for too long.
    fn check_pace(&mut self, now: Time) {
        let Phase::Open(flow) = &mut self.phase else { return };
        match flow.late_point(now) {
            Some(LatePoint { id, contact: true, waited }) => {
                self.report_fault(Report::Slow { id, contact: true, waited })
            }
            Some(LatePoint { id, contact, waited }) => self.reports.push_back(Report::Slow { id, contact, waited }),
            None => {}
        }
    }

    /// Adds reports of the progress in the open epoch, each once.
    fn report_progress(&mut self) {
        if let Phase::Open(flow) = &mut self.phase {
            self.reports.extend(flow.take_progress());
        }
    }

    /// Returns whether the tool touches the panel, or a point that was sent will touch it.
    fn is_contact_possible(&self) -> bool {
        matches!(&self.phase, Phase::Open(flow) if flow.is_contact_possible())
    }

    fn check_interlocks(&mut self, state: &State) {
        let by_hand = matches!(state.mode, Mode::T1 | Mode::T2);
        let causes = [
            // The causes are in the order in which the operator must remove them: for example, an open guard also
            // switches the drives off.
            (state.emergency_stop, StopCause::EmergencyStop),
            (!state.guard_closed, StopCause::GuardOpen),
            (!state.drives_on, StopCause::DrivesOff),
            (self.is_contact_possible() && state.override_percent != CONTACT_OVERRIDE_PERCENT, StopCause::Override),
            (state.stopped && by_hand && self.was_automatic, StopCause::ModeTurned),
            (state.stopped && !state.motion_possible, StopCause::NoProgram),
            (state.stopped, StopCause::ByProgram),
        ];
        // If the controller has stopped the epoch, it accepts no more commands, so the epoch ends even if nothing is
        // queued.
        let ends = state.stopped || matches!(&self.phase, Phase::Open(flow) if flow.is_busy());
        if let Some(&(_, cause)) = causes.iter().find(|(holds, _)| ends && *holds) {
            self.report_fault(Report::Interrupted { cause });
        }
    }
}

impl PendingAbort {
    /// Records the last executed command of the ended epoch. A command that was not sent is an error.
    fn record_executed(&mut self, done: CommandId) -> Result<(), SequenceError> {
        let (first, last) = (CommandId(0), self.sent);
        if done > last {
            return Err(SequenceError::Command { what: "executed", found: done, first, last });
        }
        self.done = self.done.max(done);
        Ok(())
    }
}

/// Returns the time at which the unfinished message began. If a previous message ended in these bytes, the unfinished
/// message began with these bytes, at the time `now`.
fn message_start(before: Option<Time>, framer: &Framer, has_ended: bool, now: Time) -> Option<Time> {
    framer.is_inside().then(|| before.filter(|_| !has_ended).unwrap_or(now))
}
