//! Arguments of the commands about stored data: the store, pages, recordings, codes.

use super::values::parse_non_empty;
use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand};
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
    /// Do not check the files (scans, pictures), which needs most of the time.
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
