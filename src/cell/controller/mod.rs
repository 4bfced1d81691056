//! Compares the controller's files with each other and with the cell's file, as pure functions of their texts.
//!
//! A cell is described in three places: in the cell's file on the PC, and on the controller in `cell_config.dat` and in
//! the two EthernetKRL files. `compare` finds the contradictions between these files and between the controller's
//! programs, and `data` those between the data list and the cell's file. `data_list` parses the numbers and
//! declarations of a data list. `sum` computes the checksum that identifies the controller's programs. `names` contains
//! the names of the controller's files, the numbers with which the PC plans motions, and the type of a contradiction.
//! This module does not connect to a controller: which programs the controller executes is shown by the checksum that
//! it reports.

mod compare;
mod data;
mod data_list;
mod names;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod planted;
mod sum;

#[cfg(test)]
mod tests;

pub use compare::{Comparison, ControllerFiles, among_programs, compare};
pub use data_list::highest_acceleration_m_s2;
pub use names::{
    AIR_ACCELERATION_M_S2, COMMANDS, CONFIG, DATA, Difference, MOTION, PROGRAMS, RETRACT_M_S2, RETRACT_MM,
    RETRACT_MM_S, STATES, SUBMIT, USER, is_named,
};
pub use sum::{SumError, program_sum};
