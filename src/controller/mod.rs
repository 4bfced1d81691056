//! The controller's files held against each other and against the cell's file, as pure functions over their texts.
//!
//! A cell is described three times: in the cell's file on the PC, in `cell_config.dat` and in the two EthernetKRL
//! files on the controller. `compare` finds every place at which they contradict each other, `sum` computes the
//! number by which the controller's programs name themselves, and `stated` reads the numbers of a data list.
//! Nothing here talks to a controller: what it executes is another question, which its sum answers.

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
