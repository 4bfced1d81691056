//! The parts that the sender needs.

use super::status::OfficeStatus;
use crate::daemon::interface_context::InterfaceContext;
use panelprep_cell::cell;
use std::path::PathBuf;

/// The parts that the sender needs.
pub struct OfficeParts {
    /// The `[office]` table of the cell's file.
    pub office: cell::Office,
    /// The store's folder.
    pub folder: PathBuf,
    /// The interface that provides the state to report; `None` if no service runs.
    pub front: Option<InterfaceContext>,
    /// The status that is shown to people.
    pub status: OfficeStatus,
}
