//! Builds the cell's nodes from the tables of `packml`, and converts the values of these tables to OPC UA's types.

use opcua::server::address_space::{
    AccessLevel, AddressSpace, EventNotifier, MethodBuilder, ObjectBuilder, VariableBuilder,
};
use opcua::types::{
    Argument, DataTypeId, DataValue, DateTime, EUInformation, ExtensionObject, LocalizedText, NodeId, ObjectId,
    ObjectTypeId, QualifiedName, ReferenceTypeId, StatusCode, UAString, VariableTypeId, Variant,
};
use panelprep_interfaces::packml::{ArgumentKind, Kind, METHODS, Method, NODES, Node, Value};
use std::collections::BTreeSet;

/// Namespace URI of the cell's nodes.
pub const NAMESPACE: &str = "urn:panelprep:cell";
/// Name of the cell's object, which is below the folder Objects.
pub const ROOT_NAME: &str = "Panelprep";
/// Name of the object below the cell's object that contains the methods.
const COMMANDS_NAME: &str = "Commands";

/// Returns the node ID for a path that begins at the cell's object; an empty path is the cell's object itself.
pub(super) fn node_id(namespace: u16, path: &str) -> NodeId {
    NodeId::new(namespace, if path.is_empty() { ROOT_NAME.to_owned() } else { path.to_owned() })
}

/// Returns the method with this node ID.
pub(super) fn method_for_node(namespace: u16, id: &NodeId) -> Option<&'static Method> {
    METHODS.iter().find(|method| *id == node_id(namespace, &format!("{COMMANDS_NAME}/{}", method.name)))
}

/// Splits a path into the path of the parent and the name of the node.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

/// Returns every object in the paths of nodes and methods; each object precedes the nodes that it contains.
fn objects() -> Vec<&'static str> {
    let mut all = BTreeSet::from([COMMANDS_NAME]);
    for Node { path, .. } in NODES {
        all.extend(path.match_indices('/').map(|(at, _)| &path[..at]));
    }
    all.into_iter().collect()
}

/// Builds all nodes.
pub(super) fn build(space: &mut AddressSpace, namespace: u16) {
    let name = |name: &str| QualifiedName::new(namespace, name);
    ObjectBuilder::new(&node_id(namespace, ""), name(ROOT_NAME), ROOT_NAME)
        .description(english_text("The robot cell, with the data of the operator's page."))
        .event_notifier(EventNotifier::SUBSCRIBE_TO_EVENTS)
        .organized_by(ObjectId::ObjectsFolder)
        .has_type_definition(ObjectTypeId::BaseObjectType)
        .reference(ObjectId::Server, ReferenceTypeId::HasNotifier, opcua::nodes::ReferenceDirection::Inverse)
        .insert(space);
    for path in objects() {
        let (parent, own) = split(path);
        ObjectBuilder::new(&node_id(namespace, path), name(own), own)
            .component_of(node_id(namespace, parent))
            .has_type_definition(ObjectTypeId::BaseObjectType)
            .insert(space);
    }
    NODES.iter().for_each(|node| variable(space, namespace, node));
    METHODS.iter().for_each(|one| add_method(space, namespace, one));
}

fn english_text(text: &str) -> LocalizedText {
    LocalizedText::new("en", text)
}

fn variable(space: &mut AddressSpace, namespace: u16, node: &Node) {
    let (parent, own) = split(node.path);
    let (id, (data_type, is_array)) = (node_id(namespace, node.path), data_type(node.kind));
    let (readable, unit) = (AccessLevel::CURRENT_READ, unit(node.unit));
    let kind = if unit.is_some() { VariableTypeId::AnalogUnitType } else { VariableTypeId::BaseDataVariableType };
    VariableBuilder::new(&id, QualifiedName::new(namespace, own), own)
        .description(english_text(node.meaning))
        .data_type(data_type)
        .value_rank(if is_array { 1 } else { -1 })
        .value(Variant::Empty)
        .access_level(readable)
        .user_access_level(readable)
        .component_of(node_id(namespace, parent))
        .has_type_definition(kind)
        .insert(space);
    if let Some(unit) = unit {
        let property = node_id(namespace, &format!("{}/EngineeringUnits", node.path));
        VariableBuilder::new(&property, "EngineeringUnits", "EngineeringUnits")
            .data_type(DataTypeId::EUInformation)
            .value_rank(-1)
            .value(ExtensionObject::from_message(unit))
            .access_level(readable)
            .user_access_level(readable)
            .property_of(id)
            .has_type_definition(VariableTypeId::PropertyType)
            .insert(space);
    }
}

fn argument(name: &str, data_type: DataTypeId, meaning: &str) -> Argument {
    let (name, data_type, description) = (name.into(), data_type.into(), english_text(meaning));
    Argument { name, data_type, value_rank: -1, array_dimensions: None, description }
}

fn add_method(space: &mut AddressSpace, namespace: u16, method: &Method) {
    let path = format!("{COMMANDS_NAME}/{}", method.name);
    let id = node_id(namespace, &path);
    let kind = |kind| match kind {
        ArgumentKind::String => DataTypeId::String,
        ArgumentKind::Boolean => DataTypeId::Boolean,
        ArgumentKind::UInt32 => DataTypeId::UInt32,
    };
    let taken: Vec<Argument> =
        method.arguments.iter().map(|one| argument(one.name, kind(one.kind), one.meaning)).collect();
    let output = argument("Message", DataTypeId::String, "Result of the call, if the state does not contain it.");
    let mut builder = MethodBuilder::new(&id, QualifiedName::new(namespace, method.name), method.name)
        .description(english_text(method.meaning))
        .executable(true)
        .user_executable(true)
        .component_of(node_id(namespace, COMMANDS_NAME));
    if !taken.is_empty() {
        builder = builder.input_args(space, &node_id(namespace, &format!("{path}/InputArguments")), &taken);
    }
    builder.output_args(space, &node_id(namespace, &format!("{path}/OutputArguments")), &[output]).insert(space);
}

/// The start of 1970 in the time of OPC UA, in ticks of 100 ns since 1601.
const UNIX_EPOCH_TICKS: i64 = 116_444_736_000_000_000;
const TICKS_IN_MS: i64 = 10_000;

/// Converts a time in ms since 1970 to the time of OPC UA.
pub(super) fn time(unix_ms: i64) -> DateTime {
    DateTime::from(
        unix_ms.saturating_mul(TICKS_IN_MS).saturating_add(UNIX_EPOCH_TICKS).clamp(0, DateTime::endtimes_ticks()),
    )
}

/// Converts a value to the type of OPC UA; a value that is not known becomes null.
fn variant(value: &Value) -> Variant {
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

/// Returns the value with its time. If `is_known` is false, because the service's loop does not answer, the value is
/// marked as the last known one.
pub(super) fn data_value(value: &Value, is_known: bool, at: DateTime) -> DataValue {
    let status = if is_known { StatusCode::Good } else { StatusCode::UncertainLastUsableValue };
    DataValue::new_at_status(variant(value), at, status)
}

/// Returns the data type of a node's values, and whether they are arrays.
fn data_type(kind: Kind) -> (DataTypeId, bool) {
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

/// Returns a unit in the form of OPC UA. The number of the unit is its code of UNECE Recommendation 20, read as bytes
/// (Part 8, 5.6.3.3).
fn unit(unit: &str) -> Option<EUInformation> {
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
    fn every_node_and_method_is_found_by_its_path() {
        let mut space = AddressSpace::new();
        space.add_namespace(NAMESPACE, 1);
        build(&mut space, 1);
        for node in NODES {
            assert!(space.find_node(&node_id(1, node.path)).is_some(), "{}", node.path);
            let (parent, _) = split(node.path);
            let (parent, own) = (node_id(1, parent), node_id(1, node.path));
            assert!(space.has_reference(&parent, &own, ReferenceTypeId::HasComponent), "{}", node.path);
        }
        for method in METHODS {
            let id = node_id(1, &format!("{COMMANDS_NAME}/{}", method.name));
            assert_eq!(method_for_node(1, &id).map(|found| found.name), Some(method.name));
        }
        assert_eq!(method_for_node(1, &node_id(1, "Commands/Format")), None);
        assert_eq!(objects().iter().filter(|path| **path == "PackML").count(), 1);
    }

    #[test]
    fn every_unit_of_the_table_has_its_code() {
        for node in NODES.iter().filter(|node| !node.unit.is_empty()) {
            assert!(unit(node.unit).is_some(), "{}: {}", node.path, node.unit);
        }
        // Expected unit numbers, from the table in OPC UA Part 8.
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
