//! A full disk: pictures are dropped first, then a file that was kept for this is given up, so that the journal goes on
//! until the cell rests.

use super::Store;
use super::blobs::{self, Blobs};
use super::error::StoreError;
use rusqlite::ErrorCode;
use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The file's name.
pub(super) const FILE: &str = "panelprep.reserve";
/// Its size. A line of the journal takes at most 16 kB of the database's log: the reserve is good for 2,000 lines, where a
/// retract, a hold and a stop take less than 100.
pub(super) const MB: u64 = 32;
/// Free disk below which no picture is written any more, MB: the rest is the journal's.
const PICTURES_MB: u64 = 64;
/// Free disk below which no program starts on a store without a reserve, MB: its journal would end before the cell rests.
const JOURNAL_MB: u64 = 8;
/// Free disk at which an error that may have other causes is one of the full disk, bytes.
const NOTHING_BYTES: u64 = 1_000_000;

/// Whether the disk is full, as the store's writers found it. Clones are the same one.
#[derive(Debug, Clone, Default)]
pub(super) struct Fullness(Arc<Found>);

#[derive(Debug, Default)]
struct Found {
    is_full: AtomicBool,
    /// Pictures that found no place since they were last asked for.
    dropped: AtomicU64,
}

impl Fullness {
    pub fn fill(&self) {
        self.0.is_full.store(true, Ordering::Relaxed);
    }

    pub fn is_full(&self) -> bool {
        self.0.is_full.load(Ordering::Relaxed)
    }

    pub fn is_over(&self) {
        self.0.is_full.store(false, Ordering::Relaxed);
    }

    /// Keeps a picture, or drops it where the disk is full: the rest of it is the journal's.
    pub fn put_picture(&self, blobs: &Blobs, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        if !self.is_full() && is_too_full_for_pictures(blobs.store()) {
            self.fill();
        }
        let kept = if self.is_full() { Ok(None) } else { blobs.put(bytes).map(Some) };
        let kept = match kept {
            Err(StoreError::File { source, .. }) if source.kind() == ErrorKind::StorageFull => {
                self.fill();
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

/// The file that is given up when the disk is full.
#[derive(Debug)]
pub(super) struct Reserve {
    path: PathBuf,
}

impl Reserve {
    pub fn of(store: &Path) -> Self {
        Reserve { path: store.join(FILE) }
    }

    /// Takes the disk's blocks, where they are not taken yet.
    pub fn take(&self) -> std::io::Result<()> {
        let bytes = MB << 20;
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(&self.path)?;
        if file.metadata()?.len() == bytes {
            return Ok(());
        }
        let taken = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes);
        let taken = taken.map_err(std::io::Error::from).and_then(|()| file.sync_all());
        if taken.is_err() {
            // Half a reserve takes what others need.
            let _ = fs::remove_file(&self.path);
        }
        taken
    }

    /// Gives it up; false where there was none.
    pub fn release(&self) -> bool {
        let released = fs::remove_file(&self.path).is_ok();
        if released && let Some(folder) = self.path.parent() {
            // The blocks are free once the folder is on the disk; where that fails, the next writing tells.
            let _ = File::open(folder).and_then(|folder| folder.sync_all());
        }
        released
    }
}

/// Whether this error says that the disk is full.
pub(super) fn is_full(error: &rusqlite::Error, folder: &Path) -> bool {
    match error.sqlite_error_code() {
        Some(ErrorCode::DiskFull) => true,
        // Its log and the memory that connections share are files too.
        Some(ErrorCode::SystemIoFailure | ErrorCode::CannotOpen) => nothing_left(folder),
        _ => false,
    }
}

/// Whether a disk has no room for the files that SQLite makes.
pub(super) fn nothing_left(folder: &Path) -> bool {
    blobs::free_bytes(folder).is_ok_and(|free| free < NOTHING_BYTES)
}

/// Whether the journal finds no place here.
pub(super) fn is_too_full_for_the_journal(folder: &Path) -> bool {
    blobs::free_mb(folder).is_ok_and(|free| free < JOURNAL_MB)
}

/// Whether pictures find no place here.
pub(super) fn is_too_full_for_pictures(folder: &Path) -> bool {
    blobs::free_mb(folder).is_ok_and(|free| free < PICTURES_MB)
}

impl Store {
    /// Whether the disk was found full since [`Store::has_room`] last found it otherwise.
    pub fn is_disk_full(&self) -> bool {
        self.fullness.is_full()
    }

    /// Keeps a picture as [`Store::put_blob`] does; `None` where the disk is full: it is dropped, and the room that is left is
    /// the journal's.
    ///
    /// # Errors
    /// As [`Store::put_blob`], but for a full disk.
    pub fn put_picture(&self, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        self.writable()?;
        self.fullness.put_picture(&self.blobs, bytes)
    }

    /// How many pictures were dropped since this was last asked.
    pub fn dropped_pictures(&self) -> u64 {
        self.fullness.0.dropped.swap(0, Ordering::Relaxed)
    }

    /// Whether there is room for the reserve and pictures again; where there is, the reserve is taken.
    pub fn has_room(&mut self) -> bool {
        let free = self.blobs.free_mb().unwrap_or(0);
        let has_room = free >= MB + PICTURES_MB && self.reserve.take().is_ok();
        if has_room {
            self.fullness.is_over();
        }
        has_room
    }

    /// The disk is full, and what to delete.
    pub fn full(&self) -> StoreError {
        full(self.folder())
    }
}

/// The disk of this store is full, and what to delete.
pub(super) fn full(folder: &Path) -> StoreError {
    let free_mb = blobs::free_mb(folder).unwrap_or(0);
    StoreError::Full { path: folder.to_owned(), free_mb, advice: advice(folder) }
}

/// What of the store may be deleted.
fn advice(folder: &Path) -> String {
    let recordings = folder.join("recordings");
    let files = fs::read_dir(&recordings).into_iter().flatten().flatten();
    let sizes: Vec<u64> = files.filter_map(|file| Some(file.metadata().ok()?.len())).collect();
    let mb = sizes.iter().sum::<u64>() / 1_000_000;
    let recordings = match sizes.len() {
        0 => "files of other programs on this disk".to_owned(),
        count => format!("recordings that were looked at ({count} files, {mb} MB, in {})", recordings.display()),
    };
    format!(
        "delete {recordings}, or let [store] keep in the cell's file remove clips and scans of old cycles; nothing else in the store may be deleted"
    )
}
