//! What the sender is made of.

use super::status::PushStatus;
use crate::cell::Push;
use crate::daemon::record_source::RecordSource;
use std::path::PathBuf;
use std::sync::Arc;

/// What the sender is made of.
pub struct PushParts {
    /// `[push]` of the cell's file.
    pub push: Push,
    /// The store's folder.
    pub folder: PathBuf,
    /// The source of the pages of cycles.
    pub records: Arc<dyn RecordSource>,
    /// The status that is shown to people.
    pub status: PushStatus,
}
