//! The compliant tool: a FerRobotics ACF over TCP, and a mock of it inside the program.
//!
//! - `link`: a thread of its own that keeps the session; what it heard is read without waiting
//! - `mock`: a tool as bytes in and bytes out, with faults; its stroke ends where the disc touches
//! - `simulated`: session and mock in the time of the simulated world
//! - `server`: the mock behind a TCP port, for tests of the link
//!
//! **The driver has not run on a real tool yet.** To be proven on site: that the log-in word is echoed, what the tool does by
//! itself when its link is cut, and that its force is that of a scale.

mod link;
mod mock;
mod server;
mod simulated;

#[cfg(test)]
mod tests;

pub use link::{AcfLink, AcfStartError};
pub use mock::{MockAcf, Surrounding, ToolFault};
pub use server::MockAcfServer;
pub use simulated::{SimulatedAcf, SimulatedPanel, Surroundings};

use crate::cell::CompliantTool;
use crate::force::{Loss, Press, Reading, SessionLimits};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// What is newly known of a tool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolNews {
    /// It says this; it came so long ago, ms.
    Reading {
        /// What it says.
        reading: Reading,
        /// When, ms ago.
        age_ms: u32,
    },
    /// Its link is lost; told once.
    Lost(Loss),
}

/// A compliant tool at the end of a link. No call waits for it.
pub trait ConnectedTool: Send {
    /// Tells it what to press with from now on.
    fn press(&mut self, press: Press);
    /// What is newly known of it; none where nothing is.
    fn news(&mut self) -> Option<ToolNews>;
}

/// What a session with this tool works by.
pub fn session_limits(tool: &CompliantTool) -> SessionLimits {
    SessionLimits {
        login: tool.login.clone(),
        id: tool.id,
        period: Duration::from_millis(u64::from(tool.period_ms)),
        reply_within: Duration::from_millis(u64::from(tool.reply_ms)),
        at_rest: Press::held_back(tool.min_force_n),
    }
}
