//! Recordings of cycles: the places and names that are allowed for their files, the free space that they need, the data
//! with which they begin, and their status.

use super::cycle_setup::Calibrations;
use super::disk;
use super::fault::SetupFault;
use crate::report::page::{Row, Section};
use panelprep_cell::record::CycleId;
use panelprep_store::store;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Component, Path, PathBuf};

/// Minimum free disk space at the beginning of a cycle, MB: enough for the cycle's pictures and for the longest journal
/// of a day.
pub const MIN_FREE_SPACE_MB: u64 = 1_000;
/// Free disk space below which a recording ends, MB: twice the space that the service needs to begin a cycle.
pub const MIN_FREE_SPACE_FOR_RECORDING_MB: u64 = 2 * MIN_FREE_SPACE_MB;

/// The data with which a recording begins, and its file.
#[derive(Debug, Clone)]
pub struct RecordingPlan {
    /// A new file; `None` if the store names it by the cycle's number.
    pub file: Option<PathBuf>,
    /// The files that the cycle uses, by their names in the recording.
    pub files: Vec<(String, Vec<u8>)>,
    /// The calibrations.
    pub calibrations: Calibrations,
}

/// The status of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingResult {
    /// The file.
    pub file: String,
    /// Whether the recording can be replayed.
    pub is: RecordingStatus,
    /// Number of entries in the recording.
    pub entries: u64,
    /// The status in words for people.
    pub message: String,
}

/// Whether a recording can be replayed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordingStatus {
    /// The recording is being written.
    UnderWay,
    /// The recording is complete.
    Whole,
    /// The recording is not complete.
    NotWhole,
}

impl RecordingResult {
    /// Returns the status of a recording that can be replayed.
    pub fn complete_recording(file: String, entries: u64) -> Self {
        let message = format!("recorded in {file}, {entries} entries");
        RecordingResult { file, is: RecordingStatus::Whole, entries, message }
    }

    /// Returns the status of a recording that cannot be replayed, for this reason; its number of entries is not
    /// known.
    pub fn incomplete_recording(file: String, why: &str) -> Self {
        let message = format!("{file} cannot be replayed: {why}");
        RecordingResult { file, is: RecordingStatus::NotWhole, entries: 0, message }
    }
}

/// Returns the folder with the recordings of a store.
pub fn recordings(store: &Path) -> PathBuf {
    store.join("recordings")
}

/// Returns the default file for the recording of a cycle.
pub fn recording_file(store: &Path, cycle: CycleId) -> PathBuf {
    recordings(store).join(format!("cycle-{:06}.mcap", cycle.0))
}

/// Returns the free space on the disk on which this file is, or will be, MB.
///
/// # Errors
/// If the disk cannot be queried.
pub fn free_mb(file: &Path) -> io::Result<u64> {
    let there = std::path::absolute(file)?;
    store::free_mb(there.ancestors().find(|path| path.exists()).unwrap_or(Path::new("/")))
}

/// Describes why nothing is recorded on a disk with this free space.
pub fn disk_full_message(free_mb: u64) -> String {
    format!(
        "the disk of the recording has {free_mb} MB of free space (minimum {MIN_FREE_SPACE_FOR_RECORDING_MB} MB); delete files"
    )
}

/// Checks, before anything moves, that a recording could begin in this file or, without a file, in this store.
///
/// # Errors
/// If the file exists already, its folder does not exist, or there is too little room.
pub fn check_recording_file(file: Option<&Path>, store: &Path) -> Result<(), SetupFault> {
    if let Some(file) = file {
        if file.exists() {
            return Err(file_exists_fault(file));
        }
        let folder = disk::folder_of(file);
        if !folder.is_dir() {
            return Err(missing_folder_fault(folder));
        }
        if rustix::fs::access(folder, rustix::fs::Access::WRITE_OK | rustix::fs::Access::EXEC_OK).is_err() {
            let words = "this program's user may not write to this folder, or the systemd unit prevents it; record to another folder";
            return Err(SetupFault::file_fault(folder, words));
        }
    }
    let place = file.unwrap_or(store);
    let free_mb = free_mb(place).map_err(|error| SetupFault::file_fault(place, error))?;
    if free_mb < MIN_FREE_SPACE_FOR_RECORDING_MB {
        return Err(SetupFault::file_fault(place, disk_full_message(free_mb)));
    }
    Ok(())
}

/// Checks the same for a file that a command names, which this program writes with the rights of its user. The file
/// must also be outside the store, where only the program names files. The store may be made later.
///
/// # Errors
/// As [`check_recording_file`], and if the file is inside the store or is a link.
pub fn check_command_file(file: &Path, store: &Path) -> Result<(), SetupFault> {
    // A link is refused as an existing file, wherever it leads, and also if it leads nowhere.
    if file.symlink_metadata().is_ok() {
        return Err(file_exists_fault(file));
    }
    check_recording_file(Some(file), store)?;
    if store.exists() && is_inside_store(disk::folder_of(file), store)? {
        return Err(refused_name(file, STORE_PATH_REFUSAL));
    }
    Ok(())
}

/// Returns whether a folder is the store or is inside it, after all links are resolved.
fn is_inside_store(folder: &Path, store: &Path) -> Result<bool, SetupFault> {
    let resolved = |path: &Path| path.canonicalize().map_err(|error| SetupFault::file_fault(path, error));
    Ok(resolved(folder)?.starts_with(resolved(store)?))
}

fn refused_name(file: &Path, words: &'static str) -> SetupFault {
    let shown: String =
        file.to_string_lossy().chars().flat_map(char::escape_debug).take(MAX_SHOWN_CHARACTERS).collect();
    SetupFault::RecordName { file: shown, words }
}

const STORE_PATH_REFUSAL: &str = "the file is inside the store, where only the service names files; name a file outside of \
                            the store, or give --record without a name to record to the store's recordings/";

/// Returns the path of a recording that a client of the service names. It must be an absolute path of a new file
/// outside the store; all links in it are resolved. So a client cannot make the service write into its store or over an
/// existing file.
///
/// # Errors
/// If the name does not meet these conditions, or its folder does not exist.
pub fn check_client_file(file: &Path, store: &Path) -> Result<PathBuf, SetupFault> {
    let refused = |words| refused_name(file, words);
    let Some(text) = file.to_str() else { return Err(refused("the path is not UTF-8")) };
    if text.chars().any(char::is_control) {
        return Err(refused("the path contains control characters, such as a line feed"));
    }
    if !file.is_absolute() {
        return Err(refused(
            "the path is relative, but the service runs in another folder; give the absolute path",
        ));
    }
    let is_plain = file.components().all(|part| matches!(part, Component::RootDir | Component::Normal(_)));
    // The components of a path do not include a . after the first one.
    let has_dot = text.contains("/./") || text.ends_with("/.");
    let name = file.file_name().filter(|_| is_plain && !text.ends_with('/') && !has_dot);
    let (Some(name), Some(folder)) = (name, file.parent()) else {
        return Err(refused("the path contains . or .., or names a folder; give the absolute path of a new file"));
    };
    if !folder.is_dir() {
        return Err(missing_folder_fault(folder));
    }
    if is_inside_store(folder, store)? {
        return Err(refused(STORE_PATH_REFUSAL));
    }
    let folder = folder.canonicalize().map_err(|error| SetupFault::file_fault(folder, error))?;
    let file = folder.join(name);
    // A link is refused as an existing file, wherever it leads, and also if it leads nowhere.
    match file.symlink_metadata() {
        Ok(_) => Err(file_exists_fault(&file)),
        Err(_) => Ok(file),
    }
}

/// Maximum number of characters of a refused name that are shown.
const MAX_SHOWN_CHARACTERS: usize = 200;

/// Returns the fault to report if the disk refuses a recording in a new file.
pub fn open_refusal(file: &Path, error: std::io::Error) -> SetupFault {
    match error.kind() {
        std::io::ErrorKind::AlreadyExists => file_exists_fault(file),
        _ => SetupFault::file_fault(file, error),
    }
}

fn missing_folder_fault(folder: &Path) -> SetupFault {
    let words = "this program sees no such folder; create the folder, or record to another folder (the systemd unit of the service \
                 hides home folders and gives the service a private /tmp)";
    SetupFault::file_fault(folder, words)
}

fn file_exists_fault(file: &Path) -> SetupFault {
    SetupFault::file_fault(file, "already exists; remove it, or record to another file")
}

/// Returns the section about the recording on a cycle's page.
pub fn section(recorded: &RecordingResult) -> Section {
    let whole = recorded.is == RecordingStatus::Whole;
    let rows = vec![
        Row::new("file", &recorded.file, ""),
        Row::new("entries", if whole { recorded.entries.to_string() } else { "not known".to_owned() }, ""),
        Row::new("can be replayed", if whole { "yes" } else { "no" }, "yes"),
    ];
    Section { heading: "Recording".to_owned(), text: recorded.message.clone(), rows, figures: vec![] }
}
