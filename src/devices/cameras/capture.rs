//! The data of a shot, the interface of a camera that takes it, and the reason why a camera did not deliver it.

use crate::zivid::ZividFault;
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use panelprep_cell::files::{ClipError, CloudFileError, PictureError, PoseError};
use serde::{Deserialize, Serialize};
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

/// A shot of the 3D camera.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Points and colours.
    pub cloud: OrganizedCloud<Camera>,
    /// Time of the shot, s.
    pub time_s: f64,
}

/// A colour picture of the fixed camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The picture.
    pub picture: ColorPicture,
    /// Time of the picture, s.
    pub time_s: f64,
}

/// A picture of the flange camera.
#[derive(Debug, Clone, PartialEq)]
pub struct FlangePicture {
    /// The picture.
    pub picture: ColorPicture,
    /// The pose of the flange at that time, if the source of the picture knows it; a real camera does not.
    pub base_from_flange: Option<Rigid<Base, Flange>>,
    /// Time of the picture, s.
    pub time_s: f64,
}

/// The data that a camera reports about its last shot, each value if it reports it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// The exposure time, µs; the sum if there are several exposures.
    pub exposure_us: Option<f64>,
    /// The temperature of the camera's lens or, if it has no such sensor, of its housing, °C.
    pub camera_c: Option<f64>,
    /// Pause before the shot because the camera was too hot, ms.
    pub throttled_ms: Option<f64>,
}

/// The fixed 3D camera.
pub trait Scanner: Send {
    /// Takes points and colours of the scene, with the camera's own light.
    ///
    /// # Errors
    /// If the camera does not deliver.
    fn capture_3d(&mut self) -> Result<Shot, CameraError>;

    /// Takes a colour picture with the cell's light, as for the film.
    ///
    /// # Errors
    /// If the camera does not deliver.
    fn capture_2d(&mut self) -> Result<Picture, CameraError>;

    /// Begins a clip: colour pictures one after the other, at most this many per second. Any other capture ends the
    /// clip. Returns the start time on the clock of the pictures: a picture that is missing after this time is a gap
    /// in the clip.
    ///
    /// # Errors
    /// If the camera does not begin.
    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError>;

    /// Returns the clip's next picture; `None` if none is due yet. If the camera takes pictures automatically, this
    /// waits for the next one. Of the pictures that are not fetched in time, the oldest are dropped: each picture has
    /// the time at which it was taken.
    ///
    /// # Errors
    /// If the camera does not deliver, or no clip is being taken.
    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError>;

    /// Ends the clip; returns how many of its pictures were dropped.
    ///
    /// # Errors
    /// If the camera does not report this, or no clip is being taken.
    fn end_clip(&mut self) -> Result<u64, CameraError>;

    /// Checks whether the camera is able to deliver. The check takes no shot that a cycle needs.
    ///
    /// # Errors
    /// If the camera is not able to deliver.
    fn check_ready(&mut self) -> Result<(), CameraError>;

    /// Waits while the camera is being started, which may take minutes; [`Scanner::check_ready`] reports its state
    /// afterwards.
    fn wait_warmed_up(&mut self) {}

    /// Returns what the camera reports about its last shot.
    fn conditions(&self) -> Conditions {
        Conditions::default()
    }
}

/// The colour camera on the flange, with its own lamp.
pub trait FlangeCamera: Send {
    /// Takes a picture from the present pose of the flange.
    ///
    /// # Errors
    /// If the camera does not deliver.
    fn capture(&mut self) -> Result<FlangePicture, CameraError>;

    /// Checks whether the camera is able to deliver. The check takes no shot that a cycle needs.
    ///
    /// # Errors
    /// If the camera is not able to deliver.
    fn check_ready(&mut self) -> Result<(), CameraError>;

    /// Returns what the camera reports about its last shot.
    fn conditions(&self) -> Conditions {
        Conditions::default()
    }
}

impl<S: Scanner + ?Sized> Scanner for Box<S> {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        (**self).capture_3d()
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        (**self).capture_2d()
    }

    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError> {
        (**self).begin_clip(pictures_per_second)
    }

    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError> {
        (**self).next_clip_picture()
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        (**self).end_clip()
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        (**self).check_ready()
    }

    fn wait_warmed_up(&mut self) {
        (**self).wait_warmed_up();
    }

    fn conditions(&self) -> Conditions {
        (**self).conditions()
    }
}

impl<C: FlangeCamera + ?Sized> FlangeCamera for Box<C> {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        (**self).capture()
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        (**self).check_ready()
    }

    fn conditions(&self) -> Conditions {
        (**self).conditions()
    }
}
