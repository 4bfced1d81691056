//! The nodes of the server. The nodes of the cell are values for callers with permission to read, and methods; no value
//! can be written. The nodes of OPC UA's own namespace are those of async-opcua, but the methods of conditions are
//! handled here first.

use super::access::{Access, Caller};
use super::address_space;
use super::address_space::{NAMESPACE, method_for_node};
use super::calls::{CallOutcome, Calls};
use super::conditions::AlarmConditions;
use async_trait::async_trait;
use opcua::server::CreateMonitoredItem;
use opcua::server::address_space::AddressSpace;
use opcua::server::diagnostics::NamespaceMetadata;
use opcua::server::node_manager::memory::{
    CoreNodeManagerBuilder, CoreNodeManagerImpl, InMemoryNodeManagerImpl, InMemoryNodeManagerImplBuilder,
};
use opcua::server::node_manager::{
    MethodCall, MonitoredItemRef, MonitoredItemUpdateRef, ParsedReadValueId, RequestContext, ServerContext,
};
use opcua::sync::RwLock;
use opcua::types::{
    DataValue, DiagnosticBits, DiagnosticInfo, MethodId, MonitoringMode, NodeClass, NodeId, ObjectTypeId,
    ReferenceTypeId, StatusCode, TimestampsToReturn, UAString, Variant,
};
use panelprep_interfaces::packml::method;
use std::sync::Arc;

/// The nodes of OPC UA's own namespace.
pub(super) struct CoreNodes {
    core: CoreNodeManagerImpl,
    calls: Arc<Calls>,
    conditions: Arc<AlarmConditions>,
}

impl CoreNodes {
    pub fn build(
        (calls, conditions): (Arc<Calls>, Arc<AlarmConditions>),
        context: ServerContext,
        space: &mut AddressSpace,
    ) -> Self {
        CoreNodes { core: CoreNodeManagerBuilder.build(context, space), calls, conditions }
    }

    /// Adds the method Acknowledge to new conditions, and removes it from conditions that have ended.
    pub fn link_conditions(space: &mut AddressSpace, were: &[NodeId], are: &[NodeId]) {
        let acknowledge = NodeId::from(MethodId::AcknowledgeableConditionType_Acknowledge);
        for gone in were.iter().filter(|node| !are.contains(node)) {
            space.delete_reference(gone, &acknowledge, ReferenceTypeId::HasComponent);
        }
        for new in are.iter().filter(|node| !were.contains(node)) {
            space.insert_reference(new, &acknowledge, ReferenceTypeId::HasComponent);
        }
    }

    fn refresh_conditions(&self, context: &RequestContext, subscription: Option<&Variant>) -> StatusCode {
        let Some(Variant::UInt32(number)) = subscription else { return StatusCode::BadInvalidArgument };
        let of_session = context.subscriptions.get_session_subscriptions(context.session_id);
        if of_session.is_none_or(|all| all.lock().get(*number).is_none()) {
            return StatusCode::BadSubscriptionIdInvalid;
        }
        self.conditions.refresh(&context.subscriptions)
    }

    async fn acknowledge_alarm(&self, context: &RequestContext, call: &mut MethodCall) {
        let [Variant::ByteString(event), Variant::LocalizedText(_)] = call.arguments() else {
            call.set_status(StatusCode::BadInvalidArgument);
            return;
        };
        let alarm = match self.conditions.acknowledged_alarm(call.object_id(), event) {
            Ok(alarm) => Variant::from(alarm.as_str()),
            Err(status) => {
                call.set_status(status);
                return;
            }
        };
        let Some(method) = method("AcknowledgeAlarm") else { return };
        let caller = self.calls.access.caller_of_token(&context.token);
        let from = self.calls.access.session_origin(channel_id(context));
        let outcome = self.calls.call(method, &[alarm], caller.as_ref(), &from).await;
        let is_done = matches!(outcome, CallOutcome::Done(_));
        write_result(call, outcome);
        if is_done {
            call.set_outputs(vec![]);
        }
    }

    fn may_read(&self, context: &RequestContext) -> bool {
        matches!(self.calls.access.caller_of_token(&context.token), Some(Caller::Anonymous | Caller::Person { .. }))
    }
}

#[async_trait]
impl InMemoryNodeManagerImpl for CoreNodes {
    async fn init(&self, space: &mut AddressSpace, context: ServerContext) {
        self.core.init(space, context).await;
    }

    fn name(&self) -> &str {
        self.core.name()
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        self.core.namespaces()
    }

    fn owns_server_events(&self) -> bool {
        self.core.owns_server_events()
    }

    async fn read_values(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        nodes: &[&ParsedReadValueId],
        max_age: f64,
        timestamps: TimestampsToReturn,
    ) -> Vec<DataValue> {
        self.core.read_values(context, space, nodes, max_age, timestamps).await
    }

    async fn create_value_monitored_items(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        items: &mut [&mut &mut CreateMonitoredItem],
    ) {
        self.core.create_value_monitored_items(context, space, items).await;
    }

    async fn create_event_monitored_items(
        &self,
        context: &RequestContext,
        _: &RwLock<AddressSpace>,
        items: &mut [&mut &mut CreateMonitoredItem],
    ) {
        self.calls.access.remember_channel(&context.token, channel_id(context));
        if !self.may_read(context) {
            items.iter_mut().for_each(|item| item.set_status(StatusCode::BadUserAccessDenied));
        }
    }

    async fn set_monitoring_mode(
        &self,
        context: &RequestContext,
        mode: MonitoringMode,
        items: &[&MonitoredItemRef],
    ) {
        self.core.set_monitoring_mode(context, mode, items).await;
    }

    async fn modify_monitored_items(&self, context: &RequestContext, items: &[&MonitoredItemUpdateRef]) {
        self.core.modify_monitored_items(context, items).await;
    }

    async fn delete_monitored_items(&self, context: &RequestContext, items: &[&MonitoredItemRef]) {
        self.core.delete_monitored_items(context, items).await;
    }

    async fn call(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        calls: &mut [&mut &mut MethodCall],
    ) -> Result<(), StatusCode> {
        let mut others = Vec::new();
        for call in calls.iter_mut() {
            match call.method_id().as_method_id() {
                Ok(MethodId::ConditionType_ConditionRefresh) => {
                    let status = self.refresh_conditions(context, call.arguments().first());
                    call.set_status(status);
                }
                Ok(MethodId::AcknowledgeableConditionType_Acknowledge) => {
                    self.acknowledge_alarm(context, call).await
                }
                _ => others.push(&mut **call),
            }
        }
        let mut others: Vec<&mut &mut MethodCall> = others.iter_mut().map(|call| &mut **call).collect();
        self.core.call(context, space, &mut others).await
    }
}

/// The cell's nodes.
pub(super) struct CellNodes {
    pub calls: Arc<Calls>,
    pub namespace: u16,
}

impl CellNodes {
    /// Registers the namespace of the cell and builds its nodes.
    pub fn build(calls: Arc<Calls>, context: &ServerContext, space: &mut AddressSpace) -> Self {
        let namespace = {
            let mut types = context.type_tree.write();
            // Clients request the node ID of a condition with an empty path (Part 9, 5.5.2.13), which async-opcua does
            // not support.
            let condition = NodeId::from(ObjectTypeId::ConditionType);
            types.add_type_property(&condition, &condition, &[], NodeClass::Object);
            types.namespaces_mut().add_namespace(NAMESPACE)
        };
        space.add_namespace(NAMESPACE, namespace);
        address_space::build(space, namespace);
        CellNodes { calls, namespace }
    }

    fn access(&self) -> &Arc<Access> {
        &self.calls.access
    }
}

/// Returns the secure channel on which a request arrived.
fn channel_id(context: &RequestContext) -> u32 {
    context.session.read().secure_channel_id()
}

/// Writes the outcome into a call; includes the reason if the client requested diagnostics.
fn write_result(call: &mut MethodCall, outcome: CallOutcome) {
    match outcome {
        CallOutcome::Done(words) => {
            call.set_status(StatusCode::Good);
            call.set_outputs(vec![Variant::from(words)]);
        }
        CallOutcome::Refused(status, reason) => {
            call.set_status(status);
            if call.diagnostic_bits().contains(DiagnosticBits::OPERATIONAL_LEVEL_ADDITIONAL_INFO) {
                let additional_info = Some(UAString::from(format!("{} ({})", reason.message, reason.code)));
                call.set_diagnostic_info(DiagnosticInfo { additional_info, ..DiagnosticInfo::default() });
            }
        }
    }
}

#[async_trait]
impl InMemoryNodeManagerImpl for CellNodes {
    async fn init(&self, _: &mut AddressSpace, _: ServerContext) {}

    fn name(&self) -> &str {
        "cell"
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        vec![NamespaceMetadata {
            namespace_uri: NAMESPACE.to_owned(),
            namespace_index: self.namespace,
            namespace_version: Some(env!("CARGO_PKG_VERSION").to_owned()),
            ..NamespaceMetadata::default()
        }]
    }

    async fn read_values(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        nodes: &[&ParsedReadValueId],
        max_age: f64,
        timestamps: TimestampsToReturn,
    ) -> Vec<DataValue> {
        // The channel is also recorded when a subscription begins, so that the connection can be ended if the account
        // changes.
        self.access().remember_channel(&context.token, channel_id(context));
        let space = space.read();
        nodes.iter().map(|node| space.read(context, node, max_age, timestamps)).collect()
    }

    async fn call(
        &self,
        context: &RequestContext,
        _: &RwLock<AddressSpace>,
        calls: &mut [&mut &mut MethodCall],
    ) -> Result<(), StatusCode> {
        let channel = channel_id(context);
        self.access().remember_channel(&context.token, channel);
        let (caller, from) = (self.access().caller_of_token(&context.token), self.access().session_origin(channel));
        for call in calls {
            let Some(method) = method_for_node(self.namespace, call.method_id()) else {
                call.set_status(StatusCode::BadMethodInvalid);
                continue;
            };
            let arguments = call.arguments().to_vec();
            let caller: Option<&Caller> = caller.as_ref();
            let outcome = self.calls.call(method, &arguments, caller, &from).await;
            write_result(call, outcome);
        }
        Ok(())
    }
}
