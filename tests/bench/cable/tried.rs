//! Tests the judges: the controller's reports are changed before the judges receive them, so that each judge must find
//! something.

use super::message;
use super::truth::{Event, Side};

/// The reports that can be changed to test the judges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tried {
    /// A stopped arm continues to creep.
    Motion,
    /// The controller never reports that it has stopped, and moves.
    Stop,
    /// The tool continues to run.
    Tool,
    /// The arm stays at the position at which it was stopped.
    Retract,
    /// The last waypoints were not executed.
    Pass,
}

impl Tried {
    /// # Panics
    /// If there is no such word.
    pub fn named(word: &str) -> Self {
        match word {
            "motion" => Tried::Motion,
            "stop" => Tried::Stop,
            "tool" => Tried::Tool,
            "retract" => Tried::Retract,
            "pass" => Tried::Pass,
            other => panic!("tried={other}: allowed are motion, stop, tool, retract and pass"),
        }
    }

    /// Returns the events that the judges receive.
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
                Tried::Motion if is_stopped => {
                    crept_deg += 0.05;
                    let angle = message::number(&event.text, "J/A1").unwrap_or(0.0) + crept_deg;
                    message::replaced(&event.text, "J/A1", &format!("{angle:.6}"))
                }
                Tried::Stop => whole("Flags", |flags| flags & !128 | 8),
                Tried::Tool if is_stopped => whole("Out", |outputs| outputs | 16),
                Tried::Retract if is_stopped => Some(standing(&event.text, &before)),
                Tried::Pass => whole("Done", |done| (done - 40).max(0)),
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

/// Returns the state with the earlier axis angles.
fn standing(text: &str, before: &str) -> String {
    ["J/A1", "J/A2", "J/A3", "J/A4", "J/A5", "J/A6"].iter().fold(text.to_owned(), |text, axis| {
        let angle = message::value(before, axis);
        angle.and_then(|angle| message::replaced(&text, axis, angle)).unwrap_or(text)
    })
}
