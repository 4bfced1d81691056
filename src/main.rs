//! Arguments and exit codes.

use clap::Parser;
use panelprep::cli::args::Arguments;
use std::process::ExitCode;

fn main() -> ExitCode {
    panelprep::cli::run(&Arguments::parse())
}
