//! The record of a cycle on one page to read and to sign, as HTML and as PDF; what it has no room for follows as annex.
//!
//! One content (`content`, its tables in `blocks`) from what is kept of the cycle (`sources`), drawn twice. Decides nothing: every word and number stands in the
//! record already.

mod blocks;
mod content;
mod grids;
mod html;
mod layout;
mod numbers;
mod pdf;
mod sources;

pub use blocks::Block;
pub use content::Sheet;
pub use grids::{GridMap, GridState};
pub use html::html;
pub use pdf::{Attached, PdfError, pdf};
pub use sources::{EarlierCycle, Equipment, LastVerification, Signatory, Sources};

#[cfg(test)]
mod tests;
