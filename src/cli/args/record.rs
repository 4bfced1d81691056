//! Arguments of `record`: the signed records of cycles.

use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

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
