//! The last picture of each camera that was taken between cycles, for the page.

use panelprep_devices::cameras::{Conditions, PictureQuality};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The last picture of a camera that was requested on the page.
pub(super) struct CameraShot {
    pub jpeg: Vec<u8>,
    pub unix_ms: i64,
    pub size_px: [usize; 2],
    pub quality: PictureQuality,
    pub conditions: Conditions,
}

/// The last picture of each camera.
#[derive(Default)]
pub(super) struct CameraShots([Mutex<Option<Arc<CameraShot>>>; 2]);

impl CameraShots {
    fn lock_slot(&self, at: usize) -> MutexGuard<'_, Option<Arc<CameraShot>>> {
        self.0[at].lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn store(&self, at: usize, view: CameraShot) {
        *self.lock_slot(at) = Some(Arc::new(view));
    }

    pub fn last_shot(&self, at: usize) -> Option<Arc<CameraShot>> {
        self.lock_slot(at).clone()
    }
}
