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
//! such failure: the reserve is given up, and the journal goes on until the cell rests (`reserve`).

mod blobs;
mod chain;
mod checkpoints;
mod commit;
mod contacts;
mod copy;
mod cycles;
mod discs;
mod error;
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
mod teaching;
mod verifications;
mod verify;

pub use blobs::{BlobWriter, free_mb};
pub use copy::{BLOBS, Copied, ROW_FILES};
pub use cycles::CycleStart;
pub use error::StoreError;
pub use incidents::Incident;
pub use lease::Lease;
pub use prune::Pruned;
pub use teaching::{Taught, TaughtCorner, Teaching};
pub use verifications::calibration_hash;
pub use verify::Verified;

use blobs::Blobs;
use commit::Steps;
use head::HeadFile;
use motions::Settled;
use reserve::{Fullness, Reserve};
use rusqlite::Connection;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

const DATABASE: &str = "panelprep.sqlite";

/// An open store.
#[derive(Debug)]
pub struct Store {
    connection: Connection,
    blobs: Blobs,
    lease: Option<Lease>,
    /// Where the chain's head is written; none for reading.
    head: Option<HeadFile>,
    /// An append failed; the journal may or may not hold its line.
    journal_in_doubt: bool,
    /// What the journal folds to, once it was recovered.
    folded: Option<Settled>,
    /// What was found changed behind the program's back when the store was opened.
    changed: Vec<String>,
    /// The journal says so.
    change_is_told: bool,
    reserve: Reserve,
    fullness: Fullness,
    clock: fn() -> SystemTime,
    steps: Steps,
}

impl Store {
    /// Keeps these bytes; the hash is what [`Store::blob`] finds them by. Bytes that are there already are kept once.
    ///
    /// # Errors
    /// Where the store is open for reading, or the file cannot be written, or is there already and damaged.
    pub fn put_blob(&self, bytes: &[u8]) -> Result<String, StoreError> {
        self.writable()?;
        self.blobs.put(bytes).map_err(|error| self.full_or(error))
    }

    /// Whatever writes files of this store beside its writer, on a thread of its own. What no row names is only a file.
    ///
    /// # Errors
    /// Where the store is open for reading.
    pub fn blob_writer(&self) -> Result<BlobWriter, StoreError> {
        self.writable()?;
        Ok(self.blobs.writer(&self.fullness))
    }

    /// The bytes with this hash.
    ///
    /// # Errors
    /// Where the file is missing or no longer has this hash.
    pub fn blob(&self, hash: &str) -> Result<Vec<u8>, StoreError> {
        self.blobs.get(hash)
    }

    /// Free space on the store's disk, MB, once a probe could be written to it.
    ///
    /// # Errors
    /// Where the store is open for reading, or its disk refuses.
    pub fn free_mb(&self) -> Result<u64, StoreError> {
        self.writable()?;
        self.blobs.free_mb()
    }

    fn writable(&self) -> Result<(), StoreError> {
        match self.lease {
            Some(_) => Ok(()),
            None => Err(StoreError::ReadOnly { path: self.path().to_owned() }),
        }
    }

    /// What was found changed behind the program's back when the store was opened for writing, in words.
    pub fn changed(&self) -> &[String] {
        &self.changed
    }

    /// Now, s since 1970: a label on rows; nothing is decided by it, and a clock that is wrong stops nothing.
    fn unix_s(&self) -> i64 {
        unix_ms(self.clock()).div_euclid(1_000)
    }

    fn clock(&self) -> SystemTime {
        (self.clock)()
    }

    /// A file that found no place, as the full disk that it is.
    fn full_or(&self, error: StoreError) -> StoreError {
        match error {
            StoreError::File { source, .. } if source.kind() == std::io::ErrorKind::StorageFull => {
                self.fullness.fill();
                self.full()
            }
            other => other,
        }
    }

    fn folder(&self) -> &Path {
        self.path().parent().unwrap_or(Path::new("."))
    }

    fn path(&self) -> &Path {
        Path::new(self.connection.path().unwrap_or(DATABASE))
    }

    fn failed(&self, doing: &'static str, error: &rusqlite::Error) -> StoreError {
        StoreError::database(doing, self.path(), error)
    }
}

/// ms since 1970; before it they are negative.
fn unix_ms(time: SystemTime) -> i64 {
    let ms = |span: std::time::Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX);
    match time.duration_since(UNIX_EPOCH) {
        Ok(since) => ms(since),
        Err(before) => -ms(before.duration()),
    }
}

#[cfg(test)]
pub(crate) mod tests;
