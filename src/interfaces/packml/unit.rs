//! The cycle's state as a PackML number, and the unit's mode.
//!
//! The cycle already has PackML's names ([`At`]); the numbers are those of ISA-TR88.00.02-2015, table of states.
//! Suspending, Suspended and Unsuspending (13, 5, 14) do not occur, because no neighbouring machine makes this cell
//! wait.

use panelprep_cell::cycle::{At, Robot, State};

/// A state of the unit, with its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr, strum::VariantArray)]
#[expect(missing_docs, reason = "the names are PackML's")]
pub enum UnitState {
    Clearing = 1,
    Stopped = 2,
    Starting = 3,
    Idle = 4,
    Execute = 6,
    Stopping = 7,
    Aborting = 8,
    Aborted = 9,
    Holding = 10,
    Held = 11,
    Unholding = 12,
    Resetting = 15,
    Completing = 16,
    Complete = 17,
}

impl UnitState {
    /// Returns the state of the unit for this state of the cycle.
    pub fn from_state(at: At) -> Self {
        match at {
            At::Stopped => UnitState::Stopped,
            At::Resetting => UnitState::Resetting,
            At::Idle => UnitState::Idle,
            At::Starting => UnitState::Starting,
            At::Execute(_) => UnitState::Execute,
            At::Holding(_) => UnitState::Holding,
            At::Held(_) => UnitState::Held,
            At::Unholding { .. } => UnitState::Unholding,
            At::Completing { .. } => UnitState::Completing,
            At::Complete { .. } => UnitState::Complete,
            At::Stopping { .. } => UnitState::Stopping,
            At::Aborting { .. } => UnitState::Aborting,
            At::Aborted { .. } => UnitState::Aborted,
            At::Clearing { .. } => UnitState::Clearing,
        }
    }

    /// Its number.
    pub fn number(self) -> i32 {
        self as i32
    }

    /// Returns the state's name, as PackML writes it.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns whether the state ends by itself, as PackML's acting states do; in other states the unit waits for a
    /// command.
    pub fn is_acting_state(self) -> bool {
        use UnitState::{Aborted, Complete, Held, Idle, Stopped};
        !matches!(self, Stopped | Idle | Held | Complete | Aborted)
    }
}

/// The unit's mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr)]
pub enum UnitMode {
    /// Cycles on panels.
    Production = 1,
    /// A run in the air, without water, tool and contact.
    Maintenance = 2,
    /// The robot is in T1 or T2 and is operated by hand.
    Manual = 3,
}

impl UnitMode {
    /// Returns the mode for this state of the cycle. The robot's mode switch has priority over the purpose of the
    /// cycle.
    pub fn from_state(state: &State) -> Self {
        match state.facts.robot {
            Robot::NotAutomatic => UnitMode::Manual,
            _ if state.job.running && state.job.air => UnitMode::Maintenance,
            _ => UnitMode::Production,
        }
    }

    /// Its number.
    pub fn number(self) -> i32 {
        self as i32
    }

    /// Returns the mode's name, as PackML writes it.
    pub fn name(self) -> &'static str {
        self.into()
    }
}
