//! An open store: its database, the files beside it, and its common state.
//!
//! The common state contains the state of motions and cycles according to the journal (its events, applied to the
//! cycle's state table), whether the disk is full, and the steps of a transaction at which tests inspect the files.

use super::blobs::Blobs;
use super::error::StoreError;
use super::fullness::{self, BlobWriter, DiskFullness, MIN_FREE_TO_CONTINUE_MB, ReserveFile};
use super::head::HeadFile;
use super::lease::WriteLease;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{Effect, Event, Motion, Outcome, Report, State, step};
use panelprep_cell::record::CycleId;
use rusqlite::Connection;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

pub(super) const DATABASE: &str = "panelprep.sqlite";

/// A store that is open for reading or writing.
#[derive(Debug)]
pub struct Store {
    pub(super) connection: Connection,
    pub(super) blobs: Blobs,
    pub(super) lease: Option<WriteLease>,
    /// The file of the chain's head; `None` if the store is open for reading only.
    pub(super) head: Option<HeadFile>,
    /// Whether an append to the journal failed in a way that leaves unknown whether the line was written.
    pub(super) is_journal_in_doubt: bool,
    /// The state computed from the journal, after recovery.
    pub(super) folded_state: Option<JournalFold>,
    /// Changes by other programs that were found when the store was opened.
    pub(super) external_changes: Vec<String>,
    /// Whether the journal already contains the event about these changes.
    pub(super) is_change_recorded: bool,
    pub(super) reserve: ReserveFile,
    pub(super) fullness: DiskFullness,
    pub(super) clock: fn() -> SystemTime,
    pub(super) steps: Steps,
}

impl Store {
    /// Stores bytes in a file, and returns their hash, with which [`Store::blob`] returns the bytes. Equal bytes are
    /// stored only once.
    ///
    /// # Errors
    /// If the store is open for reading only, or the file cannot be written, or already exists and is damaged.
    pub fn store_blob(&self, bytes: &[u8]) -> Result<String, StoreError> {
        self.require_writable()?;
        self.blobs.store_bytes(bytes).map_err(|error| self.full_disk_or(error))
    }

    /// Returns a writer for files of this store, for use in another thread while this store is written. A file has no
    /// effect as long as no row names it.
    ///
    /// # Errors
    /// If the store is open for reading only.
    pub fn blob_writer(&self) -> Result<BlobWriter, StoreError> {
        self.require_writable()?;
        Ok(BlobWriter::new(&self.blobs, &self.fullness))
    }

    /// Returns the bytes with this hash.
    ///
    /// # Errors
    /// If the file is missing, or its content was changed.
    pub fn blob(&self, hash: &str) -> Result<Vec<u8>, StoreError> {
        self.blobs.get(hash)
    }

    /// Writes a test file to the disk of the store, and returns the free space, MB.
    ///
    /// # Errors
    /// If the store is open for reading only, or its disk cannot be written.
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

    /// Returns the changes by other programs that were found when the store was opened for writing, as texts.
    pub fn changed(&self) -> &[String] {
        &self.external_changes
    }

    /// Returns the present time, s since 1970. Times in rows are for information only: no decision depends on them, so
    /// that a wrong clock has no effect.
    pub(super) fn unix_s(&self) -> i64 {
        unix_ms(self.clock()).div_euclid(1_000)
    }

    pub(super) fn clock(&self) -> SystemTime {
        (self.clock)()
    }

    /// Converts an error whose cause is a full disk to the error of the full disk; returns any other error unchanged.
    pub(super) fn full_disk_or(&self, error: StoreError) -> StoreError {
        match error {
            StoreError::File { source, .. } if source.kind() == std::io::ErrorKind::StorageFull => {
                self.fullness.mark_full();
                self.disk_full_error()
            }
            other => other,
        }
    }

    /// Returns the folder of the store.
    pub fn folder(&self) -> &Path {
        self.path().parent().unwrap_or(Path::new("."))
    }

    pub(super) fn path(&self) -> &Path {
        Path::new(self.connection.path().unwrap_or(DATABASE))
    }

    pub(super) fn database_error(&self, doing: &'static str, error: &rusqlite::Error) -> StoreError {
        StoreError::database(doing, self.path(), error)
    }

    /// Returns whether the disk was found to be full, and no free space has been found by [`Store::has_free_space`]
    /// since.
    pub fn is_disk_full(&self) -> bool {
        self.fullness.is_disk_full()
    }

    /// Stores a picture as [`Store::store_blob`] does. If the disk is full, the picture is dropped and `None` is
    /// returned, because the remaining space is needed for the journal.
    ///
    /// # Errors
    /// The errors of [`Store::store_blob`], except a full disk.
    pub fn store_picture(&self, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        self.require_writable()?;
        self.fullness.store_picture(&self.blobs, bytes)
    }

    /// Returns the number of pictures that were dropped since the last call.
    pub fn dropped_pictures(&self) -> u64 {
        self.fullness.take_dropped_count()
    }

    /// Allocates the reserve again, and returns whether there is enough space for it and for pictures.
    pub fn has_free_space(&mut self) -> bool {
        let free = self.blobs.free_mb().unwrap_or(0);
        let has_room = free >= MIN_FREE_TO_CONTINUE_MB && self.reserve.allocate().is_ok();
        if has_room {
            self.fullness.clear_full();
        }
        has_room
    }

    /// Returns the error of a full disk, which names the files to delete.
    pub fn disk_full_error(&self) -> StoreError {
        fullness::disk_full_error(self.folder())
    }
}

/// Returns a time as ms since 1970; negative for earlier times.
pub(super) fn unix_ms(time: SystemTime) -> i64 {
    let ms = |span: std::time::Duration| i64::try_from(span.as_millis()).unwrap_or(i64::MAX);
    match time.duration_since(UNIX_EPOCH) {
        Ok(since) => ms(since),
        Err(before) => -ms(before.duration()),
    }
}

/// A motion with its outcome and the number of its executed waypoints.
pub(super) type MotionEnd = (Motion, Outcome, u32);

/// The state of motions and cycles, computed from the lines of the journal so far.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JournalFold {
    pub(super) state: State,
    pub(super) closed: Option<MotionEnd>,
    pub(super) concluded: Option<(Option<CycleId>, Verdict)>,
    pub(super) cycle: Option<CycleId>,
}

impl JournalFold {
    pub const INITIAL: JournalFold =
        JournalFold { state: State::INITIAL, closed: None, concluded: None, cycle: None };

    pub fn step(&mut self, event: Event, cycle: Option<CycleId>) {
        let (state, effects) = step(self.state, event);
        self.state = state;
        self.cycle = cycle;
        for effect in effects {
            match effect {
                Effect::CloseIntent { motion, outcome, done } => self.closed = Some((motion, outcome, done)),
                Effect::Conclude { verdict } => self.concluded = Some((cycle, verdict)),
                _ => {}
            }
        }
    }

    /// Returns the state after the last line of the journal.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the state after a restart of the program.
    pub fn after_restart(&self) -> State {
        step(self.state, Event::Reported(Report::Boot)).0
    }
}

/// The steps of a transaction. The process may end between any two steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    Prepared,
    Committed,
    Settled,
}

/// A function that a test calls at each step to inspect the files; without a test there is none.
#[derive(Default)]
pub(super) struct Steps {
    #[cfg(test)]
    pub told: Option<Box<dyn Fn(Step) + Send>>,
}

impl std::fmt::Debug for Steps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Steps")
    }
}

impl Steps {
    #[cfg_attr(not(test), expect(clippy::unused_self, reason = "only tests look"))]
    pub fn reach(&self, step: Step) {
        #[cfg(test)]
        if let Some(told) = &self.told {
            told(step);
        }
        let _ = step;
    }
}
