//! The handshake with a line by digital signals of the robot's controller: a thread that looks at inputs and cell ten times a second,
//! sets outputs, and asks for what `crate::line` says, through the gateway as every front does. Nothing in the loop waits for it, and
//! where it does not look the controller's program tells the line of a fault once its link is gone.

mod front;

#[cfg(test)]
mod tests;

pub use front::{LineFront, LineParts};
