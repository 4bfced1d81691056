//! Arguments of the commands about stored data: the store and its backup, pages, recordings, codes; the signed records
//! and the history of cycles; and `panelprep archive`, the office's side of the records.

use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use clap::{Args, Subcommand, ValueEnum};
use panelprep_cell::cell::ProofStage;
use panelprep_store::history::languages;
use std::path::PathBuf;

/// Options of `store`.
#[derive(Debug, Clone, Args)]
pub struct StoreCommand {
    /// The task for the store.
    #[command(subcommand)]
    pub what: StoreTask,
}

/// The tasks of the store command.
#[derive(Debug, Clone, Subcommand)]
pub enum StoreTask {
    /// Compare every row with the chain of hashes, the chain with its head outside of the database, and every file
    /// with its hash: report what was changed, deleted, inserted, reordered or rolled back.
    #[command(after_help = "Example, of a copy:\n  panelprep store verify --store /media/copy/store \
                            --rows-only\nExit codes: 0 no problem was found, 1 a problem was found, 2 there is no \
                            store to read.")]
    Verify(VerifyStore),
    /// List the records that the office must have from this cell: each end of a cycle, signature and verification
    /// by its name, with the SHA-256 of its content. `panelprep archive check` compares the office's own list with
    /// this list.
    #[command(
        after_help = "Example, for a list to take to the office:\n  panelprep store list --cell target/cell/cell.toml --json > target/cell-1.json"
    )]
    List,
    /// Begin a new epoch of the records for the office: new records get names that no earlier record of this cell
    /// can have. This is for a store that was copied back without `panelprep restore`, which begins a new epoch
    /// automatically.
    #[command(
        after_help = "Example:\n  panelprep store renew --why 'disk image of May brought back' --cell target/cell/cell.toml"
    )]
    Renew(RenewStore),
}

/// Options of `store renew`.
#[derive(Debug, Clone, Args)]
pub struct RenewStore {
    /// The reason; it is recorded in the store.
    #[arg(long, value_name = "WORDS", value_parser = parse_non_empty)]
    pub why: String,
}

/// Options of `store verify`.
#[derive(Debug, Clone, Args)]
pub struct VerifyStore {
    /// Do not check the files (scans, pictures), because this check takes most of the time.
    #[arg(long)]
    pub rows_only: bool,
}

/// Options of `explain`.
#[derive(Debug, Clone, Args)]
pub struct Explain {
    /// The code in parentheses after a message.
    pub code: Option<String>,
    /// The language in which meaning and remedy are shown.
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
    /// File for the page; without it, the file that the service writes: in `reports/` in the store.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of `record`.
#[derive(Debug, Clone, Args)]
pub struct RecordCommand {
    /// The task for signed records.
    #[command(subcommand)]
    pub what: RecordTask,
}

/// The tasks of the record command.
#[derive(Debug, Clone, Subcommand)]
pub enum RecordTask {
    /// Sign the record of a cycle, as the account that runs this command; also while the service runs.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep record sign 1 --cell target/cell/cell.toml --name 'Grace Hopper' --meaning reviewed")]
    Sign(SignRecord),
    /// Write the signed record of a cycle into a folder: canonical JSON, signature, signatures by persons,
    /// public key, head, the files that the record names, and the page to read and sign as PDF.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep record export 1 --cell target/cell/cell.toml --out target/record\n\
        All cycles: panelprep record export --all --out target/records")]
    Export(ExportRecord),
    /// Verify signed records with only the public key: report records that were changed, are missing, were exchanged or
    /// were rolled back.
    #[command(
        after_help = "Example, after the example of `panelprep record export --help`:\n  panelprep record verify \
                            target/record --public-key target/record/public-key.pem\nAll records of a cell, up to \
                            a head that was kept elsewhere: panelprep record verify target/records --public-key \
                            KEY --head HEAD\nExit codes: 0 no problem was found, 1 a problem was found, 2 a file \
                            cannot be read."
    )]
    Verify(VerifyRecord),
    /// Print the head of the chain of signed records. If the head is written to a file each day and kept elsewhere,
    /// it later shows whether records were removed from the end of the chain.
    #[command(after_help = "Example, after the example of `panelprep cycle --help`:\n  \
        panelprep record head --cell target/cell/cell.toml --out target/head.json")]
    Head(HeadOfRecords),
}

/// Options of `record sign`.
#[derive(Debug, Clone, Args)]
pub struct SignRecord {
    /// The number of the cycle.
    pub cycle: i64,
    /// Your printed name. Your account on this computer is written next to it.
    #[arg(long)]
    pub name: String,
    /// The meaning of your signature.
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

/// The meaning of a signature.
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
    /// An earlier release is withdrawn; state the reason as the remark.
    ReleaseWithdrawn,
}

/// Options of `record export`.
#[derive(Debug, Clone, Args)]
pub struct ExportRecord {
    /// The numbers of the cycles.
    #[arg(required_unless_present = "all", conflicts_with = "all", value_name = "N")]
    pub cycles: Vec<i64>,
    /// Export every cycle that is over.
    #[arg(long)]
    pub all: bool,
    /// The folder to write; it is created if it does not exist.
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
}

/// Options of `record verify`.
#[derive(Debug, Clone, Args)]
pub struct VerifyRecord {
    /// Records: `.json` files, each with its `.sig` in the same folder, or folders of records.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// The cell's public key as PEM, or several keys in one file; without this option, the keys in the cell's store.
    #[arg(long, value_name = "FILE")]
    pub public_key: Option<PathBuf>,
    /// A head, with its `.sig` in the same folder. The records must then be all records of the cell, from the first
    /// to the record that the head names.
    #[arg(long, value_name = "FILE")]
    pub head: Option<PathBuf>,
    /// The records must be all records of the cell, from the first to the last one that is given. Without this
    /// option and without a head, missing numbers are reported but are not a fault: the record of one cycle may be
    /// passed on without the records of other cycles.
    #[arg(long)]
    pub all: bool,
}

/// Options of `record head`.
#[derive(Debug, Clone, Args)]
pub struct HeadOfRecords {
    /// File for the head, with its signature next to it as `.sig`.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of `history`.
#[derive(Debug, Clone, Args)]
pub struct History {
    /// The task; without a task, cycles are searched.
    #[command(subcommand)]
    pub what: Option<HistoryTask>,
    /// What is searched.
    #[command(flatten)]
    pub search: SearchArguments,
    /// Maximum number of cycles: for a search, of cycles found; for a trend, a heat map and alarms, the newest
    /// cycles.
    #[arg(long, global = true, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u16).range(1..=1_000))]
    pub limit: u16,
    /// Print comma-separated values (CSV) on standard output, for a spreadsheet.
    #[arg(long, global = true, conflicts_with = "json")]
    pub csv: bool,
}

/// Conditions of a search. In names `*` matches any characters; without it, the whole name must match.
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
    /// Operator, as named at the start.
    #[arg(long, value_name = "NAME")]
    pub operator: Option<String>,
    /// Only cycles that began at this time or later, UTC: 2026-05-31 or 2026-05-31T09:00.
    #[arg(long, value_name = "DATE")]
    pub from: Option<String>,
    /// Only cycles that began before this time, UTC; a date without a time includes the whole day.
    #[arg(long, value_name = "DATE")]
    pub to: Option<String>,
    /// How the cycle ended.
    #[arg(long, value_name = "VERDICT")]
    pub verdict: Option<EndName>,
    /// Words that must all occur in the reasons of the verdict, in codes or sentences.
    #[arg(long, value_name = "WORDS")]
    pub text: Option<String>,
    /// Only cycles with a smaller number than this cycle: the next part of a long search result.
    #[arg(long, value_name = "N")]
    pub before: Option<i64>,
}

/// How a cycle ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[expect(missing_docs, reason = "these are the words of the verdicts")]
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
    /// Summary of one cycle: part, verdict, grids, residuals and errors, times, disc.
    Show {
        /// The number of the cycle.
        cycle: i64,
    },
    /// Two cycles side by side: their inputs, every check with its difference and limit, every grid.
    Compare {
        /// The number of one cycle.
        first: i64,
        /// The number of the other cycle.
        second: i64,
    },
    /// The trend of a quantity of a panel over its cycles, with its limits, and with hints by the Western Electric
    /// rules.
    #[command(after_help = format!("NAME is one of these words:\n  {}\nor, in quotes, the name of a check on the page of a cycle.",
        panelprep_store::history::KnownQuantity::keywords().join("\n  ")))]
    Trend {
        /// The panel, by its name in the recipe.
        panel: String,
        /// The quantity: a keyword of the list below, or the name of a check.
        name: String,
    },
    /// How often the film broke on each grid of a panel, and after which time, over all parts of this kind.
    Heat {
        /// The panel, by its name in the recipe.
        panel: String,
    },
    /// The alarms of the newest cycles, or of one cycle: when each was raised and cleared, its cause and remedy.
    Alarms {
        /// The number of the cycle.
        cycle: Option<i64>,
    },
}

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

/// Maximum number of the last cycle that a person may state; a larger number by a typing error would use up the numbers
/// of the cell.
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
    /// Receive the records of the cells from the broker, store them in PostgreSQL and a folder, and confirm to the cells
    /// what the archive contains, until a signal stops this command. After a failure (broker, database, disk) it tries
    /// again.
    #[command(
        after_help = "The settings are those of config/archive.toml. On a machine with nats-server -js and PostgreSQL:\n  \
        panelprep archive run --settings /etc/panelprep/archive.toml"
    )]
    Run(RunArchive),
    /// Check that the archive contains everything that cells sent: no record number is missing, contents match their
    /// hashes, signatures match their keys, each signed record follows its predecessor, and all files are complete.
    /// Also compare the archive with the cells that are named.
    #[command(after_help = "Example, with one cell's store on this machine and the list of another cell:\n  \
                            panelprep archive check --settings /etc/panelprep/archive.toml \
                            cell-1=/var/lib/panelprep/store cell-2=cell-2.json\nThe list is what `panelprep store \
                            list --json` prints in that cell.\nExit codes: 0 no problem was found, 1 a problem was \
                            found, 2 the archive or a list cannot be read.")]
    Check(CheckArchive),
    /// Create an account for the office's page, or change its password. The password is read from the terminal or from
    /// standard input.
    #[command(
        after_help = "Example:\n  panelprep archive account anna --printed-name 'Anna Office' --settings /etc/panelprep/archive.toml"
    )]
    Account(ArchiveAccount),
    /// Offer a recipe that was approved in the office to all cells. Each cell's set-up page then shows the
    /// difference, and a person there accepts it; no cell changes automatically.
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
    /// The archive's settings, with `[fleet] listen`.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Options of `archive run`.
#[derive(Debug, Clone, Args)]
pub struct RunArchive {
    /// The archive's settings: broker, database, folder of files.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Options of `archive check`.
#[derive(Debug, Clone, Args)]
pub struct CheckArchive {
    /// Cells to compare with: the cell's name, =, and either the folder of its store or the file of its list.
    #[arg(value_name = "CELL=STORE_OR_LIST")]
    pub cells: Vec<String>,
    /// The archive's settings.
    #[arg(long, value_name = "FILE", default_value = "config/archive.toml")]
    pub settings: PathBuf,
}

/// Parses a stage of the list of proofs.
///
/// # Errors
/// If there is no such stage.
pub fn parse_stage(text: &str) -> Result<ProofStage, String> {
    text.parse().map_err(|_| "valid: A, B or C".to_owned())
}

/// Parses a text from a person and removes the blanks around it.
///
/// # Errors
/// If it is empty.
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
