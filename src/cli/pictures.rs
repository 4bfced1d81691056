//! Writes pictures as PNG for `--pictures`.

use super::disk;
use super::fault::Fault;
use panelprep_base::geometry::ColorPicture;
use panelprep_cell::files;
use panelprep_service::stages::ResultDrawing;
use std::path::{Path, PathBuf};

/// Writes a picture as PNG into a folder.
///
/// # Errors
/// If writing to the disk fails.
pub fn save(folder: &Path, name: &str, picture: &ColorPicture) -> Result<PathBuf, Fault> {
    let file = folder.join(format!("{name}.png"));
    disk::write(&file, files::write_color_png(picture).map_err(Fault::stage)?)?;
    Ok(file)
}

/// Writes a stage's drawings.
///
/// # Errors
/// If one could not be drawn, or writing to the disk fails.
pub fn write_drawings(folder: &Path, drawings: impl IntoIterator<Item = ResultDrawing>) -> Result<(), Fault> {
    for ResultDrawing { name, picture, .. } in drawings {
        save(folder, &name, &picture.map_err(Fault::stage)?)?;
    }
    Ok(())
}
