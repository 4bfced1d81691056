//! Differences between a replayed cycle and the recorded one, and the form of a finding in recordings of earlier
//! versions of this program.
//!
//! Earlier versions stored the name, value, unit and limit of each number, in a different order, and not all numbers
//! on which a gate decides. A finding of this version is converted to that form before the two are compared: of each
//! number, only the parts that such a recording has, in the recording's order. Nothing that a recording contains is
//! left out of the comparison.

use panelprep_base::verdict::SINCE_CHECKS;
use panelprep_cell::record::name;
use panelprep_vision::inspect::name as film;
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

/// The beginnings of the names of the numbers that earlier versions of this program did not store. They were added
/// when a finding's numbers became the checks of its gate.
const NAMES_SINCE_CHECKS: [&str; 12] = [
    panelprep_vision::locate::refine::FARTHEST_CORNER,
    film::DRY_PICTURE,
    film::FILM_CHANGE,
    film::FIRST_SHARPNESS,
    film::WET_GRIDS,
    film::FAINT_GRIDS,
    film::UNSEEN_GRIDS,
    film::MASKED_GRIDS,
    panelprep_toolpath::path::TOOL_ERROR,
    panelprep_toolpath::path::GRID_CHECK_PREFIX,
    name::WORN_BY_A_GRID,
    name::BEGUN_GRIDS_NAME,
];

/// Returns a finding of this program in the form of the recorded finding.
pub(super) fn convert_to_recorded_form(recorded: &Value, mut now: Value) -> Value {
    let empty = Vec::new();
    let kept = recorded["numbers"].as_array().unwrap_or(&empty);
    let is_of_today = kept.iter().any(|number| SINCE_CHECKS.iter().any(|key| number.get(key).is_some()));
    let Some(found) = now["numbers"].as_array_mut().filter(|_| !is_of_today) else { return now };
    for number in found.iter_mut().filter_map(Value::as_object_mut) {
        for key in SINCE_CHECKS {
            number.remove(key);
        }
    }
    // Removes the numbers that an earlier version of this program did not report at all.
    found.retain(|number| {
        let is_new =
            number["name"].as_str().is_some_and(|name| NAMES_SINCE_CHECKS.iter().any(|new| name.starts_with(new)));
        !is_new || kept.iter().any(|other| other["name"] == number["name"])
    });
    let place = |number: &Value| kept.iter().position(|other| other["name"] == number["name"]);
    // The sort is stable: numbers that the recording does not have come last and are a difference.
    found.sort_by_key(|number| place(number).unwrap_or(usize::MAX));
    now
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Judgement, Verdict};
    use panelprep_cell::record::{Check, Finding, Kind, LimitSource};
    use serde_json::json;

    fn found(checks: impl IntoIterator<Item = Check>) -> Value {
        let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
        json!(Finding::new(Kind::Inspect, 1, judgement).with_checks(checks))
    }

    fn rms(mm: f64, allowed_mm: f64) -> Check {
        let check = Check::new("residual", "mm", mm).with_max(allowed_mm, LimitSource::recipe("locate.max_rms_mm"));
        check.or_reject("poor_fit", || "too much".to_owned())
    }

    fn shift() -> Check {
        Check::new("shift", "mm", 12.5)
    }

    /// The numbers as an earlier version of this program wrote them: in another order, and with only four values
    /// for each number.
    fn earlier() -> Value {
        let mut recorded = found([]);
        recorded["numbers"] = json!([
            {"name": "shift", "value": 12.5, "unit": "mm", "limit": "unlimited"},
            {"name": "residual", "value": 0.1, "unit": "mm", "limit": {"at_most": 0.25}},
        ]);
        recorded
    }

    fn differing(recorded: &Value, now: Value) -> Vec<String> {
        let now = convert_to_recorded_form(recorded, now);
        differences(recorded, &now).into_iter().map(|(place, ..)| place).collect()
    }

    #[test]
    fn what_is_the_same_is_the_same_in_an_earlier_form() {
        let dry = Check::new(NAMES_SINCE_CHECKS[0], "", 1.0);
        assert_eq!(differing(&earlier(), found([rms(0.1, 0.25), dry, shift()])), Vec::<String>::new());
    }

    #[test]
    fn another_number_limit_or_verdict_is_a_difference_in_an_earlier_form() {
        assert_eq!(differing(&earlier(), found([rms(0.11, 0.25), shift()])), ["numbers.residual.value"]);
        assert_eq!(differing(&earlier(), found([rms(0.1, 0.26), shift()])), ["numbers.residual.limit.at_most"]);
        let unlimited = Check::new("residual", "mm", 0.1);
        assert_eq!(differing(&earlier(), found([unlimited, shift()])), ["numbers.residual.limit"]);
        let mut rejected = found([rms(0.1, 0.25), shift()]);
        rejected["judgement"]["verdict"] = json!("reject");
        assert_eq!(differing(&earlier(), rejected), ["judgement.verdict"]);
        assert_eq!(differing(&earlier(), found([rms(0.1, 0.25)])), ["numbers"], "one is missing");
        let more = Check::new("another", "mm", 1.0);
        assert_eq!(differing(&earlier(), found([rms(0.1, 0.25), shift(), more])), ["numbers"], "one is added");
    }

    /// A recording of this version of the program is compared completely, including order and codes.
    #[test]
    fn a_recording_of_today_is_compared_whole() {
        let recorded = found([rms(0.1, 0.25), shift()]);
        assert_eq!(differing(&recorded, found([rms(0.1, 0.25), shift()])), Vec::<String>::new());
        let other_code = rms(0.1, 0.25).reviews("poor_fit", String::new);
        assert_eq!(differing(&recorded, found([other_code, shift()])), ["numbers.residual.severity"]);
        let dry = Check::new(NAMES_SINCE_CHECKS[0], "", 1.0);
        assert_eq!(differing(&recorded, found([rms(0.1, 0.25), shift(), dry])), ["numbers"]);
        assert_ne!(differing(&recorded, found([shift(), rms(0.1, 0.25)])), Vec::<String>::new(), "another order");
    }
}
