//! The files of an SQLite database: its log beside it, and the hash of either.

use super::chain::Hash;
use super::error::StoreError;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// SQLite's log beside a database.
pub(super) fn log_of(database: &Path) -> PathBuf {
    let mut log = database.as_os_str().to_owned();
    log.push("-wal");
    PathBuf::from(log)
}

/// Makes the disk keep the log of this database, where it has one. A process that was killed may have left rows in it that it did not
/// flush; whoever acts on them, or tells the head of them, must not lose them with the power. The log has none of SQLite's locks,
/// which closing a file of the database would release.
pub(super) fn flush_log(database: &Path) -> Result<(), StoreError> {
    let flushed = File::open(log_of(database)).and_then(|log| log.sync_all());
    match flushed {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(StoreError::File { doing: "flush the log of", path: database.to_owned(), source: error })
        }
        _ => Ok(()),
    }
}

/// SHA-256 of a file.
pub(super) fn file_hash(path: &Path) -> Result<Hash, std::io::Error> {
    let (mut file, mut hasher, mut buffer) = (File::open(path)?, Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hasher.finalize().into()),
            count => hasher.update(&buffer[..count]),
        }
    }
}
