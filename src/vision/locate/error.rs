//! The reasons why a panel is not located.

use panelprep_base::number_text::distinguishable_texts;

/// Reasons why the panel is not located. All variants but the last mean that there is no panel of the taught kind.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LocateError {
    /// The search box is nearly empty.
    #[error(
        "the search box is nearly empty: it contains {found} blocks of scan points, at least {needed} are needed; \
         check that the panel is in the fixture"
    )]
    EmptyBox {
        /// Number of blocks in the box that contain scan points.
        found: usize,
        /// Minimum number of blocks.
        needed: usize,
    },
    /// There are objects in the box, but none of the size of the panel.
    #[error(
        "none of {pieces} objects in the search box has the panel's size: the most similar object has {} mm², the \
         panel has {} mm²; check that the right panel is in the fixture and that nothing is in front of it", distinguishable_texts(*area_mm2, *taught_area_mm2, 0)[0],
        distinguishable_texts(*area_mm2, *taught_area_mm2, 0)[1]
    )]
    NoPieceFits {
        /// Number of examined objects.
        pieces: usize,
        /// Area of the object that is most similar to the panel, mm².
        area_mm2: f64,
        /// Area of the panel, mm².
        taught_area_mm2: f64,
    },
    /// Surface and outline leave one direction unconstrained.
    #[error(
        "the matched points do not determine the panel's pose in every direction: {surface} points on the surface \
         and {outline} on the outline; scan the whole panel"
    )]
    Degenerate {
        /// Number of matched points on the surface.
        surface: usize,
        /// Number of matched points on the outline.
        outline: usize,
    },
}
