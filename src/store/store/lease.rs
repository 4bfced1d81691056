//! One writer at a time: a lock on the store's folder.
//!
//! It is a lock of the operating system and not SQLite's exclusive mode, which would also exclude readers (a
//! `locate` beside the running daemon) and cannot report the holder. It is not on a file in the folder: a person
//! could remove such a file and so admit a second writer. The system releases the lock when its process ends,
//! however it ends. `panelprep.lock` names the holder, for messages alone.

use super::error::StoreError;
use std::fs::{self, File, TryLockError};
use std::path::Path;

/// Lock file that names the writer.
const FILE: &str = "panelprep.lock";

/// The right to write, until the lease is dropped.
#[derive(Debug)]
pub struct WriteLease {
    locked: File,
}

impl WriteLease {
    /// Acquires the lock; every other writer is refused until it is dropped.
    ///
    /// # Errors
    /// If another process, or another store of this process, holds it.
    pub fn acquire(store: &Path) -> Result<Self, StoreError> {
        let at = |doing| {
            let path = store.to_owned();
            move |source| StoreError::File { operation: doing, path, source }
        };
        let folder = File::open(store).map_err(at("open"))?;
        match folder.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder =
                    fs::read_to_string(store.join(FILE)).ok().and_then(|text| text.trim().parse::<u32>().ok());
                let holder = holder.map_or("another process".to_owned(), |id| format!("process {id}"));
                return Err(StoreError::Leased { path: store.to_owned(), holder });
            }
            Err(TryLockError::Error(source)) => return Err(at("lock")(source)),
        }
        if let Err(error) = fs::write(store.join(FILE), format!("{}\n", std::process::id())) {
            // Without this file, only a message is less exact; the service must start on a full disk, too.
            tracing::warn!("{} cannot be written: {error}", store.join(FILE).display());
        }
        Ok(WriteLease { locked: folder })
    }
}

impl Drop for WriteLease {
    /// Unlocks explicitly instead of by closing the file. A child process between its fork and its exec still has a
    /// copy of the descriptor, and with it the lock.
    fn drop(&mut self) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the folder closes next, which also releases a lock that could not be released here"
        )]
        let _ = self.locked.unlock();
    }
}
