//! The panel from its drawing: computes from a mesh the scan that the 3D camera would record at the nominal pose of the
//! panel.
//!
//! The result has the form of a scan (`seen`), so that it is processed like the scan of a real panel. A drawing that is
//! not one clear surface is refused: nothing is repaired and nothing is guessed.
//!
//! - `part`: unit and part of the drawing; gaps, doubled faces, the size of its facets
//! - `seen`: the view of a camera, by the nearest triangle of each ray; a surface that passes through itself

mod error;
mod part;
mod seen;
#[cfg(test)]
mod tests;

pub use error::{ListedPart, NominalError};
pub use part::{HARMLESS_GAP_MM, Part, PartEdges};
pub use seen::{PartHit, PartRays, PartView, UnseenFractions};
