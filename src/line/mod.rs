//! The handshake with a line by digital signals, for lines without OPC UA: when a start is requested, and what is
//! signalled.
//!
//! The line sets two inputs of the robot's controller, `part_present` and `start_request`, and reads its outputs
//! `ready`, `cycle_done`, `pass`, `fail`, `review` and `fault`. `signals` defines the signals for each state of the
//! cell; `handshake` defines when the line makes a request. It requests a start and, once the part is removed, a
//! reset: people have the same requests, through the same gates. Pure: the signals go over the robot's link
//! (`daemon/line`).

mod handshake;
mod signals;

#[cfg(test)]
mod tests;

pub use handshake::{Handshake, LineObservation, LineRequest};
pub use signals::{CellStatus, LineInputs, LineSignals, line_signals};
