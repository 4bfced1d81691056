//! Which page of a cycle was written last, for the reply that names it.

use panelprep_cell::record::CycleId;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The last written page, and its cycle. All clones share the same page.
#[derive(Debug, Clone, Default)]
pub struct LastWrittenPage(Arc<Mutex<Option<(CycleId, PathBuf)>>>);

impl LastWrittenPage {
    /// Records that this page of the cycle was written.
    pub fn is(&self, cycle: CycleId, page: &Path) {
        *self.lock() = Some((cycle, page.to_owned()));
    }

    pub(super) fn get(&self, cycle: CycleId) -> Option<PathBuf> {
        self.lock().as_ref().filter(|(written, _)| *written == cycle).map(|(_, page)| page.clone())
    }

    fn lock(&self) -> MutexGuard<'_, Option<(CycleId, PathBuf)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
