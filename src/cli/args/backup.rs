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
    /// The number of the cell's last cycle, 0 to 999999999. Needed if the store's folder is empty or does not show it,
    /// for example on a new computer: later cycles are numbered above it. Also needed as evidence that nothing was
    /// sanded since the backup: the replaced store must show the same number.
    #[arg(long, value_name = "NUMBER", value_parser = last_cycle)]
    pub last_cycle: Option<i64>,
}

/// The largest number that a person may state. A typing error beyond it would use up the numbers of the cell.
const MAX_LAST_CYCLE: i64 = 999_999_999;

fn last_cycle(text: &str) -> Result<i64, String> {
    let limits = || {
        format!(
            "the limits are 0 to {MAX_LAST_CYCLE}: state the number of the cell's last cycle, 0 if there was none"
        )
    };
    text.parse().ok().filter(|number| (0..=MAX_LAST_CYCLE).contains(number)).ok_or_else(limits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_last_cycle_is_a_number_within_its_limits() {
        assert_eq!((last_cycle("0"), last_cycle("999999999")), (Ok(0), Ok(999_999_999)));
        let words = "the limits are 0 to 999999999: state the number of the cell's last cycle, 0 if there was none";
        for wrong in ["1000000000", "-1", "", "12a", "9223372036854775808"] {
            assert_eq!(last_cycle(wrong), Err(words.to_owned()), "{wrong}");
        }
    }
}
