//! A compliant tool as the loop uses it: its commands, its reports, and the limits of its session.

use panelprep_cell::cell::CompliantTool;
use panelprep_cell::force::{ForceSetPoint, LinkLossCause, SessionLimits, ToolReading};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A report of a tool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolReport {
    /// A reading, with its age, ms.
    Reading {
        /// Its report.
        reading: ToolReading,
        /// Age of the reading, ms.
        age_ms: u32,
    },
    /// The link to the tool is lost; reported once.
    Lost(LinkLossCause),
}

/// A compliant tool that is connected by a link. No call blocks for an answer of the tool.
pub trait ConnectedTool: Send {
    /// Commands the force with which the tool presses from now on.
    fn set_force(&mut self, press: ForceSetPoint);
    /// Returns the next report of the tool; `None` if there is none.
    fn next_report(&mut self) -> Option<ToolReport>;
}

/// Returns the limits that a session with this tool uses.
pub fn session_limits(tool: &CompliantTool) -> SessionLimits {
    SessionLimits {
        login: tool.login.clone(),
        id: tool.id,
        period: Duration::from_millis(u64::from(tool.period_ms)),
        reply_within: Duration::from_millis(u64::from(tool.reply_ms)),
        rest_set_point: ForceSetPoint::retracted(tool.min_force_n),
    }
}
