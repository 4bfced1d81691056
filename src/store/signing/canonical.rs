//! Canonical JSON (RFC 8785) for signatures, and the differences between a signed record and the present one, each with
//! its path in the record.
//!
//! All numbers of canonical JSON are doubles. An integer beyond ±(2⁵³ − 1), such as the number of a plan, would lose
//! digits. Therefore it is written as a string of its digits, as RFC 8785 recommends in appendix D.

use super::key::SigningError;
use serde::Serialize;
use serde_json::Value;

/// Largest integer n for which a double represents both n and n + 1 exactly.
const MAX_EXACT_INTEGER: u64 = (1 << 53) - 1;

/// Returns the canonical JSON of a value, which is signed.
///
/// # Errors
/// If JSON cannot represent the value.
pub fn canonical(value: &impl Serialize) -> Result<Vec<u8>, SigningError> {
    let json = |error: serde_json::Error| SigningError::Json { problem: error.to_string() };
    let value = large_numbers_as_text(serde_json::to_value(value).map_err(json)?);
    serde_json_canonicalizer::to_vec(&value).map_err(json)
}

/// Converts strings back to integers in the fields with these names.
pub(super) fn restore_large_numbers(value: Value, names: &[&str]) -> Value {
    match value {
        Value::Array(values) => {
            Value::Array(values.into_iter().map(|value| restore_large_numbers(value, names)).collect())
        }
        Value::Object(entries) => {
            let again = |(name, value): (String, Value)| {
                let number = value.as_str().and_then(|text| text.parse::<u64>().ok());
                match number.filter(|number| *number > MAX_EXACT_INTEGER && names.contains(&name.as_str())) {
                    Some(number) => (name, Value::from(number)),
                    None => (name, restore_large_numbers(value, names)),
                }
            };
            Value::Object(entries.into_iter().map(again).collect())
        }
        other => other,
    }
}

/// Converts all integers that a double cannot represent exactly to strings.
pub(super) fn large_numbers_as_text(value: Value) -> Value {
    let is_beyond = |value: &Value| {
        value.as_u64().or(value.as_i64().map(i64::unsigned_abs)).is_some_and(|number| number > MAX_EXACT_INTEGER)
    };
    match value {
        Value::Array(values) => Value::Array(values.into_iter().map(large_numbers_as_text).collect()),
        Value::Object(entries) => {
            Value::Object(entries.into_iter().map(|(name, value)| (name, large_numbers_as_text(value))).collect())
        }
        Value::Number(_) if is_beyond(&value) => Value::String(value.to_string()),
        other => other,
    }
}

/// Path of the requests in a record. After the end of a cycle further requests may be stored, and a request that was
/// only in the journal gets its answer.
const REQUESTS_PATH: &str = "/asked";
/// Path of the motions in a record. If a motion was open when an aborted cycle was signed, its end is stored later.
const MOTIONS_PATH: &str = "/motions/";
/// Paths of counts that may increase after signing.
const GROWING_COUNT_PATHS: [&str; 1] = ["/events"];
/// Maximum number of differences that are listed.
const MAX_DIFFERENCES: usize = 5;

/// Returns the paths at which the values `signed` and `now` differ, such as `/findings/2/numbers/0/value`, each with
/// both values.
///
/// A field that exists only in `now` is not a difference: a newer version of the program may record more data of a
/// cycle.
pub fn differences(signed: &Value, now: &Value) -> Vec<String> {
    let mut found = Vec::new();
    compare("", signed, now, &mut found);
    found.truncate(MAX_DIFFERENCES);
    found
}

fn compare(at: &str, signed: &Value, now: &Value, found: &mut Vec<String>) {
    if signed == now || found.len() >= MAX_DIFFERENCES {
        return;
    }
    match (signed, now) {
        (Value::Array(signed), Value::Array(now)) if at == REQUESTS_PATH && are_requests_present(signed, now) => {}
        (Value::Object(signed), Value::Object(now)) => {
            let is_open = is_motion_path(at) && signed.get("outcome").is_some_and(Value::is_null);
            for (name, value) in signed.iter().filter(|(name, _)| !is_open || *name == "motion") {
                compare(&format!("{at}/{name}"), value, now.get(name).unwrap_or(&Value::Null), found);
            }
        }
        (Value::Array(signed), Value::Array(now)) if signed.len() == now.len() => {
            for (index, (value, now)) in signed.iter().zip(now).enumerate() {
                compare(&format!("{at}/{index}"), value, now, found);
            }
        }
        (Value::Number(signed), Value::Number(now))
            if GROWING_COUNT_PATHS.contains(&at) && is_grown_count(signed, now) => {}
        _ => found.push(format!(
            "{at}: signed value {}, present value {}",
            shorten_value(signed),
            shorten_value(now)
        )),
    }
}

fn is_motion_path(at: &str) -> bool {
    at.strip_prefix(MOTIONS_PATH).is_some_and(|number| !number.contains('/'))
}

/// Returns whether all signed requests are still present. A request that was only in the journal at the time of
/// signing, without sender and answer, may have both now.
fn are_requests_present(signed: &[Value], now: &[Value]) -> bool {
    let mut left: Vec<&Value> = now.iter().collect();
    signed.iter().all(|one| {
        let is_bare = one["who"].is_null() && one["answer"].is_null();
        let same = |now: &&Value| **now == *one || (is_bare && now["wanted"] == one["wanted"]);
        left.iter().position(same).map(|at| left.swap_remove(at)).is_some()
    })
}

fn is_grown_count(signed: &serde_json::Number, now: &serde_json::Number) -> bool {
    signed.as_u64().zip(now.as_u64()).is_some_and(|(signed, now)| signed <= now)
}

fn shorten_value(value: &Value) -> String {
    let text = match value {
        Value::Array(values) => return format!("a list with length {}", values.len()),
        Value::Object(_) => return "an object".to_owned(),
        other => other.to_string(),
    };
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

/// Tests which changes of a record are reported as differences.
#[cfg(test)]
mod tests {
    use super::differences;
    use serde_json::json;

    #[test]
    fn differences_state_their_path_and_new_fields_are_permitted() {
        let signed = json!({"panel": "wing", "findings": [{"numbers": [1, 2]}], "asked": [1], "events": 5});
        let same =
            json!({"panel": "wing", "findings": [{"numbers": [1, 2]}], "asked": [1, 2], "events": 7, "new": 1});
        assert_eq!(differences(&signed, &same), [] as [String; 0]);
        let other = json!({"findings": [{"numbers": [1, 3]}], "asked": [], "events": 4});
        let told = differences(&signed, &other).join("; ");
        for words in [
            "/panel: signed value \"wing\", present value null",
            "/findings/0/numbers/1: signed value 2, present value 3",
            "/asked: signed value a list with length 1, present value a list with length 0",
            "/events: signed value 5, present value 4",
        ] {
            assert!(told.contains(words), "no {words} in {told}");
        }
    }

    /// After the record of an aborted cycle was signed, the robot may still report the end of a motion, and a request
    /// that was only in the journal gets its answer.
    #[test]
    fn additions_after_the_end_of_a_cycle_are_no_difference() {
        let motion =
            |outcome: Option<&str>, done: u32| json!({"motion": {"epoch": 3}, "outcome": outcome, "done": done});
        let asked =
            |answer: Option<&str>| json!({"wanted": "stop", "who": answer.map(|_| "ada"), "answer": answer});
        let record =
            |motion: serde_json::Value, asked: serde_json::Value| json!({"motions": [motion], "asked": [asked]});
        let signed = record(motion(None, 0), asked(None));
        assert_eq!(
            differences(&signed, &record(motion(Some("cleared"), 7), asked(Some("done")))),
            [] as [String; 0]
        );
        let closed = record(motion(Some("done"), 7), asked(Some("done")));
        let told = differences(&closed, &record(motion(Some("done"), 8), asked(Some("refused")))).join("; ");
        assert!(told.contains("/motions/0/done: signed value 7, present value 8"), "{told}");
        assert!(told.contains("/asked/0/answer: signed value \"done\", present value \"refused\""), "{told}");
        let other = json!({"motions": [{"motion": {"epoch": 4}, "outcome": null, "done": 0}], "asked": []});
        let told = differences(&signed, &other).join("; ");
        assert!(
            told.contains("/motions/0/motion/epoch: signed value 3, present value 4") && told.contains("/asked: "),
            "{told}"
        );
    }
}
