//! What people, the safety controller and the cell's PLC do, and what that means for the robot program.
//!
//! The program runs, is paused (T1 and T2 without the start key), or was reset and waits for its start. An emergency
//! stop, drives off, an open guard, a turned mode switch and any stop of a paused program reset it: no start key goes on
//! with what was planned, and nothing is known of the tool's tip until it was started again.

use super::log::StopCause;
use super::model::Controller;
use super::setup::{Clock, Mode};
use super::submit::REOPEN_MS;
use super::wire::Channel;
use crate::geometry::Joints;

/// What the safety controller and the pendant say.
#[derive(Debug, Clone, Copy)]
pub(super) struct Safety {
    pub(super) mode: Mode,
    pub(super) drives_on: bool,
    pub(super) e_stop: bool,
    pub(super) guard_closed: bool,
    start_key: bool,
    /// The robot program is selected.
    pub(super) selected: bool,
    /// It was started, and has not been reset since.
    pub(super) started: bool,
    /// Another program than the cell's is selected.
    pub(super) foreign: bool,
    pub(super) foreign_resets: u32,
}

impl Safety {
    /// Automatic, nothing in the way, the program started.
    pub(super) fn at_start() -> Self {
        Safety {
            mode: Mode::Ext,
            drives_on: true,
            e_stop: false,
            guard_closed: true,
            start_key: false,
            selected: true,
            started: true,
            foreign: false,
            foreign_resets: 0,
        }
    }

    fn manual(&self) -> bool {
        matches!(self.mode, Mode::T1 | Mode::T2)
    }

    fn enabled(&self) -> bool {
        self.drives_on && !self.e_stop && (self.manual() || self.guard_closed)
    }

    /// Whether the program runs, so that the arm may move.
    pub(super) fn motion_possible(&self) -> bool {
        self.started && self.enabled() && !self.paused()
    }

    /// Whether a program that is started would run.
    pub(super) fn may_start(&self) -> bool {
        self.enabled() && (!self.manual() || self.start_key)
    }

    /// There is a program, and it has made its block coincidence.
    pub(super) fn has_program(&self) -> bool {
        self.started
    }

    /// The start key was let go.
    pub(super) fn paused(&self) -> bool {
        self.started && self.manual() && !self.start_key
    }

    /// The program begins again from its top, once it is started.
    pub(super) fn reset_program(&mut self) {
        self.started = false;
    }
}

impl Controller {
    /// Starts the robot program where drives, guard, mode and key allow it. The arm stands where it stands.
    pub fn start_program(&mut self) {
        if self.running.is_some() {
            return self.start_interpreted();
        }
        let safety = &mut self.safety;
        safety.started |= safety.selected && safety.enabled() && (!safety.manual() || safety.start_key);
    }

    /// The emergency stop: the arm stands at once where it is, the drives go off, the epoch ends.
    pub fn press_e_stop(&mut self) {
        self.safety.e_stop = true;
        self.safety.drives_on = false;
        self.stop(StopCause::EStop, String::new());
    }

    /// Releases the emergency stop. The drives stay off and nothing goes on.
    pub fn release_e_stop(&mut self) {
        self.safety.e_stop = false;
    }

    /// Switches the drives; not on while the emergency stop is pressed.
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

    /// Holds or releases the start key, which T1 and T2 need; released, the motion waits.
    pub fn hold_start_key(&mut self, held: bool) {
        self.safety.start_key = held;
        if held {
            self.start_program();
        }
    }

    /// A person jogs the arm there: it stands there at once. Not while anything is planned; whether it was done.
    pub fn jog(&mut self, joints: Joints) -> bool {
        let stands = self.mover.stands();
        if stands {
            self.mover.jog(joints);
        }
        stands
    }

    /// Sets an input that the world leaves alone.
    pub fn set_input(&mut self, number: u16, value: bool) {
        self.inputs.insert(number, value);
    }

    /// The robot program is deselected: the arm stands, and channels of its environment are closed.
    pub fn deselect(&mut self) {
        if std::mem::replace(&mut self.safety.selected, false) {
            self.stop(StopCause::Deselected, String::new());
        }
        for channel in [Channel::Command, Channel::State] {
            if self.lives_with_program(channel) {
                self.disconnect(channel);
                self.link(channel).listens_at_ms = u64::MAX;
            }
        }
    }

    /// The robot program is selected and started; nothing moves by it.
    pub fn select(&mut self) {
        self.safety.selected = true;
        self.select_interpreted();
        self.start_program();
        for channel in [Channel::Command, Channel::State] {
            if self.lives_with_program(channel) {
                self.link(channel).listens_at_ms = self.now_ms + REOPEN_MS;
            }
        }
    }

    /// The controller starts again: channels, epochs and counts are gone, the arm stands, outputs are off.
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
        self.forget_all();
    }
}
