//! Arguments of the commands about what is kept: the store, pages, recordings, codes.

use super::values::parse_non_empty;
use crate::history::languages;
use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Options of `store`.
#[derive(Debug, Clone, Args)]
pub struct StoreCommand {
    /// What to do with it.
    #[command(subcommand)]
    pub what: StoreTask,
}

/// What may be done with a store.
#[derive(Debug, Clone, Subcommand)]
pub enum StoreTask {
    /// Hold every row against the chain of hashes, the chain against its head outside of the database, and every file
    /// against its hash: name what was changed, deleted, put in, reordered or rolled back.
    #[command(after_help = "Example, of a copy:\n  panelprep store verify --store /media/copy/store \
                            --rows-only\nExit codes: 0 no problem was found, 1 a problem was found, 2 there is no \
                            store to read.")]
    Verify(VerifyStore),
    /// List what the office is to have of this cell: each end of a cycle, signature and verification by its name,
    /// with the SHA-256 of its content. `panelprep archive check` holds the office's own list against it.
    #[command(
        after_help = "Example, to be taken to the office:\n  panelprep store list --cell target/cell/cell.toml --json > target/cell-1.json"
    )]
    List,
    /// Begin a new epoch of what the office is to have: records from now on get names that no earlier record of
    /// this cell can have. For a store that was copied back by other means than `panelprep restore`, which does
    /// this by itself.
    #[command(
        after_help = "Example:\n  panelprep store renew --why 'disk image of May brought back' --cell target/cell/cell.toml"
    )]
    Renew(RenewStore),
}

/// Options of `store renew`.
#[derive(Debug, Clone, Args)]
pub struct RenewStore {
    /// Why; it is kept in the store.
    #[arg(long, value_name = "WORDS", value_parser = parse_non_empty)]
    pub why: String,
}

/// Options of `store verify`.
#[derive(Debug, Clone, Args)]
pub struct VerifyStore {
    /// Leave out the files (scans, pictures), which need most of the time.
    #[arg(long)]
    pub rows_only: bool,
}

/// Options of `explain`.
#[derive(Debug, Clone, Args)]
pub struct Explain {
    /// The word in parentheses behind a message.
    pub code: Option<String>,
    /// The language of meaning and remedy.
    #[arg(long, default_value = "en", value_parser = PossibleValuesParser::new(languages()))]
    pub language: String,
}

/// Options of `replay`.
#[derive(Debug, Clone, Args)]
pub struct Replay {
    /// What `--record` wrote.
    pub recording: PathBuf,
}

/// `panelprep page`.
#[derive(Debug, Args)]
pub struct PageOf {
    /// The number of the cycle.
    pub cycle: i64,
    /// File for the page; without it, the place where the service writes it: `reports/` in the store.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
