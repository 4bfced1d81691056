//! The controller from outside: the actions of people and of the cell's PLC (keys, switches, buttons, and the
//! selection of programs), and its state as tests, cameras and servers can see it.

use super::log::{ContactSample, ExecutedMotion, ProgramStop, StopCause};
use super::model::Controller;
use super::options::{Clock, Mode};
use super::submit::REOPEN_MS;
use super::wire::Channel;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
use std::collections::BTreeMap;

impl Controller {
    /// Starts the robot program if drives, guard, mode and key allow it. This does not move the arm.
    pub fn start_program(&mut self) {
        if self.running.is_some() {
            return self.start_interpreted();
        }
        let safety = &mut self.safety;
        safety.started |= safety.selected && safety.is_enabled() && (!safety.is_manual() || safety.start_key);
    }

    /// Presses the emergency stop: the arm stops at once where it is, the drives go off, the epoch ends.
    pub fn press_e_stop(&mut self) {
        self.safety.e_stop = true;
        self.safety.drives_on = false;
        self.stop(StopCause::EStop, String::new());
    }

    /// Releases the emergency stop. The drives stay off and nothing continues.
    pub fn release_e_stop(&mut self) {
        self.safety.e_stop = false;
    }

    /// Switches the drives; they do not switch on while the emergency stop is pressed.
    pub fn switch_drives(&mut self, on: bool) {
        if !on && self.safety.drives_on {
            self.stop(StopCause::Drives, String::new());
        }
        self.safety.drives_on = on && !self.safety.e_stop;
    }

    /// Opens or closes the guard; opening it stops the automatic modes at once.
    pub fn set_guard(&mut self, closed: bool) {
        let automatic = matches!(self.safety.mode, Mode::Aut | Mode::Ext);
        if !closed && self.safety.guard_closed && automatic {
            self.stop(StopCause::Guard, String::new());
        }
        self.safety.guard_closed = closed;
    }

    /// Turns the mode switch, which ends the epoch.
    pub fn select_mode(&mut self, mode: Mode) {
        if mode != self.safety.mode {
            self.stop(StopCause::Mode, String::new());
        }
        self.safety.mode = mode;
    }

    /// Presses or releases the start key, which must be held in T1 and T2; when it is released, the motion pauses.
    pub fn set_start_key(&mut self, held: bool) {
        self.safety.start_key = held;
        if held {
            self.start_program();
        }
    }

    /// Jogs the arm to these angles, as a person does; the arm is there at once. This is not possible while a motion
    /// is planned. Returns whether the arm was jogged.
    pub fn jog_to(&mut self, joints: Joints) -> bool {
        let stands = self.mover.is_idle();
        if stands {
            self.mover.set_joints(joints);
        }
        stands
    }

    /// Sets an input that the world does not set.
    pub fn set_input(&mut self, number: u16, value: bool) {
        self.inputs.insert(number, value);
    }

    /// Deselects the robot program: the arm stops, and channels of its environment are closed.
    pub fn deselect_program(&mut self) {
        if std::mem::replace(&mut self.safety.selected, false) {
            self.stop(StopCause::Deselected, String::new());
        }
        for channel in [Channel::Command, Channel::State] {
            if self.closes_with_program(channel) {
                self.disconnect(channel);
                self.link(channel).listens_at_ms = u64::MAX;
            }
        }
    }

    /// Selects and starts the robot program; this moves nothing.
    pub fn select(&mut self) {
        self.safety.selected = true;
        self.select_interpreted();
        self.start_program();
        for channel in [Channel::Command, Channel::State] {
            if self.closes_with_program(channel) {
                self.link(channel).listens_at_ms = self.now_ms + REOPEN_MS;
            }
        }
    }

    /// Restarts the controller: channels, epochs and counts are lost, the arm stops, outputs are off.
    pub fn reboot(&mut self, down_ms: u64) {
        self.stop(StopCause::Rebooted, String::new());
        if self.running.is_some() {
            return self.reboot_interpreted(down_ms);
        }
        for channel in [Channel::Command, Channel::State] {
            self.disconnect(channel);
            let instant = self.setup.clock == Clock::LockStep;
            self.link(channel).listens_at_ms = if instant { self.now_ms } else { self.now_ms + down_ms };
        }
        self.reset_controller();
    }
}

impl Controller {
    /// Returns the delay of the bytes, whether they are sent in fragments, and the seed of both.
    pub(super) fn wire_faults(&self) -> (Option<(u64, u64)>, bool, u64) {
        let faults = &self.setup.faults;
        (faults.delay_ms, faults.fragment, faults.seed)
    }

    /// Returns the source of the controller's time.
    pub fn clock(&self) -> Clock {
        self.setup.clock
    }

    /// Returns the time since the start, ms.
    pub fn time_ms(&self) -> u64 {
        self.now_ms
    }

    /// Returns the axis angles.
    pub fn joints(&self) -> Joints {
        self.mover.joints()
    }

    /// Returns the true flange pose.
    pub fn flange_pose(&self) -> Rigid<Base, Flange> {
        match &self.setup.real_arm {
            Some(arm) => arm.base_from_flange(&self.mover.joints()),
            None => self.mover.base_from_flange(),
        }
    }

    /// Returns whether the arm moves or has planned moves.
    pub fn is_moving(&self) -> bool {
        !self.mover.is_idle() || self.contact.is_retract_due()
    }

    /// Returns the override that a person has set, %.
    pub fn override_percent(&self) -> u8 {
        self.troubles.override_percent()
    }

    /// Returns the deviation of the reported pose along Z of the present base, mm.
    pub fn pose_deviation_mm(&self) -> f64 {
        self.troubles.pose_deviation_mm()
    }

    /// Returns every `$OUT` that was ever set.
    pub fn outputs(&self) -> &BTreeMap<u16, bool> {
        &self.outputs
    }

    /// Returns whether mode, keys, drives, guard and program let the arm move.
    pub fn can_move(&self) -> bool {
        self.safety.motion_possible()
    }

    /// Returns every `$FLAG` that was ever set.
    pub fn flags(&self) -> &BTreeMap<u16, bool> {
        &self.flags
    }

    /// Returns the last command received in the present epoch, and the last one executed.
    pub fn counts(&self) -> (i32, i32) {
        self.running
            .as_ref()
            .map_or((self.epoch.last_received, self.epoch.last_executed), |running| running.counts())
    }

    /// The present epoch.
    pub fn epoch(&self) -> i32 {
        self.running.as_ref().map_or(self.epoch.number, |running| running.epoch())
    }

    /// Returns whether the program has stopped the epoch.
    pub fn is_stopped(&self) -> bool {
        self.running.as_ref().map_or(self.stopped, |running| running.is_stopped())
    }

    /// Returns how many times the next point was missing.
    pub fn underrun_count(&self) -> i32 {
        self.running.as_ref().map_or(self.underruns, |running| running.underruns())
    }

    /// Returns how many commands of ended epochs arrived and were dropped.
    pub fn stale_commands(&self) -> u64 {
        self.stale_messages
    }

    /// Returns every motion that was executed, in order.
    pub fn executed_motions(&self) -> &[ExecutedMotion] {
        &self.executed
    }

    /// Returns the samples of the tool at each tick of every contact.
    pub fn trace(&self) -> &[ContactSample] {
        &self.trace
    }

    /// Returns every stop by the program.
    pub fn program_stops(&self) -> &[ProgramStop] {
        &self.stops
    }
}
