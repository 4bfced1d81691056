//! The controller's shipped programs, executed: two interpreters, EthernetKRL, the states of the robot program.
//!
//! Replaces the hand-written model of `submit`, `program` and `channels` if [`Setup::programs`] names programs; the
//! arm, people's actions, faults and channels' bytes are the same. In each tick a seeded scheduler lets the two
//! interpreters execute random numbers of statements alternately, and sometimes starves one of them: the programs must
//! be correct with any order that a controller could choose.
//!
//! - `running` (the programs' state and the system variables' values), `variables` (system variables and the other
//!   parts of the controller that a program uses), `ethernet` (the EKI functions)
//! - `states` (selected, started, stopped, reset; values for tests), `schedule` (one tick, and what lets time pass in
//!   lock step)
//!
//! Not modelled: motions inside of interrupt programs, continuing a braked motion, triggers other than at a motion's
//! end, HALT.
//!
//! [`Setup::programs`]: super::Setup

mod ethernet;
mod running;
mod schedule;
mod states;
mod variables;

pub use running::RobotState;

pub(super) use running::RunningPrograms;
