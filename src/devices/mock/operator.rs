//! The controller from outside: the actions of people and of the cell's PLC (keys, switches, buttons, selection of
//! programs), and the state that tests, cameras and servers can read.

use super::log::{ContactSample, ExecutedMotion, ProgramStop, StopCause};
use super::model::Controller;
use super::options::{Clock, Mode};
use super::submit::REOPEN_MS;
use super::wire::Channel;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
use std::collections::BTreeMap;

impl Controller {
    /// Starts the robot program if drives, guard, mode and keys permit. The start does not move the arm.
    pub fn start_program(&mut self) {
        if self.running.is_some() {
            return self.start_interpreted();
        }
        let safety = &mut self.safety;
        safety.started |= safety.selected && safety.is_enabled() && (!safety.is_manual() || safety.start_key);
    }

    /// Presses the emergency stop: the arm stops immediately, the drives are switched off, and the epoch ends.
    pub fn press_e_stop(&mut self) {
        self.safety.e_stop = true;
        self.safety.drives_on = false;
        self.stop(StopCause::EStop, String::new());
    }

    /// Releases the emergency stop. The drives stay off and no motion continues.
    pub fn release_e_stop(&mut self) {
        self.safety.e_stop = false;
    }

    /// Switches the drives on or off; they stay off while the emergency stop is pressed.
    pub fn switch_drives(&mut self, on: bool) {
        if !on && self.safety.drives_on {
            self.stop(StopCause::Drives, String::new());
        }
        self.safety.drives_on = on && !self.safety.e_stop;
    }

    /// Opens or closes the guard. Opening it stops the arm immediately in the automatic modes.
    pub fn set_guard(&mut self, closed: bool) {
        let automatic = matches!(self.safety.mode, Mode::Aut | Mode::Ext);
        if !closed && self.safety.guard_closed && automatic {
            self.stop(StopCause::Guard, String::new());
        }
        self.safety.guard_closed = closed;
    }

    /// Changes the operating mode, which ends the epoch.
    pub fn select_mode(&mut self, mode: Mode) {
        if mode != self.safety.mode {
            self.stop(StopCause::Mode, String::new());
        }
        self.safety.mode = mode;
    }

    /// Presses or releases the Start key. In T1 and T2 the key must be held; when it is released, the motion pauses.
    pub fn set_start_key(&mut self, held: bool) {
        self.safety.start_key = held;
        if held {
            self.start_program();
        }
    }

    /// Jogs the arm to these axis angles, as a person does; the arm reaches them immediately. Returns false if a motion
    /// is planned, in which case the arm is not moved.
    pub fn jog_to(&mut self, joints: Joints) -> bool {
        let stands = self.mover.is_idle();
        if stands {
            self.mover.set_joints(joints);
        }
        stands
    }

    /// Sets an input to which the simulated world is not connected.
    pub fn set_input(&mut self, number: u16, value: bool) {
        self.inputs.insert(number, value);
    }

    /// Deselects the robot program: the arm stops, and the channels that belong to the program are closed.
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

    /// Selects and starts the robot program; nothing moves.
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

    /// Restarts the controller after `down_ms`: the arm stops, the outputs are switched off, and channels, epochs and
    /// counters are reset.
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
    /// Returns the injected faults of the connection: the delay of the bytes, whether they are sent in fragments, and
    /// the random seed.
    pub(super) fn wire_faults(&self) -> (Option<(u64, u64)>, bool, u64) {
        let faults = &self.setup.faults;
        (faults.delay_ms, faults.fragment, faults.seed)
    }

    /// Returns the source of the controller's time.
    pub fn clock(&self) -> Clock {
        self.setup.clock
    }

    /// Returns the time since the start of the controller, ms.
    pub fn time_ms(&self) -> u64 {
        self.now_ms
    }

    /// Returns the axis angles.
    pub fn joints(&self) -> Joints {
        self.mover.joints()
    }

    /// Returns the true flange pose, which differs from the calculated one if the real arm differs from the nominal
    /// arm.
    pub fn flange_pose(&self) -> Rigid<Base, Flange> {
        match &self.setup.real_arm {
            Some(arm) => arm.base_from_flange(&self.mover.joints()),
            None => self.mover.base_from_flange(),
        }
    }

    /// Returns whether the arm moves or motions are planned.
    pub fn is_moving(&self) -> bool {
        !self.mover.is_idle() || self.contact.is_retract_due()
    }

    /// Returns the override that a person has set, %.
    pub fn override_percent(&self) -> u8 {
        self.troubles.override_percent()
    }

    /// Returns the injected error of the reported pose along Z of the active base, mm.
    pub fn pose_deviation_mm(&self) -> f64 {
        self.troubles.pose_deviation_mm()
    }

    /// Returns the value of every `$OUT` that was ever set.
    pub fn outputs(&self) -> &BTreeMap<u16, bool> {
        &self.outputs
    }

    /// Returns whether mode, keys, drives, guard and program permit motion of the arm.
    pub fn can_move(&self) -> bool {
        self.safety.motion_possible()
    }

    /// Returns the value of every `$FLAG` that was ever set.
    pub fn flags(&self) -> &BTreeMap<u16, bool> {
        &self.flags
    }

    /// Returns the numbers of the last command that was received in the current epoch, and of the last one that was
    /// executed.
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

    /// Returns the number of underruns: how often the next point of a path was missing.
    pub fn underrun_count(&self) -> i32 {
        self.running.as_ref().map_or(self.underruns, |running| running.underruns())
    }

    /// Returns the number of commands of ended epochs that arrived and were dropped.
    pub fn stale_commands(&self) -> u64 {
        self.stale_messages
    }

    /// Returns all executed motions, in their order.
    pub fn executed_motions(&self) -> &[ExecutedMotion] {
        &self.executed
    }

    /// Returns the samples of the tool's position in all contacts, one per tick.
    pub fn trace(&self) -> &[ContactSample] {
        &self.trace
    }

    /// Returns all stops by the robot program.
    pub fn program_stops(&self) -> &[ProgramStop] {
        &self.stops
    }
}
