//! The files of the archive. The name of a file is its SHA-256 hash; a file is either complete or absent, as in a
//! store. The files are in 256 folders, named by the first two digits of the hash.

use super::database::ArchiveError;
use panelprep_cell::files::is_hex;
use panelprep_store::office::{Body, Message};
use panelprep_store::store::{Blobs, StoreError};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A folder of files that are named by the hash of their content.
#[derive(Debug, Clone)]
pub(super) struct ContentFiles(PathBuf);

/// The state of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum FileState {
    Whole,
    Missing,
    Damaged(String),
}

impl ContentFiles {
    pub fn in_folder(folder: &Path) -> Self {
        ContentFiles(folder.to_owned())
    }

    /// Creates the folder, and writes and removes a test file, so that a problem is found at the start and not with the
    /// first picture.
    pub fn check_writable(&self) -> Result<(), ArchiveError> {
        let trial = self.0.join(".trial");
        fs::create_dir_all(&self.0).map_err(ArchiveError::file_error("make", &self.0))?;
        fs::write(&trial, b"trial").map_err(ArchiveError::file_error("write", &trial))?;
        fs::remove_file(&trial).map_err(ArchiveError::file_error("remove", &trial))
    }

    fn blobs_for_hash(&self, hash: &str) -> Blobs {
        Blobs::for_folder(self.0.join(hash.get(..2).unwrap_or("")))
    }

    /// Writes a file with this hash and content. An existing file is not written again, unless it is damaged.
    pub fn store(&self, hash: &str, bytes: &[u8]) -> Result<(), ArchiveError> {
        let near = self.blobs_for_hash(hash);
        near.create_folder()?;
        match near.store_bytes(bytes) {
            Err(StoreError::DamagedBlob { path, .. }) => {
                fs::remove_file(&path).map_err(ArchiveError::file_error("remove", &path))?;
                near.store_bytes(bytes)?;
            }
            put => drop(put?),
        }
        Ok(())
    }

    /// Returns the content of a file; `None` if the file is missing or damaged, or the text is not a hash.
    pub fn get(&self, hash: &str) -> Option<Vec<u8>> {
        is_hex(hash, 64).then(|| self.blobs_for_hash(hash).get(hash).ok()).flatten()
    }

    /// Returns whether all files that a record names are complete, except the files that the cell had already removed.
    pub fn has_all_files(&self, message: &Message) -> bool {
        let Body::Signature { files, .. } = &message.envelope.body else { return true };
        files
            .iter()
            .filter(|file| file.gone.is_none())
            .all(|file| self.blobs_for_hash(&file.hash).contains(&file.hash))
    }

    /// Returns the state of the file with this hash.
    pub fn file_state(&self, hash: &str) -> Result<FileState, ArchiveError> {
        match self.blobs_for_hash(hash).get(hash) {
            Ok(_) => Ok(FileState::Whole),
            Err(StoreError::DamagedBlob { found, .. }) => Ok(FileState::Damaged(found)),
            Err(StoreError::File { source, .. }) if source.kind() == ErrorKind::NotFound => Ok(FileState::Missing),
            Err(error) => Err(error.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::files::content_hash;

    #[test]
    fn a_damaged_file_is_replaced_when_it_is_received_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = ContentFiles::in_folder(folder.path());
        let hash = content_hash(b"picture");
        assert_eq!(files.file_state(&hash).expect("looked"), FileState::Missing);
        files.store(&hash, b"picture").expect("kept");
        assert_eq!(files.file_state(&hash).expect("looked"), FileState::Whole);
        fs::write(folder.path().join(&hash[..2]).join(&hash), b"p1cture").expect("spoilt");
        assert_eq!(files.file_state(&hash).expect("looked"), FileState::Damaged(content_hash(b"p1cture")));
        files.store(&hash, b"picture").expect("kept again");
        assert_eq!(files.file_state(&hash).expect("looked"), FileState::Whole);
    }
}
