//! Errors for a picture that shows no corner, as text for the person who set the recipe.

use panelprep_base::number_text::distinguishable_texts;
use panelprep_cell::imaging::ImagingError;

/// The reason why a picture shows no corner.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CornerError {
    /// No pixel has the panel's brightness.
    #[error(
        "no pixel has the brightness of the panel, {min}…{max}; check that the light is on and that the panel is \
         in view"
    )]
    NoContour {
        /// Darkest brightness of the panel.
        min: usize,
        /// Brightest brightness of the panel.
        max: usize,
    },
    /// The largest object with the panel's brightness is too small.
    #[error(
        "the largest object with the panel's brightness covers {} % of the picture, at least {} % are needed; \
         check that the panel is in view, and check panel_gray_max", distinguishable_texts(*found_percent, *needed_percent, 1)[0], distinguishable_texts(*found_percent, *needed_percent, 1)[1]
    )]
    ContourTooSmall {
        /// The fraction of the picture that the object covers, percent.
        found_percent: f64,
        /// The required fraction, percent.
        needed_percent: f64,
    },
    /// The corner lies at the border of the picture or beyond.
    #[error(
        "the corner at ({u:.0}, {v:.0}) px lies at the picture's border; move the camera so that the corner is \
         well inside the picture"
    )]
    CornerAtBorder {
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// One of the edges that meet in the corner is too short or too faint.
    #[error(
        "an edge beside the corner has {found} sharp points, at least {needed} are needed; check that the edge is \
         in view over rounding_mm and edge_mm, free of reflections, and clearly darker than the background"
    )]
    EdgeTooShort {
        /// Number of edge points found.
        found: usize,
        /// Number of edge points needed.
        needed: usize,
    },
    /// The two edges have nearly the same direction.
    #[error(
        "the two edges meet at {}°, at least {}° are needed; check that the picture shows a corner of the panel", distinguishable_texts(*angle_deg, *min_deg, 1)[0],
        distinguishable_texts(*angle_deg, *min_deg, 1)[1]
    )]
    EdgesParallel {
        /// The angle, degrees.
        angle_deg: f64,
        /// The smallest angle allowed, degrees.
        min_deg: f64,
    },
    /// OpenCV rejected the picture.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}
