//! The states of a robot program.

/// `$PRO_STATE1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotState {
    /// No program is selected.
    Free,
    /// The program is selected and at its first line.
    Reset,
    /// The program runs.
    Active,
    /// The program was stopped; Start continues it.
    Stopped,
    /// The program has reached its end.
    Ended,
}
