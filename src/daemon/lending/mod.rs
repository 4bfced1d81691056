//! The service's cameras, lent between cycles: `panelprep shoot` and the live calibrations take pictures while the service
//! has the cameras.
//!
//! [`SharedCameras`] are the loop's cameras, and lend themselves to one connection at a time while the cell rests without a cycle
//! (`serving`). The loop never waits for a shot that begins after the cell has left its rest: what is lent is asked back before
//! each shot, and a film ends with its next picture. [`BorrowedScanner`] and [`BorrowedFlangeCamera`] are the other end of the
//! connection (`client`).
//!
//! ```text
//! {"ask":"shoot","shot":"scan"}                                  a line to the service
//! {"sent":"scan","bytes":3987654,"time_s":12.1,"conditions":{…}}   a line from it, then so many bytes of PCD
//! ```
//!
//! Of a film the pictures come one after the other until the client closes its writing side, then `{"sent":"ended",…}`.
//! The robot is not moved, no output is switched, and nothing is written to the store. Where the arm stands meanwhile the answer
//! to `{"ask":"state"}` says.

mod client;
mod serving;

pub use client::{BorrowedFlangeCamera, BorrowedScanner};
pub(super) use serving::serve;

use super::cameras::Cameras;
use super::ports::{CameraAnswer, CameraCommand, CameraFault, Port};
use crate::cycle::State;
use crate::devices::cameras::{Conditions, FlangeCamera, Scanner};
use crate::eki;
use crate::geometry::Joints;
use crate::verdict::Reason;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// What may be asked of the cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum ShotRequest {
    /// A scan of the 3D camera.
    Scan,
    /// A colour picture of the 3D camera.
    Picture,
    /// A picture of the flange camera.
    Corner,
    /// Pictures of the 3D camera, one after the other.
    Film {
        /// At most so many a second, and at most 100.
        pictures_per_second: f64,
    },
}

impl ShotRequest {
    /// What is asked for, in a word.
    pub fn word(self) -> &'static str {
        match self {
            ShotRequest::Scan => "a scan",
            ShotRequest::Picture => "a picture",
            ShotRequest::Corner => "a picture of the flange camera",
            ShotRequest::Film { .. } => "a film",
        }
    }
}

/// The head of what the service sends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "sent", rename_all = "lowercase", deny_unknown_fields)]
enum Sent {
    /// A scan: so many bytes of PCD follow.
    Scan {
        /// Their number.
        bytes: usize,
        /// When it was taken, s.
        time_s: f64,
        conditions: Conditions,
    },
    /// A picture: red, green and blue of each pixel follow, row by row.
    Picture { width_px: usize, height_px: usize, time_s: f64, conditions: Conditions },
    /// A film begins; the time is on its pictures' clock.
    Began { time_s: f64 },
    /// It has ended; so many of its pictures were dropped.
    Ended { dropped: u64 },
    /// There is no shot, or no further one.
    Failed { reasons: Vec<Reason> },
}

/// The cell's cameras, whatever they are.
pub type AllCameras = Cameras<Box<dyn Scanner>, Box<dyn FlangeCamera>>;

/// Whoever asks for a shot waits so long for the end of another one.
const NEXT_PATIENCE: Duration = Duration::from_secs(1);

/// The code of the reason why there is no shot while the cell is at work.
const AT_WORK: &str = "at_work";

/// How old the robot's last state may be when the axes are said to stand where it says.
const FRESH: Duration = Duration::from_millis(500);

/// The robot's last state, and when it came. Clones are the same one.
#[derive(Debug, Clone, Default)]
pub struct LastState(Arc<Mutex<Option<(eki::State, Instant)>>>);

impl LastState {
    /// This is the last one; `None` where the link is lost.
    pub fn is(&self, state: Option<&eki::State>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = state.map(|state| (*state, Instant::now()));
    }

    /// Where the axes stand, while the arm stands and the state is fresh.
    fn stands(&self) -> Option<Joints> {
        let (state, came) = (*self.0.lock().unwrap_or_else(PoisonError::into_inner))?;
        (came.elapsed() < FRESH && !state.moving).then_some(state.joints)
    }
}

struct Inside {
    cameras: AllCameras,
    /// A film that is lent is under way.
    films: bool,
}

/// The service's cameras. Clones are the same ones.
#[derive(Clone)]
pub struct SharedCameras(Arc<Shared>);

struct Shared {
    inside: Mutex<Inside>,
    last: LastState,
    /// The cell rests, and no cycle is under way.
    rests: AtomicBool,
    is_lent: AtomicBool,
}

impl SharedCameras {
    /// Shares these cameras of a cell whose robot's last state is here.
    pub fn new(cameras: AllCameras, last: LastState) -> Self {
        let (rests, is_lent) = (AtomicBool::new(false), AtomicBool::new(false));
        let inside = Mutex::new(Inside { cameras, films: false });
        SharedCameras(Arc::new(Shared { inside, last, rests, is_lent }))
    }

    /// How the cell stands now.
    pub(super) fn cell_is(&self, state: &State) {
        self.0.rests.store(state.at.rests() && !state.job.running, Ordering::Relaxed);
    }

    /// Something begins that may need the cameras: they are lent no more until the cell's state is told again.
    pub(super) fn are_needed(&self) {
        self.0.rests.store(false, Ordering::Relaxed);
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.0.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does something with the cameras for the loop; a film that is lent ends before.
    fn with<T>(&self, act: impl FnOnce(&mut AllCameras) -> T) -> T {
        let mut inside = self.lock();
        if std::mem::take(&mut inside.films) {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "who asked for the film is told that the cell is at work"
            )]
            let _ = inside.cameras.scanner.end_clip();
        }
        act(&mut inside.cameras)
    }

    /// Lends the cameras, or says why not. Whoever has just sent the last byte of a shot is waited for.
    fn lend(&self) -> Result<Lent<'_>, Reason> {
        let since = Instant::now();
        while self.0.is_lent.swap(true, Ordering::Acquire) {
            if since.elapsed() > NEXT_PATIENCE {
                return Err(Reason::new("busy", "somebody else takes pictures now; ask again when that has ended"));
            }
            thread::sleep(Duration::from_millis(2));
        }
        Ok(Lent(self))
    }

    /// Where the axes stand, while the arm stands and its state is fresh.
    pub(super) fn stands(&self) -> Option<Joints> {
        self.0.last.stands()
    }
}

impl std::fmt::Debug for SharedCameras {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SharedCameras").field("rests", &self.0.rests).field("is_lent", &self.0.is_lent).finish()
    }
}

/// The cameras, lent until this is dropped.
struct Lent<'a>(&'a SharedCameras);

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        self.0.0.is_lent.store(false, Ordering::Release);
    }
}

impl Lent<'_> {
    /// The cameras for one shot, or for one picture of a film, where the cell still rests.
    fn cameras(&self) -> Result<MutexGuard<'_, Inside>, Reason> {
        let inside = self.0.lock();
        // Asked once they are locked: whoever locks them later finds the shot ended.
        if self.0.0.rests.load(Ordering::Relaxed) {
            return Ok(inside);
        }
        Err(Reason::new(AT_WORK, "the cell is at work; ask again when the cycle has ended"))
    }
}

impl Port<CameraCommand> for SharedCameras {
    fn perform(&mut self, command: CameraCommand) -> Result<CameraAnswer, CameraFault> {
        self.with(|cameras| cameras.perform(command))
    }
}

#[cfg(test)]
mod tests;
