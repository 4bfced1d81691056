//! Reads and writes files completely or not at all.

use super::fault::SetupFault;
use crate::check::{decode, utf_8_error};
use crate::requirements::NamedFile;
use panelprep_base::disk;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Returns the bytes of a file.
///
/// # Errors
/// If it is not a regular file, is too large or cannot be read; the error names the file.
pub fn read(file: &Path) -> Result<Vec<u8>, SetupFault> {
    disk::read(file).map_err(|error| SetupFault::file_fault(file, error))
}

/// Returns the text of a file.
///
/// # Errors
/// As [`read`], and if it is not UTF-8.
pub fn read_text(file: &Path) -> Result<String, SetupFault> {
    String::from_utf8(read(file)?)
        .map_err(|error| SetupFault::file_fault(file, utf_8_error(error.as_bytes(), &error.utf8_error())))
}

/// Reads the text of a file of the controller, EthernetKRL or KRL, in any of its encodings.
///
/// # Errors
/// As [`read`], and if the file is not text.
pub fn read_controller_text(file: &Path) -> Result<String, SetupFault> {
    let decoded =
        decode(&file.display().to_string(), &read(file)?).map_err(|error| SetupFault::file_fault(file, error))?;
    Ok(decoded.text)
}

/// Reads a file that a cell's file names.
pub fn read_referenced(file: &Path) -> NamedFile {
    let bytes = match disk::read(file) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return NamedFile::Missing,
        Err(error) => return NamedFile::Unreadable(error.to_string()),
    };
    match String::from_utf8(bytes) {
        Ok(text) => NamedFile::Text(text),
        Err(error) => NamedFile::Unreadable(utf_8_error(error.as_bytes(), &error.utf8_error()).to_string()),
    }
}

/// Returns the folder of a file; the current folder if the path names none.
pub(super) fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes a temporary file next to the target and renames it, so that the target is never half written.
///
/// # Errors
/// If the folder cannot be made or writing to the disk fails.
pub fn write(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), SetupFault> {
    write_and_rename(file, bytes.as_ref(), |_| Ok(()))
}

/// Writes a file that must survive a power cut, such as a calibration or a page. When this returns, file and folder
/// are on the disk. Whatever happens, the file is either the old one or the new one.
///
/// # Errors
/// As [`write`].
pub fn write_durable(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), SetupFault> {
    write_and_rename(file, bytes.as_ref(), File::sync_all)?;
    File::open(folder_of(file))
        .and_then(|folder| folder.sync_all())
        .map_err(|error| SetupFault::file_fault(file, error))
}

fn write_and_rename(
    file: &Path,
    bytes: &[u8],
    flush: impl Fn(&File) -> std::io::Result<()>,
) -> Result<(), SetupFault> {
    let named = |error: std::io::Error| SetupFault::file_fault(file, error);
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(named)?;
    }
    let mut beside = file.as_os_str().to_owned();
    beside.push(".part");
    let beside = PathBuf::from(beside);
    let write = || {
        let mut part = File::create(&beside)?;
        part.write_all(bytes)?;
        flush(&part)?;
        fs::rename(&beside, file)
    };
    write().map_err(|error| {
        #[expect(clippy::let_underscore_must_use, reason = "best effort: the error that counts is the first one")]
        let _ = fs::remove_file(&beside);
        named(error)
    })
}
