//! The values of the table of nodes, in OPC UA's types.

use opcua::types::{DataTypeId, DataValue, DateTime, EUInformation, LocalizedText, StatusCode, UAString, Variant};
use panelprep_interfaces::packml::{Kind, Value};

/// Start of 1970 in OPC UA's time, which counts 100 ns since 1601.
const UNIX_EPOCH_TICKS: i64 = 116_444_736_000_000_000;
const TICKS_IN_MS: i64 = 10_000;

/// Converts a time, given in ms since 1970.
pub(super) fn time(unix_ms: i64) -> DateTime {
    DateTime::from(
        unix_ms.saturating_mul(TICKS_IN_MS).saturating_add(UNIX_EPOCH_TICKS).clamp(0, DateTime::endtimes_ticks()),
    )
}

/// Returns the value; a null if it is not known.
pub(super) fn variant(value: &Value) -> Variant {
    match value {
        Value::Absent => Variant::Empty,
        Value::Boolean(value) => Variant::from(*value),
        Value::Int32(value) => Variant::from(*value),
        Value::UInt32(value) => Variant::from(*value),
        Value::Double(value) => Variant::from(*value),
        Value::String(text) => Variant::from(text.as_str()),
        Value::DateTime(unix_ms) => Variant::from(time(*unix_ms)),
        Value::Strings(texts) => Variant::from(texts.iter().map(UAString::from).collect::<Vec<_>>()),
        Value::DateTimes(times) => Variant::from(times.iter().map(|at| time(*at)).collect::<Vec<_>>()),
    }
}

/// Returns the value with its time. `is_known` is false if the service's loop does not answer: this is then marked as
/// the last known value.
pub(super) fn data_value(value: &Value, is_known: bool, at: DateTime) -> DataValue {
    let status = if is_known { StatusCode::Good } else { StatusCode::UncertainLastUsableValue };
    DataValue::new_at_status(variant(value), at, status)
}

/// Returns the type of a node's values, and whether they are arrays.
pub(super) fn data_type(kind: Kind) -> (DataTypeId, bool) {
    match kind {
        Kind::Boolean => (DataTypeId::Boolean, false),
        Kind::Int32 => (DataTypeId::Int32, false),
        Kind::UInt32 => (DataTypeId::UInt32, false),
        Kind::Double => (DataTypeId::Double, false),
        Kind::String => (DataTypeId::String, false),
        Kind::DateTime => (DataTypeId::DateTime, false),
        Kind::Strings => (DataTypeId::String, true),
        Kind::DateTimes => (DataTypeId::DateTime, true),
    }
}

/// Returns a unit as OPC UA names it: by its code of UNECE Recommendation 20, whose letters are the number's bytes
/// (Part 8, 5.6.3.3).
pub(super) fn unit(unit: &str) -> Option<EUInformation> {
    let (code, description) = match unit {
        "s" => ("SEC", "second"),
        "h" => ("HUR", "hour"),
        "mm" => ("MMT", "millimetre"),
        _ => return None,
    };
    Some(EUInformation {
        namespace_uri: UAString::from("http://www.opcfoundation.org/UA/units/un/cefact"),
        unit_id: code.bytes().fold(0, |id, letter| id * 256 + i32::from(letter)),
        display_name: LocalizedText::new("", unit),
        description: LocalizedText::new("en", description),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_interfaces::packml::NODES;

    #[test]
    fn every_unit_of_the_table_has_its_code() {
        for node in NODES.iter().filter(|node| !node.unit.is_empty()) {
            assert!(unit(node.unit).is_some(), "{}: {}", node.path, node.unit);
        }
        // Expected values from the table of OPC UA Part 8.
        let id = |name| unit(name).map(|unit| unit.unit_id);
        assert_eq!([id("s"), id("h"), id("mm")], [Some(5_457_219), Some(4_740_434), Some(5_066_068)]);
    }

    #[test]
    fn times_are_those_of_the_calendar() {
        assert_eq!(time(0).to_rfc3339(), "1970-01-01T00:00:00.000Z");
        assert_eq!(time(1_700_000_000_123).to_rfc3339(), "2023-11-14T22:13:20.123Z");
        assert_eq!(time(i64::MAX), DateTime::endtimes());
        assert_eq!(time(i64::MIN).ticks(), 0);
    }

    #[test]
    fn a_value_of_a_silent_service_is_the_last_usable_one() {
        let at = time(5);
        let known = data_value(&Value::Int32(4), true, at);
        assert_eq!((known.status, known.value), (Some(StatusCode::Good), Some(Variant::Int32(4))));
        assert_eq!(data_value(&Value::Int32(4), false, at).status, Some(StatusCode::UncertainLastUsableValue));
        assert_eq!(data_value(&Value::Absent, true, at).value, Some(Variant::Empty));
    }
}
