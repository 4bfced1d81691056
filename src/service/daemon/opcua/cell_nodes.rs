//! The cell's nodes as the server provides them: values for callers who may read, and calls of methods. Nothing can
//! be written.

use super::access::{Access, Caller};
use super::address_space::{self, NAMESPACE, method_for_node};
use super::calls::{CallOutcome, Calls};
use async_trait::async_trait;
use opcua::server::address_space::AddressSpace;
use opcua::server::diagnostics::NamespaceMetadata;
use opcua::server::node_manager::memory::InMemoryNodeManagerImpl;
use opcua::server::node_manager::{MethodCall, ParsedReadValueId, RequestContext, ServerContext};
use opcua::sync::RwLock;
use opcua::types::{
    DataValue, DiagnosticBits, DiagnosticInfo, NodeClass, NodeId, ObjectTypeId, StatusCode, TimestampsToReturn,
    UAString, Variant,
};
use std::sync::Arc;

/// The cell's nodes.
pub(super) struct CellNodes {
    pub calls: Arc<Calls>,
    pub namespace: u16,
}

impl CellNodes {
    /// Registers the namespace and builds the nodes.
    pub fn build(calls: Arc<Calls>, context: &ServerContext, space: &mut AddressSpace) -> Self {
        let namespace = {
            let mut types = context.type_tree.write();
            // Clients request a condition's node by the empty path (Part 9, 5.5.2.13), which async-opcua does not
            // support.
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
pub(super) fn channel(context: &RequestContext) -> u32 {
    context.session.read().secure_channel_id()
}

/// Writes the result into a call; the reason is included if the client asks for diagnostics.
pub(super) fn write_result(call: &mut MethodCall, outcome: CallOutcome) {
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
        // The channel is also recorded when a subscription begins, so that the connection can be ended after the
        // account is changed.
        self.access().remember_channel(&context.token, channel(context));
        let space = space.read();
        nodes.iter().map(|node| space.read(context, node, max_age, timestamps)).collect()
    }

    async fn call(
        &self,
        context: &RequestContext,
        _: &RwLock<AddressSpace>,
        calls: &mut [&mut &mut MethodCall],
    ) -> Result<(), StatusCode> {
        let channel = channel(context);
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
