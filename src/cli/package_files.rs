//! The files that a package ships with the program: manual pages, and completions for shells. They are made from
//! the command line's own definition.

use super::args::{Arguments, PackageFiles};
use super::disk;
use super::fault::Fault;
use super::outcome::Outcome;
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use panelprep_base::verdict::{Judgement, Verdict};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Shells, each with the file name under which it looks for its completions.
const COMPLETION_FILES: [(Shell, &str); 3] =
    [(Shell::Bash, "panelprep"), (Shell::Zsh, "_panelprep"), (Shell::Fish, "panelprep.fish")];

/// Writes the files.
///
/// # Errors
/// If writing to the disk fails.
pub fn run(args: &PackageFiles) -> Result<Outcome, Fault> {
    let mut command = Arguments::command().disable_help_subcommand(true);
    command.build();
    let mut files = Vec::new();
    write_manual(&command, &args.out.join("man"), &mut files)?;
    for (shell, name) in COMPLETION_FILES {
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut Arguments::command(), "panelprep", &mut text);
        let file = args.out.join("completions").join(name);
        disk::write(&file, text)?;
        files.push(file);
    }
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Pass, reasons: vec![] });
    outcome.lines = files.iter().map(|file| file.display().to_string()).collect();
    outcome.add_value("files", json!(files));
    Ok(outcome)
}

/// Writes a manual page for a command and for each subcommand.
fn write_manual(command: &Command, folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Fault> {
    let page = clap_mangen::Man::new(command.clone());
    let file = folder.join(page.get_filename());
    let mut text = Vec::new();
    page.render(&mut text).map_err(|error| Fault::file_fault(&file, error))?;
    disk::write(&file, text)?;
    files.push(file);
    let mut below = command.get_subcommands().filter(|below| !below.is_hide_set());
    below.try_for_each(|below| write_manual(below, folder, files))
}
