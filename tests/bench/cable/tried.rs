//! Tests the checks: the controller's reports are changed before they are checked, and each change must be reported as
//! a violation.

use super::message;
use super::truth::{Event, Side};

/// The changes of the reports with which the checks are tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportChange {
    /// The stopped arm continues to move slowly.
    Motion,
    /// The controller never reports that it has stopped, and continues to move.
    Stop,
    /// The tool continues to run.
    Tool,
    /// The arm does not retract after a stop.
    Retract,
    /// The last waypoints were not executed.
    Pass,
}

impl ReportChange {
    /// Returns the change with this name.
    ///
    /// # Panics
    /// If no change has this name.
    pub fn named(word: &str) -> Self {
        match word {
            "motion" => ReportChange::Motion,
            "stop" => ReportChange::Stop,
            "tool" => ReportChange::Tool,
            "retract" => ReportChange::Retract,
            "pass" => ReportChange::Pass,
            other => panic!("tried={other}: valid: motion, stop, tool, retract, pass"),
        }
    }

    /// Returns the changed events, which are then checked.
    pub fn changed(self, mut events: Vec<Event>) -> Vec<Event> {
        let (mut before, mut crept_deg) = (String::new(), 0.0);
        let states = events.iter_mut().filter(|event| event.side == Side::True && event.text.contains("<St "));
        for event in states {
            let is_stopped = message::whole(&event.text, "Flags") & 128 != 0;
            let whole = |name: &str, change: fn(i64) -> i64| {
                let value = change(message::whole(&event.text, name)).to_string();
                message::replaced(&event.text, name, &value)
            };
            let changed = match self {
                ReportChange::Motion if is_stopped => {
                    crept_deg += 0.05;
                    let angle = message::number(&event.text, "J/A1").unwrap_or(0.0) + crept_deg;
                    message::replaced(&event.text, "J/A1", &format!("{angle:.6}"))
                }
                ReportChange::Stop => whole("Flags", |flags| flags & !128 | 8),
                ReportChange::Tool if is_stopped => whole("Out", |outputs| outputs | 16),
                ReportChange::Retract if is_stopped => Some(standing(&event.text, &before)),
                ReportChange::Pass => whole("Done", |done| (done - 40).max(0)),
                _ => None,
            };
            if !is_stopped {
                before.clone_from(&event.text);
            }
            event.text = changed.unwrap_or_else(|| event.text.clone());
        }
        events
    }
}

/// Returns the state with the axis angles of an earlier state.
fn standing(text: &str, before: &str) -> String {
    ["J/A1", "J/A2", "J/A3", "J/A4", "J/A5", "J/A6"].iter().fold(text.to_owned(), |text, axis| {
        let angle = message::value(before, axis);
        angle.and_then(|angle| message::replaced(&text, axis, angle)).unwrap_or(text)
    })
}
