//! The folder of files that are named by the hash of their content (blobs).

use super::error::StoreError;
use super::flush;
use panelprep_cell::files::content_hash;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Number of temporary files that this process has created. It makes their names unique if two threads store the same
/// content at the same time.
static TEMPORARY_FILE_COUNT: AtomicU64 = AtomicU64::new(0);

/// A folder of files that are named by the hash of their content.
#[derive(Debug, Clone)]
pub struct Blobs {
    folder: PathBuf,
}

impl Blobs {
    /// Returns the folder of a store's files for reading, without creating it.
    pub(super) fn open_for_reading(store: &Path) -> Self {
        Blobs::for_folder(store.join("blobs"))
    }

    /// Creates the folder of a store's files.
    pub(super) fn create(store: &Path) -> Result<Self, StoreError> {
        let blobs = Blobs::open_for_reading(store);
        blobs.create_folder()?;
        Ok(blobs)
    }

    /// Returns the folder at this path; it need not exist.
    pub fn for_folder(folder: PathBuf) -> Self {
        Blobs { folder }
    }

    /// Creates the folder.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn create_folder(&self) -> Result<(), StoreError> {
        fs::create_dir_all(&self.folder).map_err(file_error("create", &self.folder))
    }

    /// Returns the path of the folder.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the path of the store that contains this folder.
    pub(super) fn store(&self) -> &Path {
        self.folder.parent().unwrap_or(Path::new("."))
    }

    /// Stores bytes in a file, and returns their hash. The file is written with a temporary name, flushed, and then
    /// renamed, so that a file with a hash as its name is always complete.
    ///
    /// # Errors
    /// If the file cannot be written, or already exists and is damaged.
    pub fn store_bytes(&self, bytes: &[u8]) -> Result<String, StoreError> {
        let hash = content_hash(bytes);
        let path = self.folder.join(&hash);
        match self.get(&hash) {
            // The file exists, but the process that wrote it may have ended before it flushed the folder.
            Ok(_) => return self.flush_names().map(|()| hash),
            Err(StoreError::File { source, .. }) if source.kind() == ErrorKind::NotFound => {}
            // A damaged file is not replaced: an unexplained change of a file on this disk must be reported, not
            // hidden.
            Err(error) => return Err(error),
        }
        let part = self.part(&hash);
        let written = write_flushed(&part, bytes).map_err(file_error("write", &part));
        let renamed = written.and_then(|()| fs::rename(&part, &path).map_err(file_error("rename", &part)));
        if renamed.is_err() {
            #[expect(
                clippy::let_underscore_must_use,
                reason = "the first error is the one to report; a part that stays is never read"
            )]
            let _ = fs::remove_file(&part);
        }
        renamed?;
        self.flush_names().map(|()| hash)
    }

    fn flush_names(&self) -> Result<(), StoreError> {
        flush::flush_folder(&self.folder).map_err(file_error("flush", &self.folder))
    }

    fn part(&self, name: &str) -> PathBuf {
        let number = TEMPORARY_FILE_COUNT.fetch_add(1, Ordering::Relaxed);
        self.folder.join(format!("{name}.{}.{number}.part", std::process::id()))
    }

    /// Writes and flushes a test file in the folder, and returns the free space on the disk, MB.
    pub(super) fn free_mb(&self) -> Result<u64, StoreError> {
        let probe = self.part("probe");
        // The test file is needed, because a disk that has become read-only still reports its free space.
        let written = write_flushed(&probe, b"probe").map_err(file_error("write", &probe));
        let removed = fs::remove_file(&probe).map_err(file_error("remove", &probe));
        written.and(removed)?;
        free_mb(&self.folder).map_err(file_error("read the free space on the disk of", &self.folder))
    }

    /// Returns whether a file with this hash exists. Its content is not verified.
    pub fn contains(&self, hash: &str) -> bool {
        self.folder.join(hash).is_file()
    }

    /// Returns the content of the file with this hash, after verifying the hash.
    ///
    /// # Errors
    /// If the file is missing, or its content was changed.
    pub fn get(&self, hash: &str) -> Result<Vec<u8>, StoreError> {
        let path = self.folder.join(hash);
        let bytes = fs::read(&path).map_err(file_error("read", &path))?;
        let found = content_hash(&bytes);
        if found == hash { Ok(bytes) } else { Err(StoreError::DamagedBlob { path, found }) }
    }
}

/// Returns the free space on the disk that contains this path, MB.
///
/// # Errors
/// If the path does not exist.
pub fn free_mb(path: &Path) -> std::io::Result<u64> {
    free_bytes(path).map(|bytes| bytes / 1_000_000)
}

/// Returns the free space on the disk that contains this path, bytes.
pub(super) fn free_bytes(path: &Path) -> std::io::Result<u64> {
    let disk = rustix::fs::statvfs(path)?;
    Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
}

fn write_flushed(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

fn file_error<'p>(doing: &'static str, path: &'p Path) -> impl Fn(std::io::Error) -> StoreError + 'p {
    move |source| StoreError::File { operation: doing, path: path.to_owned(), source }
}
