//! Writes new files; for `--pictures`, pictures as PNG. Other files are read and written as those of the cell's set-up.

use super::fault::Fault;
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::files;
pub use panelprep_service::setup::disk::{
    read, read_controller_text, read_referenced, read_text, write, write_durable,
};
use panelprep_service::stages::ResultDrawing;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes a new file; an existing file stays as it is.
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

/// Writes a picture as PNG into a folder.
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
