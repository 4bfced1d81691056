//! Arguments of `panelprep archive`.

use clap::builder::NonEmptyStringValueParser;
use clap::{Args, Subcommand};
use std::path::PathBuf;

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
