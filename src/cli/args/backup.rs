//! Arguments of `backup` and `restore`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// The parts of a backup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackupPart {
    /// The taught data, cycles, the journal, pictures and scans.
    Store,
    /// The cell's file, the calibrations and camera settings that it names, and the recipes in its folder.
    Configuration,
}

/// Options of `backup`.
#[derive(Debug, Clone, Args)]
pub struct Backup {
    /// The archive to write; it must not exist.
    pub archive: PathBuf,
    /// Save only this part.
    #[arg(long, value_enum)]
    pub only: Option<BackupPart>,
}

/// Options of `restore`.
#[derive(Debug, Clone, Args)]
pub struct Restore {
    /// An archive that `panelprep backup` wrote.
    pub archive: PathBuf,
    /// Restore only this part.
    #[arg(long, value_enum)]
    pub only: Option<BackupPart>,
    /// Replace this part if it exists already; the replaced part is kept next to it as NAME.before-restore-1. Repeat
    /// the option to replace several parts.
    #[arg(long, value_enum, value_name = "PART")]
    pub replace: Vec<BackupPart>,
    /// Also write files that are named in the cell's file and are outside of its folder.
    #[arg(long)]
    pub outside: bool,
    /// The number of the cell's last cycle. Needed if the store's folder is empty or does not show it, for example on
    /// a new computer: later cycles are numbered above it.
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(i64).range(0..))]
    pub last_cycle: Option<i64>,
}
