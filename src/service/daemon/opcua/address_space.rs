//! Builds the cell's nodes from the tables of `packml`.

use super::values::{data_type, unit};
use opcua::server::address_space::{
    AccessLevel, AddressSpace, EventNotifier, MethodBuilder, ObjectBuilder, VariableBuilder,
};
use opcua::types::{
    Argument, DataTypeId, ExtensionObject, LocalizedText, NodeId, ObjectId, ObjectTypeId, QualifiedName,
    ReferenceTypeId, VariableTypeId, Variant,
};
use panelprep_interfaces::packml::{ArgumentKind, METHODS, Method, NODES, Node};
use std::collections::BTreeSet;

/// The namespace of the cell's nodes.
pub const NAMESPACE: &str = "urn:panelprep:cell";
/// The name of the cell's object, below Objects.
pub const ROOT: &str = "Panelprep";
/// The object with the methods as components, below the cell's object.
pub const COMMANDS: &str = "Commands";

/// Returns the node with this path, counted from the cell's object; an empty path is the object itself.
pub(super) fn node_id(namespace: u16, path: &str) -> NodeId {
    NodeId::new(namespace, if path.is_empty() { ROOT.to_owned() } else { path.to_owned() })
}

/// Returns the method that has this node.
pub(super) fn method_for_node(namespace: u16, id: &NodeId) -> Option<&'static Method> {
    METHODS.iter().find(|method| *id == node_id(namespace, &format!("{COMMANDS}/{}", method.name)))
}

/// Returns the path of the parent and the node's own name.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

/// Returns every object that the paths of nodes and methods name, each before its content.
fn objects() -> Vec<&'static str> {
    let mut all = BTreeSet::from([COMMANDS]);
    for Node { path, .. } in NODES {
        all.extend(path.match_indices('/').map(|(at, _)| &path[..at]));
    }
    all.into_iter().collect()
}

/// Builds all nodes.
pub(super) fn build(space: &mut AddressSpace, namespace: u16) {
    let name = |name: &str| QualifiedName::new(namespace, name);
    ObjectBuilder::new(&node_id(namespace, ""), name(ROOT), ROOT)
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
    let path = format!("{COMMANDS}/{}", method.name);
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
        .component_of(node_id(namespace, COMMANDS));
    if !taken.is_empty() {
        builder = builder.input_args(space, &node_id(namespace, &format!("{path}/InputArguments")), &taken);
    }
    builder.output_args(space, &node_id(namespace, &format!("{path}/OutputArguments")), &[output]).insert(space);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_node_and_method_is_where_its_path_states() {
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
            let id = node_id(1, &format!("{COMMANDS}/{}", method.name));
            assert_eq!(method_for_node(1, &id).map(|found| found.name), Some(method.name));
        }
        assert_eq!(method_for_node(1, &node_id(1, "Commands/Format")), None);
        assert_eq!(objects().iter().filter(|path| **path == "PackML").count(), 1);
    }
}
