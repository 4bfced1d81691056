//! The handshake with a production line by digital signals, for lines without OPC UA: the conditions for a start
//! request, and the signals to the line.
//!
//! The line sets two inputs of the robot's controller, `part_present` and `start_request`, and reads its outputs
//! `ready`, `cycle_done`, `pass`, `fail`, `review` and `fault`. `signals` defines the signals for each state of the
//! cell; `handshake` defines when the line makes a request. The line requests a start and, once the part is removed, a
//! reset. Persons make the same requests, and the same gates check them. Pure: the signals go over the robot's link
//! (`daemon/line`).

mod handshake;
mod signals;

#[cfg(test)]
mod tests;

pub use handshake::{Handshake, LineObservation, LineRequest};
pub use signals::{CellStatus, LineInputs, LineSignals, line_signals};
