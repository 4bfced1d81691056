//! Options of a mock controller (its clock, its mode, the rules that it follows), and the states of the safety
//! controller and the pendant with their effect on the robot program.
//!
//! The program runs, is paused (in T1 and T2 without the Start key), or was reset and waits for its start. It is reset
//! by an emergency stop, by switching off the drives, by opening the guard, by changing the mode, and by any stop while
//! it is paused. After a reset the Start key does not continue the planned motions, and the TCP position is unknown
//! until the program is started again.

/// The program checksum that the hand-written model reports; a controller that executes programs reports theirs.
pub const CHECKSUM: i32 = 1;

/// The source of the controller's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Time advances only by calls of [`Controller::advance_ms`](super::Controller::advance_ms), which the server makes
    /// according to the wall clock.
    Free,
    /// Time advances only with the client's heartbeats: each grants 100 ms, once every command up to the one that it
    /// names has arrived.
    LockStep,
}

/// The mode switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Manual mode with at most 250 mm/s; the arm moves only while the Start key is pressed.
    T1 = 1,
    /// Manual mode with full speed; the arm moves only while the Start key is pressed.
    T2 = 2,
    /// Automatic.
    Aut = 3,
    /// Automatic External: a higher-level controller (PLC) starts the program.
    Ext = 4,
}

/// A rule that the controller's programs follow. A test can omit one rule, to check that other tests detect this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Commands of ended epochs are dropped.
    EpochCheck,
    /// If the client sends nothing for too long, the queued commands are discarded and the channels are closed.
    Watchdog,
    /// A lost connection ends the epoch.
    LinkLoss,
    /// A stop discards the queued commands.
    Discard,
    /// A stop in contact is followed by a retract from the panel.
    Retract,
    /// The end of an epoch switches the tool's outputs off.
    OutputsOff,
    /// One request raises the epoch by at most the maximum step.
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
    /// Whether the robot program is selected.
    pub(super) selected: bool,
    /// Whether the program was started and not reset since.
    pub(super) started: bool,
    /// Whether a program that does not belong to the cell is selected.
    pub(super) foreign: bool,
    pub(super) foreign_program_resets: u32,
}

impl SafetyState {
    /// Returns the initial state: automatic mode, nothing prevents motion, the program is started.
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

    /// Returns whether the program runs, so that the arm can move.
    pub(super) fn motion_possible(&self) -> bool {
        self.started && self.is_enabled() && !self.is_paused()
    }

    /// Returns whether a program could be started.
    pub(super) fn may_start(&self) -> bool {
        self.is_enabled() && (!self.is_manual() || self.start_key)
    }

    /// Returns whether a program was started and has executed its block coincidence (BCO) motion.
    pub(super) fn has_program(&self) -> bool {
        self.started
    }

    /// Returns whether the program is paused because the Start key was released.
    pub(super) fn is_paused(&self) -> bool {
        self.started && self.is_manual() && !self.start_key
    }

    /// Resets the program: after its next start it begins at its first line.
    pub(super) fn reset_program(&mut self) {
        self.started = false;
    }
}
