//! The interface of a compliant tool for the control loop: its commands and reports, and the limits of its session.

use panelprep_cell::cell::CompliantTool;
use panelprep_cell::force::{ForceSetPoint, LinkLossCause, SessionLimits, ToolReading};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A report of a compliant tool.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolReport {
    /// A measurement of the tool (force, position, contact, errors), with its age.
    Reading {
        /// The measured values.
        reading: ToolReading,
        /// Age of the measurement, ms.
        age_ms: u32,
    },
    /// The connection to the tool is lost; each loss is reported once.
    Lost(LinkLossCause),
}

/// A compliant tool with a connection. No method blocks until the tool replies.
pub trait ConnectedTool: Send {
    /// Sets the force with which the tool presses from now on.
    fn set_force(&mut self, press: ForceSetPoint);
    /// Returns the next report of the tool; `None` if there is no new one.
    fn next_report(&mut self) -> Option<ToolReport>;
}

/// Returns the session limits for a tool with these parameters of the cell file.
pub fn session_limits(tool: &CompliantTool) -> SessionLimits {
    SessionLimits {
        login: tool.login.clone(),
        id: tool.id,
        period: Duration::from_millis(u64::from(tool.period_ms)),
        reply_within: Duration::from_millis(u64::from(tool.reply_ms)),
        rest_set_point: ForceSetPoint::retracted(tool.min_force_n),
    }
}
