//! The reasons why a scan cannot teach a panel, as text for the person who teaches.

use super::region::GridId;
use crate::imaging::ImagingError;
use panelprep_base::geometry::Pixel;

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
