//! Stores the progress of a transfer in a file in the folder of the store's database. If the file is lost or
//! damaged, the only consequence is that data are sent again.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

/// Returns the content of the file with this name in this folder; the initial value if it has no content.
pub(super) fn read<T: DeserializeOwned + Default>(folder: &Path, name: &str) -> T {
    let bytes = panelprep_base::disk::read(&folder.join(name)).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// Writes the progress, either completely or not at all.
///
/// # Errors
/// If the disk refuses, with the file's name.
pub(super) fn write(folder: &Path, name: &str, progress: &impl Serialize) -> Result<(), String> {
    let (path, part) = (folder.join(name), folder.join(format!("{name}.part")));
    let written = || -> std::io::Result<()> {
        let mut file = File::create(&part)?;
        file.write_all(&serde_json::to_vec(progress)?)?;
        file.sync_all()?;
        fs::rename(&part, &path)
    };
    written().map_err(|error| format!("{}: {error}", path.display()))
}
