//! The OPC UA server: an interface by which a line of machines uses the service's requests and states. It makes no
//! decisions for the cell.
//!
//! ```text
//! client ─ door (limits, addresses) ─ async-opcua (channels, certificates, sessions) ─ access (accounts, roles)
//!                                      ├─ core_nodes (OPC UA's own nodes, conditions)
//!                                      └─ cell_nodes ─ calls → Gateway → the loop
//! the loop ─ state, five times a second ─ follow ─ values of `packml::NODES`, conditions
//! the store ─ once a second ─ depth ─────┘
//! ```
//!
//! It runs on a thread and a runtime of its own, separate from the cell's supervision. A panic in code that reads from
//! the network ends a connection, or this server, which then restarts; it never stops the cell. The loop never waits
//! for clients. Names and passwords, roles, log-in pauses and audit trail are those of the operator's page. Stop and
//! abort need no role.

mod access;
mod address_space;
mod alarm_event;
mod calls;
mod cell_nodes;
mod certificates;
mod conditions;
mod connection_limit;
mod core_nodes;
mod depth;
mod error;
mod flood;
mod follow;
mod server;
mod settings;
mod values;

pub use server::{OpcUaParts, OpcUaServer};
