//! Makes the disk keep what must not go with the power: names in a folder, and what a process that was killed has left.
//!
//! A file that was made, renamed or removed is so after a power cut once its folder is flushed.

use super::database_files::log_of;
use super::error::StoreError;
use std::fs::File;
use std::io::{Error, ErrorKind};
use std::path::Path;

/// Makes the disk keep the names of the files in this folder.
///
/// # Errors
/// Where it is not there, or the disk refuses.
pub(super) fn names(folder: &Path) -> Result<(), Error> {
    File::open(folder)?.sync_all()
}

/// Makes the disk keep what a process that was killed may not have come to flush: the name of this database, and rows in its log.
/// Whoever acts on such rows, or tells the head of them, must not lose them with the power. The log has none of SQLite's locks,
/// which closing a file of the database would release.
///
/// # Errors
/// Where the disk refuses; a file that is not there is none.
pub(super) fn left_behind(database: &Path) -> Result<(), StoreError> {
    let log = log_of(database);
    for file in database.parent().into_iter().chain([log.as_path()]) {
        match File::open(file).and_then(|file| file.sync_all()) {
            Err(source) if source.kind() != ErrorKind::NotFound => {
                return Err(StoreError::File { doing: "flush", path: file.to_owned(), source });
            }
            _ => {}
        }
    }
    Ok(())
}
