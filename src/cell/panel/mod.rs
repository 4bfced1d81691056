//! The taught panel: the data of a panel at its nominal pose, derived from one scan and the recipe.
//!
//! The panel's frame equals the robot's base at teaching (thesis 3.8), or the frame of the drawing. The scan is kept
//! unchanged. Crop, outline, region, grids and corners are derived from it each time it is loaded, so that an improved
//! derivation needs no new scan. This module does not determine where the panel is now: see `locate`.

mod error;
mod extent;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod flat;
mod nominal_pose;
mod off_panel;
mod region;
pub mod segment;
mod taught;

pub use error::{LearnError, WrongCorner};
pub use extent::OutlineFrom;
pub use nominal_pose::{nominal_pose, panel_from_base_at_teaching};
pub use off_panel::{BoxCut, GapKind, OffPanel};
pub use region::{GridId, GridIdError, Region};
pub use taught::{CornerTeaching, Grid, TaughtCorner, TaughtPanel, TaughtSource};
