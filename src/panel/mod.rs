//! The taught panel: what is known of a panel at its nominal place, derived from one scan and the recipe.
//!
//! The panel's frame is the robot's base at teaching (thesis 3.8). The scan stays as it was taken; crop, outline,
//! region, grids and corners are derived from it each time it is loaded, so that a better derivation needs no new
//! scan. Decides nothing about where the panel is now.

mod corner;
mod error;
mod extent;
mod region;
pub mod segment;
mod sheet;
mod taught;

pub use corner::{CornerTeaching, TaughtCorner};
pub use error::{LearnError, WrongCorner};
pub use extent::OutlineFrom;
pub use region::{GridId, GridIdError, Region};
pub use taught::{Grid, TaughtPanel, panel_from_base_at_teaching};
