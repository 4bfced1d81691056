//! The cell as an edge node of MQTT Sparkplug B 3.0, without sockets and clocks: the published values, and the
//! requests in commands.
//!
//! It is a live view: its data may be lost, and nothing in the cell waits for it. `payload` (protobuf) · `value` ·
//! `cell_view` (the published values) · `metrics` (the table of all published values) · `topic` · `host` (the
//! primary host) · `command` · `limit` (floods) · `node` (the state machine). The connection is `daemon/sparkplug`.
//!
//! Source: Sparkplug specification, version 3.0.0, Eclipse Foundation, 2022.

mod cell_view;
mod command;
mod host;
mod limit;
mod metrics;
mod node;
mod payload;
mod topic;
mod value;

#[cfg(test)]
mod tests;

pub use cell_view::{CellView, LoopView, StoreView};
pub use command::{CommandError, NodeCommand, commands};
pub use host::HostState;
pub use metrics::{METRICS, MetricDefinition, values};
pub use node::{AuditNote, EdgeNode, Message, NodeAction, NodeEvent, NodeSetup, NodeTime};
pub use payload::{Metric, Payload, WireType};
pub use topic::CellIds;
pub use value::{DataType, Value};
