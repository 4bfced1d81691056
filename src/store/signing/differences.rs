//! Differences between the signed record and the present one, by their path in the record.

use serde_json::Value;

/// Path of the requests: more requests may follow while the cell waits with its result, and a request that was only in
/// the journal receives its answer.
const REQUESTS_PATH: &str = "/asked";
/// Path of the motions: a motion that was open when an aborted cycle was signed receives its end later, from the robot
/// or from a person.
const MOTION: &str = "/motions/";
/// Fields with counts that may grow after signing.
const GROWING_FIELDS: [&str; 1] = ["/events"];
/// The most differences that are reported; the first ones are enough.
const MAX_DIFFERENCES: usize = 5;

/// Lists the places at which `now` differs from what was `signed`, such as `/findings/2/numbers/0/value`, each with
/// both values.
///
/// A field that only `now` has is not a difference: a later version of the program may record more of a cycle.
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
            if GROWING_FIELDS.contains(&at) && is_grown_count(signed, now) => {}
        _ => found.push(format!(
            "{at}: signed value {}, present value {}",
            shorten_value(signed),
            shorten_value(now)
        )),
    }
}

fn is_motion_path(at: &str) -> bool {
    at.strip_prefix(MOTION).is_some_and(|number| !number.contains('/'))
}

/// Returns whether each signed request is still present; a request that was only in the journal at that time, without
/// its sender and answer, may have them now.
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
        Value::Array(values) => return format!("a list of {}", values.len()),
        Value::Object(_) => return "an object".to_owned(),
        other => other.to_string(),
    };
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
