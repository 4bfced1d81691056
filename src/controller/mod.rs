//! Compares the controller's files with each other and with the cell's file, as pure functions of their texts.
//!
//! A cell is described three times: in the cell's file on the PC, in `cell_config.dat` and in the two EthernetKRL
//! files on the controller. `compare` finds every contradiction between them. `sum` computes the checksum with
//! which the controller's programs identify themselves, and `stated` reads the numbers of a data list. Nothing here
//! communicates with a controller: which programs it executes is another question, which its checksum answers.

mod compare;
mod data;
mod difference;
mod names;
mod stated;
mod sum;
#[cfg(test)]
mod tests;

pub use compare::{ControllerFiles, differences};
pub use difference::Difference;
pub use names::{COMMANDS, CONFIG, DATA, MOTION, PROGRAMS, STATES};
pub use sum::{SumError, base_name, program_sum};
