//! The link to a robot's controller: an EKI session over two TCP connections, on its own thread and runtime, so
//! that no computation delays it.
//!
//! The rest of the program uses [`RobotLink`]: commands go in, reports come out. A lost link is reported once and
//! reconnected with back-off; reconnecting requests the controller's state and moves nothing. Dropping the link
//! aborts the motion in progress.
//!
//! In lock step (`ClockMode::LockStep`) the controller's virtual time passes only while a caller waits in
//! [`RobotLink::next`] and no report is left: 100 ms for each wait. The same commands at the same reports give the
//! same motion, bit for bit, however slow the machine is.
//!
//! The link does not judge waypoints: see the gate in `path`. It reports events and decides nothing: see `cycle`.

mod link;
mod queue;
mod run;

#[cfg(test)]
mod tests;

pub use link::{BlockingLink, LineOutputs, RobotLink, StartError, StopLine, link_limits};
pub use run::Address;
