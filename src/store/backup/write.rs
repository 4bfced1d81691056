//! Writes a backup archive: copies the rows of the store at one moment, packs them with the files that they name, and
//! reads the archive back.

use super::entry::{Entry, MANIFEST_FORMAT, MANIFEST_NAME, Manifest, ManifestEntry};
use super::error::BackupError;
use super::read::{Archive, HashingWriter};
use crate::store::{BLOBS, ROW_FILES, Store};
use panelprep_cell::files::{content_hash, hex};
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// The configuration to pack.
#[derive(Debug, Clone, Default)]
pub struct Configuration {
    /// The text of the cell's file (`cell.toml`).
    pub cell: String,
    /// The existing files that the cell's file names, each with its key, such as `calibration.scanner`.
    pub named_files: Vec<(String, PathBuf)>,
    /// The recipes in the folder of the cell's file: relative name and path of each.
    pub recipes: Vec<(String, PathBuf)>,
}

/// The result of a backup.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BackupReport {
    /// Contradictions found in the store, as texts. If there are any, no archive was written.
    pub differences: Vec<String>,
    /// The list of the archive's entries.
    pub manifest: Manifest,
    /// Size of the archive, bytes.
    pub bytes: u64,
}

/// Maximum size of a configuration file, bytes. Such a file usually has a page of text; the settings file of a camera
/// has a few pages.
const MAX_CONFIGURATION_BYTES: u64 = 4 << 20;
/// Compression level of zstd, its default. Pictures are already compressed; rows and scans are not.
const COMPRESSION_LEVEL: i32 = 3;
/// Maximum number of attempts. A new attempt is made if the service removes an old clip between the copy of the rows
/// and the copy of the files.
const MAX_ATTEMPTS: usize = 3;

/// The source of an entry's content.
enum EntrySource {
    Bytes(Vec<u8>),
    File(PathBuf),
}

/// The entries to pack.
#[derive(Default)]
struct PackContent {
    entries: Vec<ManifestEntry>,
    sources: Vec<EntrySource>,
    links: Option<u64>,
}

/// The reason why the entries could not be packed.
enum PackFailure {
    /// A file of the store is missing or was changed.
    Blob(String),
    Error(BackupError),
}

impl From<BackupError> for PackFailure {
    fn from(error: BackupError) -> Self {
        PackFailure::Error(error)
    }
}

/// Writes an archive with `store` and `configuration`. No file may exist at the path of the archive. A service may
/// write to the store at the same time. The archive is read back before it is renamed to its final name.
///
/// # Errors
/// If the store or a file cannot be read, or the archive cannot be written. No incomplete archive is left.
pub fn write(
    archive: &Path,
    store: Option<&Path>,
    configuration: Option<&Configuration>,
    made_unix_s: i64,
) -> Result<BackupReport, BackupError> {
    if archive.symlink_metadata().is_ok() {
        return Err(BackupError::AlreadyExists { path: archive.to_owned() });
    }
    let folder = match archive.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    fs::create_dir_all(folder).map_err(BackupError::file_error("create", folder))?;
    let beside = || tempfile::Builder::new().prefix(".panelprep-backup-").tempdir_in(folder);
    let mut last = String::new();
    for _ in 0..MAX_ATTEMPTS {
        let staging = beside().map_err(BackupError::file_error("write in", folder))?;
        let mut load = PackContent::default();
        if let Some(store) = store
            && let Some(found) = load.add_store(store, &staging.path().join("rows"))?
        {
            return Ok(BackupReport { differences: found, manifest: load.manifest(made_unix_s), bytes: 0 });
        }
        if let Some(configuration) = configuration {
            load.add_configuration(configuration)?;
        }
        let manifest = load.manifest(made_unix_s);
        let part = staging.path().join("archive");
        match pack_archive(&part, &manifest, &load.sources) {
            Ok(()) => {}
            Err(PackFailure::Error(error)) => return Err(error),
            Err(PackFailure::Blob(words)) => {
                last = words;
                continue;
            }
        }
        // Read the complete archive back before it can be used.
        let read = Archive::open(&part)?;
        read.for_each_entry(|_, reader| {
            let drained = std::io::copy(reader, &mut std::io::sink());
            drained.map(drop).map_err(|error| read.unreadable_error(&error))
        })?;
        let bytes = part.metadata().map_err(BackupError::file_error("read", &part))?.len();
        rename_to_final(&part, archive, folder)?;
        return Ok(BackupReport { differences: Vec::new(), manifest, bytes });
    }
    let manifest = PackContent::default().manifest(made_unix_s);
    Ok(BackupReport { differences: vec![last], manifest, bytes: 0 })
}

/// Renames the archive to its final name, without overwriting a file that has appeared there.
fn rename_to_final(part: &Path, archive: &Path, folder: &Path) -> Result<(), BackupError> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    renameat_with(CWD, part, CWD, archive, RenameFlags::NOREPLACE).map_err(|error| match error {
        rustix::io::Errno::EXIST => BackupError::AlreadyExists { path: archive.to_owned() },
        error => BackupError::file_error("write", archive)(error.into()),
    })?;
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(BackupError::file_error("flush", folder))
}

impl PackContent {
    fn manifest(&self, made_unix_s: i64) -> Manifest {
        let program = env!("CARGO_PKG_VERSION").to_owned();
        Manifest { format: MANIFEST_FORMAT, program, made_unix_s, links: self.links, entries: self.entries.clone() }
    }

    fn add(&mut self, entry: &Entry, (bytes, sha256): (u64, String), source: EntrySource) {
        self.entries.push(ManifestEntry { name: entry.name(), bytes, sha256 });
        self.sources.push(source);
    }

    /// Adds the store, and copies its rows to the folder `rows`. Returns the contradictions found in the store, if
    /// there are any.
    fn add_store(&mut self, store: &Path, rows: &Path) -> Result<Option<Vec<String>>, BackupError> {
        let copied = Store::copy_rows(store, rows)?;
        if !copied.deviations.is_empty() {
            return Ok(Some(copied.deviations));
        }
        self.links = Some(copied.links);
        for file in ROW_FILES {
            let path = rows.join(file);
            let mut open = File::open(&path).map_err(BackupError::file_error("read", &path))?;
            let content = copy_hashed(&mut open, &mut std::io::sink()).map_err(|error| {
                let (CopySide::Read(error) | CopySide::Written(error)) = error;
                BackupError::file_error("read", &path)(error)
            })?;
            self.add(&Entry::Rows(file), content, EntrySource::File(path));
        }
        let mut found = Vec::new();
        for hash in copied.files {
            let path = store.join(BLOBS).join(&hash);
            match path.metadata() {
                Ok(file) => self.add(&Entry::Blob(hash.clone()), (file.len(), hash), EntrySource::File(path)),
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    found.push(format!("the file {BLOBS}/{hash} is missing, and no removal was recorded"));
                }
                Err(error) => return Err(BackupError::file_error("read", &path)(error)),
            }
        }
        Ok((!found.is_empty()).then_some(found))
    }

    fn add_configuration(&mut self, configuration: &Configuration) -> Result<(), BackupError> {
        let mut add = |entry: Entry, bytes: Vec<u8>| {
            let said = (bytes.len() as u64, content_hash(&bytes));
            self.add(&entry, said, EntrySource::Bytes(bytes));
        };
        add(Entry::Cell, configuration.cell.clone().into_bytes());
        for (key, file) in &configuration.named_files {
            add(Entry::Named(key.clone()), read_small_file(file)?);
        }
        for (name, file) in &configuration.recipes {
            add(Entry::Recipe(name.clone()), read_small_file(file)?);
        }
        Ok(())
    }
}

fn read_small_file(file: &Path) -> Result<Vec<u8>, BackupError> {
    let bytes = panelprep_base::disk::read(file).map_err(BackupError::file_error("read", file))?;
    match bytes.len() as u64 {
        found if found > MAX_CONFIGURATION_BYTES => {
            Err(BackupError::TooLarge { path: file.to_owned(), found, limit_bytes: MAX_CONFIGURATION_BYTES })
        }
        _ => Ok(bytes),
    }
}

/// Packs all entries into a file, adds the seal, and flushes the file to the disk.
fn pack_archive(part: &Path, manifest: &Manifest, sources: &[EntrySource]) -> Result<(), PackFailure> {
    let failed = BackupError::file_error("write", part);
    // Only the owner may read the archive, because it contains all data of the cell.
    let mut options = fs::OpenOptions::new();
    std::os::unix::fs::OpenOptionsExt::mode(options.write(true).create_new(true), 0o600);
    let file = options.open(part).map_err(&failed)?;
    let sealing = HashingWriter::new(BufWriter::with_capacity(1 << 20, file));
    let mut encoder = zstd::Encoder::new(sealing, COMPRESSION_LEVEL).map_err(&failed)?;
    encoder.include_checksum(true).map_err(&failed)?;
    let mut tar = tar::Builder::new(encoder);
    let text = serde_json::to_vec_pretty(manifest).map_err(|error| failed(error.into()))?;
    append(&mut tar, MANIFEST_NAME, text.len() as u64, &mut text.as_slice()).map_err(&failed)?;
    for (listed, source) in manifest.entries.iter().zip(sources) {
        match source {
            EntrySource::Bytes(bytes) => {
                append(&mut tar, &listed.name, listed.bytes, &mut bytes.as_slice()).map_err(&failed)?;
            }
            EntrySource::File(path) => file_entry(&mut tar, listed, path, &failed)?,
        }
    }
    let encoder = tar.into_inner().map_err(&failed)?;
    let sealed = encoder.finish().and_then(HashingWriter::seal).map_err(&failed)?;
    let file = sealed.into_inner().map_err(|error| failed(error.into_error()))?;
    Ok(file.sync_all().map_err(&failed)?)
}

/// Packs a file of the store while its hash is verified.
fn file_entry<W: Write>(
    tar: &mut tar::Builder<W>,
    listed: &ManifestEntry,
    path: &Path,
    failed: &dyn Fn(std::io::Error) -> BackupError,
) -> Result<(), PackFailure> {
    let damaged = |words: &str| PackFailure::Blob(format!("the file {} {words}", listed.name));
    let file = File::open(path).map_err(|error| match error.kind() {
        ErrorKind::NotFound => damaged("is missing, and no removal was recorded"),
        _ => BackupError::file_error("read", path)(error).into(),
    })?;
    let mut hashing =
        HashingReader { inner: file.take(listed.bytes), hasher: Sha256::new(), count: 0, failed: None };
    let appended = append(tar, &listed.name, listed.bytes, &mut hashing);
    if let Some(error) = hashing.failed {
        return Err(BackupError::file_error("read", path)(error).into());
    }
    appended.map_err(failed)?;
    let found = hex(&hashing.hasher.finalize());
    match hashing.count == listed.bytes && found == listed.sha256 {
        true => Ok(()),
        false => Err(damaged(&format!("is damaged: its SHA-256 is {found}"))),
    }
}

fn append<W: Write>(
    tar: &mut tar::Builder<W>,
    name: &str,
    bytes: u64,
    content: &mut dyn Read,
) -> Result<(), std::io::Error> {
    let mut header = tar::Header::new_gnu();
    header.set_size(bytes);
    header.set_mode(0o644);
    header.set_entry_type(tar::EntryType::Regular);
    tar.append_data(&mut header, name, content)
}

/// A reader that computes the hash of all bytes that are read, and keeps a read error apart from a write error.
struct HashingReader<R> {
    inner: R,
    hasher: Sha256,
    count: u64,
    failed: Option<std::io::Error>,
}

impl<R: Read> Read for HashingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match self.inner.read(buffer) {
            Ok(count) => {
                self.hasher.update(&buffer[..count]);
                self.count += count as u64;
                Ok(count)
            }
            Err(error) => {
                let kind = error.kind();
                self.failed = Some(error);
                Err(kind.into())
            }
        }
    }
}

/// The side of a copy that failed.
pub(super) enum CopySide {
    Read(std::io::Error),
    Written(std::io::Error),
}

/// Copies all bytes, and returns their number and their SHA-256.
pub(super) fn copy_hashed(from: &mut dyn Read, to: &mut dyn Write) -> Result<(u64, String), CopySide> {
    let (mut hasher, mut count, mut buffer) = (Sha256::new(), 0, vec![0; 1 << 16]);
    loop {
        match from.read(&mut buffer).map_err(CopySide::Read)? {
            0 => return Ok((count, hex(&hasher.finalize()))),
            read => {
                hasher.update(&buffer[..read]);
                to.write_all(&buffer[..read]).map_err(CopySide::Written)?;
                count += read as u64;
            }
        }
    }
}
