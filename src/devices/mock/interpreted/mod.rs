//! The controller's shipped programs, executed: two interpreters, EthernetKRL, the states of the robot program.
//!
//! Replaces the hand-written model of `submit`, `program` and `answer` if [`Setup::programs`] names programs; the arm,
//! people's actions, faults and channels' bytes are the same. In each tick a seeded scheduler gives statements to the
//! two interpreters in turns of any length, and sometimes starves one of them: the programs must be correct with any
//! order that a controller could choose.
//!
//! - `programs` (the executed programs), `running` (their state), `values` and `variables` (system variables),
//!   `environment` (the parts of the controller that a program uses), `ethernet` (the EKI functions)
//! - `robot_state` and `states` (selected, started, stopped, reset), `schedule` (one tick), `lock_step` and `held`
//!   (what lets time pass), `seen` (values for tests)
//!
//! Not modelled: motions inside of interrupt programs, continuing a braked motion, triggers other than at a motion's
//! end, HALT.
//!
//! [`Setup::programs`]: super::Setup

mod environment;
mod ethernet;
mod held;
mod lock_step;
mod programs;
mod robot_state;
mod running;
mod schedule;
mod seen;
mod states;
mod values;
mod variables;

pub use programs::Programs;
pub use robot_state::RobotState;

pub(super) use running::RunningPrograms;
