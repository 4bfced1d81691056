//! The file of the private key with which a cell signs its records. It is created when it is first needed, and only its
//! owner can read it.

use super::error::StoreError;
use super::flush;
use crate::signing::{CellKey, PublicKey, SigningError};
use panelprep_base::random;
use std::fs::{self, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Name of the private key's file in the folder of the store, if no other file is configured.
const PRIVATE_KEY_FILE: &str = "record-key.pem";
/// Name of the public keys' file in the folder of the store. The public key of a replaced key stays in this file,
/// because it verifies older records.
const PUBLIC_KEY_FILE: &str = "record-key.pub.pem";

/// Where the file of the private key is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KeyLocation {
    /// In the folder of the store.
    InStore,
    /// At this path; the file is created if it does not exist.
    File(PathBuf),
    /// At this path; the file is provided from outside, such as a systemd credential, and is not created.
    Provided(PathBuf),
}

/// Returns the private key of a cell. If there is none yet, it is created from random bytes of the operating system.
/// The public key is written to the folder of the store as PEM.
///
/// # Errors
/// If the file cannot be read or created, contains no ed25519 key, or can be read by other users.
pub fn cell_key(store: &Path, place: &KeyLocation) -> Result<CellKey, StoreError> {
    let (file, may_be_made) = match place {
        KeyLocation::InStore => (store.join(PRIVATE_KEY_FILE), true),
        KeyLocation::File(file) => (file.clone(), true),
        KeyLocation::Provided(file) => (file.clone(), false),
    };
    let key = match fs::read_to_string(&file) {
        Ok(pem) => {
            if may_be_made {
                check_private(&file)?;
            }
            CellKey::read(&pem).map_err(|source| key_error(&file, source))?
        }
        Err(error) if error.kind() == ErrorKind::NotFound && may_be_made => create_key_file(&file)?,
        Err(error) => return Err(file_error("read", &file)(error)),
    };
    publish(store, &key)?;
    Ok(key)
}

/// Returns the public keys in the folder of the store: of the present private key and of replaced ones.
///
/// # Errors
/// If the file is missing, or contains other data.
pub fn public_keys(store: &Path) -> Result<Vec<PublicKey>, StoreError> {
    let file = store.join(PUBLIC_KEY_FILE);
    let pem = fs::read_to_string(&file).map_err(file_error("read", &file))?;
    PublicKey::parse_all(&pem).map_err(|source| key_error(&file, source))
}

/// Checks that only the owner can read the private key: any other reader could sign in the name of the cell.
fn check_private(file: &Path) -> Result<(), StoreError> {
    let mode = fs::metadata(file).map_err(file_error("look at", file))?.mode() & 0o777;
    if mode & 0o077 == 0 {
        return Ok(());
    }
    let words = format!(
        "users other than its owner can use the file (mode {mode:03o}, valid: 600): run chmod 600, or replace the \
         key if others may have read it"
    );
    Err(file_error("use", file)(io::Error::new(ErrorKind::PermissionDenied, words)))
}

/// Creates the file of the private key with a temporary name and renames it, so that the file is always complete. If
/// another process has created a key first, this key is returned.
fn create_key_file(file: &Path) -> Result<CellKey, StoreError> {
    let bytes = random::bytes().map_err(file_error("make", file))?;
    let key = CellKey::from_random_bytes(&bytes);
    let pem = key.to_pem().map_err(|source| key_error(file, source))?;
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(file_error("create", folder))?;
    match write_temporary(folder, &pem).map_err(file_error("make", file))?.persist_noclobber(file) {
        Ok(_) => flush::flush_folder(folder).map(|()| key).map_err(file_error("make", file)),
        Err(error) if error.error.kind() == ErrorKind::AlreadyExists => {
            let pem = fs::read_to_string(file).map_err(file_error("read", file))?;
            CellKey::read(&pem).map_err(|source| key_error(file, source))
        }
        Err(error) => Err(file_error("make", file)(error.error)),
    }
}

/// Writes and flushes a temporary file in this folder, which only its owner can read.
fn write_temporary(folder: &Path, text: &str) -> io::Result<NamedTempFile> {
    let mut file = NamedTempFile::new_in(folder)?;
    file.write_all(text.as_bytes())?;
    file.as_file().sync_all()?;
    Ok(file)
}

/// Adds the public key to its file, unless the file already contains it.
fn publish(store: &Path, key: &CellKey) -> Result<(), StoreError> {
    let file = store.join(PUBLIC_KEY_FILE);
    let before = match fs::read_to_string(&file) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
        Err(error) => return Err(file_error("read", &file)(error)),
    };
    if PublicKey::parse_all(&before).is_ok_and(|keys| keys.contains(&key.public_key())) {
        return Ok(());
    }
    let pem = key.public_key().to_pem().map_err(|source| key_error(&file, source))?;
    let write = || {
        fs::create_dir_all(store)?;
        let written = write_temporary(store, &format!("{pem}{before}"))?;
        // Every user may read the public key, which verifies the signatures of the cell.
        written.as_file().set_permissions(Permissions::from_mode(0o644))?;
        written.persist(&file).map_err(|error| error.error).map(drop)
    };
    write().map_err(file_error("write", &file))
}

fn key_error(file: &Path, source: SigningError) -> StoreError {
    StoreError::Signing { path: file.to_owned(), source }
}

fn file_error<'p>(doing: &'static str, path: &'p Path) -> impl Fn(io::Error) -> StoreError + 'p {
    move |source| StoreError::File { operation: doing, path: path.to_owned(), source }
}
