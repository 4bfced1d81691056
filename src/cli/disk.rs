//! Files in and out: whole or not at all.

use super::fault::Fault;
use crate::disk;
use std::fs;
use std::path::{Path, PathBuf};

/// The bytes of a file.
///
/// # Errors
/// Where it is no regular file, is too large or cannot be read, with its name.
pub fn read(file: &Path) -> Result<Vec<u8>, Fault> {
    disk::read(file).map_err(|error| Fault::file(file, error))
}

/// The text of a file.
///
/// # Errors
/// As [`read`], and where it is not UTF-8.
pub fn read_text(file: &Path) -> Result<String, Fault> {
    String::from_utf8(read(file)?).map_err(|error| Fault::file(file, error))
}

/// Writes a file beside its place and renames it there, so that it is never half written.
///
/// # Errors
/// Where the folder cannot be made or the disk refuses.
pub fn write(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Fault> {
    let named = |error: std::io::Error| Fault::file(file, error);
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(named)?;
    }
    let mut beside = file.as_os_str().to_owned();
    beside.push(".part");
    let beside = PathBuf::from(beside);
    let written = fs::write(&beside, bytes).and_then(|()| fs::rename(&beside, file));
    written.map_err(|error| {
        let _ = fs::remove_file(&beside); // Best effort: the error that counts is the first one.
        named(error)
    })
}
