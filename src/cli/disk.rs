//! Reads and writes files completely or not at all; for `--pictures`, writes pictures as PNG.

use super::fault::Fault;
use panelprep_base::disk;
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::files;
use panelprep_service::check::{decode, utf_8_error};
use panelprep_service::requirements::NamedFile;
use panelprep_service::stages::ResultDrawing;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Reads the bytes of a file.
///
/// # Errors
/// If the file is not a regular file, is too large or cannot be read; the error contains its name.
pub fn read(file: &Path) -> Result<Vec<u8>, Fault> {
    disk::read(file).map_err(|error| Fault::file_fault(file, error))
}

/// Reads the text of a file.
///
/// # Errors
/// The errors of [`read`], and if the file is not UTF-8.
pub fn read_text(file: &Path) -> Result<String, Fault> {
    String::from_utf8(read(file)?)
        .map_err(|error| Fault::file_fault(file, utf_8_error(error.as_bytes(), &error.utf8_error())))
}

/// Reads the text of an EthernetKRL or KRL file of the controller, in any of its encodings.
///
/// # Errors
/// The errors of [`read`], and if the file is not a text.
pub fn read_controller_text(file: &Path) -> Result<String, Fault> {
    let decoded =
        decode(&file.display().to_string(), &read(file)?).map_err(|error| Fault::file_fault(file, error))?;
    Ok(decoded.text)
}

/// Reads a file that the cell file names.
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

/// Writes a temporary file next to the target and renames it, so that the target is never partly written.
///
/// # Errors
/// If the folder cannot be created, or writing to the disk fails.
pub fn write(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Fault> {
    write_and_rename(file, bytes.as_ref(), |_| Ok(()))
}

/// Writes a file that must survive a power failure, such as a calibration or a page. When the function returns, file
/// and folder are on the disk. After a power failure, the file is either the old one or the new one.
///
/// # Errors
/// The errors of [`write`].
pub fn write_durable(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Fault> {
    write_and_rename(file, bytes.as_ref(), File::sync_all)?;
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(|error| Fault::file_fault(file, error))
}

/// Writes a new file; an existing file is not changed.
///
/// # Errors
/// If the file exists, the folder cannot be created, or writing to the disk fails.
pub fn write_new(file: &Path, bytes: impl AsRef<[u8]>) -> Result<(), Fault> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(|error| Fault::file_fault(file, error))?;
    }
    let made = File::create_new(file).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => Fault::AlreadyExists { file: file.to_owned() },
        _ => Fault::file_fault(file, error),
    });
    made?.write_all(bytes.as_ref()).map_err(|error| {
        #[expect(clippy::let_underscore_must_use, reason = "best effort: only the first error is reported")]
        let _ = fs::remove_file(file);
        Fault::file_fault(file, error)
    })
}

fn write_and_rename(file: &Path, bytes: &[u8], flush: impl Fn(&File) -> std::io::Result<()>) -> Result<(), Fault> {
    let named = |error: std::io::Error| Fault::file_fault(file, error);
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
        #[expect(clippy::let_underscore_must_use, reason = "best effort: only the first error is reported")]
        let _ = fs::remove_file(&beside);
        named(error)
    })
}

/// Writes a picture as PNG to a folder, and returns its path.
///
/// # Errors
/// If writing to the disk fails.
pub fn save_picture(folder: &Path, name: &str, picture: &ColorPicture) -> Result<PathBuf, Fault> {
    let file = folder.join(format!("{name}.png"));
    write(&file, files::write_color_png(picture).map_err(Fault::stage)?)?;
    Ok(file)
}

/// Writes the drawings of a stage to a folder.
///
/// # Errors
/// If a drawing cannot be drawn, or writing to the disk fails.
pub fn write_drawings(folder: &Path, drawings: impl IntoIterator<Item = ResultDrawing>) -> Result<(), Fault> {
    for ResultDrawing { name, picture, .. } in drawings {
        save_picture(folder, &name, &picture.map_err(Fault::stage)?)?;
    }
    Ok(())
}
