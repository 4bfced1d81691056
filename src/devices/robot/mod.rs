//! The link to a robot controller: an EKI session over two TCP connections, with its own thread and runtime, so that no
//! computation delays it.
//!
//! The rest of the program uses [`RobotLink`] to send commands and receive reports. A lost link is reported once, and
//! connected again with increasing delays. A new connection requests the controller's state and moves nothing. Dropping
//! the link aborts the motion in progress.
//!
//! In lock step (`ClockMode::LockStep`) the controller's virtual time advances only while a caller waits in
//! [`RobotLink::next`] and no report is pending, by 100 ms for each wait. If the caller sends the same commands after
//! the same reports, the motion is the same bit for bit, regardless of the speed of the computer.
//!
//! The link does not check waypoints; `path` does. It reports events and decides nothing; `cycle` decides.

mod link;
mod queue;
mod run;

#[cfg(test)]
mod tests;

pub use link::{BlockingLink, LineOutputs, RobotLink, StartError, StopLine, link_limits};
pub use run::Address;
