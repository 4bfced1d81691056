//! Pictures out: PNG for `--pictures`, JPEG for pages.

use super::disk;
use super::fault::Fault;
use crate::files;
use crate::geometry::ColorPicture;
use crate::report::page::Figure;
use std::path::{Path, PathBuf};

/// Writes a picture as PNG into a folder.
///
/// # Errors
/// Where the disk refuses.
pub fn save(folder: &Path, name: &str, picture: &ColorPicture) -> Result<PathBuf, Fault> {
    let file = folder.join(format!("{name}.png"));
    disk::write(&file, files::write_color_png(picture).map_err(Fault::stage)?)?;
    Ok(file)
}

/// A picture for a page.
///
/// # Errors
/// Where it cannot be encoded.
pub fn figure(picture: &ColorPicture, caption: impl Into<String>) -> Result<Figure, Fault> {
    Ok(Figure { caption: caption.into(), jpeg: files::write_color_jpeg(picture).map_err(Fault::stage)? })
}
