//! One picture of a lent camera, with the data that the camera reports about it.

use super::shared::{CameraLease, SharedCameras};
use crate::daemon::ports::CameraPort as _;
use panelprep_base::geometry::ColorPicture;
use panelprep_base::verdict::Reason;
use panelprep_devices::cameras::{CameraError, Conditions};

/// The camera that is requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::daemon) enum CameraEye {
    /// The fixed 3D camera.
    Scanner,
    /// The camera on the flange.
    Flange,
}

/// A picture that a camera took.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::daemon) struct TakenPicture {
    /// The picture.
    pub picture: ColorPicture,
    /// Time of the picture by the camera's clock, s.
    pub time_s: f64,
    /// The conditions of the shot that the camera reports.
    pub conditions: Conditions,
}

impl CameraLease<'_> {
    /// Takes a picture, if the cell is still at rest.
    pub(super) fn capture(&self, eye: CameraEye) -> Result<TakenPicture, Reason> {
        let cameras = &mut self.cameras()?.cameras;
        let failed = |error: CameraError| Reason::new("camera", error.to_string());
        let (picture, time_s, conditions) = match eye {
            CameraEye::Scanner => {
                let shot = cameras.scanner.capture_2d().map_err(failed)?;
                (shot.picture, shot.time_s, cameras.scanner.conditions())
            }
            CameraEye::Flange => {
                let shot = cameras.flange.capture().map_err(failed)?;
                (shot.picture, shot.time_s, cameras.flange.conditions())
            }
        };
        Ok(TakenPicture { picture, time_s, conditions })
    }
}

impl SharedCameras {
    /// Checks whether both cameras answer, if the cell is at rest and no other client has them; returns the
    /// problems found.
    pub(in crate::daemon) fn check_cameras(&self) -> Option<Vec<Reason>> {
        let lent = self.lend().ok()?;
        let faults = lent.cameras().ok()?.cameras.check_cameras();
        Some(faults.into_iter().map(|fault| Reason::new("camera", fault.to_string())).collect())
    }

    /// Takes a picture between cycles; it waits for the camera, on the calling thread.
    ///
    /// # Errors
    /// If the cell is at work, another client uses the cameras, or the camera delivers no picture.
    pub(in crate::daemon) fn capture(&self, eye: CameraEye) -> Result<TakenPicture, Reason> {
        self.lend()?.capture(eye)
    }
}
