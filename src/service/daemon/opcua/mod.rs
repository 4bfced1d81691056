//! The OPC UA server: an interface by which a line of machines uses the service's requests and states. It makes no
//! decisions for the cell.
//!
//! ```text
//! client ─ door (limits, addresses) ─ async-opcua (channels, certificates, sessions) ─ access (accounts, roles)
//!                                      └─ nodes ┬─ OPC UA's own nodes, conditions
//!                                                └─ the cell's nodes ─ calls → Gateway → the loop
//! the loop ─ state, five times a second ─ follow ─ values of `packml::NODES`, conditions
//! the store ─ once a second ──────────────┘
//! ```
//!
//! It runs on a thread and a runtime of its own, separate from the cell's supervision. A panic in code that reads from
//! the network ends a connection, or this server, which then restarts; it never stops the cell. The loop never waits
//! for clients. Names and passwords, roles, log-in pauses and audit trail are those of the operator's page. Stop and
//! abort need no role.

mod access;
mod address_space;
mod calls;
mod certificates;
mod conditions;
mod connection_limit;
mod follow;
mod nodes;
mod server;

pub use server::{OpcUaParts, OpcUaServer};
