//! The errors of the water-break test, as text for the person who recorded the pictures.

use panelprep_base::phase::Phase;
use panelprep_cell::imaging::ImagingError;

/// The reason why pictures could not be inspected. A test without a result is not an error but has the verdict
/// `invalid`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InspectError {
    /// The picture is from another camera, or was scaled.
    #[error(
        "the picture has {found_width}×{found_height} px, but the camera was calibrated for {width}×{height} px, \
         so the grids cannot be projected; record the pictures with the size of the calibration"
    )]
    PictureSize {
        /// Number of columns of the picture.
        found_width: usize,
        /// Number of rows of the picture.
        found_height: usize,
        /// Number of columns in the calibration.
        width: usize,
        /// Number of rows in the calibration.
        height: usize,
    },
    /// No point of the region projects into the picture.
    #[error(
        "the region lies outside of the picture at the panel's present pose; check that the pose belongs to this \
         clip"
    )]
    RegionNotInPicture,
    /// The times of the pictures do not increase.
    #[error("the picture at {time_s} s follows a picture at {previous_s} s; times must increase")]
    TimeOrder {
        /// The time of the picture, s.
        time_s: f64,
        /// The time of the previous picture, s.
        previous_s: f64,
    },
    /// A phase occurred again after it had ended.
    #[error(
        "the picture at {time_s} s is of phase {phase} but follows a picture of phase {previous}; the order is \
         dry, spray, wet"
    )]
    PhaseOrder {
        /// The time of the picture, s.
        time_s: f64,
        /// Phase of the picture.
        phase: Phase,
        /// Phase of the previous picture.
        previous: Phase,
    },
    /// The clip has too many wet pictures.
    #[error("the clip has more than {most} wet pictures; take fewer pictures per second")]
    TooManyPictures {
        /// Maximum number of pictures.
        most: usize,
    },
    /// The wet phase of the clip is too long.
    #[error("the clip has wet pictures more than {most_s} s after the first one; end the clip sooner")]
    TooLong {
        /// Maximum duration, s.
        most_s: f64,
    },
    /// The clip has no wet picture.
    #[error("the clip has no picture of phase wet; the first fully wet picture is the reference of the test")]
    NoWetPicture,
    /// OpenCV refused a picture.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}
