//! The link to a robot's controller: an EKI session over two TCP connections, on a thread and runtime of its own, so
//! that no computation delays it.
//!
//! [`RobotLink`] is what the rest of the program holds: commands go in, reports come out. A lost link is told once and
//! made again with back-off; that asks for the controller's state and moves nothing. Dropping the link aborts what is
//! under way.
//!
//! In lock step ([`Pace::LockStep`]) the controller's virtual time passes only while somebody waits in
//! [`RobotLink::next`] and nothing else is left to tell: 100 ms for each wait. The same commands at the same reports
//! give the same motion, bit by bit, however slow the machine is.
//!
//! Does not know what a waypoint may be: see the gate in `path`. Tells what happened, decides nothing: see `cycle`.

mod address;
mod blocking;
mod connect;
mod link;
mod order;
mod queue;
mod run;

#[cfg(test)]
mod tests;

pub use address::Address;
pub use blocking::BlockingLink;
pub use link::{RobotLink, StartError, link_limits};
