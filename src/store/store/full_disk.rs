//! Behaviour of a store while its disk is full, and the check whether there is space again.

use super::database::Store;
use super::error::StoreError;
use super::reserve::{self, ROOM_MB};

impl Store {
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
        reserve::disk_full_error(self.folder())
    }
}
