//! The controller's files held against each other and against the cell's file, as pure functions over their texts.
//!
//! A cell is described three times: in the cell's file on the PC, in `cell_config.dat` and in the two EthernetKRL files on the
//! controller. `compare` finds every place at which they contradict each other, `sum` computes the number by which the
//! controller's programs name themselves, and `stated` reads the numbers of a data list. Nothing here talks to a controller: what
//! it executes is another question, which its sum answers.

mod compare;
mod data;
mod stated;
mod sum;
#[cfg(test)]
mod tests;

pub use compare::{ControllerFiles, Difference, differences};
pub use sum::{SumError, base_name, program_sum};

/// Name of the data list that a cell engineer edits.
pub const CONFIG: &str = "cell_config.dat";
/// Name of the data list of the protocol.
pub const DATA: &str = "cell_data.dat";
/// Name of the command channel's file.
pub const COMMANDS: &str = "CELLCMD.xml";
/// Name of the state channel's file.
pub const STATES: &str = "CELLSTAT.xml";
/// Name of the robot program, whose interrupts name flags and a timer by their numbers.
pub const MOTION: &str = "cell_motion.src";
/// Names of all files of the controller whose texts are compared or summed, in the order in which the sum takes them.
pub const PROGRAMS: [&str; 6] =
    [DATA, "cell_judge.src", "cell_link.src", MOTION, "cell_submit.src", "cell_tell.src"];
