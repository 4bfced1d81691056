//! The handshake with a line by digital signals, for lines without OPC UA: when a start is asked for, and what is told.
//!
//! The line sets two inputs of the robot's controller, `part_present` and `start_request`, and reads its outputs `ready`, `cycle_done`,
//! `pass`, `fail`, `review` and `fault`. `signals` says what is told in which state of the cell; `handshake` when the line asks for
//! something. It asks for a start and, once the part is taken, for a reset: requests that people have, through the same gates. Pure:
//! the signals go over the robot's link (`daemon/line`).

mod handshake;
mod signals;

#[cfg(test)]
mod tests;

pub use handshake::{Handshake, LineRequest, Look};
pub use signals::{CellStands, LineInputs, Told, told};
