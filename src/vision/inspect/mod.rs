//! The water-break test: where, when and on what area the water film broke (thesis 4.2–4.4, Fig. 4.9).
//!
//! **A grid passes only on positive evidence of an unbroken film.** Each pixel is compared with the brightness of its
//! own film and, if it still has one, with its dry reference ([`model`] states the rule and the limits). The thesis's
//! pipeline ([`thesis`]) can be chosen instead (`method = "thesis"`). The taught pixels of the region are projected to
//! the present pose of the panel and convert broken pixels into mm² of each grid ([`footprint`]). Each picture is
//! checked for usability ([`quality`], [`steady`]). At the end the broken pixels are combined into breaks
//! ([`conclude`], [`break_mask`]), without the places that were already wet in the dry picture. The verdict is derived
//! from all results ([`gate`]). Pictures are processed one by one and not stored, so that memory does not grow with the
//! length of the clip.
//!
//! A dry picture before the spray is part of the test. It is the reference for the lamp, the position of the panel and
//! the dry brightness of every place that was not sanded since. A place that never becomes wet, or dries under the
//! spray, is a break at 0 s.
//!
//! Times are counted from the first fully wet picture, by the timestamps of the pictures. This module does not locate
//! the panel and draws nothing. [`InspectError`] states why pictures cannot be inspected, as text for the person who
//! recorded them.

mod advice;
mod break_mask;
mod conclude;
mod error;
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
pub use error::InspectError;
pub use footprint::{Footprint, GridFootprint};
pub use gate::{MAX_OUTLINE_OFFSET_PX, MIN_CHANGE_TO_NOISE, coarse_resolution_reason, name};
pub use observed::{CellDemands, ComparisonReference, Demands, GridInspection, Observation, picture_interval_s};
pub use quality::{Flaw, FlawedPictures, Quality};
pub use score::{Confusion, Score, score, score_within};
pub use tuning::{MIN_CONTRAST_TO_NOISE, Tuning, thesis_checks};
pub use watch::{FilmView, FilmWatch, PictureResult};
