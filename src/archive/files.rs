//! The folder of files: each under its SHA-256, whole or not there.

use super::error::ArchiveError;
use crate::files::{content_hash, is_hex};
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A folder of files that are named by their content, in 256 folders by the first two digits.
#[derive(Debug, Clone)]
pub(super) struct Files(PathBuf);

/// How a file stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Held {
    Whole,
    Missing,
    Damaged(String),
}

impl Files {
    pub fn at(folder: &Path) -> Self {
        Files(folder.to_owned())
    }

    fn path(&self, hash: &str) -> PathBuf {
        self.0.join(hash.get(..2).unwrap_or("")).join(hash)
    }

    /// Keeps these bytes under the hash that they have. One that is there already is not written again.
    pub fn put(&self, hash: &str, bytes: &[u8]) -> Result<(), ArchiveError> {
        let path = self.path(hash);
        if self.held(hash)? == Held::Whole {
            return Ok(());
        }
        let folder = path.parent().unwrap_or(&self.0);
        fs::create_dir_all(folder).map_err(ArchiveError::file("make", folder))?;
        let part = folder.join(format!("{hash}.{}.part", std::process::id()));
        let write = || -> std::io::Result<()> {
            let mut file = File::create(&part)?;
            file.write_all(bytes)?;
            file.sync_all()?;
            fs::rename(&part, &path)?;
            File::open(folder)?.sync_all()
        };
        write().map_err(ArchiveError::file("write", &path))
    }

    /// The bytes of a file that is whole; a hash that is none names nothing.
    pub fn get(&self, hash: &str) -> Option<Vec<u8>> {
        let is_hash = is_hex(hash, 64);
        let bytes = is_hash.then(|| fs::read(self.path(hash)).ok()).flatten()?;
        (content_hash(&bytes) == hash).then_some(bytes)
    }

    /// How the file with this hash stands.
    pub fn held(&self, hash: &str) -> Result<Held, ArchiveError> {
        let path = self.path(hash);
        match fs::read(&path) {
            Ok(bytes) => match content_hash(&bytes) {
                found if found == hash => Ok(Held::Whole),
                found => Ok(Held::Damaged(found)),
            },
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Held::Missing),
            Err(source) => Err(ArchiveError::file("read", &path)(source)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_was_damaged_is_written_anew_when_it_comes_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = Files::at(folder.path());
        let hash = content_hash(b"picture");
        assert_eq!(files.held(&hash).expect("looked"), Held::Missing);
        files.put(&hash, b"picture").expect("kept");
        assert_eq!(files.held(&hash).expect("looked"), Held::Whole);
        fs::write(files.path(&hash), b"p1cture").expect("spoilt");
        assert_eq!(files.held(&hash).expect("looked"), Held::Damaged(content_hash(b"p1cture")));
        files.put(&hash, b"picture").expect("kept again");
        assert_eq!(files.held(&hash).expect("looked"), Held::Whole);
    }
}
