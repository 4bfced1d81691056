//! Handling of a full disk: pictures are dropped first, because the remaining space is needed for the journal.
//!
//! The reserve is a file that is deleted when the disk is full, so that the journal can be written until the cell is at
//! rest.

use super::blobs::Blobs;
use super::error::StoreError;
use super::{blobs, flush};
use rusqlite::ErrorCode;
use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Minimum free space at which pictures are written, MB; less space is kept for the journal.
const MIN_FREE_FOR_PICTURES_MB: u64 = 64;

/// Whether a writer of the store has found the disk to be full. Clones share the same state.
#[derive(Debug, Clone, Default)]
pub(super) struct DiskFullness(Arc<FullnessState>);

#[derive(Debug, Default)]
struct FullnessState {
    is_full: AtomicBool,
    /// Number of pictures that were dropped since the last query.
    dropped: AtomicU64,
}

impl DiskFullness {
    pub fn mark_full(&self) {
        self.0.is_full.store(true, Ordering::Relaxed);
    }

    pub fn is_disk_full(&self) -> bool {
        self.0.is_full.load(Ordering::Relaxed)
    }

    pub fn clear_full(&self) {
        self.0.is_full.store(false, Ordering::Relaxed);
    }

    /// Returns the number of pictures that were dropped since the last call.
    pub fn take_dropped_count(&self) -> u64 {
        self.0.dropped.swap(0, Ordering::Relaxed)
    }

    /// Stores a picture, or drops it if the disk is full, because the remaining space is needed for the journal.
    pub fn store_picture(&self, blobs: &Blobs, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        if !self.is_disk_full() && is_too_full_for_pictures(blobs.store()) {
            self.mark_full();
        }
        // A dropped picture is only counted and reported, but a line of the journal that cannot be written would stop
        // the cell.
        let kept = if self.is_disk_full() { Ok(None) } else { blobs.store_bytes(bytes).map(Some) };
        let kept = match kept {
            Err(StoreError::File { source, .. }) if source.kind() == ErrorKind::StorageFull => {
                self.mark_full();
                Ok(None)
            }
            kept => kept,
        };
        if matches!(kept, Ok(None)) {
            self.0.dropped.fetch_add(1, Ordering::Relaxed);
        }
        kept
    }
}

/// Returns whether the free space on the disk of this folder is too small for pictures.
fn is_too_full_for_pictures(folder: &Path) -> bool {
    blobs::free_mb(folder).is_ok_and(|free| free < MIN_FREE_FOR_PICTURES_MB)
}

/// A writer for files of a store, used in another thread than the store's writer.
#[derive(Debug)]
pub struct BlobWriter(Blobs, DiskFullness);

impl BlobWriter {
    pub(super) fn new(blobs: &Blobs, fullness: &DiskFullness) -> Self {
        BlobWriter(blobs.clone(), fullness.clone())
    }

    /// Stores a picture as [`Store::store_picture`](super::Store::store_picture) does.
    ///
    /// # Errors
    /// If the file cannot be written for a reason other than a full disk, or already exists and is damaged.
    pub fn store_picture(&self, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        self.1.store_picture(&self.0, bytes)
    }
}

/// File name of the reserve.
const RESERVE_FILE: &str = "panelprep.reserve";
/// Size of the reserve, MB. A line of the journal needs at most 16 kB in the database's write-ahead log, so the reserve
/// is sufficient for 2,000 lines. A retract, a hold and a stop need fewer than 100 lines.
pub(super) const RESERVE_MB: u64 = 32;
/// Minimum free space at which the disk is no longer treated as full, MB: for the reserve and for pictures.
pub(super) const MIN_FREE_TO_CONTINUE_MB: u64 = RESERVE_MB + MIN_FREE_FOR_PICTURES_MB;
/// Minimum free space at which a program starts with a store without a reserve, MB. With less space, the journal could
/// fill the disk before the cell is at rest.
const MIN_FREE_FOR_JOURNAL_MB: u64 = 8;
/// Free space below which an ambiguous error of SQLite is treated as a full disk, bytes.
const MIN_FREE_BYTES: u64 = 1_000_000;

/// The reserve: a file that is deleted when the disk is full.
#[derive(Debug)]
pub(super) struct ReserveFile {
    path: PathBuf,
}

impl ReserveFile {
    pub fn new(store: &Path) -> Self {
        ReserveFile { path: store.join(RESERVE_FILE) }
    }

    /// Allocates the disk space of the reserve, unless it is already allocated.
    pub fn allocate(&self) -> std::io::Result<()> {
        let bytes = RESERVE_MB << 20;
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(&self.path)?;
        if file.metadata()?.len() == bytes {
            return Ok(());
        }
        let taken = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes);
        let taken = taken.map_err(std::io::Error::from).and_then(|()| file.sync_all());
        if taken.is_err() {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "a partial reserve would only use disk space that other files need"
            )]
            let _ = fs::remove_file(&self.path);
        }
        taken
    }

    /// Deletes the reserve, and returns whether it existed.
    pub fn release(&self) -> bool {
        let released = fs::remove_file(&self.path).is_ok();
        if released && let Some(folder) = self.path.parent() {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "the space is free after the folder is flushed; if that fails, the next write reports it"
            )]
            let _ = flush::flush_folder(folder);
        }
        released
    }
}

/// Returns whether the cause of a database error is a full disk.
pub(super) fn is_disk_full_error(error: &rusqlite::Error, folder: &Path) -> bool {
    match error.sqlite_error_code() {
        Some(ErrorCode::DiskFull) => true,
        // On a full disk, SQLite may also report an I/O error of its log or its shared-memory file.
        Some(ErrorCode::SystemIoFailure | ErrorCode::CannotOpen) => has_no_space(folder),
        _ => false,
    }
}

/// Returns whether the free space on the disk is too small for the files that SQLite creates.
pub(super) fn has_no_space(folder: &Path) -> bool {
    blobs::free_bytes(folder).is_ok_and(|free| free < MIN_FREE_BYTES)
}

/// Returns whether the free space on the disk of this folder is too small for the journal.
pub(super) fn is_too_full_for_journal(folder: &Path) -> bool {
    blobs::free_mb(folder).is_ok_and(|free| free < MIN_FREE_FOR_JOURNAL_MB)
}

/// Returns the error of a full disk, which names the files to delete.
pub(super) fn disk_full_error(folder: &Path) -> StoreError {
    let free = match blobs::free_mb(folder) {
        Ok(free_mb) => format!("{free_mb} MB free"),
        Err(error) => format!("the free space cannot be read: {error}"),
    };
    StoreError::Full { path: folder.to_owned(), free, minimum_mb: MIN_FREE_TO_CONTINUE_MB, advice: advice(folder) }
}

/// Returns which files may be deleted, as an instruction.
fn advice(folder: &Path) -> String {
    let recordings = folder.join("recordings");
    let files = fs::read_dir(&recordings).into_iter().flatten().flatten();
    let sizes: Vec<u64> = files.filter_map(|file| Some(file.metadata().ok()?.len())).collect();
    let mb = sizes.iter().sum::<u64>() / 1_000_000;
    let recordings = match sizes.len() {
        0 => "files of other programs on this disk".to_owned(),
        count => {
            format!("recordings that are no longer needed ({count} files, {mb} MB, in {})", recordings.display())
        }
    };
    format!(
        "delete {recordings}, or set [store] keep in the cell's file, which removes clips and scans of old cycles; \
         nothing else in the store may be deleted"
    )
}
