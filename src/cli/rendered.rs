//! The files of a rendered folder.

use std::path::PathBuf;

/// The folder's files by their role.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// The folder.
    pub folder: PathBuf,
    /// Length of the folder's wet films, s.
    pub seconds: u32,
}

impl Rendered {
    /// Returns the path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}
