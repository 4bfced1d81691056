//! An open store: its database, the files beside it, and the state shared by its parts.

use super::blobs::Blobs;
use super::error::StoreError;
use super::fold::JournalFold;
use super::fullness::{BlobWriter, DiskFullness};
use super::head::HeadFile;
use super::lease::WriteLease;
use super::reserve::ReserveFile;
use super::steps::Steps;
use rusqlite::Connection;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

pub(super) const DATABASE: &str = "panelprep.sqlite";

/// An open store.
#[derive(Debug)]
pub struct Store {
    pub(super) connection: Connection,
    pub(super) blobs: Blobs,
    pub(super) lease: Option<WriteLease>,
    /// The file of the chain's head; `None` for reading.
    pub(super) head: Option<HeadFile>,
    /// Whether an append failed, so that it is not known whether the journal contains its line.
    pub(super) is_journal_in_doubt: bool,
    /// The folded state of the journal after recovery.
    pub(super) folded_state: Option<JournalFold>,
    /// Changes made outside this program that were found when the store was opened.
    pub(super) external_changes: Vec<String>,
    /// Whether the journal has recorded this change.
    pub(super) is_change_recorded: bool,
    pub(super) reserve: ReserveFile,
    pub(super) fullness: DiskFullness,
    pub(super) clock: fn() -> SystemTime,
    pub(super) steps: Steps,
}

impl Store {
    /// Stores these bytes; [`Store::blob`] finds them by the returned hash. Bytes that exist already are stored
    /// once.
    ///
    /// # Errors
    /// If the store is open for reading, or the file cannot be written, or exists already and is damaged.
    pub fn store_blob(&self, bytes: &[u8]) -> Result<String, StoreError> {
        self.require_writable()?;
        self.blobs.store_bytes(bytes).map_err(|error| self.full_disk_or(error))
    }

    /// Returns a writer for files of this store, for use beside the store's writer on a separate thread. A file that
    /// no row names has no effect.
    ///
    /// # Errors
    /// If the store is open for reading.
    pub fn blob_writer(&self) -> Result<BlobWriter, StoreError> {
        self.require_writable()?;
        Ok(BlobWriter::new(&self.blobs, &self.fullness))
    }

    /// The bytes with this hash.
    ///
    /// # Errors
    /// If the file is missing or no longer has this hash.
    pub fn blob(&self, hash: &str) -> Result<Vec<u8>, StoreError> {
        self.blobs.get(hash)
    }

    /// Returns the free space on the store's disk, MB, after a probe was written to the disk.
    ///
    /// # Errors
    /// If the store is open for reading, or its disk refuses.
    pub fn free_mb(&self) -> Result<u64, StoreError> {
        self.require_writable()?;
        self.blobs.free_mb()
    }

    pub(super) fn require_writable(&self) -> Result<(), StoreError> {
        match self.lease {
            Some(_) => Ok(()),
            None => Err(StoreError::ReadOnly { path: self.path().to_owned() }),
        }
    }

    /// The changes made outside this program that were found when the store was opened for writing, as text.
    pub fn changed(&self) -> &[String] {
        &self.external_changes
    }

    /// Returns the present time, s since 1970. The time only labels rows: it affects no decision, and a wrong clock
    /// stops nothing.
    pub(super) fn unix_s(&self) -> i64 {
        unix_ms(self.clock()).div_euclid(1_000)
    }

    pub(super) fn clock(&self) -> SystemTime {
        (self.clock)()
    }

    /// Converts the error of a file that was not written on a full disk to the error of the full disk.
    pub(super) fn full_disk_or(&self, error: StoreError) -> StoreError {
        match error {
            StoreError::File { source, .. } if source.kind() == std::io::ErrorKind::StorageFull => {
                self.fullness.mark_full();
                self.disk_full_error()
            }
            other => other,
        }
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        self.path().parent().unwrap_or(Path::new("."))
    }

    pub(super) fn path(&self) -> &Path {
        Path::new(self.connection.path().unwrap_or(DATABASE))
    }

    /// Returns whether the table exists: a store of an earlier version of this program that is open read-only lacks
    /// some tables.
    pub(super) fn has_table(&self, name: &str) -> Result<bool, StoreError> {
        let there = self.connection.table_exists(None, name);
        there.map_err(|error| self.database_error("read the tables of", &error))
    }

    pub(super) fn database_error(&self, doing: &'static str, error: &rusqlite::Error) -> StoreError {
        StoreError::database(doing, self.path(), error)
    }
}

/// Returns ms since 1970; negative for earlier times.
pub(super) fn unix_ms(time: SystemTime) -> i64 {
    let ms = |span: std::time::Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX);
    match time.duration_since(UNIX_EPOCH) {
        Ok(since) => ms(since),
        Err(before) => -ms(before.duration()),
    }
}
