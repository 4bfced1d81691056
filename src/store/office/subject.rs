//! The NATS subjects and streams of the broker.

use panelprep_cell::cell::CellName;
use panelprep_cell::files::content_hash;

/// The stream of records and files on the way to the office server.
pub const STREAM: &str = "PANELPREP";
/// All subjects of the stream of records.
pub const ALL_RECORDS: &str = "panelprep.records.*";
/// The stream in which the office server reports which items it has. It keeps the last report for each cell and epoch.
pub const ARCHIVED_STREAM: &str = "PANELPREP_ARCHIVED";
/// All subjects of the stream of these reports.
pub const ALL_ARCHIVED: &str = "panelprep.archived.*.*";
/// The subjects on which all cells report their state.
pub const ALL_STATES: &str = "panelprep.state.*";

/// The stream of offered recipes. It keeps the last offer for each panel.
pub const OFFER_STREAM: &str = "PANELPREP_OFFERS";
/// All subjects of the stream of offers.
pub const ALL_OFFERS: &str = "panelprep.offers.*";

/// Returns the subject for offers of a recipe of this panel. It contains a hash of the panel's name, because the name
/// may contain characters that are invalid in a subject.
pub fn offer_subject(panel: &str) -> String {
    let hash = content_hash(panel.as_bytes());
    format!("panelprep.offers.{}", hash.get(..16).unwrap_or(&hash))
}

/// Returns the subject on which a cell sends records and files.
pub fn records(cell: &CellName) -> String {
    format!("panelprep.records.{cell}")
}

/// Returns the subject on which the office server reports the number up to which it has all items of a cell's epoch.
pub fn archived_subject(cell: &CellName, epoch: &str) -> String {
    format!("panelprep.archived.{cell}.{epoch}")
}

/// Returns the subject on which a cell reports its state.
pub fn state(cell: &CellName) -> String {
    format!("panelprep.state.{cell}")
}
