//! The record of a cycle on one page, for reading and signing, as HTML and as PDF; content that does not fit on the
//! page follows as an annex.
//!
//! The sheet (`sheet`) consists of tables (`tables`). It is created once from the stored data of the cycle and is drawn
//! in both formats. Nothing is decided here: every word and number is already in the record.

mod pdf;
mod sheet;
mod tables;

pub use pdf::{AttachedFile, PdfError, pdf};
pub use sheet::{RecordSheet, html};
pub use tables::{
    Block, EarlierCycle, Equipment, GridMap, GridState, LastVerification, PrintedSignature, RecordSources,
};

#[cfg(test)]
mod tests;
