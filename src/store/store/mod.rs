//! The store: taught panels, cycles, the journal of all events, and the files that they name.
//!
//! The store is a folder with `panelprep.sqlite` (WAL, synchronous FULL), `panelprep.head` (the head of the hash
//! chain), `panelprep.reserve` (disk space for the journal on a full disk), `panelprep.lock` (the writing process),
//! `record-key.pem` (the key that signs records, if no other file is configured), and the folder `blobs/` with scans,
//! pictures, recipes and calibrations, each named by its SHA-256. A file is written before the row that names it, so
//! that a row never names an incomplete file. Rows of taught panels, findings, journal, requests, contact paths and
//! permits are never changed; the end of a cycle or a motion is written once. Each row is part of a hash chain
//! (`chain`), whose head is also stored outside of the database (`head`). Therefore changed, deleted, reordered and
//! rolled-back rows are detected (`verify`). Only the table of parts is not in the chain: it is an index of texts that
//! are in the chain, and is compared with them. For a panel, only the original inputs are stored; other modules compute
//! all further data when they load the panel.
//!
//! The journal is written before effects: [`Store::append`] returns when the event is on the disk. After a failed
//! append no further event is written, because it is unknown whether the line was written; the next process finds out.
//! A full disk is handled differently: the reserve is released, and the journal is written until the cell is at rest
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
    //! Functions for tests of other crates.

    use super::Store;
    use std::time::SystemTime;

    /// Sets the clock from which a store takes the times in its rows.
    pub fn set_clock(store: &mut Store, clock: fn() -> SystemTime) {
        store.clock = clock;
    }
}
#[cfg(test)]
pub(crate) mod tests;
