//! The reason why a camera did not deliver a shot.

use crate::zivid::ZividFault;
use panelprep_cell::files::{ClipError, CloudFileError, PictureError, PoseError};
use std::path::PathBuf;

/// The role of a camera in the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraRole {
    /// The fixed 3D camera.
    Scanner,
    /// The camera on the flange.
    Flange,
}

impl std::fmt::Display for CameraRole {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            CameraRole::Scanner => "scanner",
            CameraRole::Flange => "flange camera",
        })
    }
}

/// The reason why a shot could not be taken.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// No camera answers.
    #[error("the {which} is not available: {reason}")]
    Missing {
        /// The camera.
        which: CameraRole,
        /// The item found instead.
        reason: String,
    },
    /// The camera responds, but did not deliver a shot in time.
    #[error("no shot from the {which} within {waited_ms} ms")]
    Timeout {
        /// The camera.
        which: CameraRole,
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// A recording has come to its end.
    #[error("{} contains no further {what}: all {played} were used", folder.display())]
    RecordingExhausted {
        /// The recording.
        folder: PathBuf,
        /// The item that was requested.
        what: &'static str,
        /// Number of captures that were played.
        played: usize,
    },
    /// A shot of another size than the calibrated one.
    #[error("a shot of the {which} is {}×{} px, but its calibration is for {}×{} px", found_px[0], found_px[1], expected_px[0], expected_px[1])]
    WrongSize {
        /// The camera.
        which: CameraRole,
        /// Width and height, px.
        found_px: [usize; 2],
        /// Width and height in the calibration, px.
        expected_px: [usize; 2],
    },
    /// The camera answers, but its data cannot be used.
    #[error("the {which} delivered no usable picture: {reason}")]
    Unusable {
        /// The camera.
        which: CameraRole,
        /// The reason why the shot is not usable.
        reason: String,
    },
    /// A picture of a clip that was not begun, or that has ended.
    #[error("the {which} is not recording a clip, so it has no picture of a clip")]
    NoClip {
        /// The camera.
        which: CameraRole,
    },
    /// A 3D shot with the arm in front of the camera.
    #[error("a 3D shot needs the arm at standstill in its park pose; the largest deviation of an axis is \
             {axis_off_deg:.2}°, {}", if *moving { "and the arm is moving" } else { "and the arm is at standstill" })]
    ArmInView {
        /// The largest deviation of an axis from the park pose, degrees.
        axis_off_deg: f64,
        /// Whether the arm is moving.
        moving: bool,
    },
    /// A picture of the flange camera while the flange moves.
    #[error("a picture of the flange camera needs the arm at standstill, but the arm is moving")]
    ArmMoves,
    /// The service uses the cameras, and delivers no picture.
    #[error("the service, which uses the cameras, reports: {problem}")]
    Service {
        /// Its message, or the state of the connection to it.
        problem: String,
    },
    /// The service uses the cameras, and the cell is at work.
    #[error("the service is using the cameras for a cycle; try again when the cycle has ended")]
    AtWork,
    /// A fault of the Zivid, in the terms of the fault model.
    #[error(transparent)]
    Zivid(#[from] ZividFault),
    /// A file of a recording that cannot be used.
    #[error("{}: {cause}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// The problem in the file.
        cause: FileError,
    },
}

/// Problems of a file of a recording.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The disk reported an error.
    #[error(transparent)]
    Disk(#[from] std::io::Error),
    /// The cloud cannot be read.
    #[error(transparent)]
    Cloud(#[from] CloudFileError),
    /// A picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The pose of the flange.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// A fault in the times of the pictures.
    #[error(transparent)]
    Clip(#[from] ClipError),
}
