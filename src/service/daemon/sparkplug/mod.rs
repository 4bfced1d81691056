//! The cell at an MQTT broker, as an edge node of Sparkplug B: a live view, whose data may be lost.
//!
//! ```text
//! the loop ─ state, twice a second ─ edge ─ view ──────┐
//! the store ─ every minute, and at each change ────────┤
//! broker ─ TLS ─ connection ─ packets ─ session ─ panelprep_interfaces::sparkplug::EdgeNode ─ actions ─ publish
//!                                                                              └──── asking → Gateway → the loop, audit trail
//! ```
//!
//! It runs on a thread and a runtime of its own. Whatever the broker does, the loop, the robot's link and the cameras
//! never wait for it. Commands go through the gateway, as those of every interface do.

mod edge;
mod session;

#[cfg(test)]
mod tests;

pub use edge::{SparkplugEdge, SparkplugParts};
