//! A compliant tool as the loop knows it: what it is told, and what is newly known of it.

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
