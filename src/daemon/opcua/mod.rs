//! The OPC UA server: a front for a line of machines on the service's requests and states. It decides nothing of the cell.
//!
//! ```text
//! client ─ door (limits, addresses) ─ async-opcua (channels, certificates, sessions) ─ access (accounts, roles)
//!                                      ├─ core_nodes (OPC UA's own nodes, conditions)
//!                                      └─ cell_nodes ─ calls → Gateway → the loop
//! the loop ─ state, five times a second ─ follow ─ values of `packml::NODES`, conditions
//! the store ─ once a second ─ depth ─────┘
//! ```
//!
//! It runs on a thread and a runtime of its own, which stands apart from the cell's supervision: a panic in what reads a network ends
//! a connection, or this server, which begins anew, and never the cell. Whatever clients do, the loop waits for none of it. Names and
//! passwords, roles, pauses and audit trail are those of the operator's page. Stop and abort need no role.

mod access;
mod address_space;
mod alarm_event;
mod calls;
mod cell_nodes;
mod certificates;
mod conditions;
mod core_nodes;
mod depth;
mod door;
mod error;
mod flood;
mod follow;
mod server;
mod settings;
mod values;

pub use server::{OpcUaParts, OpcUaServer};
