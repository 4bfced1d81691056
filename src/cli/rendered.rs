//! The files of a rendered folder.

use std::path::PathBuf;

/// The folder's files by their role.
#[derive(Debug, Clone)]
pub struct RenderedFiles {
    /// The folder.
    pub folder: PathBuf,
    /// Length of the folder's wet films, s.
    pub seconds: u32,
}

impl RenderedFiles {
    /// Returns the path of a file in the folder.
    pub fn file_path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}
