//! The panel from its drawing: computes from a mesh what the 3D camera would see at the panel's nominal pose.
//!
//! The result has the form of a scan (`seen`), so that all further processing is that of a scanned panel. A drawing
//! that is not one clear surface is refused: nothing is repaired and nothing is guessed.
//!
//! - `part`: unit and part of the drawing; gaps, doubled faces, the size of its facets
//! - `seen`: a camera's view, by the nearest triangle of each ray; a surface that passes through itself

mod error;
mod part;
mod seen;
#[cfg(test)]
mod tests;

pub use error::{ListedPart, NominalError};
pub use part::{HARMLESS_GAP_MM, Part, PartEdges};
pub use seen::{PartHit, PartRays, PartView, UnseenShares};
