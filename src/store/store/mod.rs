//! The store: taught panels, cycles, the journal of every event, and the files that all of these name.
//!
//! It is a folder with `panelprep.sqlite` (WAL, synchronous FULL), `panelprep.head` (the chain's head),
//! `panelprep.reserve` (disk space for the journal on a full disk), `panelprep.lock` (the writing process) and
//! `record-key.pem` (the key that signs records, if no other is configured). Its folder `blobs/` holds scans, pictures,
//! recipes and calibrations under their SHA-256. Blobs are written first, and the row that names them last, in one
//! transaction: a row never names an incomplete file. Rows of taught panels, findings, journal, requests, contact paths
//! and permits are never changed; the end of a cycle and of a motion is written once. Each row is part of a chain of
//! hashes (`chain`); the head of the chain is also kept outside of the database (`head`). Changed, deleted, reordered
//! or rolled-back rows are detected (`verify`). Only the table of parts is not in the chain: it is an index over texts
//! that are in the chain, and is compared with them. Of a panel only raw inputs are stored; other modules derive all
//! other data from them when they are loaded.
//!
//! The journal is written before effects: [`Store::append`] returns when the event is on the disk. After a failed
//! append nothing more is appended, since it is unknown whether the line was written; the next process determines this.
//! A full disk is not such a failure: the reserve is released, and the journal continues until the cell is at rest
//! (`fullness`).

mod alarms;
mod blobs;
mod chain;
mod commit;
mod copy;
mod cycles;
mod database;
mod error;
mod flush;
mod fullness;
mod head;
mod journal;
mod key_file;
mod lease;
mod motions;
mod opening;
mod outbox;
mod people;
mod prune;
mod requests;
mod restores;
mod schema;
mod search;
mod signatures;
mod teaching;
mod verifications;
mod verify;

pub use blobs::{Blobs, free_mb};
pub use copy::{BLOBS, CopiedStore, ROW_FILES};
pub use cycles::{CycleCounts, CycleStart, PassesOfCycle};
pub use database::Store;
pub use error::{StoreError, UnknownPassCount};
pub use fullness::BlobWriter;
pub use key_file::{KeyLocation, cell_key, public_keys};
pub use lease::WriteLease;
pub use people::{Incident, NumberedEntry, TrailPosition};
pub use prune::PrunedFiles;
pub use requests::{NumberedRequest, ProofsPage};
pub use restores::Restore;
pub use signatures::{PersonSigningRequest, SignatureRow};
pub use teaching::{StoredTeaching, TaughtCorner, TeachingInputs};
pub use verifications::calibration_hash;
pub use verify::StoreVerification;

#[cfg(any(test, feature = "testing"))]
#[cfg_attr(feature = "testing", allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]
pub mod testing {
    //! Functions that the tests of other crates need.

    use super::Store;
    use std::time::SystemTime;

    /// Sets the clock for the times in the rows of a store.
    pub fn set_clock(store: &mut Store, clock: fn() -> SystemTime) {
        store.clock = clock;
    }
}
#[cfg(test)]
pub(crate) mod tests;
