//! Reads a backup archive: first its seal, then its manifest, then the entries in the manifest's order.
//!
//! The seal is at the end of the archive: the SHA-256 of all bytes before it, in a frame that zstd skips. It is needed
//! for two reasons: the checksum of a compressed frame does not protect all of its bits, and an archive that is
//! truncated at the end of a frame is still readable. The seal protects every bit.

use super::entry::{Entry, MANIFEST_FORMAT, MANIFEST_NAME, MAX_MANIFEST_BYTES, Manifest, ManifestEntry};
use super::error::BackupError;
use panelprep_cell::files::hex;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Error, Read, Seek, SeekFrom, Take, Write};
use std::path::{Path, PathBuf};

/// An archive with a valid seal and a valid manifest.
#[derive(Debug)]
pub struct Archive {
    path: PathBuf,
    file: File,
    /// Number of bytes before the seal.
    bytes: u64,
    /// The list of the archive's entries.
    pub manifest: Manifest,
}

type TarArchive<'f> = tar::Archive<zstd::Decoder<'static, std::io::BufReader<Take<&'f File>>>>;

/// The part of a manifest that is the same in all formats.
#[derive(Deserialize)]
struct FormatProbe {
    format: u32,
}

impl Archive {
    /// Opens an archive, reads it completely, and verifies its seal.
    ///
    /// # Errors
    /// If the file is not a backup, is damaged or truncated, or was written by a newer program.
    pub fn open(path: &Path) -> Result<Self, BackupError> {
        let mut file = panelprep_base::disk::open(path).map_err(BackupError::file_error("read", path))?;
        let damaged = |problem: String| BackupError::Damaged { path: path.to_owned(), problem };
        let bytes = match verify_seal(&mut file).map_err(BackupError::file_error("read", path))? {
            SealCheck::Whole(bytes) => bytes,
            SealCheck::Missing => {
                return Err(damaged(
                    "the file is not a backup of this program, or is incomplete: the seal is missing".to_owned(),
                ));
            }
            SealCheck::Broken => {
                return Err(damaged(
                    "the backup is damaged: its SHA-256 differs from the SHA-256 in its seal".to_owned(),
                ));
            }
        };
        let manifest = Manifest { format: 0, program: String::new(), made_unix_s: 0, links: None, entries: vec![] };
        let mut archive = Archive { path: path.to_owned(), file, bytes, manifest };
        archive.manifest = archive.read_manifest()?;
        archive.manifest.parse_entries().map_err(|words| archive.damaged_error(&words))?;
        Ok(archive)
    }

    /// Calls `take` with each entry and a reader of its content. Then the content is compared with the manifest.
    ///
    /// # Errors
    /// If the archive differs from its manifest, or `take` returns an error.
    pub fn for_each_entry<E: From<BackupError>>(
        &self,
        mut take: impl FnMut(&Entry, &mut dyn Read) -> Result<(), E>,
    ) -> Result<(), E> {
        let expected = self.manifest.parse_entries().map_err(|words| self.damaged_error(&words))?;
        let mut archive = self.open_tar()?;
        let mut entries = archive.entries().map_err(|error| self.unreadable_error(&error))?;
        // The first entry is the manifest, which was already read.
        let _ = entries.next();
        for (entry, listed) in expected.iter().zip(&self.manifest.entries) {
            let missing = || self.damaged_error(&format!("the file {} is missing", listed.name));
            let found = entries.next().ok_or_else(missing)?.map_err(|error| self.unreadable_error(&error))?;
            self.is_listed(&found, listed)?;
            let mut hashing = HashingReader { inner: found, hasher: Sha256::new() };
            take(entry, &mut hashing)?;
            // Read the part of the content that `take` has not read, because it is needed for the hash.
            std::io::copy(&mut hashing, &mut std::io::sink()).map_err(|error| self.unreadable_error(&error))?;
            let hash = hex(&hashing.hasher.finalize());
            if hash != listed.sha256 {
                return Err(self
                    .damaged_error(&format!(
                        "the SHA-256 of the file {} is {hash}, not the one in the manifest",
                        listed.name
                    ))
                    .into());
            }
        }
        match entries.next() {
            None => Ok(()),
            Some(_) => Err(self.damaged_error("the backup contains more files than its manifest lists").into()),
        }
    }

    fn read_manifest(&self) -> Result<Manifest, BackupError> {
        let mut archive = self.open_tar()?;
        let mut entries = archive.entries().map_err(|error| self.unreadable_error(&error))?;
        let first = entries.next().ok_or_else(|| self.damaged_error("the archive is empty"))?;
        let first = first.map_err(|error| self.unreadable_error(&error))?;
        if *first.path_bytes() != *MANIFEST_NAME.as_bytes() || first.size() > MAX_MANIFEST_BYTES {
            return Err(self.damaged_error("the first entry is not a manifest"));
        }
        let mut text = Vec::new();
        first.take(MAX_MANIFEST_BYTES).read_to_end(&mut text).map_err(|error| self.unreadable_error(&error))?;
        let no_manifest = |error: serde_json::Error| {
            self.damaged_error(&format!("the manifest cannot be read: {error}; use another copy of the backup"))
        };
        let FormatProbe { format } = serde_json::from_slice(&text).map_err(no_manifest)?;
        if format > MANIFEST_FORMAT {
            return Err(BackupError::NewerVersion {
                path: self.path.clone(),
                found: format,
                known: MANIFEST_FORMAT,
            });
        }
        serde_json::from_slice(&text).map_err(no_manifest)
    }

    fn open_tar(&self) -> Result<TarArchive<'_>, BackupError> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(0)).map_err(BackupError::file_error("read", &self.path))?;
        let decoder = zstd::Decoder::new(file.take(self.bytes)).map_err(|error| self.unreadable_error(&error))?;
        Ok(tar::Archive::new(decoder))
    }

    fn is_listed<R: Read>(&self, found: &tar::Entry<'_, R>, listed: &ManifestEntry) -> Result<(), BackupError> {
        let path = found.path_bytes();
        let name = String::from_utf8_lossy(&path);
        if !found.header().entry_type().is_file() || name != listed.name.as_str() || found.size() != listed.bytes {
            let name = name.escape_debug();
            return Err(self.damaged_error(&format!(
                "the backup contains \"{name}\" where its manifest lists {}",
                listed.name
            )));
        }
        Ok(())
    }

    /// Returns the error for an archive that is damaged or was changed.
    pub(super) fn damaged_error(&self, problem: &str) -> BackupError {
        BackupError::Damaged { path: self.path.clone(), problem: format!("the backup is damaged: {problem}") }
    }

    /// Returns the error for an archive whose store has the schema of an earlier program version.
    pub(super) fn earlier_version_error(&self, found: i64, known: i64) -> BackupError {
        BackupError::EarlierVersion {
            path: self.path.clone(),
            program: self.manifest.program.clone(),
            found,
            known,
        }
    }

    /// Returns the error for a file that cannot be read as an archive.
    pub(super) fn unreadable_error(&self, error: &std::io::Error) -> BackupError {
        self.damaged_error(&format!("the archive cannot be unpacked: {error}; use another copy of the backup"))
    }
}

/// A reader that computes the hash of all bytes that are read.
struct HashingReader<R> {
    inner: R,
    hasher: Sha256,
}

impl<R: Read> Read for HashingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..count]);
        Ok(count)
    }
}

/// Magic number of a skippable zstd frame, the first of several that the format defines. The length of the content
/// follows.
const FRAME_MAGIC: [u8; 4] = 0x184D_2A50_u32.to_le_bytes();
const SEAL_MAGIC: &[u8; 16] = b"panelprep seal 1";
const SEAL_PAYLOAD: u32 = 16 + 32;
/// Length of a seal, bytes.
const SEAL_BYTES: u64 = 8 + SEAL_PAYLOAD as u64;

/// A writer that computes the hash of all bytes that are written.
pub struct HashingWriter<W> {
    inner: W,
    hasher: Sha256,
}

impl<W: Write> HashingWriter<W> {
    pub fn new(inner: W) -> Self {
        HashingWriter { inner, hasher: Sha256::new() }
    }

    /// Writes the seal at the end of the archive.
    pub fn seal(mut self) -> Result<W, Error> {
        self.inner.write_all(&seal_frame(self.hasher.finalize().into()))?;
        self.inner.flush()?;
        Ok(self.inner)
    }
}

impl<W: Write> Write for HashingWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let count = self.inner.write(bytes)?;
        self.hasher.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.inner.flush()
    }
}

fn seal_frame(hash: [u8; 32]) -> Vec<u8> {
    [&FRAME_MAGIC[..], &SEAL_PAYLOAD.to_le_bytes(), SEAL_MAGIC, &hash].concat()
}

/// The result of verifying the seal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SealCheck {
    /// The file is unchanged; contains the number of bytes before the seal.
    Whole(u64),
    /// The file has no seal: it is truncated, or is not a backup.
    Missing,
    /// The file is damaged or was changed.
    Broken,
}

/// Reads the whole file and verifies its seal; then sets the read position to the beginning of the file.
fn verify_seal(file: &mut File) -> Result<SealCheck, Error> {
    let length = file.metadata()?.len();
    let Some(before) = length.checked_sub(SEAL_BYTES) else { return Ok(SealCheck::Missing) };
    file.seek(SeekFrom::Start(0))?;
    let (mut hasher, mut buffer, mut left) = (Sha256::new(), vec![0; 1 << 20], before);
    while left > 0 {
        let most = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
        let count = file.read(&mut buffer[..most])?;
        if count == 0 {
            return Ok(SealCheck::Missing);
        }
        hasher.update(&buffer[..count]);
        left -= count as u64;
    }
    let mut found = Vec::new();
    file.take(SEAL_BYTES).read_to_end(&mut found)?;
    file.seek(SeekFrom::Start(0))?;
    let begins = found.starts_with(&FRAME_MAGIC) && found.get(8..24) == Some(&SEAL_MAGIC[..]);
    Ok(match found == seal_frame(hasher.finalize().into()) {
        true => SealCheck::Whole(before),
        false if begins => SealCheck::Broken,
        false => SealCheck::Missing,
    })
}
