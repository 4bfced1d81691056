//! The handshake with a line by digital signals of the robot's controller. A thread reads the inputs and the cell ten
//! times a second, sets outputs, and makes the requests that `panelprep_cell::line` decides, through the gateway like every
//! interface. Nothing in the loop waits for it. If it does not run, the controller's program reports a fault to the
//! line once its link is gone.

mod handshake_thread;

#[cfg(test)]
mod tests;

pub use handshake_thread::{LineFront, LineParts};
