//! Flushes changes to the disk that must survive a power failure: the entries of a folder, and files that a killed
//! process has left.
//!
//! A file that was created, renamed or removed keeps this state after a power failure only if its folder was flushed.
//! An SQLite database consists of the database file and its write-ahead log.

use super::chain::Hash;
use super::error::StoreError;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Flushes the entries of this folder to the disk.
///
/// # Errors
/// If the folder does not exist, or cannot be flushed.
pub(super) fn flush_folder(folder: &Path) -> Result<(), Error> {
    File::open(folder)?.sync_all()
}

/// Flushes data that a killed process may not have flushed: the folder entry of this database, and rows in its
/// write-ahead log. If such rows are read, or the head contains them, a power failure must not remove them. Only the
/// log is opened: SQLite holds no locks on it, but closing the database file would release SQLite's locks.
///
/// # Errors
/// If a file cannot be flushed; a missing file is not an error.
pub(super) fn flush_after_kill(database: &Path) -> Result<(), StoreError> {
    let log = log_path(database);
    for file in database.parent().into_iter().chain([log.as_path()]) {
        match File::open(file).and_then(|file| file.sync_all()) {
            Err(source) if source.kind() != ErrorKind::NotFound => {
                return Err(StoreError::File { operation: "flush", path: file.to_owned(), source });
            }
            _ => {}
        }
    }
    Ok(())
}

/// Returns the path of the write-ahead log of a database.
pub(super) fn log_path(database: &Path) -> PathBuf {
    let mut log = database.as_os_str().to_owned();
    log.push("-wal");
    PathBuf::from(log)
}

/// Computes the SHA-256 of a file.
pub(super) fn file_hash(path: &Path) -> Result<Hash, std::io::Error> {
    let (mut file, mut hasher, mut buffer) = (File::open(path)?, Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hasher.finalize().into()),
            count => hasher.update(&buffer[..count]),
        }
    }
}
