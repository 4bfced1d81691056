//! The archive on the office server. It receives from the broker what the cells send, stores the records in PostgreSQL
//! and the files in a folder, and reports to each cell the number up to which all of its records are stored. A later
//! check shows whether anything is missing, changed or contradictory.
//!
//! ```text
//! cell ─▶ broker ─▶ `receiving`: parts put together, messages read and verified
//!                       ├─▶ `files`: a file under its SHA-256, whole or not there
//!                       └─▶ `message_rows`: all rows of a batch in one transaction
//!                               └─▶ only then: acknowledged to the broker, reported to the cell
//! ```
//!
//! Data that arrive twice are stored once. If they arrive again with other content, the second content is stored as a
//! contradiction beside the first. The tables for the pages (`cycles`, `quantities`, `verifications`) are computed from
//! the records in the same transaction, and can be computed again.

mod checking;
mod database;
mod files;
mod message_rows;
pub mod reading;
mod receiving;

pub use checking::{CellList, CheckedCell, check_archive};
pub use database::ArchiveError;
pub use receiving::{publish_offer, run};
