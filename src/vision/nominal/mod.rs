//! The panel from its drawing: a mesh becomes what the 3D camera would see of it at its nominal place.
//!
//! The result has the form of a scan (`seen`), so that everything behind a taught panel stays as it is. A drawing
//! that is not one clear surface is refused: nothing is repaired and nothing is guessed.
//!
//! - `part`: unit and part of the drawing · `edges`: gaps, doubled faces, the size of its facets
//! - `rays`: the nearest triangle of each ray, and a surface that passes through itself · `seen`: a camera's view

mod edges;
mod error;
mod part;
mod rays;
mod seen;

pub use edges::{HARMLESS_GAP_MM, PartEdges};
pub use error::{ListedPart, NominalError};
pub use part::Part;
pub use rays::{PartHit, PartRays};
pub use seen::{PartView, UnseenShares};

#[cfg(test)]
mod tests;
