//! Differences between a replayed cycle and the recorded one.

use serde::Serialize;
use serde_json::Value;

/// One difference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The time of the difference, s since the recording began.
    pub at_s: f64,
    /// The topic, and the value within the topic.
    pub what: String,
    /// The recorded value.
    pub recorded: String,
    /// The value of the replay.
    pub now: String,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Difference { at_s, what, recorded, now } = self;
        write!(f, "{at_s:.3} s, {what}: recorded {recorded}, now {now}")
    }
}

/// Returns each value in which the recorded and the new form differ, with its path, such as `send.move_lin.pose.x_mm`.
/// Numbers are equal if all their digits are equal.
pub(super) fn differences(recorded: &Value, now: &Value) -> Vec<(String, String, String)> {
    let mut found = Vec::new();
    compare(String::new(), recorded, now, &mut found);
    found
}

fn compare(place: String, recorded: &Value, now: &Value, found: &mut Vec<(String, String, String)>) {
    let below = |key: &str| if place.is_empty() { key.to_owned() } else { format!("{place}.{key}") };
    match (recorded, now) {
        (Value::Object(before), Value::Object(after)) if before.keys().eq(after.keys()) => {
            for (key, value) in before {
                compare(below(key), value, &after[key], found);
            }
        }
        (Value::Array(before), Value::Array(after)) if before.len() == after.len() => {
            for (index, (value, other)) in before.iter().zip(after).enumerate() {
                compare(below(&name(index, value)), value, other, found);
            }
        }
        (before, after) if before == after => {}
        (before, after) => found.push((place, shorten_value(before), shorten_value(after))),
    }
}

/// Returns the name of a list's entry: its own name, if it has one.
fn name(index: usize, value: &Value) -> String {
    value.get("name").and_then(Value::as_str).map_or_else(|| index.to_string(), str::to_owned)
}

/// Longest text that is shown for one of the two values.
const MAX_TEXT_LENGTH: usize = 200;

/// Returns a value as text, cut if it is long.
pub(super) fn shorten_value(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= MAX_TEXT_LENGTH {
        return text;
    }
    let cut: String = text.chars().take(MAX_TEXT_LENGTH).collect();
    format!("{cut}…")
}
