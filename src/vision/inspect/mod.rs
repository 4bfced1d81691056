//! The water-break test: where, when and on what area the water film broke (thesis 4.2–4.4, Fig. 4.9).
//!
//! **A grid passes only on positive evidence of an unbroken film.** Each place is compared with its own wet look and,
//! if it still has one, its own dry look ([`model`] states the rule and the limits). The thesis's own pipeline
//! ([`thesis`]) can be chosen instead (`method = "thesis"`). The taught pixels of the region are projected to the
//! panel's present pose and convert broken pixels into mm² of each grid ([`footprint`]). Each picture is checked for
//! whether it can be used ([`quality`], [`steady`]). At the end the broken pixels are combined into breaks
//! ([`conclude`], [`break_mask`]), without those that were already wet in the dry picture. One gate derives a verdict
//! from all results ([`gate`]). Pictures are processed one by one and not stored, so that memory does not grow with the
//! length of the clip.
//!
//! A dry picture before the spray is part of the test: it determines the lamp, the panel's place and the dry look of
//! every place that was not sanded since. A place that never becomes wet, or dries under the spray, is a break at 0 s.
//!
//! Times are counted from the first fully wet picture, by the pictures' timestamps. This module does not locate the
//! panel and draws nothing. [`InspectError`] states why pictures cannot be inspected, as text for the person who
//! recorded them.

mod advice;
mod break_mask;
mod conclude;
mod footprint;
mod gate;
mod model;
mod narrow_spots;
mod observed;
mod quality;
#[cfg(test)]
mod rendered;
mod sanded;
mod score;
mod steady;
#[cfg(test)]
mod tests;
mod thesis;
mod tuning;
mod watch;

pub use advice::{Advice, Channel, FlashDetector, GridContrast, Sampler, best_threshold};
pub use conclude::{Break, Inspection};
pub use footprint::{Footprint, GridFootprint};
pub use gate::{MAX_OUTLINE_OFFSET_PX, MIN_CHANGE_TO_NOISE, name, too_coarse};
pub use observed::{CellDemands, ComparisonReference, Demands, GridInspection, Observation, picture_interval_s};
use panelprep_base::phase::Phase;
use panelprep_cell::imaging::ImagingError;
pub use quality::{Flaw, FlawedPictures, Quality};
pub use score::{Confusion, Score, score, score_within};
pub use tuning::{MIN_CONTRAST_TO_NOISE, Tuning, thesis_checks};
pub use watch::{FilmView, FilmWatch, PictureResult};

/// The reason why pictures could not be inspected. A test without a result is not an error but has the verdict
/// `invalid`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InspectError {
    /// The picture is from another camera, or its size was changed.
    #[error(
        "the picture has {found_width}×{found_height} px, but the camera was calibrated for {width}×{height} px, \
         so the grids cannot be projected; record the pictures with the size of the calibration"
    )]
    PictureSize {
        /// Columns found.
        found_width: usize,
        /// Rows found.
        found_height: usize,
        /// Columns calibrated.
        width: usize,
        /// Rows calibrated.
        height: usize,
    },
    /// No point of the region projects into the picture.
    #[error(
        "the region lies outside of the picture at the panel's present pose; check that the pose belongs to this \
         clip"
    )]
    RegionNotInPicture,
    /// Pictures out of order.
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
        /// Its phase.
        phase: Phase,
        /// Phase of the previous picture.
        previous: Phase,
    },
    /// The film has too many pictures.
    #[error("the clip has more than {most} wet pictures; take fewer pictures per second")]
    TooManyPictures {
        /// Largest allowed number of pictures.
        most: usize,
    },
    /// A film that lasts too long.
    #[error("the clip has wet pictures more than {most_s} s after the first one; end the clip sooner")]
    TooLong {
        /// Longest allowed duration, s.
        most_s: f64,
    },
    /// There is no wet picture.
    #[error("the clip has no picture of phase wet; the first fully wet picture is the reference of the test")]
    NoWetPicture,
    /// OpenCV refused a picture.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}
