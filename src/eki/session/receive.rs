//! What comes in: bytes to documents, documents to what they mean for the phase at hand.

use super::flow::{Flow, Late};
use super::{Phase, Session};
use crate::eki::ack::Ack;
use crate::eki::framer::Framer;
use crate::eki::report::{Channel, LinkLoss, Report, SequenceError, StopCause};
use crate::eki::state::State;
use crate::eki::time::Time;
use crate::eki::wire::{CommandId, LAST_NUMBER};

impl Session {
    /// Bytes from the command channel.
    pub fn push_command_bytes(&mut self, bytes: &[u8], now: Time) {
        self.command_framer.push(bytes);
        let mut has_ended = false;
        while self.is_connected() {
            match self.command_framer.next_document() {
                Ok(None) => {
                    self.begun[0] = begun(self.begun[0], &self.command_framer, has_ended, now);
                    return;
                }
                Ok(Some(document)) => match self.wire.decode_ack(&document) {
                    Ok(ack) => self.on_ack(&ack, now),
                    Err(error) => self.disconnected(LinkLoss::Message { channel: Channel::Command, error }),
                },
                Err(error) => self.disconnected(LinkLoss::Frame { channel: Channel::Command, error }),
            }
            has_ended = true;
        }
    }

    /// Bytes from the state channel.
    pub fn push_state_bytes(&mut self, bytes: &[u8], now: Time) {
        self.state_framer.push(bytes);
        let mut has_ended = false;
        while self.is_connected() {
            match self.state_framer.next_document() {
                Ok(None) => {
                    self.begun[1] = begun(self.begun[1], &self.state_framer, has_ended, now);
                    return self.check_pace(now);
                }
                Ok(Some(document)) => match self.wire.decode_state(&document) {
                    Ok(state) => {
                        self.heard = now;
                        self.on_state(state, now);
                    }
                    Err(error) => self.disconnected(LinkLoss::Message { channel: Channel::State, error }),
                },
                Err(error) => self.disconnected(LinkLoss::Frame { channel: Channel::State, error }),
            }
            has_ended = true;
        }
    }

    fn on_ack(&mut self, ack: &Ack, now: Time) {
        match &mut self.phase {
            Phase::Open(flow) if ack.epoch == flow.epoch() => {
                match flow.acknowledge(ack, now) {
                    Err(error) => return self.fault(Report::SequenceError(error)),
                    Ok(()) => self.tell_progress(),
                }
                if let Some((id, refusal)) = ack.refused {
                    self.fault(Report::Refused { id, refusal });
                    if let Phase::Stopping { refusal_told, .. } = &mut self.phase {
                        *refusal_told = true;
                    }
                }
            }
            // The reason may come behind the state that shows the stop.
            Phase::Stopping { ended: Some(ended), done, refusal_told, .. } if ack.epoch == *ended => {
                *done = ack.done.max(*done);
                if let Some((id, refusal)) = ack.refused
                    && !std::mem::replace(refusal_told, true)
                {
                    self.reports.push_back(Report::Refused { id, refusal });
                }
            }
            Phase::Open(flow) if ack.epoch > flow.epoch() => {
                let error = SequenceError::Epoch { found: ack.epoch, ours: flow.epoch() };
                self.last_epoch = self.last_epoch.max(ack.epoch);
                self.fault(Report::SequenceError(error));
            }
            _ => self.stale += u64::from(ack.epoch < self.last_epoch),
        }
    }

    fn on_state(&mut self, state: State, now: Time) {
        let identity = (state.boot, state.programs_checksum);
        if self.identity.is_some_and(|known| known != identity) {
            self.phase = if self.is_greeting() { Phase::Greeting } else { Phase::Idle };
            // Its count may begin anew; ours does not, so that no number ever means two epochs.
            (self.last_sequence, self.last_epoch) = (None, self.last_epoch.max(state.epoch));
            self.reports.push_back(Report::Rebooted { state: Box::new(state) });
        }
        self.identity = Some(identity);
        self.moving = state.moving;
        if self.is_greeting() {
            // Until our first request is answered the state may be an answer to the client before us.
            if state.answered == self.asked {
                self.note_counts(&state);
                self.last_epoch = self.last_epoch.max(state.epoch);
                self.phase = Phase::Idle;
                self.reports.push_back(Report::Connected { state: Box::new(state) });
            }
            return;
        }
        if let Err(error) = self.check_counts(&state) {
            self.fault(Report::SequenceError(error));
        }
        self.note_counts(&state);
        self.in_phase(&state, now);
        self.reports.push_back(Report::State(Box::new(state)));
    }

    pub(super) fn is_greeting(&self) -> bool {
        matches!(self.phase, Phase::Greeting)
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

    fn note_counts(&mut self, state: &State) {
        self.last_sequence = Some(state.sequence);
        self.answered = state.answered.clamp(self.answered, self.asked);
        // In lock step the controller answers a heartbeat only when it has what the heartbeat names.
        while let Some((_, last_sent)) = self.named.pop_front_if(|(request, _)| *request <= self.answered) {
            if let Phase::Open(flow) = &mut self.phase {
                flow.received_up_to(CommandId(last_sent));
            }
        }
    }

    fn in_phase(&mut self, state: &State, now: Time) {
        match &mut self.phase {
            Phase::Opening { epoch, .. } if state.epoch == *epoch => {
                let epoch = *epoch;
                self.phase = Phase::Open(Box::new(Flow::new(epoch)));
                self.reports.push_back(Report::EpochOpened { epoch });
            }
            Phase::Opening { epoch, request } if state.answered >= *request => {
                self.reports.push_back(Report::EpochNotOpened { asked: *epoch, found: state.epoch });
                self.phase = Phase::Idle;
            }
            Phase::Stopping { next, done, .. } if state.epoch >= *next && !state.moving => {
                self.reports.push_back(Report::Standstill { done: *done });
                self.phase = Phase::Idle;
            }
            Phase::Stopping { ended: Some(ended), done, .. } if state.epoch == *ended => {
                *done = state.done.max(*done);
            }
            Phase::Open(flow) if state.epoch == flow.epoch() => match flow.follow(state, now) {
                Err(report) => self.fault(report),
                Ok(()) => {
                    self.tell_progress();
                    self.check_interlocks(state);
                }
            },
            Phase::Open(flow) if state.epoch > flow.epoch() => {
                let error = SequenceError::Epoch { found: state.epoch, ours: flow.epoch() };
                self.last_epoch = self.last_epoch.max(state.epoch);
                self.fault(Report::SequenceError(error));
            }
            Phase::Open(_) => self.stale += 1,
            _ => self.last_epoch = self.last_epoch.max(state.epoch),
        }
    }

    /// A robot that is far behind its plan: in the air that is told, in contact it has lingered long enough.
    fn check_pace(&mut self, now: Time) {
        let Phase::Open(flow) = &mut self.phase else { return };
        match flow.late(now) {
            Some(Late { id, contact: true, waited }) => self.fault(Report::Slow { id, contact: true, waited }),
            Some(Late { id, contact, waited }) => self.reports.push_back(Report::Slow { id, contact, waited }),
            None => {}
        }
    }

    /// Tells how far the open epoch has come, once.
    fn tell_progress(&mut self) {
        if let Phase::Open(flow) = &mut self.phase {
            self.reports.extend(flow.news());
        }
    }

    fn check_interlocks(&mut self, state: &State) {
        let causes = [
            (state.emergency_stop, StopCause::EmergencyStop),
            (!state.guard_closed, StopCause::GuardOpen),
            (!state.drives_on, StopCause::DrivesOff),
            (state.stopped, StopCause::ByProgram),
        ];
        let busy = matches!(&self.phase, Phase::Open(flow) if flow.is_busy());
        if let Some(&(_, cause)) = causes.iter().find(|(holds, _)| busy && *holds) {
            self.fault(Report::Interrupted { cause });
        }
    }
}

/// When the message at hand began: with these bytes, where another ended in them.
fn begun(before: Option<Time>, framer: &Framer, has_ended: bool, now: Time) -> Option<Time> {
    framer.is_inside().then(|| before.filter(|_| !has_ended).unwrap_or(now))
}
