//! The parts that the sender needs.

use super::status::PushStatus;
use crate::daemon::record_source::RecordSource;
use panelprep_cell::cell::PushSettings;
use std::path::PathBuf;
use std::sync::Arc;

/// The parts that the sender needs.
pub struct PushParts {
    /// The `[push]` table of the cell's file.
    pub push: PushSettings,
    /// The store's folder.
    pub folder: PathBuf,
    /// The source of the pages of cycles.
    pub records: Arc<dyn RecordSource>,
    /// The status that is shown to people.
    pub status: PushStatus,
}
