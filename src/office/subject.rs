//! The subjects and streams of the broker.

use crate::cell::CellName;

/// The stream of records and files on their way.
pub const STREAM: &str = "PANELPREP";
/// Every subject of it.
pub const ALL_RECORDS: &str = "panelprep.records.*";
/// The stream of what the office has: the last word for each cell and epoch.
pub const ARCHIVED_STREAM: &str = "PANELPREP_ARCHIVED";
/// Every subject of it.
pub const ALL_ARCHIVED: &str = "panelprep.archived.*.*";
/// Every cell's state as it is now.
pub const ALL_STATES: &str = "panelprep.state.*";

/// Where a cell sends records and files.
pub fn records(cell: &CellName) -> String {
    format!("panelprep.records.{cell}")
}

/// Where the office says how far it has an epoch of a cell.
pub fn archived(cell: &CellName, epoch: &str) -> String {
    format!("panelprep.archived.{cell}.{epoch}")
}

/// Where a cell says its state.
pub fn state(cell: &CellName) -> String {
    format!("panelprep.state.{cell}")
}
