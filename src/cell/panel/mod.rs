//! The taught panel: the data of a panel at its nominal pose, derived from one scan and the recipe.
//!
//! The panel's frame equals the robot's base at teaching (thesis 3.8), or the frame of the drawing. The scan is kept
//! unchanged. Crop, outline, region, grids and corners are derived from it each time it is loaded, so that an improved
//! derivation needs no new scan. This module does not determine where the panel is now: see `locate`.
//!
//! This file has the errors for a scan that cannot teach a panel, as text for the person who teaches, and the panel's
//! frame at its nominal place.

mod extent;
#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod flat;
mod off_panel;
mod region;
pub mod segment;
mod taught;

pub use extent::OutlineFrom;
pub use off_panel::{BoxCut, GapKind, OffPanel};
pub use region::{GridId, GridIdError, Region};
pub use taught::{CornerTeaching, Grid, TaughtCorner, TaughtPanel, TaughtSource};

use crate::imaging::ImagingError;
use crate::recipe::Recipe;
use panelprep_base::geometry::{Base, Drawing, Panel, Pixel, Rigid};

/// If points are missing, the neighbourhood for fitting a plane is doubled up to this size, px: some 15 mm, over which
/// a panel is nearly flat.
const MAX_HALF_WIDTH_PX: usize = 40;

/// The reason why a scan cannot teach a panel.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// Some corners of the region are not on the panel; all such corners are listed.
    #[error(
        "{}; choose all four corners of the region inside the panel's outline; if points of the panel are missing, \
         state the outline in [panel] outline_px",
        list(corners)
    )]
    WrongCorners {
        /// The corners that are not valid.
        corners: Vec<WrongCorner>,
    },
    /// No point of the scan under the region's centre lies in the search box.
    #[error(
        "no panel under the region's centre, ({u:.0}, {v:.0}) px: the scan has no point in the search box there, \
         {}; check that the region's corners are on the panel, and check the box", describe_box_content(*largest)
    )]
    NothingAtPanelPosition {
        /// The region's centre, column, px.
        u: f64,
        /// The region's centre, row, px.
        v: f64,
        /// Number of points in the largest piece of the scan elsewhere in the box.
        largest: usize,
    },
    /// The piece of the scan under the region's centre and in the search box is too small for a panel.
    #[error(
        "no panel under the region's centre, ({u:.0}, {v:.0}) px: the connected part of the scan in the search box \
         there has {found} points, at least {needed} are needed; check the box and the position of the panel"
    )]
    NoPanel {
        /// The region's centre, column, px.
        u: f64,
        /// The region's centre, row, px.
        v: f64,
        /// Points found.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// A corner of the recipe's outline is not in the picture.
    #[error(
        "outline_px in [panel]: the corner ({u:.0}, {v:.0}) px lies outside of the picture, {width}×{height} px; \
         check that it was drawn on this picture"
    )]
    OutlineOutside {
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
        /// The picture's width, px.
        width: usize,
        /// Its height, px.
        height: usize,
    },
    /// A grid has a hole at its edge, and no surface around the hole.
    #[error(
        "grid {grid} has too few scan points around its edge at ({u:.0}, {v:.0}) px to determine the surface \
         there; scan again, at a steeper angle or with a longer exposure, or move the region"
    )]
    GridWithoutPoints {
        /// The grid.
        grid: GridId,
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// The region's corners enclose no area.
    #[error("the region's four corners enclose no area; draw the region again")]
    EmptyRegion,
    /// No panel lies in the view of a corner picture.
    #[error(
        "the corner at ({u:.1}, {v:.1}) px of the flange picture is not near the panel's outline; check the flange \
         pose, and if the recipe has outline_px, check that it follows the panel's edge"
    )]
    CornerOffPanel {
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// OpenCV rejected the mask.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}

/// A corner of the region that is not on the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrongCorner {
    /// Number of the corner, from 1.
    pub corner: usize,
    /// Its position in the recipe.
    pub at: Pixel,
    /// The size of the picture, px, if the corner lies outside the picture.
    pub outside_of: Option<[usize; 2]>,
}

impl std::fmt::Display for WrongCorner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let WrongCorner { corner, at: Pixel { u, v }, outside_of } = self;
        write!(f, "corner {corner} of the region, ({u:.0}, {v:.0}) px, ")?;
        match outside_of {
            Some([width, height]) => write!(f, "lies outside of the picture, {width}×{height} px"),
            None => f.write_str("is not on the panel"),
        }
    }
}

fn list(corners: &[WrongCorner]) -> String {
    corners.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Describes what the search box contains outside the place at which the panel was searched.
fn describe_box_content(largest: usize) -> String {
    match largest {
        0 => "and no point elsewhere in it".to_owned(),
        points => format!("but a part with {points} points elsewhere in it"),
    }
}

/// Declares that at teaching the frame of a scanned panel is the base (thesis 3.8). Only [`nominal_pose`] uses it, and
/// tests of scanned panels.
pub fn panel_from_base_at_teaching() -> Rigid<Panel, Base> {
    Rigid::from_isometry_unchecked(nalgebra::Isometry3::identity())
}

/// Returns the panel's frame at its nominal place: the drawing's frame if the panel is taught from its drawing, so that
/// the base in the controller is the drawing's, and otherwise the base.
pub fn nominal_pose(recipe: &Recipe) -> Rigid<Base, Panel> {
    // The only declaration that the panel's frame is the drawing's.
    let of_drawing =
        |base_from_drawing: Rigid<Base, Drawing>| Rigid::from_isometry_unchecked(*base_from_drawing.isometry());
    let scanned = || panel_from_base_at_teaching().inverse();
    recipe.nominal().map_or_else(scanned, |nominal| of_drawing(nominal.base_from_drawing()))
}
