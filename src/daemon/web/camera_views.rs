//! The last picture of each camera that was taken between cycles, for the page.

use crate::devices::cameras::{Conditions, PictureQuality};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The last picture of a camera that was requested on the page.
pub(super) struct View {
    pub jpeg: Vec<u8>,
    pub unix_ms: i64,
    pub size_px: [usize; 2],
    pub quality: PictureQuality,
    pub conditions: Conditions,
}

/// The last picture of each camera.
#[derive(Default)]
pub(super) struct Views([Mutex<Option<Arc<View>>>; 2]);

impl Views {
    fn slot(&self, at: usize) -> MutexGuard<'_, Option<Arc<View>>> {
        self.0[at].lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn keep(&self, at: usize, view: View) {
        *self.slot(at) = Some(Arc::new(view));
    }

    pub fn last(&self, at: usize) -> Option<Arc<View>> {
        self.slot(at).clone()
    }
}
