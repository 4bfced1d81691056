//! The tasks of the submit interpreter: requests, the transfer of commands to the ring buffer, the watchdog, the stop.

use super::channel_file::EkiFault;
use super::log::{ProgramStop, StopCause};
use super::model::{Controller, Epoch, RING_ENTRIES};
use super::options::{Clock, Rule};
use super::wire::{self, Channel, Command, Refusal, Request};

/// Maximum number of commands that are read in one tick.
const COMMANDS_PER_TICK: usize = 8;
/// The period that a heartbeat grants in lock step, ms.
const HEARTBEAT_GRANT_MS: u64 = 100;
/// Time without a message of the client after which the epoch is stopped, ms.
const WATCHDOG_TIMEOUT_MS: u64 = 400;
/// Time without a message of the client after which the program clears its channels and listens again, ms. Otherwise a
/// client that disappeared without closing its connection would occupy the channel forever.
const CLIENT_SILENCE_TIMEOUT_MS: u64 = 3_000;
/// Time that the program needs to clear, initialise and open a channel, ms.
pub(super) const REOPEN_MS: u64 = 24;
/// Maximum step by which one request may raise the epoch.
const MAX_EPOCH_STEP: i32 = 1_000_000;
/// Maximum $VEL.CP, m/s, and $ACC.CP, m/s².
const MAX_VEL_ACC: [f64; 2] = [2.0, 10.0];

impl Controller {
    /// Processes the requests in order. In lock step a heartbeat waits for the commands that it names.
    pub(super) fn serve_requests(&mut self) {
        if self.troubles.is_submit_stalled() || self.running.is_some() {
            return;
        }
        self.reset_flags(Channel::State);
        while self.states.connected && self.request_places.is_waiting(&self.states.memory) {
            let is_grant =
                |request: &Request| self.setup.clock == Clock::LockStep && request.operation == wire::HEARTBEAT;
            let next = self.request_places.next(&self.states.memory);
            // A document that arrived after the heartbeat, such as an abort, must not wait for the heartbeat.
            let is_last = self.request_places.waiting_count(&self.states.memory) == 1;
            let is_delivered = next.as_ref().is_none_or(|next| self.is_heartbeat_satisfied(next));
            let grants = next.as_ref().is_some_and(is_grant) && (is_delivered || is_last);
            if grants && !is_delivered {
                return;
            }
            let request = match self.request_places.pop(&mut self.states.memory) {
                Ok(request) => request,
                Err(fault) => return self.close(Channel::State, fault),
            };
            (self.last_frame_ms, self.last_request_ms) = (self.now_ms, self.now_ms);
            match request.operation {
                wire::ABORT => self.abort(request.n1),
                wire::RESET => self.reset(request.n1),
                wire::LINE => self.set_line_outputs(request.n1),
                wire::HEARTBEAT if grants => {
                    self.read_up_to = Some((request.epoch, request.n1));
                    self.advance_ms(HEARTBEAT_GRANT_MS);
                    self.read_up_to = None;
                }
                _ => {}
            }
            self.send_state(request.id);
        }
    }

    /// Returns whether the heartbeat need not wait for the commands that it names: they have arrived, their channel was
    /// lost, or the epoch has ended. If the command channel is not open yet, the heartbeat waits.
    fn is_heartbeat_satisfied(&self, heartbeat: &Request) -> bool {
        let named = (heartbeat.epoch, heartbeat.n1);
        heartbeat.n1 <= 0 || !self.awaits_commands || heartbeat.epoch < self.epoch.number || self.arrived >= named
    }

    /// Executes an abort of the client. The epoch is stopped in any case. If the number is not valid as the next epoch,
    /// the epoch number does not change.
    fn abort(&mut self, number: i32) {
        self.stop(StopCause::Abort, String::new());
        if self.is_next_epoch(number) {
            self.epoch = Epoch::closed(number);
        }
    }

    /// Returns whether the number is above the current epoch by at most the maximum step, so that a single wrong
    /// message cannot exhaust the counter.
    fn is_next_epoch(&self, number: i32) -> bool {
        let steps = i64::from(number) - i64::from(self.epoch.number);
        steps > 0 && (steps <= i64::from(MAX_EPOCH_STEP) || self.setup.omitted_rule == Some(Rule::EpochStep))
    }

    /// Opens an epoch, in which base and tool are not set. Only a motion that is still being stopped continues.
    fn reset(&mut self, number: i32) {
        if !self.is_next_epoch(number) {
            return;
        }
        if self.epoch.open && self.is_busy() {
            self.stop(StopCause::Superseded, String::new());
        }
        self.epoch = Epoch::new_open(number);
        self.contact.forget();
        self.stopped = false;
    }

    /// Reads commands from the buffers of the command channel.
    pub(super) fn read_commands(&mut self) {
        if !self.commands.connected || !self.command_places.is_waiting(&self.commands.memory) {
            return;
        }
        self.reset_flags(Channel::Command);
        for _ in 0..COMMANDS_PER_TICK {
            if !self.command_places.is_waiting(&self.commands.memory) {
                return;
            }
            let next = self.command_places.next_epoch_and_id(&self.commands.memory);
            if let (Some(last), Some(next)) = (self.read_up_to, next)
                && next > last
            {
                return;
            }
            match self.command_places.pop(&mut self.commands.memory) {
                Ok(command) => {
                    self.last_frame_ms = self.now_ms;
                    self.process_command(command);
                }
                Err(fault) => return self.close(Channel::Command, fault),
            }
        }
    }

    fn process_command(&mut self, command: Command) {
        let left_out = self.setup.omitted_rule;
        if command.epoch < self.epoch.number && left_out != Some(Rule::EpochCheck) {
            self.stale_messages += 1; // in flight when its epoch ended
            return;
        }
        let judged = match (left_out, self.troubles.take_refusal()) {
            (_, Some(refusal)) => Err(refusal),
            (Some(Rule::EpochCheck), None) => Ok(()),
            (_, None) => self.judge(&command),
        };
        match judged {
            Ok(()) => {
                self.epoch.last_received = command.id;
                self.epoch.ring.push_back(command);
            }
            Err(refusal) => self.refuse(command.id, refusal, String::new()),
        }
    }

    fn judge(&self, command: &Command) -> Result<(), Refusal> {
        if command.epoch > self.epoch.number {
            return Err(Refusal::WrongEpoch);
        }
        if !self.epoch.open {
            return Err(if self.stopped { Refusal::Stopped } else { Refusal::WrongEpoch });
        }
        if command.id != self.epoch.last_received + 1 {
            return Err(Refusal::IdGap);
        }
        self.judge_values(command)?;
        let moves = [wire::MOVE_J, wire::MOVE_LIN, wire::CALL_SUBROUTINE].contains(&command.operation);
        if moves && !self.safety.motion_possible() {
            return Err(Refusal::NoMotion);
        }
        if self.epoch.ring.len() >= RING_ENTRIES { Err(Refusal::RingFull) } else { Ok(()) }
    }

    fn judge_values(&self, command: &Command) -> Result<(), Refusal> {
        let Command { n: [n1, n2], r: [r1, r2], p, .. } = *command;
        let percent = |number: f64| (1.0..=100.0).contains(&number);
        let right = match command.operation {
            wire::MOVE_J => {
                let target = super::kinematics::to_joints(p);
                self.setup.arm.within_limits(&target).map_err(|_| Refusal::Unreachable)?;
                percent(r1) && r2 == 0.0
            }
            wire::MOVE_LIN if n2 == 1 && self.troubles.override_percent() != 100 => return Err(Refusal::Override),
            wire::MOVE_LIN => n1 >= 0 && (0..=1).contains(&n2) && r1 >= 0.0 && (0.0..=MAX_VEL_ACC[0]).contains(&r2),
            wire::SET_BASE => true,
            wire::SET_TCP => (0..=1).contains(&n1),
            wire::SET_ACC_SPEED => {
                let motion = r1 > 0.0 && r1 <= MAX_VEL_ACC[0] && r2 > 0.0 && r2 <= MAX_VEL_ACC[1];
                motion && percent(f64::from(n1)) && percent(f64::from(n2))
            }
            wire::SET_DIGOUT => {
                let is_listed = self.setup.outputs.iter().any(|number| i32::from(*number) == n1);
                is_listed && (0..=1).contains(&n2) && (r1 == 0.0 || r1 == 1.0)
            }
            wire::SET_DIGIN if self.mapped_flag(n1).is_none() => return Err(Refusal::ReadOnly),
            wire::SET_DIGIN => (0..=1).contains(&n2),
            wire::CALL_SUBROUTINE => usize::try_from(n1).is_ok_and(|n1| n1 < self.setup.subroutines_ms.len()),
            _ => return Err(Refusal::UnknownOperation),
        };
        if right { Ok(()) } else { Err(Refusal::OutOfRange) }
    }

    /// Returns the number of the flag that is read instead of this input.
    pub(super) fn mapped_flag(&self, input: i32) -> Option<u16> {
        u16::try_from(input).ok().and_then(|input| self.setup.mapped_inputs.get(&input)).copied()
    }

    /// Refuses a command. No subsequent command is executed either, because a path with a gap is worse than a stop.
    pub(super) fn refuse(&mut self, id: i32, refusal: Refusal, detail: String) {
        if !matches!(refusal, Refusal::WrongEpoch | Refusal::Stopped) {
            self.stop(StopCause::Refused(refusal), detail);
        }
        self.epoch.refusal.get_or_insert((refusal, id));
    }

    /// Ends the epoch if the client sends nothing for too long while commands are queued, or while tool or water is on.
    /// Also ends it if the override changes in contact.
    pub(super) fn check_watchdog(&mut self) {
        if self.epoch.open
            && self.troubles.override_percent() != 100
            && self.contact.touches(self.mover.current_move())
        {
            self.refuse(self.epoch.last_executed + 1, Refusal::Override, String::new());
        }
        let watches = self.setup.omitted_rule != Some(Rule::Watchdog);
        let at_stake = self.is_busy() || self.has_harmful_output_on();
        if self.epoch.open && at_stake && watches && self.now_ms - self.last_frame_ms >= WATCHDOG_TIMEOUT_MS {
            self.stop(StopCause::Watchdog, String::new());
        }
        let silence_ms = self.now_ms - self.last_request_ms;
        if (self.commands.connected || self.states.connected) && watches && silence_ms >= CLIENT_SILENCE_TIMEOUT_MS
        {
            for channel in [Channel::Command, Channel::State] {
                self.troubles.cable_buffer[channel as usize].clear();
                self.troubles.hung_up[channel as usize] = false;
                self.drop_client(channel, EkiFault::NoContact);
            }
        }
    }

    /// Ends the epoch if commands are queued but no program runs that can execute them.
    pub(super) fn check_program_running(&mut self) {
        if self.epoch.open && self.is_busy() && !self.safety.has_program() {
            self.stop(StopCause::Deselected, String::new());
        }
    }

    /// Stops the robot program if the submit interpreter has not run for the watchdog's time.
    pub(super) fn stop_without_submit(&mut self) {
        let watches = self.setup.omitted_rule != Some(Rule::Watchdog);
        let dead_ms = self.now_ms - self.submit_ran_ms;
        if !(self.safety.has_program() && watches && dead_ms >= WATCHDOG_TIMEOUT_MS) {
            return;
        }
        if self.epoch.open {
            self.stop(StopCause::SubmitDead, String::new());
        }
        // Outputs that an ended epoch left on are switched off immediately, because no interpreter runs that counts
        // their delays.
        self.switch_off_outputs(|_| true);
    }

    /// Ends the epoch because its link was lost, even if no command is queued, so that a running tool is switched off.
    pub(super) fn link_lost(&mut self) {
        if self.running.is_none() && self.epoch.open && self.setup.omitted_rule != Some(Rule::LinkLoss) {
            self.stop(StopCause::LinkLost, String::new());
        }
    }

    fn is_busy(&self) -> bool {
        !self.epoch.ring.is_empty() || !self.mover.is_idle()
    }

    /// Ends the epoch: switches tool and water off, brakes, discards the queued commands, and retracts from the panel
    /// if the tool is in contact and the drives stay on.
    pub(super) fn stop(&mut self, cause: StopCause, detail: String) {
        if self.running.is_some() {
            return self.stop_interpreted(cause);
        }
        self.update_executed_count();
        let contact = self.contact.touches(self.mover.current_move());
        let at_once = cause.is_immediate() || self.safety.is_paused();
        // A retract belongs to the end of an epoch and is never executed afterwards. Only a running program can execute
        // it.
        let may_retract =
            self.epoch.open && self.safety.has_program() && self.setup.omitted_rule != Some(Rule::Retract);
        if self.epoch.open {
            let (time_ms, epoch) = (self.now_ms, self.epoch.number);
            self.stops.push(ProgramStop { time_ms, epoch, cause, contact, detail });
            // A second stop must not extend the delays.
            self.ended_ms = self.now_ms;
            self.pending_off_outputs = self.setup.off_delays_ms.keys().copied().collect();
        }
        self.switch_off_outputs(|after_ms| after_ms == 0);
        if self.setup.omitted_rule != Some(Rule::Discard) {
            self.epoch.ring.clear();
        }
        self.epoch.subroutine_until_ms = None;
        self.epoch.open = false;
        self.stopped = true;
        if at_once {
            self.safety.reset_program();
            self.contact.stop(self.mover.current_move(), false);
            self.mover.stop_immediately();
        } else if !self.contact.is_retract_due() {
            // A retract in progress continues.
            self.contact.stop(self.mover.current_move(), may_retract);
            self.mover.start_braking();
        }
    }
}
