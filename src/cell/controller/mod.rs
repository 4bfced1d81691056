//! Compares the controller's files with each other and with the cell's file, as pure functions of their texts.
//!
//! A cell is described three times: in the cell's file on the PC, in `cell_config.dat` and in the two EthernetKRL
//! files on the controller. `compare` finds every contradiction between them and among the controller's programs,
//! `data` those of the data list with the cell's file. `data_list` reads the numbers and declarations of a data list,
//! and `sum` computes the checksum with which the controller's programs identify themselves. `names` has the names of
//! the controller's files, the numbers with which the PC plans, and the type of a contradiction. Nothing here
//! communicates with a controller: which programs it executes is another question, which its checksum answers.

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
