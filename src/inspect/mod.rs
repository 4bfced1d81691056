//! The water-break test: where, when and on how much surface the water film broke (thesis 4.2–4.4, Fig. 4.9).
//!
//! The method: a film darkens the panel by one factor, the light changes this smoothly, and glints move. A place that looks
//! dry for long enough has broken ([`model`]). The thesis's own pipeline ([`thesis`], [`film`]) can be chosen instead (`method =
//! "thesis"`). The taught pixels of the region are projected to the panel's present pose and convert broken pixels into mm² of
//! each grid ([`footprint`]). Each picture is checked for whether it can be used ([`quality`], [`steady`]). At the end the broken
//! pixels are assembled ([`conclude`], [`settle`], [`pieces`]), without those that were wet already in the dry picture ([`doubt`]), and
//! without film that looks as the dry panel does ([`alike`]). One
//! gate turns all of it into a verdict ([`gate`], [`place`]). Pictures are processed one by one and not kept, so that memory does not
//! grow with the clip.
//!
//! A dry picture before the spray is part of the test: it is the reference by which a pixel is wet or dry. A place that never
//! becomes wet, or dries under the spray, is a break at 0 s.
//!
//! Times are counted from the first fully wet picture. This room does not locate the panel and draws nothing.

mod advice;
mod alike;
mod conclude;
mod doubt;
mod error;
mod film;
mod film_advice;
mod footprint;
mod gate;
mod model;
mod observed;
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
mod tuning;
mod watch;

pub use advice::{Advice, Channel, Sampler, best_threshold};
pub use conclude::Inspection;
pub use error::InspectError;
pub use film_advice::{Flashes, GridContrast};
pub use footprint::{Footprint, GridFootprint};
pub use gate::{MIN_CHANGE_LEVELS, name};
pub use observed::{ByCell, Demands, GridInspection, Observation};
pub use pieces::Break;
pub use place::{MAX_OFF_PX, too_coarse};
pub use quality::{Flaw, Flawed, Quality};
pub use score::{Confusion, Score, score, score_within};
pub use tuning::{MIN_CONTRAST_TO_NOISE, Tuning, thesis_checks};
pub use watch::{Step, Watch};
