//! The water-break test: where, when and on how much surface the water film broke (thesis 4.2–4.4, Fig. 4.9).
//!
//! The one idea: a panel that is wholly wet looks the same until the film breaks, so a break is what differs from the
//! first fully wet picture and looks dry. Each wet picture goes through the thesis's pipeline ([`thesis`]), a break
//! counts once it has persisted ([`film`]), and the taught pixels of the region, projected to where the panel stands
//! now, turn broken pixels into mm² of each grid ([`footprint`]). One gate turns that evidence into a verdict
//! ([`gate`]). Pictures go in one by one and none is kept but the dry one and the reference: memory does not grow with
//! the clip.
//!
//! A place that is dry in the reference already never differs from it; where a dry picture was taken, the reference is
//! compared with that, and a place that did not change under the spray is a break at 0 s.
//!
//! Times are counted from the reference, the first fully wet picture. Does not decide where the panel stands, does not
//! draw.

mod film;
mod footprint;
mod gate;
mod pieces;
#[cfg(test)]
mod rendered;
mod score;
#[cfg(test)]
mod tests;
mod thesis;
mod watch;

pub use footprint::{Footprint, GridFootprint};
pub use gate::{Demands, GridInspection, Observation};
pub use pieces::Break;
pub use score::{Confusion, Score, score};
pub use watch::{Inspection, Step, Watch};

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
    /// Nothing to examine.
    #[error("the clip has no picture of phase wet; the first fully wet picture is the reference of the test")]
    NoWetPicture,
    /// OpenCV refused a picture.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}
