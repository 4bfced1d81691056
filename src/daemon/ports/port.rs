//! A port: one command of its enum at a time, one answer of another enum.

/// A command of a port.
pub trait Command {
    /// What its port answers.
    type Answer;
}

/// Performs commands, one at a time.
pub trait Port<C: Command> {
    /// Performs a command and gives its answer.
    fn perform(&mut self, command: C) -> C::Answer;
}
