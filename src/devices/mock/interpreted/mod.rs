//! Executes the controller's shipped programs: the two interpreters, EthernetKRL, and the states of the robot program.
//!
//! If [`Setup::programs`] contains programs, this module replaces the hand-written model (`submit`, `program` and
//! `channels`). The arm, people's actions, injected faults and the channels' bytes are the same. In each tick a seeded
//! scheduler lets the two interpreters alternately execute random numbers of statements, and sometimes gives one of
//! them almost no time. So the programs are tested with many orders that a controller could choose.
//!
//! - `running` (the state of the programs and the values of the system variables), `variables` (the access to system
//!   variables and to other parts of the controller), `ethernet` (the EKI functions)
//! - `states` (selected, started, stopped, reset; values for tests), `schedule` (one tick, and the advance of time in
//!   lock step)
//!
//! Not modelled: motions inside of interrupt programs, continuing a braked motion, triggers other than at the end of a
//! motion, HALT.
//!
//! [`Setup::programs`]: super::Setup

mod ethernet;
mod running;
mod schedule;
mod states;
mod variables;

pub use running::RobotState;

pub(super) use running::RunningPrograms;
