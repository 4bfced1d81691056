//! The reasons why a panel cannot be taught with a scan, for the person who teaches it.

use super::region::GridId;
use crate::imaging::ImagingError;
use panelprep_base::geometry::Pixel;

/// The reason why a panel cannot be taught with a scan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// Corners of the region that are not on the panel.
    #[error(
        "{}; choose all four corners of the region inside the panel's outline; if points of the panel are missing, \
         state the outline in [panel] outline_px",
        list(corners)
    )]
    WrongCorners {
        /// All corners that are not on the panel.
        corners: Vec<WrongCorner>,
    },
    /// The scan has no point in the search box at the region's centre.
    #[error(
        "no panel under the region's centre, ({u:.0}, {v:.0}) px: the scan has no point in the search box there, \
         {}; check that the region's corners are on the panel, and check the box", describe_box_content(*largest)
    )]
    NothingAtPanelPosition {
        /// Column of the region's centre, px.
        u: f64,
        /// Row of the region's centre, px.
        v: f64,
        /// Number of points in the largest connected component elsewhere in the search box.
        largest: usize,
    },
    /// The connected component at the region's centre is too small for a panel.
    #[error(
        "no panel under the region's centre, ({u:.0}, {v:.0}) px: the connected part of the scan in the search box \
         there has {found} points, at least {needed} are needed; check the box and the position of the panel"
    )]
    NoPanel {
        /// Column of the region's centre, px.
        u: f64,
        /// Row of the region's centre, px.
        v: f64,
        /// Number of points in the connected component.
        found: usize,
        /// Minimum number of points of a panel.
        needed: usize,
    },
    /// A corner of the recipe's outline is outside of the picture.
    #[error(
        "outline_px in [panel]: the corner ({u:.0}, {v:.0}) px lies outside of the picture, {width}×{height} px; \
         check that it was drawn on this picture"
    )]
    OutlineOutside {
        /// Column of the corner, px.
        u: f64,
        /// Row of the corner, px.
        v: f64,
        /// The picture's width, px.
        width: usize,
        /// The picture's height, px.
        height: usize,
    },
    /// Points are missing at the edge of a grid, and the surface there cannot be determined from the points around.
    #[error(
        "grid {grid} has too few scan points around its edge at ({u:.0}, {v:.0}) px to determine the surface \
         there; scan again, at a steeper angle or with a longer exposure, or move the region"
    )]
    GridWithoutPoints {
        /// The grid at whose edge points are missing.
        grid: GridId,
        /// Column of the point on the edge, px.
        u: f64,
        /// Row of the point on the edge, px.
        v: f64,
    },
    /// The region's corners enclose no area.
    #[error("the region's four corners enclose no area; draw the region again")]
    EmptyRegion,
    /// The corner in a corner picture is not near the panel's outline.
    #[error(
        "the corner at ({u:.1}, {v:.1}) px of the flange picture is not near the panel's outline; check the flange \
         pose, and if the recipe has outline_px, check that it follows the panel's edge"
    )]
    CornerOffPanel {
        /// Column of the corner in the corner picture, px.
        u: f64,
        /// Row of the corner in the corner picture, px.
        v: f64,
    },
    /// OpenCV refused the mask.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}

/// A corner of the region that is not on the panel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrongCorner {
    /// Number of the corner, from 1.
    pub corner: usize,
    /// The corner's pixel in the recipe.
    pub at: Pixel,
    /// Width and height of the picture, px, if the corner is outside of it.
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

/// Returns as text what the search box contains elsewhere.
fn describe_box_content(largest: usize) -> String {
    match largest {
        0 => "and the box contains no other points".to_owned(),
        points => format!("but the box contains a connected part with {points} points elsewhere"),
    }
}
