//! The cell for a production line: PackML states and modes (ISA-TR88.00.02), the values of all OPC UA nodes, and the
//! methods with the roles that may call them.
//!
//! `snapshot` (the known data of the cell at one moment, PackML numbers, values) · `nodes` (the table of all nodes) ·
//! `methods` (the table of all methods). All functions are pure; `daemon::opcua` serves these data and makes no
//! decisions either.

mod methods;
mod nodes;
mod snapshot;

#[cfg(test)]
mod tests;

pub use methods::{Argument, ArgumentKind, Command, METHODS, Method, method};
pub use nodes::{NODES, Node};
pub use snapshot::{
    CycleCounts, GridState, Kind, LastRefusal, RecipeHash, Snapshot, UnitMode, UnitState, Value, Verified, alarm_id,
};
