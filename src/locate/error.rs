//! Why a panel was not found at all. A panel that was found and is not to be trusted is `gate`'s matter.

use crate::imaging::ImagingError;

/// Why a scan gives no pose. Every variant but the last two means that no panel of the taught kind is there.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LocateError {
    /// The search box is as good as empty.
    #[error("{found} points fall in the search box, needed are {needed}; is the panel in the fixture?")]
    EmptyBox {
        /// Points found in the box.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// There are things in the box, none of the panel's size.
    #[error(
        "none of {pieces} things in the search box has the panel's size: the most alike has {area_mm2:.0} mm² and is \
         {length_mm:.0} × {width_mm:.0} mm, the panel has {taught_area_mm2:.0} mm² and is {taught_length_mm:.0} × \
         {taught_width_mm:.0} mm; is the right panel in the fixture, and nothing before it?"
    )]
    NoPieceFits {
        /// Things looked at.
        pieces: usize,
        /// Area of the most alike, mm².
        area_mm2: f64,
        /// Its length, mm.
        length_mm: f64,
        /// Its width, mm.
        width_mm: f64,
        /// The panel's area, mm².
        taught_area_mm2: f64,
        /// The panel's length, mm.
        taught_length_mm: f64,
        /// The panel's width, mm.
        taught_width_mm: f64,
    },
    /// Too little of the taught panel has a partner in the scan.
    #[error(
        "{matched} of {points} taught points have a partner in the scan, needed are {needed}: the thing in the search \
         box has the panel's size and not its shape; is the right panel in the fixture?"
    )]
    NoMatch {
        /// Points with a partner.
        matched: usize,
        /// Points asked.
        points: usize,
        /// Points needed.
        needed: usize,
    },
    /// Surface and outline leave a direction free.
    #[error(
        "surface and outline leave the panel free in a direction, with {surface} points on its surface and {outline} \
         on its outline; scan it whole"
    )]
    Degenerate {
        /// Points matched on the surface.
        surface: usize,
        /// Points matched on the outline.
        outline: usize,
    },
    /// OpenCV refused the mask.
    #[error(transparent)]
    Imaging(#[from] ImagingError),
}
