//! One writer at a time: a lock on a file beside the database.
//!
//! A lock of the operating system and not SQLite's exclusive mode: that one would also keep readers out (a `locate`
//! beside the running daemon), and cannot say who holds it. The system takes the lock back when its process ends,
//! however it ends; the file itself stays and means nothing.

use super::error::StoreError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;

/// The right to write, held until dropped.
#[derive(Debug)]
pub(super) struct Lease {
    locked: File,
}

impl Lease {
    /// # Errors
    /// Where another process, or another store of this one, holds it.
    pub fn take(store: &Path) -> Result<Self, StoreError> {
        let path = store.join("panelprep.lock");
        let at = |doing| {
            let path = path.clone();
            move |source| StoreError::File { doing, path, source }
        };
        let mut options = OpenOptions::new();
        let mut file =
            options.read(true).write(true).create(true).truncate(false).open(&path).map_err(at("open"))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                file.read_to_string(&mut holder).map_err(at("read"))?;
                let holder =
                    holder.trim().parse::<u32>().map_or("another process".to_owned(), |id| format!("process {id}"));
                return Err(StoreError::Leased { path: store.to_owned(), holder });
            }
            Err(TryLockError::Error(source)) => return Err(at("lock")(source)),
        }
        file.set_len(0).and_then(|()| file.rewind()).map_err(at("write"))?;
        writeln!(file, "{}", std::process::id()).map_err(at("write"))?;
        Ok(Lease { locked: file })
    }
}

impl Drop for Lease {
    /// Unlocks, and does not leave it to the closing of the file: a child process between its fork and its exec still
    /// holds a copy of the descriptor, and with it the lock.
    fn drop(&mut self) {
        let _ = self.locked.unlock(); // the file closes next; a lock that could not be given back goes with it
    }
}
