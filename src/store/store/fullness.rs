//! A full disk as detected by the store's writers: pictures are dropped first, so that the remaining space is for
//! the journal.

use super::blobs::{self, Blobs};
use super::error::StoreError;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Free disk space below which no picture is written, MB: the remaining space is for the journal.
pub(super) const PICTURES_MB: u64 = 64;

/// Whether the disk is full, as detected by the store's writers. Clones share the same state.
#[derive(Debug, Clone, Default)]
pub(super) struct DiskFullness(Arc<FullnessState>);

#[derive(Debug, Default)]
struct FullnessState {
    is_full: AtomicBool,
    /// Pictures that could not be stored since the last query.
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

    /// The number of pictures dropped since the last call.
    pub fn take_dropped_count(&self) -> u64 {
        self.0.dropped.swap(0, Ordering::Relaxed)
    }

    /// Stores a picture, or drops it if the disk is full: the remaining space is for the journal.
    pub fn store_picture(&self, blobs: &Blobs, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        if !self.is_disk_full() && is_too_full_for_pictures(blobs.store()) {
            self.mark_full();
        }
        // A lost picture is counted and reported; a lost line of the journal would end the cell.
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

/// Returns whether there is too little space for pictures here.
fn is_too_full_for_pictures(folder: &Path) -> bool {
    blobs::free_mb(folder).is_ok_and(|free| free < PICTURES_MB)
}

/// Stores files for a store's writer.
#[derive(Debug)]
pub struct BlobWriter(Blobs, DiskFullness);

impl BlobWriter {
    pub(super) fn new(blobs: &Blobs, fullness: &DiskFullness) -> Self {
        BlobWriter(blobs.clone(), fullness.clone())
    }

    /// As [`Store::store_picture`](super::Store::store_picture).
    ///
    /// # Errors
    /// If the file cannot be written for a reason other than a full disk, or exists already and is damaged.
    pub fn store_picture(&self, bytes: &[u8]) -> Result<Option<String>, StoreError> {
        self.1.store_picture(&self.0, bytes)
    }
}
