//! Texts that the program contains about itself. `panelprep explain` prints the meaning of a message's code and the
//! remedy, as the page of messages in the manual does. `panelprep package-files` writes the manual pages and shell
//! completions, which are generated from the definition of the command line.

use super::args::{Arguments, Explain, PackageFiles};
use super::disk;
use super::fault::Fault;
use super::output::Outcome;
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use panelprep_base::config::nearest;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_store::history::{code, codes, row};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Explains a code; without a code, lists all codes.
///
/// # Errors
/// If no message has this code.
pub fn run(args: &Explain) -> Result<Outcome, Fault> {
    let mut outcome = Outcome { exit_code: 0, json: serde_json::Map::new(), lines: vec![] };
    let Some(word) = &args.code else {
        let words: Vec<&str> = codes().iter().map(|code| &*code.code).collect();
        outcome.add_line(words.join("\n"));
        outcome.add_value("codes", json!(words));
        return Ok(outcome);
    };
    let word = word.trim_matches(['(', ')', '`']);
    let Some(known) = code(word) else {
        let words: Vec<&str> = codes().iter().map(|code| &*code.code).collect();
        let nearest = nearest(word, &words).map(|(name, _)| name.to_owned());
        return Err(Fault::NoSuchCode { found: word.to_owned(), nearest });
    };
    let (cause, remedy) =
        row(word, &args.language).map_or((&*known.cause, &*known.remedy), |row| (row.cause, row.remedy));
    outcome.add_line(cause);
    outcome.add_line(if args.language == "en" { format!("What to do: {remedy}") } else { remedy.to_owned() });
    outcome.add_value("code", json!(known.code));
    outcome.add_value("priority", json!(known.priority));
    outcome.add_value("meaning", json!(cause));
    outcome.add_value("remedy", json!(remedy));
    Ok(outcome)
}

/// The shells, each with the file name under which it finds its completions.
const COMPLETION_FILES: [(Shell, &str); 3] =
    [(Shell::Bash, "panelprep"), (Shell::Zsh, "_panelprep"), (Shell::Fish, "panelprep.fish")];

/// Writes the manual pages and the shell completions.
///
/// # Errors
/// If writing to the disk fails.
pub fn write_package_files(args: &PackageFiles) -> Result<Outcome, Fault> {
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

/// Writes a manual page for a command, and for each of its subcommands.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_explained_and_the_nearest_is_suggested_for_a_mistyped_one() {
        let asked_in = |code: &str, language: &str| {
            run(&Explain { code: Some(code.to_owned()), language: language.to_owned() })
        };
        let asked = |code: &str| asked_in(code, "en");
        let words = asked("(low_overlap)").expect("a row").lines.join("\n");
        assert!(words.contains("overlap") && words.contains("What to do: "), "{words}");
        let fault = asked("low_overlapp").expect_err("no such code").to_string();
        assert!(fault.contains("did you mean low_overlap?"), "{fault}");
        let german = asked_in("low_overlap", "de").expect("a row").lines.join("\n");
        assert!(german.contains("min_overlap") && german != words, "{german}");
        assert!(
            run(&Explain { code: None, language: "en".to_owned() }).expect("a list").lines[0].lines().count() > 150
        );
    }
}
