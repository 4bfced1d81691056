//! The record of a cycle on one page, to read and to sign, as HTML and as PDF; content that does not fit on the page
//! follows as an annex.
//!
//! The content (`content`, its tables in `blocks`) is created once from the stored data of the cycle (`sources`), and
//! is drawn in both formats. Nothing is decided here: every word and number is already in the record.

mod blocks;
mod content;
mod grids;
mod html;
mod layout;
mod numbers;
mod pdf;
mod sources;

pub use blocks::Block;
pub use content::RecordSheet;
pub use grids::{GridMap, GridState};
pub use html::html;
pub use pdf::{AttachedFile, PdfError, pdf};
pub use sources::{EarlierCycle, Equipment, LastVerification, PrintedSignature, RecordSources};

#[cfg(test)]
mod tests;
