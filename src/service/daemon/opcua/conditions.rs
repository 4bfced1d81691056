//! The active alarms as OPC UA conditions. Each change of an alarm is sent as an event. A client that connects requests
//! all active alarms (ConditionRefresh). A person acknowledges an alarm by the ID of its event (Acknowledge). The
//! fields of an event are those of AlarmConditionType (Part 9), by their browse paths.
//!
//! async-opcua supports the types of conditions and events, but provides no conditions. The methods of conditions
//! belong to the types in the base namespace; therefore they are handled here before async-opcua's own node manager
//! receives the calls (`nodes`). A condition has a name but no node. The base namespace declares that the condition has
//! the method Acknowledge, because otherwise async-opcua does not allow a client to call it.

use super::address_space::{node_id, time};
use crate::setup::clock::now_unix_ms;
use opcua::nodes::Event;
use opcua::server::SubscriptionCache;
use opcua::types::event_field::EventField;
use opcua::types::{
    AttributeId, ByteString, DateTime, LocalizedText, NodeId, NumericRange, ObjectTypeId, QualifiedName,
    StatusCode, UAString, Variant,
};
use panelprep_interfaces::packml::alarm_id;
use panelprep_store::history::{Alarm, Priority};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Minimum interval between two refreshes of all alarms, for all clients together.
const MIN_REFRESH_INTERVAL: Duration = Duration::from_millis(500);
/// Prefix of the names of conditions.
const NAME_PREFIX: &str = "Alarm/";

/// The active alarms as they were last reported to the clients.
#[derive(Debug, Default)]
pub(super) struct AlarmConditions {
    namespace: OnceLock<u16>,
    inside: Mutex<Inside>,
}

#[derive(Debug, Default)]
struct Inside {
    reported: BTreeMap<String, Alarm>,
    refreshed: Option<Instant>,
}

fn alarm_status(alarm: &Alarm) -> AlarmStatus {
    AlarmStatus { is_active: alarm.is_active(), is_acknowledged: alarm.acknowledged.is_some() }
}

impl AlarmConditions {
    /// Sets the namespace index of the cell's nodes, which is known after the server has started.
    pub fn set_namespace(&self, namespace: u16) {
        self.namespace.get_or_init(|| namespace);
    }

    fn namespace(&self) -> u16 {
        self.namespace.get().copied().unwrap_or_default()
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn event(&self, alarm: &Alarm, now_unix_ms: i64) -> AlarmEvent {
        let condition = node_id(self.namespace(), &format!("{NAME_PREFIX}{}", alarm_id(alarm)));
        AlarmEvent::new(alarm, alarm_status(alarm), (&node_id(self.namespace(), ""), condition), now_unix_ms)
    }

    /// Returns the node IDs of the conditions of all active alarms.
    pub fn nodes(&self) -> Vec<NodeId> {
        let name = |id: &String| node_id(self.namespace(), &format!("{NAME_PREFIX}{id}"));
        self.lock().reported.keys().map(name).collect()
    }

    /// Updates the active alarms; reports new, acknowledged and cleared alarms to the clients.
    pub fn update_conditions(&self, alarms: &[Alarm], subscriptions: &SubscriptionCache) {
        let changed = self.changed(alarms, now_unix_ms());
        self.notify(&changed, subscriptions);
    }

    fn changed(&self, alarms: &[Alarm], now_unix_ms: i64) -> Vec<AlarmEvent> {
        let now: BTreeMap<String, Alarm> = alarms.iter().map(|alarm| (alarm_id(alarm), alarm.clone())).collect();
        let mut inside = self.lock();
        let came = now
            .iter()
            .filter(|(id, alarm)| inside.reported.get(*id).map(alarm_status) != Some(alarm_status(alarm)));
        let gone = inside.reported.iter().filter(|(id, _)| !now.contains_key(*id));
        let gone = gone.map(|(_, alarm)| Alarm { gone_unix_ms: Some(now_unix_ms), ..alarm.clone() });
        let came = came.map(|(_, alarm)| alarm.clone());
        let events = came.chain(gone).map(|alarm| self.event(&alarm, now_unix_ms)).collect();
        inside.reported = now;
        events
    }

    fn notify(&self, events: &[AlarmEvent], subscriptions: &SubscriptionCache) {
        let source = node_id(self.namespace(), "");
        subscriptions.notify_events(events.iter().map(|event| (event as &dyn Event, &source)));
    }

    /// Reports all active alarms again, between the events that begin and end a refresh.
    pub fn refresh(&self, subscriptions: &SubscriptionCache) -> StatusCode {
        let now_unix_ms = now_unix_ms();
        let alarms: Vec<Alarm> = {
            let mut inside = self.lock();
            if inside.refreshed.is_some_and(|at| at.elapsed() < MIN_REFRESH_INTERVAL) {
                return StatusCode::BadRefreshInProgress;
            }
            inside.refreshed = Some(Instant::now());
            inside.reported.values().cloned().collect()
        };
        let lasting = alarms.iter().map(|alarm| self.event(alarm, now_unix_ms));
        let begin = AlarmEvent::refresh(true, now_unix_ms);
        let events: Vec<AlarmEvent> =
            std::iter::once(begin).chain(lasting).chain([AlarmEvent::refresh(false, now_unix_ms)]).collect();
        self.notify(&events, subscriptions);
        StatusCode::Good
    }

    /// Returns the name of the alarm that a client acknowledges with this event ID of this condition.
    ///
    /// # Errors
    /// If the condition does not exist, the event is not the last event of the condition, or the alarm was already
    /// acknowledged.
    pub fn acknowledged_alarm(&self, condition: &NodeId, event: &ByteString) -> Result<String, StatusCode> {
        let inside = self.lock();
        let is_meant = |id: &String| *condition == node_id(self.namespace(), &format!("{NAME_PREFIX}{id}"));
        let (id, alarm) =
            inside.reported.iter().find(|(id, _)| is_meant(id)).ok_or(StatusCode::BadNodeIdUnknown)?;
        if alarm.acknowledged.is_some() {
            return Err(StatusCode::BadConditionBranchAlreadyAcked);
        }
        if event_id(alarm, alarm_status(alarm)) != *event {
            return Err(StatusCode::BadEventIdUnknown);
        }
        Ok(id.clone())
    }
}

/// An OPC UA event and its fields.
#[derive(Debug, Clone, PartialEq)]
struct AlarmEvent {
    kind: NodeId,
    time: DateTime,
    /// The node ID of the condition.
    condition: NodeId,
    fields: BTreeMap<&'static str, Variant>,
}

/// The status of an alarm as a condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct AlarmStatus {
    pub is_active: bool,
    pub is_acknowledged: bool,
}

impl AlarmStatus {
    /// Returns whether a client that connects now must receive the alarm.
    fn is_retained(self) -> bool {
        self.is_active
    }
}

/// Returns the OPC UA severity of a priority, 1 to 1000.
fn severity_number(priority: Priority) -> u16 {
    match priority {
        Priority::High => 900,
        Priority::Medium => 600,
        Priority::Low => 300,
        Priority::Note => 100,
    }
}

/// Returns the ID of an event, computed from the alarm and its status. A client acknowledges the alarm with this ID.
fn event_id(alarm: &Alarm, standing: AlarmStatus) -> ByteString {
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
            ("SourceName", Variant::from(super::address_space::ROOT_NAME)),
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
        // A client requests the node ID of the condition in this form (Part 9, 5.5.2.13).
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

#[cfg(test)]
mod tests {
    use super::*;
    use opcua::types::{AttributeId, NumericRange, ObjectTypeId, QualifiedName, Variant};
    use panelprep_base::verdict::Reason;
    use panelprep_store::history::Acknowledgement;

    fn alarm(code: &'static str, raised_unix_ms: i64) -> Alarm {
        Alarm::new_between_cycles(&Reason::new(code, "5 MB are free"), raised_unix_ms)
    }

    fn field(event: &AlarmEvent, path: &str) -> Variant {
        let path: Vec<QualifiedName> = path.split('/').map(|name| QualifiedName::new(0, name)).collect();
        event.get_field(&ObjectTypeId::AlarmConditionType.into(), AttributeId::Value, &NumericRange::None, &path)
    }

    fn condition(event: &AlarmEvent) -> NodeId {
        let of = ObjectTypeId::ConditionType.into();
        match event.get_field(&of, AttributeId::NodeId, &NumericRange::None, &[]) {
            Variant::NodeId(id) => *id,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn an_alarm_is_raised_acknowledged_and_cleared() {
        let conditions = AlarmConditions::default();
        conditions.set_namespace(3);
        let of = |alarms: &[Alarm]| {
            let told = conditions.changed(alarms, 9_000);
            told.iter()
                .map(|event| {
                    let [name, active, acked, retain] =
                        ["ConditionName", "ActiveState/Id", "AckedState/Id", "Retain"]
                            .map(|path| field(event, path).to_string());
                    format!("{name} {active} {acked} {retain}")
                })
                .collect::<Vec<_>>()
        };
        let came = [alarm("disk_scarce", 5)];
        assert_eq!(of(&came), ["disk_scarce true false true"]);
        assert_eq!(of(&came), Vec::<String>::new(), "told once");
        let who = "Ada (ada)".to_owned();
        let seen =
            Acknowledgement { unix_ms: 7, cycle: None, code: "disk_scarce".to_owned(), raised_unix_ms: 5, who };
        let seen = [Alarm { acknowledged: Some(seen), ..came[0].clone() }, alarm("camera", 6)];
        assert_eq!(of(&seen), ["camera true false true", "disk_scarce true true true"]);
        assert_eq!(of(&[]), ["camera false false false", "disk_scarce false true false"]);
    }

    #[test]
    fn an_alarm_is_acknowledged_only_by_its_last_event() {
        let conditions = AlarmConditions::default();
        conditions.set_namespace(3);
        let told = conditions.changed(&[alarm("disk_scarce", 5)], 9_000);
        let Variant::ByteString(id) = field(&told[0], "EventId") else { panic!("{told:?}") };
        let node = condition(&told[0]);
        assert_eq!(conditions.acknowledged_alarm(&node, &id), Ok("0/disk_scarce/5".to_owned()));
        let other = ByteString::from(vec![1; 16]);
        assert_eq!(conditions.acknowledged_alarm(&node, &other), Err(StatusCode::BadEventIdUnknown));
        let nowhere = node_id(3, "Alarm/0/disk_scarce/6");
        assert_eq!(conditions.acknowledged_alarm(&nowhere, &id), Err(StatusCode::BadNodeIdUnknown));
    }
}
