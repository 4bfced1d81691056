//! The office's archive: it receives from the broker what the cells send, and stores the records in PostgreSQL and the
//! files in a folder. It reports to each cell up to which number it has everything. Later it proves that nothing is
//! missing, changed or contradictory.
//!
//! ```text
//! cell ─▶ broker ─▶ `receiving`: parts put together, messages read and verified
//!                       ├─▶ `files`: a file under its SHA-256, whole or not there
//!                       └─▶ `message_rows`: all rows of a batch in one transaction
//!                               └─▶ only then: acknowledged to the broker, reported to the cell
//! ```
//!
//! Data that arrives twice is stored once. If it arrives twice with different content, the second content is stored as
//! a contradiction beside the first. Tables that pages read (`cycles`, `quantities`, `verifications`) are made from
//! the records in the same transaction, and can be made again from them.

mod checking;
mod database;
mod files;
mod message_rows;
pub mod reading;
mod receiving;

pub use checking::{CellList, CheckedCell, check_archive};
pub use database::ArchiveError;
pub use receiving::{publish_offer, run};
