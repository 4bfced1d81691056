//! The errors of backup and restore.

use crate::store::StoreError;
use std::path::{Path, PathBuf};

/// The reason why a backup or a restore failed. Unless stated otherwise, no file of the cell was changed.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// An operation on a file or folder failed.
    #[error("cannot {operation} {}: {source}", path.display())]
    File {
        /// The operation that failed.
        operation: &'static str,
        /// The path of the file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The store reported an error.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The content of the archive is damaged or was changed.
    #[error("{}: {problem}", path.display())]
    Damaged {
        /// The path of the archive.
        path: PathBuf,
        /// The damage or change.
        problem: String,
    },
    /// The archive was written by a newer version of this program.
    #[error("{}: the backup has format {found}, this program supports formats up to {known}: restore it with the \
             newer program", path.display())]
    NewerVersion {
        /// The path of the archive.
        path: PathBuf,
        /// Format of the archive.
        found: u32,
        /// Newest format that this program supports.
        known: u32,
    },
    /// The archive was made by an earlier version of this program, with other tables.
    #[error(
        "{}: the store in the backup has schema {found}, this program needs schema {known}. Restore the backup \
         with version {program}, which made it. Then install this version, which updates the store", path.display()
    )]
    EarlierVersion {
        /// The path of the archive.
        path: PathBuf,
        /// The version of the program that wrote the archive.
        program: String,
        /// Schema version of the store in the archive.
        found: i64,
        /// Schema version of this program.
        known: i64,
    },
    /// A file already exists at the path of the archive.
    #[error("{} already exists and is not overwritten; name another file, or move it away", path.display())]
    AlreadyExists {
        /// The path of the archive.
        path: PathBuf,
    },
    /// Files that would be restored already exist.
    #[error(
        "{} {} already present, and --replace was not given: add --replace {option} to put the backup in place; \
         the replaced files are kept", list(paths), if paths.len() == 1 { "is" } else { "are" }
    )]
    NotReplaced {
        /// The paths of the existing files.
        paths: Vec<PathBuf>,
        /// The value of `--replace` that permits their replacement.
        option: &'static str,
    },
    /// The cell's file in the archive names files outside of its folder.
    #[error(
        "the cell's file in the backup names {}, outside of the folder {}: add --outside to write there too", list(paths),
        folder.display()
    )]
    Outside {
        /// The paths outside of the folder.
        paths: Vec<PathBuf>,
        /// The folder of the cell's file.
        folder: PathBuf,
    },
    /// The archive does not contain the requested store or configuration.
    #[error("{}: the backup contains no {wanted}, because it was made with --only", path.display())]
    PartMissing {
        /// The path of the archive.
        path: PathBuf,
        /// What is missing: "store" or "configuration".
        wanted: &'static str,
    },
    /// A configuration file is too large.
    #[error("{} has {found} bytes; the limit for a file of the configuration is {limit_bytes} bytes", path.display())]
    TooLarge {
        /// The path of the file.
        path: PathBuf,
        /// Size of the file, bytes.
        found: u64,
        /// Maximum size, bytes.
        limit_bytes: u64,
    },
    /// The disk does not have enough free space.
    #[error(
        "the disk of {} has {free_mb} MB free, and the backup needs {needed_mb} MB there in addition to the data \
         in use: free some space, or name another folder", path.display()
    )]
    NoRoom {
        /// The path of the file or folder that would be written.
        path: PathBuf,
        /// Free space on the disk, MB.
        free_mb: u64,
        /// Space that the restore needs, MB.
        needed_mb: u64,
    },
    /// The number of the last cycle is unknown. It is needed, because no number may be used twice.
    #[error(
        "{} is not an unchanged later state of the store in the backup, so the number of the cell's last cycle is not \
         known; state it with --last-cycle NUMBER, from the office's page of this cell or from the last record; the last one of the backup is {own}",
        path.display()
    )]
    LastCycleUnknown {
        /// The folder of the store that would be replaced.
        path: PathBuf,
        /// Number of the last cycle in the backup; 0 if there is none.
        own: i64,
    },
    /// The stated number of the last cycle is below that of the last cycle in the backup.
    #[error(
        "--last-cycle {stated} is below {own}, the last cycle of the backup; state the last number that the cell used"
    )]
    LastCycleTooLow {
        /// The number that the person stated.
        stated: i64,
        /// Number of the last cycle in the backup.
        own: i64,
    },
    /// A service or another program uses files that would be replaced.
    #[error("{user}; stop the service first (`systemctl stop panelprep`), then restore again")]
    InUse {
        /// Which program uses the files.
        user: String,
    },
    /// A step at the end of the restore failed, and not all earlier steps could be undone.
    #[error("{cause}; the earlier steps could not be undone: {}", undone.join("; "))]
    RollbackFailed {
        /// The error that caused the rollback.
        cause: Box<BackupError>,
        /// The steps that could not be undone, as texts.
        undone: Vec<String>,
    },
}

impl BackupError {
    pub(super) fn file_error(doing: &'static str, path: &Path) -> impl Fn(std::io::Error) -> BackupError {
        move |source| BackupError::File { operation: doing, path: path.to_owned(), source }
    }
}

fn list(paths: &[PathBuf]) -> String {
    paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
}
