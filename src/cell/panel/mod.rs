//! The taught panel: the data of a panel at its nominal pose, computed from one scan and the recipe.
//!
//! The panel's frame equals the robot's base at teaching (thesis 3.8), or the frame of the drawing. The scan is stored
//! unchanged. Crop, outline, region, grids and corners are computed from it each time it is loaded, so that an improved
//! algorithm needs no new scan. The present pose of the panel is determined by `locate`, not here.

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
