//! How far records were sent, in a file beside the store's database. A file that is gone or damaged costs nothing but sending again.

use crate::office::Progress;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

const FILE: &str = "office.json";

/// The file of the store in this folder.
pub(super) fn path(folder: &Path) -> PathBuf {
    folder.join(FILE)
}

/// What it says.
pub(super) fn read(folder: &Path) -> Progress {
    let bytes = crate::disk::read(&path(folder)).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// Writes it: completely or not at all.
pub(super) fn write(folder: &Path, progress: &Progress) -> std::io::Result<()> {
    let (path, part) = (path(folder), folder.join(format!("{FILE}.part")));
    let mut file = File::create(&part)?;
    file.write_all(&serde_json::to_vec(progress)?)?;
    file.sync_all()?;
    fs::rename(part, path)
}
