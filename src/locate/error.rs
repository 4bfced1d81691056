//! Why a panel was not found at all. Whether a panel that was found can be trusted is decided by `gate`.

use crate::words::apart;

/// Why a scan gives no pose. Every variant but the last means that there is no panel of the taught kind.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LocateError {
    /// The search box is as good as empty.
    #[error(
        "{found} places of the scan are in the search box, at least {needed} are needed; is the panel in the \
             fixture?"
    )]
    EmptyBox {
        /// Places found in the box.
        found: usize,
        /// Places needed.
        needed: usize,
    },
    /// There are things in the box, none of the panel's size.
    #[error(
        "none of {pieces} objects in the search box has the panel's size: the most similar has {} mm², the panel \
         has {} mm²; is the right panel in the fixture, and nothing in front of it?", apart(*area_mm2, *taught_area_mm2, 0)[0],
        apart(*area_mm2, *taught_area_mm2, 0)[1]
    )]
    NoPieceFits {
        /// Things looked at.
        pieces: usize,
        /// Area of the most alike, mm².
        area_mm2: f64,
        /// The panel's area, mm².
        taught_area_mm2: f64,
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
}
