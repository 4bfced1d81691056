//! The compliant tool: a FerRobotics ACF over TCP, and a mock of this tool inside the program.
//!
//! - `link`: a thread of its own that keeps the session; its received data is read without waiting
//! - `mock`: a tool as bytes in and bytes out, with faults; its stroke ends when the disc touches
//! - `simulated`: session and mock in the time of the simulated world
//! - `planned_fault`: a fault of the simulated tool that begins during a path
//! - `tool`: the loop's interface to each of them
//! - `server`: the mock behind a TCP port, for tests of the link
//!
//! **The driver has not run on a real tool yet.** To be proven on site: that the log-in word is echoed, what the tool
//! does automatically when its link is cut, and that its force agrees with a scale.

mod link;
mod mock;
mod planned_fault;
mod server;
mod simulated;
mod tool;

#[cfg(test)]
mod tests;

pub use link::{AcfLink, AcfStartError};
pub use mock::{MockAcf, ToolFault, ToolSurroundings};
pub use planned_fault::{PlannedToolFault, PlannedToolFaultError};
pub use server::MockAcfServer;
pub use simulated::{SimulatedAcf, SimulatedPanel, Surroundings};
pub use tool::{ConnectedTool, ToolReport, session_limits};
