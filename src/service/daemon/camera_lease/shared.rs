//! The service's cameras, and who uses them.

use super::last_state::LastState;
use crate::daemon::cameras::Cameras;
use crate::daemon::ports::{CameraAnswer, CameraCommand, CameraFault, Port};
use panelprep_base::geometry::Joints;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::State;
use panelprep_devices::cameras::{FlangeCamera, Scanner};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// The cell's cameras, of any type.
pub type AllCameras = Cameras<Box<dyn Scanner>, Box<dyn FlangeCamera>>;

/// Longest time that a request for a shot waits for the end of another one.
const LEND_TIMEOUT: Duration = Duration::from_secs(1);

/// The code of the reason why there is no shot while the cell is at work.
pub(super) const AT_WORK_CODE: &str = "at_work";

pub(super) struct Inside {
    pub(super) cameras: AllCameras,
    /// A film that was lent to a client is in progress.
    pub(super) films: bool,
}

/// The service's cameras. All clones share the same cameras.
#[derive(Clone)]
pub struct SharedCameras(Arc<Shared>);

struct Shared {
    inside: Mutex<Inside>,
    last: LastState,
    /// The cell rests, and no cycle is in progress.
    is_at_rest: AtomicBool,
    is_lent: AtomicBool,
}

impl SharedCameras {
    /// Shares these cameras of a cell with the last state of its robot.
    pub fn new(cameras: AllCameras, last: LastState) -> Self {
        let (rests, is_lent) = (AtomicBool::new(false), AtomicBool::new(false));
        let inside = Mutex::new(Inside { cameras, films: false });
        SharedCameras(Arc::new(Shared { inside, last, is_at_rest: rests, is_lent }))
    }

    /// Records the present state of the cell.
    pub(in crate::daemon) fn set_cell_state(&self, state: &State) {
        self.0.is_at_rest.store(state.at.is_at_rest() && !state.job.running, Ordering::Relaxed);
    }

    /// Reserves the cameras for an operation that may need them: they are not lent any more until the cell's state is
    /// reported again.
    pub(in crate::daemon) fn reserve(&self) {
        self.0.is_at_rest.store(false, Ordering::Relaxed);
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Uses the cameras for the loop; a film that is lent to a client ends first.
    fn with_cameras<T>(&self, act: impl FnOnce(&mut AllCameras) -> T) -> T {
        let mut inside = self.lock();
        if std::mem::take(&mut inside.films) {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "the client that records the film receives the answer that the cell is at work"
            )]
            let _ = inside.cameras.scanner.end_clip();
        }
        act(&mut inside.cameras)
    }

    /// Lends the cameras, or returns the reason if this is not possible. It waits for a short time, since a connection
    /// that has just sent the last byte of a shot may not have returned the cameras yet.
    pub(super) fn lend(&self) -> Result<CameraLease<'_>, Reason> {
        let since = Instant::now();
        while self.0.is_lent.swap(true, Ordering::Acquire) {
            if since.elapsed() > LEND_TIMEOUT {
                return Err(Reason::new(
                    "busy",
                    "another client is taking pictures now; try again when it has \
                                                finished",
                ));
            }
            thread::sleep(Duration::from_millis(2));
        }
        Ok(CameraLease(self))
    }

    /// Returns the position of the axes, while the arm is at rest and its state is fresh.
    pub(in crate::daemon) fn resting_joints(&self) -> Option<Joints> {
        self.0.last.resting_joints()
    }
}

impl std::fmt::Debug for SharedCameras {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SharedCameras")
            .field("rests", &self.0.is_at_rest)
            .field("is_lent", &self.0.is_lent)
            .finish()
    }
}

/// The cameras, lent to a client until this is dropped.
pub(super) struct CameraLease<'a>(&'a SharedCameras);

impl Drop for CameraLease<'_> {
    fn drop(&mut self) {
        self.0.0.is_lent.store(false, Ordering::Release);
    }
}

impl CameraLease<'_> {
    /// Locks the cameras, whether or not the cell still rests.
    pub(super) fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.lock()
    }

    /// Returns the cameras for one shot, or for one picture of a film, if the cell is still at rest.
    pub(super) fn cameras(&self) -> Result<MutexGuard<'_, Inside>, Reason> {
        let inside = self.0.lock();
        // Checked after the cameras are locked: if the loop locks them later, this shot has ended by then.
        if self.0.0.is_at_rest.load(Ordering::Relaxed) {
            return Ok(inside);
        }
        Err(Reason::new(AT_WORK_CODE, "the cell is at work; try again when the cycle has ended"))
    }
}

impl Port<CameraCommand> for SharedCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        self.with_cameras(|cameras| cameras.perform(command))
    }
}
