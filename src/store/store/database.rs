//! An open store: its database, the files beside it, and the state shared by its parts.
//!
//! This state includes the state of motions and cycles according to the journal (its events, folded by the cycle's
//! state machine), the behaviour while the disk is full with the check whether there is space again, and the steps of
//! a transaction at which tests look at the files.

use super::blobs::Blobs;
use super::error::StoreError;
use super::fullness::{self, BlobWriter, DiskFullness, ROOM_MB, ReserveFile};
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

    /// Returns whether the disk was found full since [`Store::has_free_space`] last found space.
    pub fn is_disk_full(&self) -> bool {
        self.fullness.is_disk_full()
    }

    /// Stores a picture as [`Store::store_blob`] does. If the disk is full, the picture is dropped and the result is
    /// `None`: the remaining space is for the journal.
    ///
    /// # Errors
    /// As [`Store::store_blob`], except for a full disk.
    pub fn store_picture(&self, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        self.require_writable()?;
        self.fullness.store_picture(&self.blobs, bytes)
    }

    /// The number of pictures dropped since the last call.
    pub fn dropped_pictures(&self) -> u64 {
        self.fullness.take_dropped_count()
    }

    /// Returns whether there is room for the reserve and pictures again; if so, the reserve is allocated.
    pub fn has_free_space(&mut self) -> bool {
        let free = self.blobs.free_mb().unwrap_or(0);
        let has_room = free >= ROOM_MB && self.reserve.allocate().is_ok();
        if has_room {
            self.fullness.clear_full();
        }
        has_room
    }

    /// Returns the error of the full disk, with the files to delete.
    pub fn disk_full_error(&self) -> StoreError {
        fullness::disk_full_error(self.folder())
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

/// A motion with its outcome and its number of executed waypoints.
pub(super) type MotionEnd = (Motion, Outcome, u32);

/// The content of a journal about motions and cycles, as far as it was read.
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

    /// The state at the end of the journal.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the state after the next start of the program.
    pub fn after_restart(&self) -> State {
        step(self.state, Event::Reported(Report::Boot)).0
    }
}

/// Moments at which a process may end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    Prepared,
    Committed,
    Settled,
}

/// A hook with which tests look at the files at each step; the program does not use it.
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
