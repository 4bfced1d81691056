//! What is remembered: taught panels, cycles, the journal of every event, and the files that all of it names.
//!
//! A folder with `panelprep.sqlite` (WAL, synchronous FULL), `panelprep.lock` (one writer) and `blobs/`, where scans,
//! pictures, recipes and calibrations lie under their SHA-256. Blobs are written first, the row that names them last
//! and in one transaction: a row never names a file that is not whole. Rows of taught panels, findings, journal,
//! requests, contact paths and permits are never changed; a cycle and a motion get their end once. Of a panel only raw inputs are kept; what is derived from
//! them is derived again on loading, by others.
//!
//! The journal stands before effects: [`Store::append`] returns when the event is on the disk. After a failed append
//! nothing more is appended, since nobody knows whether the line is there; the next process finds out.

mod blobs;
mod contacts;
mod cycles;
mod discs;
mod error;
mod journal;
mod lease;
mod motions;
mod requests;
mod schema;
mod teaching;
mod verifications;

pub use blobs::{BlobWriter, free_mb};
pub use cycles::CycleStart;
pub use error::StoreError;
pub use teaching::{Taught, TaughtCorner, Teaching};
pub use verifications::calibration_hash;

use blobs::Blobs;
use lease::Lease;
use rusqlite::{Connection, OpenFlags};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

const DATABASE: &str = "panelprep.sqlite";

/// An open store.
#[derive(Debug)]
pub struct Store {
    connection: Connection,
    blobs: Blobs,
    lease: Option<Lease>,
    /// An append failed; the journal may or may not hold its line.
    journal_in_doubt: bool,
}

impl Store {
    /// Opens the store in this folder for reading, beside a writer too. Nothing is made or changed.
    ///
    /// # Errors
    /// Where there is no store, it is damaged, or it is that of a newer program or of another one.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let path = folder.join(DATABASE);
        if !path.is_file() {
            return Err(StoreError::Missing { path: folder.to_owned() });
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(&path, flags)
            .map_err(|error| StoreError::database("open", &path, &error))?;
        if schema::version(&connection, &path)? == 0 {
            return Err(StoreError::Missing { path: folder.to_owned() });
        }
        schema::check(&connection, &path)?;
        Ok(Store { connection, blobs: Blobs::at(folder), lease: None, journal_in_doubt: false })
    }

    /// Opens the store in this folder for writing, as the only writer; an empty or absent folder becomes a new one, and
    /// an earlier program's store is brought up to date.
    ///
    /// # Errors
    /// Where another process writes to it, the folder cannot be written, or the store is damaged, that of a newer
    /// program or of another one.
    pub fn create(folder: &Path) -> Result<Self, StoreError> {
        let blobs = Blobs::create(folder)?;
        let lease = Lease::take(folder)?;
        let path = folder.join(DATABASE);
        let failed = |error: rusqlite::Error| StoreError::database("open", &path, &error);
        let mut connection = Connection::open(&path).map_err(failed)?;
        schema::version(&connection, &path)?;
        schema::check(&connection, &path)?;
        schema::prepare(&mut connection).map_err(failed)?;
        Ok(Store { connection, blobs, lease: Some(lease), journal_in_doubt: false })
    }

    /// Keeps these bytes; the hash is what [`Store::blob`] finds them by. Bytes that are there already are kept once.
    ///
    /// # Errors
    /// Where the store is open for reading, or the file cannot be written, or is there already and damaged.
    pub fn put_blob(&self, bytes: &[u8]) -> Result<String, StoreError> {
        self.writable()?;
        self.blobs.put(bytes)
    }

    /// Whatever writes files of this store beside its writer, on a thread of its own. What no row names is only a file.
    ///
    /// # Errors
    /// Where the store is open for reading.
    pub fn blob_writer(&self) -> Result<BlobWriter, StoreError> {
        self.writable()?;
        Ok(self.blobs.writer())
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

    fn path(&self) -> &Path {
        Path::new(self.connection.path().unwrap_or(DATABASE))
    }

    fn failed(&self, doing: &'static str, error: &rusqlite::Error) -> StoreError {
        StoreError::database(doing, self.path(), error)
    }
}

/// Time since 1970, a label on rows; nothing is decided by it.
fn now() -> Result<std::time::Duration, StoreError> {
    SystemTime::now().duration_since(UNIX_EPOCH).map_err(|_| StoreError::Clock)
}

#[cfg(test)]
mod tests;
