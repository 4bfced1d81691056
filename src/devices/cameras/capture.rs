//! The data of a shot, and the interface of a camera that takes it.

use super::error::CameraError;
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use serde::{Deserialize, Serialize};

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
