//! The trait of the loop's ports. A port performs one command of its enum at a time, and returns one answer of another
//! enum.

/// A command that a port can perform.
pub trait Command {
    /// The answer of the port to this command.
    type Answer;
}

/// Performs commands, one at a time.
pub trait Port<C: Command> {
    /// Performs a command and returns its answer.
    fn perform(&mut self, command: C) -> C::Answer;
}
