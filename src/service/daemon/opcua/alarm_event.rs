//! The event of an alarm as defined by OPC UA: the fields of AlarmConditionType (Part 9), by their browse paths.

use super::values::time;
use opcua::nodes::Event;
use opcua::types::event_field::EventField;
use opcua::types::{
    AttributeId, ByteString, DateTime, LocalizedText, NodeId, NumericRange, ObjectTypeId, QualifiedName,
    StatusCode, UAString, Variant,
};
use panelprep_interfaces::packml::alarm_id;
use panelprep_store::history::{Alarm, Priority};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// An event and its fields.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct AlarmEvent {
    kind: NodeId,
    time: DateTime,
    /// The node that the event states as its condition.
    condition: NodeId,
    fields: BTreeMap<&'static str, Variant>,
}

/// The status of an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct AlarmStatus {
    pub is_active: bool,
    pub is_acknowledged: bool,
}

impl AlarmStatus {
    /// Returns whether a client that connects now must be informed of the alarm.
    fn is_retained(self) -> bool {
        self.is_active
    }
}

/// Returns the OPC UA number for the urgency, 1 to 1000.
fn severity_number(priority: Priority) -> u16 {
    match priority {
        Priority::High => 900,
        Priority::Medium => 600,
        Priority::Low => 300,
        Priority::Note => 100,
    }
}

/// Returns the id of an event, made from the alarm and its status; the alarm is acknowledged by this id.
pub(super) fn event_id(alarm: &Alarm, standing: AlarmStatus) -> ByteString {
    let AlarmStatus { is_active, is_acknowledged } = standing;
    let digest = Sha256::digest(format!("{} {is_active} {is_acknowledged}", alarm_id(alarm)).as_bytes());
    ByteString::from(digest.iter().take(16).copied().collect::<Vec<u8>>())
}

fn text(text: &str) -> Variant {
    Variant::from(LocalizedText::new("en", text))
}

impl AlarmEvent {
    /// Creates the event that reports this status of an alarm.
    pub fn new(
        alarm: &Alarm,
        standing: AlarmStatus,
        (source, condition): (&NodeId, NodeId),
        now_unix_ms: i64,
    ) -> Self {
        let at_unix_ms =
            if standing.is_active && !standing.is_acknowledged { alarm.raised_unix_ms } else { now_unix_ms };
        let (kind, at) = (NodeId::from(ObjectTypeId::AlarmConditionType), time(at_unix_ms));
        let two_state = |is, yes, no| text(if is { yes } else { no });
        let comment = alarm.acknowledged.as_ref().map_or("", |seen| &seen.who);
        let fields = [
            ("EventId", Variant::from(event_id(alarm, standing))),
            ("EventType", Variant::from(kind.clone())),
            ("SourceNode", Variant::from(source.clone())),
            ("SourceName", Variant::from(super::address_space::ROOT)),
            ("Time", Variant::from(at)),
            ("ReceiveTime", Variant::from(time(now_unix_ms))),
            ("Message", text(&alarm.message)),
            ("Severity", Variant::from(severity_number(alarm.priority))),
            ("LastSeverity", Variant::from(severity_number(alarm.priority))),
            ("ConditionClassId", Variant::from(NodeId::from(ObjectTypeId::ProcessConditionClassType))),
            ("ConditionClassName", text("ProcessConditionClassType")),
            ("ConditionName", Variant::from(alarm.code.as_str())),
            ("BranchId", Variant::from(NodeId::null())),
            ("Retain", Variant::from(standing.is_retained())),
            ("Quality", Variant::from(StatusCode::Good)),
            ("Comment", text(&alarm.remedy)),
            ("ClientUserId", Variant::from(comment)),
            ("InputNode", Variant::from(NodeId::null())),
            ("SuppressedOrShelved", Variant::from(false)),
            ("EnabledState", text("Enabled")),
            ("EnabledState/Id", Variant::from(true)),
            ("AckedState", two_state(standing.is_acknowledged, "Acknowledged", "Unacknowledged")),
            ("AckedState/Id", Variant::from(standing.is_acknowledged)),
            ("ActiveState", two_state(standing.is_active, "Active", "Inactive")),
            ("ActiveState/Id", Variant::from(standing.is_active)),
        ];
        AlarmEvent { kind, time: at, condition, fields: BTreeMap::from(fields) }
    }

    /// Returns the event that reports the beginning or the end of a refresh.
    pub fn refresh(begins: bool, now_unix_ms: i64) -> Self {
        let kind = if begins { ObjectTypeId::RefreshStartEventType } else { ObjectTypeId::RefreshEndEventType };
        let (kind, at) = (NodeId::from(kind), time(now_unix_ms));
        let digest = Sha256::digest(format!("refresh {begins} {now_unix_ms}").as_bytes());
        let fields = [
            ("EventId", Variant::from(ByteString::from(digest.iter().take(16).copied().collect::<Vec<u8>>()))),
            ("EventType", Variant::from(kind.clone())),
            ("SourceNode", Variant::from(NodeId::from(opcua::types::ObjectId::Server))),
            ("SourceName", Variant::from("Server")),
            ("Time", Variant::from(at)),
            ("ReceiveTime", Variant::from(at)),
            ("Message", text(if begins { "A refresh begins." } else { "A refresh ends." })),
            ("Severity", Variant::from(1_u16)),
        ];
        AlarmEvent { kind, time: at, condition: NodeId::null(), fields: BTreeMap::from(fields) }
    }
}

impl Event for AlarmEvent {
    fn get_field(
        &self,
        type_definition: &NodeId,
        attribute: AttributeId,
        range: &NumericRange,
        path: &[QualifiedName],
    ) -> Variant {
        // A client requests the condition's node in this form (Part 9, 5.5.2.13).
        if attribute == AttributeId::NodeId && path.is_empty() && *type_definition == ObjectTypeId::ConditionType {
            return if self.condition.is_null() { Variant::Empty } else { Variant::from(self.condition.clone()) };
        }
        self.get_value(attribute, range, path)
    }

    fn time(&self) -> &DateTime {
        &self.time
    }

    fn event_type_id(&self) -> &NodeId {
        &self.kind
    }
}

impl EventField for AlarmEvent {
    fn get_value(&self, attribute: AttributeId, range: &NumericRange, path: &[QualifiedName]) -> Variant {
        if attribute != AttributeId::Value || path.is_empty() || path.iter().any(|part| part.namespace_index != 0) {
            return Variant::Empty;
        }
        let names: Vec<&UAString> = path.iter().map(|part| &part.name).collect();
        let path = names.iter().map(|name| name.as_ref()).collect::<Vec<_>>().join("/");
        self.fields.get(path.as_str()).map_or(Variant::Empty, |field| field.get_value(attribute, range, &[]))
    }
}
