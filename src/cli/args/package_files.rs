//! Arguments of `package-files`.

use clap::Args;
use std::path::PathBuf;

/// Options of `package-files`.
#[derive(Debug, Clone, Args)]
pub struct PackageFiles {
    /// The folder for `man/` and `completions/`.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
