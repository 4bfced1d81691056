//! The record of a cycle on one page to read and to sign, as HTML and as PDF; what it has no room for follows as annex.
//!
//! One content (`content`) from what is kept of the cycle, drawn twice. Decides nothing: every word and number stands in the
//! record already.

mod content;
mod grids;
mod html;
mod layout;
mod numbers;
mod pdf;

pub use content::{Block, EarlierCycle, Equipment, LastVerification, Sheet, Signatory, Sources};
pub use grids::{GridMap, GridState};
pub use html::html;
pub use pdf::{Attached, PdfError, pdf};

#[cfg(test)]
mod tests;
