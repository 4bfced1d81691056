//! Compares the controller's files with each other and with the cell's file, as pure functions of their texts.
//!
//! A cell is described three times: in the cell's file on the PC, in `cell_config.dat` and in the two EthernetKRL
//! files on the controller. `compare` finds every contradiction between them, `declared` and `called` those among the
//! controller's programs. `sum` computes the checksum with which the controller's programs identify themselves, and
//! `stated` reads the numbers of a data list. `planned` has the numbers with which the PC plans. Nothing here
//! communicates with a controller: which programs it executes is another question, which its checksum answers.

mod called;
mod compare;
mod data;
mod declared;
mod difference;
mod names;
mod planned;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod planted;
mod stated;
mod sum;
#[cfg(test)]
mod tests;

pub use compare::{Comparison, ControllerFiles, among_programs, compare};
pub use difference::Difference;
pub use names::{COMMANDS, CONFIG, DATA, MOTION, PROGRAMS, STATES, SUBMIT, USER, is_named};
pub use planned::{AIR_ACCELERATION_M_S2, RETRACT_M_S2, RETRACT_MM, RETRACT_MM_S};
pub use stated::highest_acceleration_m_s2;
pub use sum::{SumError, program_sum};
