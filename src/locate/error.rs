//! The reasons why a panel was not found at all. `gate` decides whether a panel that was found can be trusted.

use crate::number_text::apart;

/// Why a scan gives no pose. Every variant but the last means that there is no panel of the taught kind.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LocateError {
    /// The search box is nearly empty.
    #[error(
        "{found} places of the scan are in the search box, at least {needed} are needed; is the panel in the \
             fixture?"
    )]
    EmptyBox {
        /// The number of scan places in the box.
        found: usize,
        /// Places needed.
        needed: usize,
    },
    /// There are objects in the box, but none of the panel's size.
    #[error(
        "none of {pieces} objects in the search box has the panel's size: the most similar has {} mm², the panel \
         has {} mm²; is the right panel in the fixture, and nothing in front of it?", apart(*area_mm2, *taught_area_mm2, 0)[0],
        apart(*area_mm2, *taught_area_mm2, 0)[1]
    )]
    NoPieceFits {
        /// Things looked at.
        pieces: usize,
        /// Area of the most similar object, mm².
        area_mm2: f64,
        /// The panel's area, mm².
        taught_area_mm2: f64,
    },
    /// Surface and outline leave one direction unconstrained.
    #[error(
        "surface and outline leave the panel free in a direction, with {surface} points on its surface and {outline} \
         on its outline; scan it whole"
    )]
    Degenerate {
        /// The number of points matched on the surface.
        surface: usize,
        /// The number of points matched on the outline.
        outline: usize,
    },
}
