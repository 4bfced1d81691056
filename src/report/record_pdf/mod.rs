//! The record of a cycle on one page to read and to sign, as HTML and as PDF; content that has no room on it
//! follows as annex.
//!
//! One content (`content`, its tables in `blocks`) from the kept data of the cycle (`sources`), drawn twice.
//! Decides nothing: every word and number is already in the record.

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
