//! Restores a backup: all files are unpacked beside their final path and verified, and then moved to their final path.

use super::entry::Entry;
use super::error::BackupError;
use super::placing::RestoreTransaction;
use super::read::Archive;
use super::write::{CopySide, copy_hashed};
use crate::store::{BLOBS, Restore, Store, StoreError, WriteLease, free_mb};
use panelprep_cell::cell::{Camera, Cell};
use panelprep_cell::record::CycleId;
use std::collections::BTreeMap;
use std::fs::{self, File, Metadata};
use std::io::{Read, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::net::UnixStream;
use std::path::{Component, Path, PathBuf};

/// Which parts of the backup are restored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RestoredParts {
    /// Whether the store is restored.
    pub store: bool,
    /// Whether the configuration is restored.
    pub configuration: bool,
}

/// What a person has explicitly permitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Permission {
    /// Whether an existing store may be replaced.
    pub replace_store: bool,
    /// Whether existing configuration files may be replaced.
    pub replace_configuration: bool,
    /// Whether files may be written outside of the folder of the cell's file, if the cell's file names them.
    pub outside: bool,
}

/// The parameters of a restore.
#[derive(Debug, Clone, Copy)]
pub struct Plan<'p> {
    /// The path of the archive.
    pub archive: &'p Path,
    /// The path of the cell's file, which exists or is to be restored.
    pub cell: &'p Path,
    /// The folder of the store; `None` for the folder that the cell's file states.
    pub store: Option<&'p Path>,
    /// Which parts of the backup are restored.
    pub parts: RestoredParts,
    /// What a person has permitted.
    pub permission: Permission,
    /// The number of the cell's last cycle, as stated by a person. It is required if the replaced store does not
    /// contain this number. It also confirms that the replaced store is the newest one.
    pub last_cycle: Option<CycleId>,
}

/// The result of a restore.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RestoreReport {
    /// Contradictions found in the store of the archive, as texts. If there are any, nothing was restored.
    pub differences: Vec<String>,
    /// The folder of the restored store.
    pub store: Option<PathBuf>,
    /// What is known about the cycles after the backup; `None` if no store was restored.
    pub since_backup: Option<Restore>,
    /// The paths of the restored configuration files.
    pub configuration: Vec<PathBuf>,
    /// The new paths of the replaced files.
    pub replaced_files: Vec<PathBuf>,
    /// Number of verified links in the store's hash chain.
    pub links: u64,
    /// Number of verified files of the store.
    pub files: u64,
}

/// Restores the requested parts. No existing file is replaced without permission. After an error, all files are as
/// before.
///
/// # Errors
/// If the archive is damaged, a file already exists, a service or another program uses the store, or the disk is full
/// or fails.
pub fn restore(plan: &Plan<'_>) -> Result<RestoreReport, BackupError> {
    let archive = Archive::open(plan.archive)?;
    let not_in_it = |wanted| BackupError::PartMissing { path: plan.archive.to_owned(), wanted };
    if plan.parts.store && !archive.manifest.has_store() {
        return Err(not_in_it("store"));
    }
    if plan.parts.configuration && !archive.manifest.has_configuration() {
        return Err(not_in_it("configuration"));
    }
    let in_place = installed_cell(plan.cell);
    let files = if plan.parts.configuration { configuration(&archive, plan.cell)? } else { BTreeMap::new() };
    let restored_cell = match files.get(plan.cell) {
        Some(bytes) => Some(checked_cell(&archive, plan.cell, bytes)?),
        None => None,
    };
    let cell = restored_cell.as_ref().or(in_place.as_ref());
    let store = match (plan.parts.store, plan.store, cell) {
        (false, _, _) => None,
        (true, Some(folder), _) => Some(folder.to_owned()),
        (true, None, Some(cell)) => Some(cell.store().to_owned()),
        (true, None, None) => return Err(not_in_it("configuration")),
    };
    let files = files_to_write(files, plan)?;
    let store_in_place = plan.store.or(in_place.as_ref().map(Cell::store));
    check_service_stopped(
        [in_place.as_ref().zip(store_in_place), cell.zip(store.as_deref())].into_iter().flatten(),
    )?;
    let mut lease = None;
    if let Some(folder) = store.as_deref().filter(|folder| has_entries(folder)) {
        if !plan.permission.replace_store {
            return Err(BackupError::NotReplaced { paths: vec![folder.to_owned()], option: "store" });
        }
        // The lease is kept until the end, so that no program writes to the store while it is replaced.
        lease = Some(WriteLease::acquire(folder)?);
    }
    let mut placing = RestoreTransaction::default();
    let restored = unpack_and_place(&archive, (store.as_deref(), plan.last_cycle), &files, &mut placing);
    let restored = match restored {
        Ok(restored) if restored.differences.is_empty() => restored,
        Ok(restored) => return roll_back_restore(placing, restored),
        Err(error) => return Err(placing.roll_back(error)),
    };
    drop(lease);
    let kept = placing.commit()?;
    Ok(RestoreReport { replaced_files: kept, ..restored })
}

/// Undoes all steps, because contradictions were found in the store of the archive.
fn roll_back_restore(placing: RestoreTransaction, restored: RestoreReport) -> Result<RestoreReport, BackupError> {
    let told = restored.differences.join("; ");
    let cause = BackupError::Damaged { path: PathBuf::new(), problem: told };
    match placing.roll_back(cause) {
        error @ BackupError::RollbackFailed { .. } => Err(error),
        _ => Ok(RestoreReport { differences: restored.differences, ..RestoreReport::default() }),
    }
}

/// Unpacks and verifies all files, and moves them to their final path.
fn unpack_and_place(
    archive: &Archive,
    (store, last_cycle): (Option<&Path>, Option<CycleId>),
    files: &BTreeMap<PathBuf, Vec<u8>>,
    placing: &mut RestoreTransaction,
) -> Result<RestoreReport, BackupError> {
    let mut restored = RestoreReport::default();
    let mut puts: Vec<(PathBuf, PathBuf)> = Vec::new();
    if let Some(folder) = store {
        let staged = staged_store(archive, folder, placing)?;
        let verified = Store::verify(&staged, true).map_err(|error| earlier_version_error(archive, error))?;
        if !verified.differences.is_empty() {
            return Ok(RestoreReport { differences: verified.differences, ..restored });
        }
        (restored.links, restored.files) = (verified.links, verified.files);
        let restore = since_backup(archive, (&staged, folder), last_cycle)?;
        Store::mark_restored(&staged, &restore).map_err(BackupError::Store)?;
        copy_permissions(&staged, folder.metadata().ok().as_ref())
            .map_err(BackupError::file_error("write", &staged))?;
        puts.push((staged, folder.to_owned()));
        (restored.store, restored.since_backup) = (Some(folder.to_owned()), Some(restore));
    }
    for (at, bytes) in files {
        let staged = staged_file(at, bytes, placing)?;
        puts.push((staged, at.clone()));
        restored.configuration.push(at.clone());
    }
    // It was checked earlier which files may be replaced. A file that has appeared since then is not replaced, and all
    // steps are undone.
    for (staged, at) in &puts {
        placing.move_to_final(staged, at, at.symlink_metadata().is_ok())?;
    }
    Ok(restored)
}

/// Returns what is known about the cycles after the backup: from the replaced store, from the person's statement, or
/// from both. The replaced store proves that nothing was sanded only if the person stated the number of its last cycle.
fn since_backup(
    archive: &Archive,
    (staged, replaced): (&Path, &Path),
    stated: Option<CycleId>,
) -> Result<Restore, BackupError> {
    let own = Store::open(staged).and_then(|store| store.newest_cycle()).map_err(BackupError::Store)?;
    if let (Some(own), Some(stated)) = (own, stated)
        && stated.0 < own.0
    {
        return Err(BackupError::LastCycleTooLow { stated: stated.0, own: own.0 });
    }
    let made_unix_s = archive.manifest.made_unix_s;
    let above = |stated: CycleId, found: CycleId| CycleId(stated.0.max(found.0));
    let shown = Store::compute_restore(replaced, staged, made_unix_s);
    match (shown, stated) {
        (None, None) => {
            Err(BackupError::LastCycleUnknown { path: replaced.to_owned(), own: own.map_or(0, |own| own.0) })
        }
        (None, Some(stated)) => {
            // A cycle number must not be used twice, even if it is known only from a store that fails verification.
            let found = Store::last_readable_number(replaced, staged);
            let last_cycle = found.map_or(stated, |found| above(stated, found));
            Ok(Restore { last_cycle, made_unix_s: Some(made_unix_s), is_nothing_abraded: false })
        }
        (Some(shown), None) => Ok(Restore { is_nothing_abraded: false, ..shown }),
        (Some(shown), Some(stated)) => {
            // If the numbers differ, either the replaced store is not the newest one, or the person's statement is
            // wrong.
            let is_confirmed = stated == shown.last_cycle;
            let last_cycle = above(stated, shown.last_cycle);
            Ok(Restore { last_cycle, is_nothing_abraded: shown.is_nothing_abraded && is_confirmed, ..shown })
        }
    }
}

/// Returns the error for a store of an earlier program version, which only that version can verify.
fn earlier_version_error(archive: &Archive, error: StoreError) -> BackupError {
    match error {
        StoreError::Older { found, known, .. } => archive.earlier_version_error(found, known),
        error => BackupError::Store(error),
    }
}

/// Returns the existing cell's file, if it can be parsed.
fn installed_cell(file: &Path) -> Option<Cell> {
    let text = String::from_utf8(panelprep_base::disk::read(file).ok()?).ok()?;
    Cell::check(&file.display().to_string(), &text).ok()
}

fn checked_cell(archive: &Archive, file: &Path, bytes: &[u8]) -> Result<Cell, BackupError> {
    let text = std::str::from_utf8(bytes).map_err(|error| archive.damaged_error(&error.to_string()))?;
    let checked = Cell::check(&file.display().to_string(), text);
    checked.map_err(|problems| {
        archive.damaged_error(&format!("this program does not accept the cell's file in the backup:\n{problems}"))
    })
}

/// Returns the configuration files, including the cell's file, by their final paths.
fn configuration(archive: &Archive, cell_file: &Path) -> Result<BTreeMap<PathBuf, Vec<u8>>, BackupError> {
    let mut texts: BTreeMap<Entry, Vec<u8>> = BTreeMap::new();
    archive.for_each_entry(|entry, reader| -> Result<(), BackupError> {
        if !entry.belongs_to_store() {
            let mut bytes = Vec::new();
            reader.read_to_end(&mut bytes).map_err(|error| archive.unreadable_error(&error))?;
            texts.insert(entry.clone(), bytes);
        }
        Ok(())
    })?;
    let missing = || archive.damaged_error("the cell's file is missing in the backup");
    let cell = checked_cell(archive, cell_file, texts.get(&Entry::Cell).ok_or_else(missing)?)?;
    let named: BTreeMap<String, PathBuf> = named_files(&cell).into_iter().collect();
    let folder = cell_file.parent().unwrap_or(Path::new(""));
    let mut files = BTreeMap::new();
    for (entry, bytes) in texts {
        let at = match &entry {
            Entry::Cell => cell_file.to_owned(),
            Entry::Recipe(name) => folder.join(name),
            Entry::Named(key) => match named.get(key) {
                Some(file) => file.clone(),
                None => return Err(archive.damaged_error(&format!("the cell's file in the backup names no {key}"))),
            },
            Entry::Rows(_) | Entry::Blob(_) => continue,
        };
        if files.insert(at.clone(), bytes.clone()).is_some_and(|other| other != bytes) {
            return Err(
                archive.damaged_error(&format!("two files of the backup have the same path {}", at.display()))
            );
        }
    }
    Ok(files)
}

/// Returns the configuration files that a cell's file names, each with its key.
pub fn named_files(cell: &Cell) -> Vec<(String, PathBuf)> {
    let calibration = cell.calibration().named_files().into_iter();
    let mut files: Vec<(String, PathBuf)> =
        calibration.map(|(key, file)| (format!("calibration.{key}"), file.to_owned())).collect();
    if let Camera::Device(zivid) = cell.scanner() {
        let settings = [("settings", &zivid.settings), ("settings_2d", &zivid.settings_2d)];
        files
            .extend(settings.into_iter().filter_map(|(key, file)| Some((format!("scanner.{key}"), file.clone()?))));
    }
    files
}

/// Returns the configuration files that must be written. Existing files with the same content are omitted. To replace
/// other files, or to write outside of the folder, a permission is needed.
fn files_to_write(
    files: BTreeMap<PathBuf, Vec<u8>>,
    plan: &Plan<'_>,
) -> Result<BTreeMap<PathBuf, Vec<u8>>, BackupError> {
    let folder = plan.cell.parent().unwrap_or(Path::new(""));
    let outside: Vec<PathBuf> = files.keys().filter(|file| !is_below(file, folder)).cloned().collect();
    if !outside.is_empty() && !plan.permission.outside {
        return Err(BackupError::Outside { paths: outside, folder: folder.to_owned() });
    }
    let is_new = |file: &Path, bytes: &[u8]| fs::read(file).map_or(true, |found| found != bytes);
    let files: BTreeMap<PathBuf, Vec<u8>> = files.into_iter().filter(|(file, bytes)| is_new(file, bytes)).collect();
    let there: Vec<PathBuf> = files.keys().filter(|file| file.symlink_metadata().is_ok()).cloned().collect();
    if !there.is_empty() && !plan.permission.replace_configuration {
        return Err(BackupError::NotReplaced { paths: there, option: "configuration" });
    }
    Ok(files)
}

/// Returns whether the path of a file lies in the folder or below it.
fn is_below(file: &Path, folder: &Path) -> bool {
    let rest = match (std::path::absolute(file), std::path::absolute(folder)) {
        (Ok(file), Ok(folder)) => file.strip_prefix(folder).map(Path::to_owned),
        _ => return false,
    };
    rest.is_ok_and(|rest| rest.components().all(|part| matches!(part, Component::Normal(_))))
}

/// Checks that no service replies on the sockets of these cells.
fn check_service_stopped<'c>(cells: impl Iterator<Item = (&'c Cell, &'c Path)>) -> Result<(), BackupError> {
    for (cell, store) in cells {
        for socket in [cell.socket().map(Path::to_owned), Some(store.join("panelprep.sock"))].into_iter().flatten()
        {
            if UnixStream::connect(&socket).is_ok() {
                return Err(BackupError::InUse { user: format!("a service is running on {}", socket.display()) });
            }
        }
    }
    Ok(())
}

fn has_entries(folder: &Path) -> bool {
    match fs::read_dir(folder) {
        Ok(mut entries) => entries.next().is_some(),
        Err(_) => folder.symlink_metadata().is_ok(),
    }
}

/// Unpacks the store beside its final path, and flushes it to the disk.
fn staged_store(
    archive: &Archive,
    folder: &Path,
    placing: &mut RestoreTransaction,
) -> Result<PathBuf, BackupError> {
    let parent = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    placing.make_folder(parent)?;
    let needed_mb = archive.manifest.store_bytes() / 1_000_000 + 1;
    let free_mb = free_mb(parent).map_err(BackupError::file_error("read the free space on the disk of", parent))?;
    if free_mb < needed_mb {
        return Err(BackupError::NoRoom { path: parent.to_owned(), free_mb, needed_mb });
    }
    let made = tempfile::Builder::new().prefix(".panelprep-restore-").tempdir_in(parent);
    // The temporary folder must not be removed automatically, because it is moved to its final path. After a failed
    // restore, the rollback removes it.
    let staged = made.map_err(BackupError::file_error("write in", parent))?.keep();
    placing.record_staged(&staged);
    let blobs = staged.join(BLOBS);
    fs::create_dir(&blobs).map_err(BackupError::file_error("create", &blobs))?;
    archive.for_each_entry(|entry, reader| match entry {
        Entry::Rows(file) => unpack_to(archive, &staged.join(file), reader),
        Entry::Blob(hash) => unpack_to(archive, &blobs.join(hash), reader),
        _ => Ok(()),
    })?;
    for folder in [&blobs, &staged] {
        File::open(folder)
            .and_then(|folder| folder.sync_all())
            .map_err(BackupError::file_error("flush", folder))?;
    }
    Ok(staged)
}

fn unpack_to(archive: &Archive, to: &Path, reader: &mut dyn Read) -> Result<(), BackupError> {
    let failed = BackupError::file_error("write", to);
    let mut file = File::create_new(to).map_err(&failed)?;
    match copy_hashed(reader, &mut file) {
        Ok(_) => file.sync_all().map_err(&failed),
        Err(CopySide::Read(error)) => Err(archive.unreadable_error(&error)),
        Err(CopySide::Written(error)) => Err(failed(error)),
    }
}

fn staged_file(at: &Path, bytes: &[u8], placing: &mut RestoreTransaction) -> Result<PathBuf, BackupError> {
    let folder = at.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    placing.make_folder(folder)?;
    let failed = BackupError::file_error("write", at);
    let made = tempfile::Builder::new().prefix(".panelprep-restore-").tempfile_in(folder).map_err(&failed)?;
    let (mut file, staged) = made.keep().map_err(|error| failed(error.error))?;
    placing.record_staged(&staged);
    let written = file.write_all(bytes).and_then(|()| file.sync_all());
    written.map_err(&failed)?;
    copy_file_permissions(&staged, at.metadata().ok().as_ref()).map_err(&failed)?;
    Ok(staged)
}

const DEFAULT_FILE_MODE: u32 = 0o644;
const DEFAULT_FOLDER_MODE: u32 = 0o750;

/// Sets the owner and the permissions of a file to those of the replaced file; without a replaced file, sets the
/// default permissions.
fn copy_file_permissions(file: &Path, before: Option<&Metadata>) -> std::io::Result<()> {
    if let Some(before) = before {
        chown(file, Some(before.uid()), Some(before.gid()))?;
    }
    let mode = before.map_or(DEFAULT_FILE_MODE, |before| before.mode() & 0o777);
    fs::set_permissions(file, fs::Permissions::from_mode(mode))
}

/// Sets the owner and the permissions of a store to those of the replaced store, so that the same service can write to
/// it.
fn copy_permissions(store: &Path, before: Option<&Metadata>) -> std::io::Result<()> {
    if let Some(before) = before {
        let blobs = store.join(BLOBS);
        let files = fs::read_dir(store)?.chain(fs::read_dir(&blobs)?);
        let files: Vec<PathBuf> = files.map(|file| file.map(|file| file.path())).collect::<Result<_, _>>()?;
        for path in files.iter().map(PathBuf::as_path).chain([blobs.as_path(), store]) {
            chown(path, Some(before.uid()), Some(before.gid()))?;
        }
    }
    let mode = before.map_or(DEFAULT_FOLDER_MODE, |before| before.mode() & 0o777);
    fs::set_permissions(store, fs::Permissions::from_mode(mode))
}
