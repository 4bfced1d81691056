//! Options of a mock controller: its clock, its mode and the rules that it follows; and the states of the safety
//! controller and the pendant, with their effect on the robot program.
//!
//! The program runs, is paused (T1 and T2 without the start key), or was reset and waits for its start. An emergency
//! stop, drives off, an open guard, a turned mode switch and any stop of a paused program reset it. Then no start key
//! continues the planned motions, and the TCP position is unknown until the program is started again.

/// The checksum that the hand-written model reports; controllers that execute programs report theirs.
pub const CHECKSUM: i32 = 1;

/// The source of the controller's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Time passes only by [`Controller::advance_ms`](super::Controller::advance_ms), which the server calls by the
    /// wall clock.
    Free,
    /// Time passes only by the client's heartbeats: each heartbeat grants 100 ms, after every command up to the one
    /// that it names has arrived.
    LockStep,
}

/// The mode switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Manual mode, at most 250 mm/s; the arm moves only while the start key is pressed.
    T1 = 1,
    /// Manual mode at full speed; the arm moves only while the start key is pressed.
    T2 = 2,
    /// Automatic.
    Aut = 3,
    /// Automatic External: a higher-level controller (PLC) starts the program.
    Ext = 4,
}

/// A rule that the controller's programs follow. One rule can be left out, to check that the tests notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Commands of ended epochs are dropped.
    EpochCheck,
    /// If the client is silent, the queued commands are stopped and the channels closed.
    Watchdog,
    /// A lost connection ends the epoch.
    LinkLoss,
    /// A stop discards the queued commands.
    Discard,
    /// A stop in contact is followed by a retract.
    Retract,
    /// The end of an epoch switches outputs off.
    OutputsOff,
    /// One request raises the epoch by at most one step.
    EpochStep,
}

/// The states of the safety controller and the pendant.
#[derive(Debug, Clone, Copy)]
pub(super) struct SafetyState {
    pub(super) mode: Mode,
    pub(super) drives_on: bool,
    pub(super) e_stop: bool,
    pub(super) guard_closed: bool,
    pub(super) start_key: bool,
    /// The robot program is selected.
    pub(super) selected: bool,
    /// The program was started, and has not been reset since.
    pub(super) started: bool,
    /// A program other than the cell's is selected.
    pub(super) foreign: bool,
    pub(super) foreign_program_resets: u32,
}

impl SafetyState {
    /// Returns the state at the start: automatic mode, nothing that prevents motion, the program started.
    pub(super) fn initial() -> Self {
        SafetyState {
            mode: Mode::Ext,
            drives_on: true,
            e_stop: false,
            guard_closed: true,
            start_key: false,
            selected: true,
            started: true,
            foreign: false,
            foreign_program_resets: 0,
        }
    }

    pub(super) fn is_manual(&self) -> bool {
        matches!(self.mode, Mode::T1 | Mode::T2)
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.drives_on && !self.e_stop && (self.is_manual() || self.guard_closed)
    }

    /// Returns whether the program runs, so that the arm may move.
    pub(super) fn motion_possible(&self) -> bool {
        self.started && self.is_enabled() && !self.is_paused()
    }

    /// Returns whether a program that is started would run.
    pub(super) fn may_start(&self) -> bool {
        self.is_enabled() && (!self.is_manual() || self.start_key)
    }

    /// Returns whether a program was started and has made its block coincidence.
    pub(super) fn has_program(&self) -> bool {
        self.started
    }

    /// Returns whether the start key was released.
    pub(super) fn is_paused(&self) -> bool {
        self.started && self.is_manual() && !self.start_key
    }

    /// Resets the program: it begins again at its first line, once it is started.
    pub(super) fn reset_program(&mut self) {
        self.started = false;
    }
}
