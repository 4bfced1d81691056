//! The cell as a production line sees it: PackML (ISA-TR88.00.02) states and modes, the values of all nodes of an
//! OPC UA server, and the methods with the roles that may call them.
//!
//! `snapshot` (the known data of the cell at one moment, the cycle's state as a PackML number, values)
//! · `nodes` (the one table of nodes) · `methods` (the one table of methods). Pure: `daemon::opcua` serves this
//! data and makes no decision either.

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
