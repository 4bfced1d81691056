//! The cell as an edge node of MQTT Sparkplug B 3.0, without sockets and clocks: the published values, and the
//! commands.
//!
//! The node gives a live view: its data may be lost, and the cell never waits for it. `payload` (protobuf, values,
//! topics) · `metrics` (the table of all published values) · `command` (commands, and limits for a flood of commands) ·
//! `node` (the state machine with the primary host). `daemon/sparkplug` contains the connection.
//!
//! Source: Sparkplug specification, version 3.0.0, Eclipse Foundation, 2022.

mod command;
mod metrics;
mod node;
mod payload;

#[cfg(test)]
mod tests;

pub use command::{CommandError, NodeCommand, commands};
pub use metrics::{CellView, LoopView, METRICS, MetricDefinition, StoreView, values};
pub use node::{AuditNote, EdgeNode, HostState, Message, NodeAction, NodeEvent, NodeSetup, NodeTime};
pub use payload::{CellIds, DataType, Metric, Payload, Value, WireType};
