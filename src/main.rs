//! Arguments and exit codes.

use panelprep::cli::args::Arguments;
use std::process::ExitCode;

fn main() -> ExitCode {
    panelprep::cli::run(&Arguments::parse_command_line())
}
