//! The water-break test: where, when and on how much surface the water film broke (thesis 4.2–4.4, Fig. 4.9).
//!
//! The one idea: a film darkens the panel by one factor, light changes it smoothly, glints move on; a place that looks
//! dry long enough has broken ([`model`]). The thesis's own pipeline ([`thesis`], [`film`]) stands beside it (`method =
//! "thesis"`). The taught pixels of the region, projected to where the panel stands now, turn broken pixels into mm² of
//! each grid ([`footprint`]). Each picture says whether it can be judged by ([`quality`], [`steady`]); what broke is put
//! together at the end ([`conclude`], [`settle`], [`pieces`]), without what the dry picture makes doubtful ([`doubt`]). One
//! gate turns all of it into a verdict ([`gate`], [`place`]). Pictures go in one by one and none is kept: memory does not grow with the clip.
//!
//! A dry picture before the spray is part of the test: by it a pixel is wet or not. A place that never becomes wet, or
//! dries under the spray, is a break at 0 s.
//!
//! Times are counted from the first fully wet picture. Does not decide where the panel stands, does not draw.

mod advice;
mod conclude;
mod doubt;
mod error;
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
pub use error::InspectError;
pub use film_advice::{Flashes, GridContrast};
pub use footprint::{Footprint, GridFootprint};
pub use gate::{ByCell, Demands, GridInspection, Observation, name};
pub use pieces::Break;
pub use place::{MAX_OFF_PX, too_coarse};
pub use quality::{Flaw, Flawed, Quality};
pub use score::{Confusion, Score, score, score_within};
pub use watch::{Step, Watch};
