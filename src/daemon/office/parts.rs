//! What the sender is made of.

use super::status::OfficeStatus;
use crate::cell;
use crate::daemon::front_parts::FrontParts;
use std::path::PathBuf;

/// What the sender is made of.
pub struct OfficeParts {
    /// `[office]` of the cell's file.
    pub office: cell::Office,
    /// The store's folder.
    pub folder: PathBuf,
    /// Whose state is told; `None` where no service runs.
    pub front: Option<FrontParts>,
    /// What people are told of it.
    pub status: OfficeStatus,
}
