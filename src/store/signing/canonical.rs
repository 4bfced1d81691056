//! JSON in the one form that is signed: RFC 8785.
//!
//! That form has no numbers other than doubles. A whole number beyond ±(2⁵³ − 1), such as the number of a plan,
//! would lose digits. It is therefore written as a text of its digits, as RFC 8785 advises in its appendix D.

use super::error::SigningError;
use serde::Serialize;
use serde_json::Value;

/// The largest whole number that a double, like its neighbours, represents exactly.
const MAX_EXACT_INTEGER: u64 = (1 << 53) - 1;

/// Returns the bytes that are signed.
///
/// # Errors
/// If JSON cannot hold the value.
pub fn canonical(value: &impl Serialize) -> Result<Vec<u8>, SigningError> {
    let json = |error: serde_json::Error| SigningError::Json { problem: error.to_string() };
    let value = large_numbers_as_text(serde_json::to_value(value).map_err(json)?);
    serde_json_canonicalizer::to_vec(&value).map_err(json)
}

/// Converts the texts of large whole numbers back to numbers, in the fields with these names, which contain only
/// numbers.
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

/// Returns the same value, with each whole number that a double cannot represent exactly written as a text.
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
