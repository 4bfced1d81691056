//! Arguments of the commands for stored data: the store and its backup, pages, recordings, codes, the signed records
//! and the history of cycles, and the archive of the office server.

use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use clap::{Args, Subcommand, ValueEnum};
use panelprep_cell::cell::ProofStage;
use panelprep_store::history::languages;
use std::path::PathBuf;

/// Options of `store`.
#[derive(Debug, Clone, Args)]
pub struct StoreCommand {
    /// The task of the command.
    #[command(subcommand)]
    pub what: StoreTask,
}

/// The tasks of the store command.
#[derive(Debug, Clone, Subcommand)]
pub enum StoreTask {
    /// Compare every row with the hash chain, the chain with its head outside of the database, and every file with its
    /// hash. Reports what was changed, deleted, inserted, reordered or rolled back.
    #[command(after_help = "Example, of a copy:\n  panelprep store verify --store /media/copy/store \
                            --rows-only\nExit codes: 0 no problem was found, 1 a problem was found, 2 there is no \
                            store to read.")]
    Verify(VerifyStore),
    /// List the records of this cell that the office server must have, each with the SHA-256 of its content: the end of
    /// each cycle, each signature and each verification. `panelprep archive check` compares the office server's records
    /// with this list.
    #[command(
        after_help = "Example, for a list to take to the office:\n  panelprep store list --cell target/cell/cell.toml --json > target/cell-1.json"
    )]
    List,
    /// Begin a new epoch of the records for the office server: new records get names that no earlier record of this
    /// cell can have. Use this for a store that was copied back without `panelprep restore`, which begins a new epoch
    /// automatically.
    #[command(
        after_help = "Example:\n  panelprep store renew --why 'disk image of May brought back' --cell target/cell/cell.toml"
    )]
    Renew(RenewStore),
}

/// Options of `store renew`.
#[derive(Debug, Clone, Args)]
pub struct RenewStore {
    /// The reason for the new epoch, which is stored.
    #[arg(long, value_name = "WORDS", value_parser = parse_non_empty)]
    pub why: String,
}

/// Options of `store verify`.
#[derive(Debug, Clone, Args)]
pub struct VerifyStore {
    /// Do not verify the files (scans, pictures), which take most of the time.
    #[arg(long)]
    pub rows_only: bool,
}

/// Options of `explain`.
#[derive(Debug, Clone, Args)]
pub struct Explain {
    /// The code that is shown in parentheses after a message.
    pub code: Option<String>,
    /// The language of the explanation.
    #[arg(long, default_value = "en", value_parser = PossibleValuesParser::new(languages()))]
    pub language: String,
}

/// Options of `replay`.
#[derive(Debug, Clone, Args)]
pub struct Replay {
    /// The recording that `--record` wrote.
    pub recording: PathBuf,
}

/// `panelprep page`.
#[derive(Debug, Args)]
pub struct PageOf {
    /// The number of the cycle.
    pub cycle: i64,
    /// File for the page; without this option, the file in `reports/` of the store that the service writes.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of `record`.
#[derive(Debug, Clone, Args)]
pub struct RecordCommand {
    /// The task of the command.
    #[command(subcommand)]
    pub what: RecordTask,
}

/// The tasks of the record command.
#[derive(Debug, Clone, Subcommand)]
pub enum RecordTask {
    /// Sign the record of a cycle with the account that runs this command; this also works while the service runs.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep record sign 1 --cell target/cell/cell.toml --name 'Grace Hopper' --meaning reviewed")]
    Sign(SignRecord),
    /// Write the signed record of a cycle to a folder: canonical JSON, signature, the signatures of persons, public
    /// key, head, the files that the record names, and the page to be signed as PDF.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep record export 1 --cell target/cell/cell.toml --out target/record\n\
        All cycles: panelprep record export --all --out target/records")]
    Export(ExportRecord),
    /// Verify signed records with only the public key. Reports records that were changed, are missing, were exchanged
    /// or were rolled back.
    #[command(
        after_help = "Example, after the example of `panelprep record export --help`:\n  panelprep record verify \
                            target/record --public-key target/record/public-key.pem\nAll records of a cell, up to \
                            a head that was kept elsewhere: panelprep record verify target/records --public-key \
                            KEY --head HEAD\nExit codes: 0 no problem was found, 1 a problem was found, 2 a file \
                            cannot be read."
    )]
    Verify(VerifyRecord),
    /// Print the head of the chain of signed records. If it is written to a file each day and kept elsewhere, it shows
    /// afterwards whether records were removed from the end of the chain.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep record head --cell target/cell/cell.toml --out target/head.json")]
    Head(HeadOfRecords),
}

/// Options of `record sign`.
#[derive(Debug, Clone, Args)]
pub struct SignRecord {
    /// The number of the cycle.
    pub cycle: i64,
    /// Your printed name. The name of your account on this computer is stored with it.
    #[arg(long)]
    pub name: String,
    /// The meaning of your signature (for example "reviewed").
    #[arg(long, value_enum)]
    pub meaning: MeaningName,
    /// A remark that you add to the signature.
    #[arg(long, value_name = "TEXT")]
    pub remark: Option<String>,
    /// The water in this cycle: kind, conductivity, temperature.
    #[arg(long, value_name = "TEXT")]
    pub water: Option<String>,
    /// The lamp in this cycle: kind, brightness at the panel.
    #[arg(long, value_name = "TEXT")]
    pub lamp: Option<String>,
    /// The ambient temperature and humidity in this cycle.
    #[arg(long, value_name = "TEXT")]
    pub ambient: Option<String>,
    /// The abrasive in this cycle: product, grit, lot.
    #[arg(long, value_name = "TEXT")]
    pub abrasive: Option<String>,
}

/// The meaning of a person's signature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MeaningName {
    /// Inspected and released.
    Released,
    /// The record was inspected and is not released.
    NotReleased,
    /// Reviewed.
    Reviewed,
    /// A deviation that the record states is accepted.
    DeviationAccepted,
    /// An earlier release is withdrawn; the remark must state the reason.
    ReleaseWithdrawn,
}

/// Options of `record export`.
#[derive(Debug, Clone, Args)]
pub struct ExportRecord {
    /// The numbers of the cycles.
    #[arg(required_unless_present = "all", conflicts_with = "all", value_name = "N")]
    pub cycles: Vec<i64>,
    /// Export every cycle that has ended.
    #[arg(long)]
    pub all: bool,
    /// The folder to write; it is created if it does not exist.
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// Options of `record verify`.
#[derive(Debug, Clone, Args)]
pub struct VerifyRecord {
    /// The records: `.json` files, each with its `.sig` in the same folder, or folders with records.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The public key of the cell as PEM, or several keys in one file; without this option, the keys in the cell's
    /// store.
    #[arg(long, value_name = "FILE")]
    pub public_key: Option<PathBuf>,
    /// A head file, with its `.sig` in the same folder. The given records must then be complete, from the first record
    /// of the cell to the one that the head names.
    #[arg(long, value_name = "FILE")]
    pub head: Option<PathBuf>,
    /// Require that the given records are complete, from the first record of the cell to the last given one. Without
    /// this option and without a head, missing numbers are reported but are no error, because a single record may be
    /// passed on.
    #[arg(long)]
    pub all: bool,
}

/// Options of `record head`.
#[derive(Debug, Clone, Args)]
pub struct HeadOfRecords {
    /// File for the head; its signature is written next to it as `.sig`.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of `history`.
#[derive(Debug, Clone, Args)]
pub struct History {
    /// The task; without a task, the command searches for cycles.
    #[command(subcommand)]
    pub what: Option<HistoryTask>,
    /// The conditions of the search.
    #[command(flatten)]
    pub search: SearchArguments,
    /// Maximum number of cycles: of a search, the cycles that are listed; of a trend, a heat map and alarms, the newest
    /// cycles that are evaluated.
    #[arg(long, global = true, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u16).range(1..=1_000))]
    pub limit: u16,
    /// Print comma-separated values (CSV) on standard output, for a spreadsheet.
    #[arg(long, global = true, conflicts_with = "json")]
    pub csv: bool,
}

/// The conditions of a search. In names, `*` matches any characters; without `*`, the whole name must match.
#[derive(Debug, Clone, Default, PartialEq, Eq, Args)]
pub struct SearchArguments {
    /// Serial number of the part.
    #[arg(long, value_name = "SERIAL")]
    pub part: Option<String>,
    /// Work order.
    #[arg(long, value_name = "ORDER")]
    pub order: Option<String>,
    /// Name of the panel in the recipe.
    #[arg(long, value_name = "PANEL")]
    pub panel: Option<String>,
    /// Name of the operator, as stated at the start of the cycle.
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
    /// Only cycles that began at this time or later, UTC: 2026-05-31 or 2026-05-31T09:00.
    #[arg(long, value_name = "DATE")]
    pub from: Option<String>,
    /// Only cycles that began before this time, UTC; a date without a time includes the whole day.
    #[arg(long, value_name = "DATE")]
    pub to: Option<String>,
    /// The verdict of the cycle, or how it ended.
    #[arg(long, value_name = "VERDICT")]
    pub verdict: Option<EndName>,
    /// Words that must all occur in the reasons of the verdict, in their codes or texts.
    #[arg(long, value_name = "WORDS")]
    pub text: Option<String>,
    /// Only cycles with a smaller number than this one, to continue a long search result.
    #[arg(long, value_name = "N")]
    pub before: Option<i64>,
}

/// The verdict of a cycle, or how it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[expect(missing_docs, reason = "the names are the words of the verdicts")]
pub enum EndName {
    Pass,
    Fail,
    Invalid,
    Review,
    Reject,
    Accept,
    Aborted,
    /// The cycle has not ended yet.
    Running,
}

/// The tasks of the history command.
#[derive(Debug, Clone, Subcommand)]
pub enum HistoryTask {
    /// Show the summary of one cycle: part, verdict, grids, residuals and errors, times, disc.
    Show {
        /// The number of the cycle.
        cycle: i64,
    },
    /// Compare two cycles side by side: their inputs, every check with its difference and limit, every grid.
    Compare {
        /// The number of the first cycle.
        first: i64,
        /// The number of the second cycle.
        second: i64,
    },
    /// Show the trend of a quantity over the cycles of a panel, with its limits and with warnings according to the
    /// Western Electric rules.
    #[command(after_help = format!("NAME is one of these words:\n  {}\nor, in quotes, the name of a check on the page of a cycle.",
        panelprep_store::history::KnownQuantity::keywords().join("\n  ")))]
    Trend {
        /// The name of the panel in the recipe.
        panel: String,
        /// The quantity: a keyword of the list below, or the name of a check.
        name: String,
    },
    /// Show how often the film broke on each grid of a panel, and after which time, over all parts of this type.
    Heat {
        /// The name of the panel in the recipe.
        panel: String,
    },
    /// List the alarms of the newest cycles, or of one cycle: when each was raised and cleared, its cause and remedy.
    Alarms {
        /// The number of the cycle.
        cycle: Option<i64>,
    },
}

/// The parts of a backup.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackupPart {
    /// The taught panels, cycles, the journal, pictures and scans.
    Store,
    /// The cell file, the calibrations and camera settings that it names, and the recipes in its folder.
    Configuration,
}

/// Options of `backup`.
#[derive(Debug, Clone, Args)]
pub struct Backup {
    /// The archive file to write; it must not exist.
    pub archive: PathBuf,
    /// Save only this part of the backup.
    #[arg(long, value_enum)]
    pub only: Option<BackupPart>,
}

/// Options of `restore`.
#[derive(Debug, Clone, Args)]
pub struct Restore {
    /// An archive file that `panelprep backup` wrote.
    pub archive: PathBuf,
    /// Restore only this part.
    #[arg(long, value_enum)]
    pub only: Option<BackupPart>,
    /// Replace this part if it already exists; the replaced part is kept next to it as NAME.before-restore-1. Repeat
    /// the option to replace several parts.
    #[arg(long, value_enum, value_name = "PART")]
    pub replace: Vec<BackupPart>,
    /// Also write files that the cell file names and that are outside of its folder.
    #[arg(long)]
    pub outside: bool,
    /// The number of the cell's last cycle, 0 to 999999999; new cycles get higher numbers. Required if the folder of
    /// the store is empty or does not contain this number, for example on a new computer. Also required as evidence
    /// that nothing was sanded since the backup: the replaced store must contain the same number.
    #[arg(long, value_name = "NUMBER", value_parser = last_cycle)]
    pub last_cycle: Option<i64>,
}

/// Maximum number of the last cycle that a person may state. A larger number, by a typing error, would use up the
/// cell's cycle numbers.
const MAX_LAST_CYCLE: i64 = 999_999_999;

fn last_cycle(text: &str) -> Result<i64, String> {
    let limits = || {
        format!(
            "the limits are 0 to {MAX_LAST_CYCLE}: state the number of the cell's last cycle, 0 if there was none"
        )
    };
    text.parse().ok().filter(|number| (0..=MAX_LAST_CYCLE).contains(number)).ok_or_else(limits)
}

/// Options of `archive`.
#[derive(Debug, Clone, Args)]
pub struct Archive {
    /// What to do.
    #[command(subcommand)]
    pub what: ArchiveTask,
}

/// The tasks of the archive command.
#[derive(Debug, Clone, Subcommand)]
pub enum ArchiveTask {
    /// Receive the records of the cells from the broker, store them in PostgreSQL and a folder, and confirm to the
    /// cells what the archive contains, until a signal stops this command. After a failure of broker, database or disk,
    /// the command tries again.
    #[command(
        after_help = "The settings are those of config/archive.toml. On a machine with nats-server -js and PostgreSQL:\n  \
        panelprep archive run --settings /etc/panelprep/archive.toml"
    )]
    Run(RunArchive),
    /// Check that the archive contains everything that the cells sent: no record number is missing, contents match
    /// their hashes, signatures match their keys, each signed record follows its predecessor, and all files are
    /// complete. Also compares the archive with the cells that are named.
    #[command(after_help = "Example, with one cell's store on this machine and the list of another cell:\n  \
                            panelprep archive check --settings /etc/panelprep/archive.toml \
                            cell-1=/var/lib/panelprep/store cell-2=cell-2.json\nThe list is what `panelprep store \
                            list --json` prints in that cell.\nExit codes: 0 no problem was found, 1 a problem was \
                            found, 2 the archive or a list cannot be read.")]
    Check(CheckArchive),
    /// Create an account for the web page of the office server, or change its password. The password is read from the
    /// terminal or from standard input.
    #[command(
        after_help = "Example:\n  panelprep archive account anna --printed-name 'Anna Office' --settings /etc/panelprep/archive.toml"
    )]
    Account(ArchiveAccount),
    /// Offer a recipe that was approved in the office to all cells. The set-up page of each cell then shows the
    /// changes, and a person at the cell accepts them; no cell changes automatically.
    #[command(
        after_help = "Example:\n  panelprep archive offer door.toml --by 'Anna Office' --why 'finer film' --settings /etc/panelprep/archive.toml"
    )]
    Offer(OfferRecipe),
}

/// Options of `archive offer`.
#[derive(Debug, Clone, Args)]
pub struct OfferRecipe {
    /// The recipe.
    #[arg(value_name = "FILE")]
    pub recipe: PathBuf,
    /// The printed name of the person who approved the recipe.
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new())]
    pub by: String,
    /// The reason for the approval.
    #[arg(long, value_name = "WORDS", value_parser = NonEmptyStringValueParser::new())]
    pub why: String,
    /// The archive's settings.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Options of `archive account`.
#[derive(Debug, Clone, Args)]
pub struct ArchiveAccount {
    /// The login name of the account.
    pub name: String,
    /// The printed name of the account's owner; without this option, the login name.
    #[arg(long, value_name = "NAME")]
    pub printed_name: Option<String>,
    /// The archive's settings.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Options of `fleet`.
#[derive(Debug, Clone, Args)]
pub struct Fleet {
    /// The settings file of the archive, with `[fleet] listen`.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Options of `archive run`.
#[derive(Debug, Clone, Args)]
pub struct RunArchive {
    /// The settings file of the archive: broker, database, folder of files.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Options of `archive check`.
#[derive(Debug, Clone, Args)]
pub struct CheckArchive {
    /// Cells to compare with: the name of the cell, =, and the folder of its store or the file of its list.
    #[arg(value_name = "CELL=STORE_OR_LIST")]
    pub cells: Vec<String>,
    /// The archive's settings.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Parses the name of a stage of the acceptance tests.
///
/// # Errors
/// If there is no stage with this name.
pub fn parse_stage(text: &str) -> Result<ProofStage, String> {
    text.parse().map_err(|_| "valid: A, B or C".to_owned())
}

/// Parses a text that must not be empty; white space at both ends is removed.
///
/// # Errors
/// If the text is empty.
pub fn parse_non_empty(text: &str) -> Result<String, String> {
    match text.trim() {
        "" => Err("must not be empty".to_owned()),
        text => Ok(text.to_owned()),
    }
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
