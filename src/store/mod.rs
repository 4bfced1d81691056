//! What is remembered: taught panels, cycles, the journal of every event, and the files that all of it names.
//!
//! A folder with `panelprep.sqlite` (WAL, synchronous FULL), `panelprep.head` (the chain's head), `panelprep.reserve` (room
//! for the journal on a full disk), `panelprep.lock` (who writes) and `blobs/`, where scans, pictures, recipes and
//! calibrations lie under their SHA-256. Blobs are written first, the row that names them last and in one transaction: a
//! row never names a file that is not whole. Rows of taught panels, findings, journal, requests, contact
//! paths and permits are never changed; a cycle and a
//! motion get their end once. Each row is in a chain of hashes (`chain`), whose head also stands outside of the database
//! (`head`): what was changed, deleted, reordered or rolled back is found (`verify`). Of a panel only raw inputs are kept;
//! what is derived from them is derived again on loading, by others.
//!
//! The journal stands before effects: [`Store::append`] returns when the event is on the disk. After a failed append
//! nothing more is appended, since nobody knows whether the line is there; the next process finds out. A full disk is no
//! such failure: the reserve is given up, and the journal goes on until the cell rests (`reserve`, `full_disk`).

mod blobs;
mod chain;
mod checkpoints;
mod commit;
mod contacts;
mod copy;
mod cycles;
mod database;
mod database_files;
mod discs;
mod error;
mod fold;
mod full_disk;
mod fullness;
mod head;
mod incidents;
mod journal;
mod lease;
mod motions;
mod opening;
mod prune;
mod requests;
mod reserve;
mod schema;
mod steps;
mod teaching;
mod verifications;
mod verify;

pub use blobs::free_mb;
pub use copy::{BLOBS, Copied, ROW_FILES};
pub use cycles::CycleStart;
pub use database::Store;
pub use error::StoreError;
pub use fullness::BlobWriter;
pub use incidents::Incident;
pub use lease::Lease;
pub use prune::Pruned;
pub use teaching::{Taught, TaughtCorner, Teaching};
pub use verifications::calibration_hash;
pub use verify::Verified;

#[cfg(test)]
pub(crate) mod tests;
