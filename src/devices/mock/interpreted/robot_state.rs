//! The states of a robot program.

/// `$PRO_STATE1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotState {
    /// No program is selected.
    Free,
    /// Selected, at its first line.
    Reset,
    /// It runs.
    Active,
    /// The program was stopped; Start continues it.
    Stopped,
    /// It has come to its end.
    Ended,
}
