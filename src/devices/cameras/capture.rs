//! A captured picture or scan: its data, the interface of the cameras, the reasons why a camera delivers none, and
//! quality measures on which a person can act: sharpness, saturation, darkness, missing points.
//!
//! Sharpness is the gradient of the grey levels, √(gᵤ² + gᵥ²) by central differences, that a thousandth of the pixels
//! exceed. It increases as the picture comes into focus, and it depends on the scene. So it can compare two focus
//! settings for the same scene, but it cannot judge one setting alone.

use crate::zivid::ZividFault;
use panelprep_base::geometry::statistics::{QuantileRank, quantile};
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use panelprep_cell::files::{ClipError, CloudFileError, PictureError, PoseError};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Minimum grey level at which a channel is saturated.
const MIN_SATURATED_LEVEL: u8 = 254;
/// Brightest channel below which a pixel is dark, grey levels.
const MAX_DARK_LEVEL: u8 = 10;
/// Fraction of the pixels, those with the largest gradients, that defines the sharpness.
const STEEPEST_FRACTION: f64 = 0.001;

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

/// The reason why a camera delivers no picture or scan.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// The camera does not respond.
    #[error("the {which} is not available: {reason}")]
    Missing {
        /// The camera.
        which: CameraRole,
        /// The reason why the camera is not available.
        reason: String,
    },
    /// The camera responds, but delivers no picture in time.
    #[error("no picture from the {which} within {waited_ms} ms: check its power and cable")]
    Timeout {
        /// The camera.
        which: CameraRole,
        /// Waiting time, ms.
        waited_ms: u64,
    },
    /// All captures of the recording were replayed.
    #[error("{} contains no further {what}: all {played} were replayed; name another recording", folder.display())]
    RecordingExhausted {
        /// The recording.
        folder: PathBuf,
        /// The kind of file that was requested.
        what: &'static str,
        /// Number of captures that were replayed.
        played: usize,
    },
    /// The picture does not have the size of the calibrated camera.
    #[error("a shot of the {which} is {}×{} px, but its calibration is for {}×{} px", found_px[0], found_px[1], expected_px[0], expected_px[1])]
    WrongSize {
        /// The camera.
        which: CameraRole,
        /// Width and height of the picture, px.
        found_px: [usize; 2],
        /// Width and height in the camera's calibration, px.
        expected_px: [usize; 2],
    },
    /// The camera responds, but its data cannot be used.
    #[error("the {which} delivered no usable picture: {reason}")]
    Unusable {
        /// The camera.
        which: CameraRole,
        /// The reason why the data cannot be used.
        reason: String,
    },
    /// A picture of a clip was requested, but the clip was not begun or has ended.
    #[error("no clip was started with the {which}, so there is no picture of a clip")]
    NoClip {
        /// The camera.
        which: CameraRole,
    },
    /// A 3D scan was requested while the arm may be in front of the camera.
    #[error("a 3D shot needs the arm at standstill in its park pose; the largest deviation of an axis is \
             {axis_off_deg:.2}°, {}", if *moving { "and the arm is moving" } else { "and the arm is at standstill" })]
    ArmInView {
        /// The largest deviation of an axis from the park pose, degrees.
        axis_off_deg: f64,
        /// Whether the arm is moving.
        moving: bool,
    },
    /// A picture of the flange camera was requested while the flange moves.
    #[error("a picture of the flange camera needs the arm at standstill, but the arm is moving")]
    ArmMoves,
    /// The service owns the cameras, and delivers no picture.
    #[error("the service, which uses the cameras, reports: {problem}")]
    Service {
        /// The message of the service, or the state of the connection to the service.
        problem: String,
    },
    /// The service uses the cameras for a cycle.
    #[error("the service is using the cameras for a cycle; try again when the cycle has ended")]
    AtWork,
    /// A fault of the Zivid camera, in the terms of the fault model.
    #[error(transparent)]
    Zivid(#[from] ZividFault),
    /// A file of the recording cannot be used.
    #[error("{}: {cause}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// The reason why the file cannot be used.
        cause: FileError,
    },
}

/// The reason why a file of a recording cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// Reading the file from the disk failed.
    #[error(transparent)]
    Disk(#[from] std::io::Error),
    /// The point cloud in the file is not valid.
    #[error(transparent)]
    Cloud(#[from] CloudFileError),
    /// The picture in the file is not valid.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The flange pose in the file is not valid.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The times of the clip's pictures are not valid.
    #[error(transparent)]
    Clip(#[from] ClipError),
}

/// A scan of the 3D camera.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Points and colours.
    pub cloud: OrganizedCloud<Camera>,
    /// Time of the scan, s.
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
    /// The pose of the flange at the time of the picture, if the source knows the pose; a real camera does not.
    pub base_from_flange: Option<Rigid<Base, Flange>>,
    /// Time of the picture, s.
    pub time_s: f64,
}

/// The conditions of a camera's last capture, as the camera reports them; `None` for a value that it does not report.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// The exposure time, µs; the sum if there are several exposures.
    pub exposure_us: Option<f64>,
    /// The temperature of the camera's lens or, if it has no such sensor, of its housing, °C.
    pub camera_c: Option<f64>,
    /// The pause before the capture because the camera was too hot, ms.
    pub throttled_ms: Option<f64>,
}

/// The fixed 3D camera.
pub trait Scanner: Send {
    /// Captures a 3D scan: points and colours of the scene, in the camera's own light.
    ///
    /// # Errors
    /// If the camera delivers no scan.
    fn capture_3d(&mut self) -> Result<Shot, CameraError>;

    /// Captures a colour picture in the light of the cell, as for the pictures of the water film.
    ///
    /// # Errors
    /// If the camera delivers no picture.
    fn capture_2d(&mut self) -> Result<Picture, CameraError>;

    /// Begins a clip: a sequence of colour pictures, at most `pictures_per_second`. Any other capture ends the clip.
    /// Returns the start time on the clock of the pictures; a picture that is missing after this time is a gap in the
    /// clip.
    ///
    /// # Errors
    /// If the camera cannot begin the clip.
    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError>;

    /// Returns the next picture of the clip; `None` if no picture is due yet. If the camera captures automatically,
    /// this function waits for the next picture. Each picture has the time of its exposure. If pictures are not fetched
    /// in time, the oldest are dropped.
    ///
    /// # Errors
    /// If the camera delivers no picture, or no clip was begun.
    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError>;

    /// Ends the clip; returns the number of its pictures that were dropped.
    ///
    /// # Errors
    /// If the camera does not report the number, or no clip was begun.
    fn end_clip(&mut self) -> Result<u64, CameraError>;

    /// Checks whether the camera is able to deliver pictures. The check uses up no recorded picture that a cycle needs.
    ///
    /// # Errors
    /// If the camera is not able to deliver pictures.
    fn check_ready(&mut self) -> Result<(), CameraError>;

    /// Waits until the camera has started, which may take minutes. Afterwards [`Scanner::check_ready`] reports its
    /// state.
    fn wait_warmed_up(&mut self) {}

    /// Returns the conditions that the camera reports about its last capture.
    fn conditions(&self) -> Conditions {
        Conditions::default()
    }
}

/// The colour camera on the flange, with its own lamp.
pub trait FlangeCamera: Send {
    /// Captures a picture from the current pose of the flange.
    ///
    /// # Errors
    /// If the camera delivers no picture.
    fn capture(&mut self) -> Result<FlangePicture, CameraError>;

    /// Checks whether the camera is able to deliver pictures. The check uses up no recorded picture that a cycle needs.
    ///
    /// # Errors
    /// If the camera is not able to deliver pictures.
    fn check_ready(&mut self) -> Result<(), CameraError>;

    /// Returns the conditions that the camera reports about its last capture.
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

/// Quality measures of a picture, computed from its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureQuality {
    /// Gradient that a thousandth of the pixels exceed, grey levels per pixel.
    pub sharpness_gray_per_px: f64,
    /// Fraction of the pixels that have a saturated channel.
    pub saturated_share: f64,
    /// Fraction of the pixels that are dark.
    pub dark_share: f64,
    /// Mean grey level.
    pub mean_gray: f64,
}

impl PictureQuality {
    /// Computes the quality measures of a picture; all are zero if the picture has only border pixels.
    pub fn compute(picture: &ColorPicture) -> Self {
        let gray = picture.to_gray();
        let (width, height) = (gray.width, gray.height);
        let at = |column: usize, row: usize| f64::from(gray.gray[row * width + column]);
        let mut slopes = Vec::new();
        for row in 1..height.saturating_sub(1) {
            for column in 1..width.saturating_sub(1) {
                let (du, dv) =
                    (at(column + 1, row) - at(column - 1, row), at(column, row + 1) - at(column, row - 1));
                slopes.push(du.hypot(dv) / 2.0);
            }
        }
        let pixels = picture.rgb.len().max(1) as f64;
        let share = |is_one: &dyn Fn(&[u8; 3]) -> bool| {
            picture.rgb.iter().filter(|rgb| is_one(rgb)).count() as f64 / pixels
        };
        PictureQuality {
            sharpness_gray_per_px: quantile(&mut slopes, 1.0 - STEEPEST_FRACTION, QuantileRank::Floor)
                .unwrap_or(0.0),
            saturated_share: share(&|rgb| rgb.iter().any(|level| *level >= MIN_SATURATED_LEVEL)),
            dark_share: share(&|rgb| rgb.iter().all(|level| *level < MAX_DARK_LEVEL)),
            mean_gray: gray.gray.iter().map(|level| f64::from(*level)).sum::<f64>() / pixels,
        }
    }
}

/// Quality measures of a scan, computed from its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanQuality {
    /// Number of pixels that have a point.
    pub points: usize,
    /// Fraction of the pixels that have no point.
    pub missing_share: f64,
    /// The 5, 50 and 95 % quantiles of the points' distance along the camera's axis, mm; `None` if there are no points.
    pub depth_mm: Option<[f64; 3]>,
}

impl ScanQuality {
    /// Computes the quality measures of a scan.
    pub fn compute(cloud: &OrganizedCloud<Camera>) -> Self {
        let mut depths: Vec<f64> = cloud.valid_points().map(|(_, point)| point.mm.z).collect();
        let points = depths.len();
        let pixels = (cloud.width() * cloud.height()).max(1);
        let mut at = |share: f64| quantile(&mut depths, share, QuantileRank::Floor);
        let depth_mm = match (at(0.05), at(0.5), at(0.95)) {
            (Some(near), Some(middle), Some(far)) => Some([near, middle, far]),
            _ => None,
        };
        ScanQuality { points, missing_share: 1.0 - points as f64 / pixels as f64, depth_mm }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: a vertical edge from 40 to 200 has a gradient of 80 grey levels per pixel
    /// in two of twenty columns. Blurred over four pixels, the edge has 40. A tenth of the pixels is saturated, and
    /// another tenth is dark.
    #[test]
    fn a_sharp_edge_has_a_steeper_gradient() {
        let picture = |levels: [u8; 20]| {
            let mut picture = ColorPicture::uniform(20, 10, [0; 3]);
            picture.rgb.iter_mut().enumerate().for_each(|(index, rgb)| *rgb = [levels[index % 20]; 3]);
            picture
        };
        let mut levels = [40; 20];
        levels[10..].fill(200);
        let sharp = PictureQuality::compute(&picture(levels));
        assert!((sharp.sharpness_gray_per_px - 80.0).abs() < 1.0 && sharp.saturated_share == 0.0, "{sharp:?}");
        (levels[9], levels[10]) = (80, 160);
        (levels[8], levels[11]) = (40, 200);
        let soft = PictureQuality::compute(&picture(levels));
        assert!(soft.sharpness_gray_per_px < 65.0, "{soft:?}");
        (levels[0], levels[1], levels[18], levels[19]) = (5, 5, 255, 255);
        let clipped = PictureQuality::compute(&picture(levels));
        assert_eq!((clipped.saturated_share, clipped.dark_share), (0.1, 0.1));
    }

    /// Expected value, calculated by hand: two of six pixels have no point.
    #[test]
    fn missing_points_are_counted() {
        let nan = [f32::NAN; 3];
        let points = vec![[0.0, 0.0, 500.0], nan, [1.0, 0.0, 600.0], [0.0, 1.0, 700.0], nan, [1.0, 1.0, 800.0]];
        let cloud = OrganizedCloud::<Camera>::new(3, 2, points, vec![[9; 3]; 6]).expect("six pixels");
        let found = ScanQuality::compute(&cloud);
        assert_eq!(found.points, 4);
        assert!((found.missing_share - 2.0 / 6.0).abs() < 1e-12 && found.depth_mm.is_some(), "{found:?}");
    }
}
