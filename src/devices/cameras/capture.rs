//! A shot: its data, the interface of a camera that takes it, the reason why a camera did not deliver it, and its
//! quality in numbers on which a person can act: sharpness, saturation, darkness, missing points.
//!
//! Sharpness is the steepness of edges: the gradient of grey levels, √(gᵤ² + gᵥ²) by central differences, at the
//! steepest thousandth of the pixels. It increases as the picture comes into focus and depends on the scene. It can
//! therefore compare two focus settings for the same scene, but it cannot judge one setting alone.

use crate::zivid::ZividFault;
use panelprep_base::geometry::{Base, Camera, ColorPicture, Flange, OrganizedCloud, Rigid};
use panelprep_cell::files::{ClipError, CloudFileError, PictureError, PoseError};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A channel at or above this grey level is saturated.
const MIN_SATURATED_LEVEL: u8 = 254;
/// A pixel is dark if its brightest channel is below this grey level.
const MAX_DARK_LEVEL: u8 = 10;
/// The steepest pixels.
const STEEPEST_SHARE: f64 = 0.001;

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
        /// The reason why the camera is not available.
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
    /// All captures of a recording were used.
    #[error("{} contains no further {what}: all {played} were used", folder.display())]
    RecordingExhausted {
        /// The recording.
        folder: PathBuf,
        /// The item that was requested.
        what: &'static str,
        /// Number of captures that were replayed.
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
    /// The service uses the cameras for a cycle.
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
    /// The pose of the flange cannot be read.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The times of the pictures are not valid.
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

/// The data that a camera reports about its last shot; `None` for a value that it does not report.
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
    /// Takes a 3D shot: points and colours of the scene, with the camera's own light.
    ///
    /// # Errors
    /// If the camera does not deliver.
    fn capture_3d(&mut self) -> Result<Shot, CameraError>;

    /// Takes a colour picture with the cell's light, as for the pictures of the water film.
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

/// The quality of a picture, from its pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureQuality {
    /// Gradient at the steepest thousandth of the pixels, grey levels per pixel.
    pub sharpness_gray_per_px: f64,
    /// Share of pixels with a saturated channel.
    pub saturated_share: f64,
    /// Share of dark pixels.
    pub dark_share: f64,
    /// Mean grey level.
    pub mean_gray: f64,
}

impl PictureQuality {
    /// Returns the quality of a picture; all zero if it has no inner pixel.
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
            sharpness_gray_per_px: quantile(&mut slopes, 1.0 - STEEPEST_SHARE).unwrap_or(0.0),
            saturated_share: share(&|rgb| rgb.iter().any(|level| *level >= MIN_SATURATED_LEVEL)),
            dark_share: share(&|rgb| rgb.iter().all(|level| *level < MAX_DARK_LEVEL)),
            mean_gray: gray.gray.iter().map(|level| f64::from(*level)).sum::<f64>() / pixels,
        }
    }
}

/// The quality of a scan, from its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanQuality {
    /// Number of pixels that have a point.
    pub points: usize,
    /// Share of pixels without a point.
    pub missing_share: f64,
    /// Distances along the camera's axis below which 5, 50 and 95 % of the points lie, mm; `None` without points.
    pub depth_mm: Option<[f64; 3]>,
}

impl ScanQuality {
    /// Computes the quality of a scan.
    pub fn compute(cloud: &OrganizedCloud<Camera>) -> Self {
        let mut depths: Vec<f64> = cloud.valid_points().map(|(_, point)| point.mm.z).collect();
        let points = depths.len();
        let pixels = (cloud.width() * cloud.height()).max(1);
        let mut at = |share: f64| quantile(&mut depths, share);
        let depth_mm = match (at(0.05), at(0.5), at(0.95)) {
            (Some(near), Some(middle), Some(far)) => Some([near, middle, far]),
            _ => None,
        };
        ScanQuality { points, missing_share: 1.0 - points as f64 / pixels as f64, depth_mm }
    }
}

/// Returns the quantile of these values for this fraction; `None` if there are no values.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let index = ((values.len() as f64 * share) as usize).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(index, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: a vertical edge from 40 to 200 has a gradient of 80 grey levels per pixel in two of twenty
    /// columns; blurred over four pixels it has 40. A tenth of the pixels is saturated, another tenth dark.
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

    /// Calculated by hand: two of six pixels have no point.
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
