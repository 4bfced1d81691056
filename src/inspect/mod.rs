//! The water-break test: where, when and on how much surface the water film broke (thesis 4.2–4.4, Fig. 4.9).
//!
//! The one idea: a film darkens the panel by one factor, light changes it smoothly, glints move on; a place that looks
//! dry long enough has broken ([`model`]). The thesis's own pipeline ([`thesis`], [`film`]) stands beside it (`method =
//! "thesis"`). The taught pixels of the region, projected to where the panel stands now, turn broken pixels into mm² of
//! each grid ([`footprint`]). Each picture says whether it can be judged by ([`quality`], [`steady`]); what broke is put
//! together at the end ([`conclude`], [`settle`], [`pieces`]), without what the dry picture makes doubtful ([`doubt`]), or a film
//! that looks as the dry panel does ([`alike`]). One
//! gate turns all of it into a verdict ([`gate`], [`place`]). Pictures go in one by one and none is kept: memory does not grow with the clip.
//!
//! A dry picture before the spray is part of the test: by it a pixel is wet or not. A place that never becomes wet, or
//! dries under the spray, is a break at 0 s.
//!
//! Times are counted from the first fully wet picture. Does not decide where the panel stands, does not draw.

mod advice;
mod alike;
mod conclude;
mod connected;
mod doubt;
mod film;
mod film_advice;
mod footprint;
mod gate;
mod model;
mod pieces;
mod place;
mod quality;
#[cfg(test)]
mod rendered;
mod score;
mod settle;
mod steady;
#[cfg(test)]
mod tests;
mod thesis;
mod watch;

pub use advice::{Advice, Channel, Sampler, best_threshold};
pub use conclude::Inspection;
pub use connected::pieces_of;
pub use film_advice::{Flashes, GridContrast};
pub use footprint::{Footprint, GridFootprint};
pub use gate::{Demands, GridInspection, MIN_CHANGE_LEVELS, Observation};
pub use pieces::Break;
pub use place::{MAX_OFF_PX, too_coarse};
pub use quality::{Flaw, Flawed, Quality};
pub use score::{Confusion, Score, score, score_within};
pub use watch::{Step, Watch};

use crate::imaging::ImagingError;
use crate::phase::Phase;

/// Why pictures could not be inspected. A test that says nothing is no error but a verdict, `invalid`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InspectError {
    /// The picture is of another camera, or scaled.
    #[error(
        "the picture has {found_width}×{found_height} px; the camera was calibrated for {width}×{height} px, and \
         grids cannot be projected to another size"
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
    /// Not one point of the region projects into the picture.
    #[error("the region lies outside of the picture where the panel stands now; is the pose this clip's?")]
    RegionNotInPicture,
    /// Pictures out of order.
    #[error("a picture at {time_s} s follows one at {previous_s} s; times must increase")]
    TimeOrder {
        /// The picture's time, s.
        time_s: f64,
        /// The time of the one before, s.
        previous_s: f64,
    },
    /// A phase that is over came back.
    #[error(
        "the picture at {time_s} s is of phase {phase} after one of phase {previous}; the order is dry, spray, wet"
    )]
    PhaseOrder {
        /// The picture's time, s.
        time_s: f64,
        /// Its phase.
        phase: Phase,
        /// The phase before.
        previous: Phase,
    },
    /// A film too long.
    #[error("the clip has more than {most} wet pictures; take fewer a second")]
    TooManyPictures {
        /// How many it may have.
        most: usize,
    },
    /// Nothing to examine.
    #[error("the clip has no picture of phase wet; the first fully wet picture is the reference of the test")]
    NoWetPicture,
    /// OpenCV refused a picture.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}
