//! `panelprep check`: checks whether configuration files are valid, and prints what they state.

use super::args::{Check, PurposeName};
use super::disk;
use super::fault::Fault;
use super::output::Outcome;
use super::teach::region_parts_off_panel;
use panelprep_base::config::{Problem, key_line};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::panel::OffPanel;
use panelprep_cell::recipe::Recipe;
use panelprep_service::check::{CheckedFor, DecodedText, FileReport, check_files_for, decode};
use panelprep_service::requirements::Purpose;
use panelprep_service::setup::{self, CellFiles, CellPaths};
use serde_json::json;
use std::path::Path;

/// Checks every file and reports all problems and warnings. EthernetKRL files are compared with each other, and KRL
/// files are checked as one program. A file that cannot be read is reported with the others; the exit code is then 2.
///
/// # Errors
/// Never; a file that cannot be read is part of the outcome.
pub fn run(args: &Check) -> Result<Outcome, Fault> {
    let mut files = Vec::new();
    let mut lines = Vec::new();
    let mut reasons = Vec::new();
    let texts: Vec<(String, Result<DecodedText, String>)> =
        args.files.iter().map(|file| read_text_for_check(file)).collect();
    let named: Vec<(&str, &str)> = texts
        .iter()
        .filter_map(|(name, decoded)| Some((name.as_str(), decoded.as_ref().ok()?.text.as_str())))
        .collect();
    let reports = check_files_for(&named, &checked_for(args));
    let right = |kind: &'static str| {
        let of_kind = named.iter().zip(&reports).filter(move |(_, report)| report.kind == Some(kind));
        of_kind.filter(|(_, report)| report.problems.is_empty()).map(|((name, _), _)| *name)
    };
    let cells: Vec<&str> = right("cell").collect();
    let recipes: Vec<&str> = right("recipe").collect();
    let mut found = reports.into_iter();
    for (name, decoded) in &texts {
        let report = match decoded {
            Ok(_) => found.next(),
            Err(message) => Some(unreadable_report(message)),
        };
        let Some(mut report) = report else { continue };
        report.warnings.splice(0..0, decoded.iter().filter_map(|decoded| decoded.warning.clone()));
        if let (Ok(decoded), [cell], true) = (decoded, &cells[..], recipes.contains(&name.as_str())) {
            match region_off_panel((name, &decoded.text), cell) {
                Ok(warnings) => report.warnings.extend(warnings),
                Err(fault) => {
                    report.descriptions.push(format!("the region was not compared with the taught panel: {fault}"))
                }
            }
        }
        let warnings: Vec<String> = report.warnings.iter().map(warning).collect();
        let ok = report.problems.is_empty();
        lines.push(format!("{name}: {}", if ok { "ok" } else { "not right" }));
        for problem in &report.problems {
            lines.push(match problem.key.is_empty() && decoded.is_err() {
                // The message already contains the name of the file or the line.
                true => format!("  {}", problem.message),
                false => format!("  {}", format_problem(problem)),
            });
        }
        lines.extend(warnings.iter().chain(&report.descriptions).map(|sentence| format!("  {sentence}")));
        if !ok {
            reasons.push(Reason::new("bad_file", format!("{name} has {} problems", report.problems.len())));
        }
        let says: Vec<&String> = report.descriptions.iter().chain(&warnings).collect();
        files.push(json!({
            "file": name, "ok": ok, "errors": report.problems, "warnings": report.warnings, "says": says
        }));
    }
    let verdict = if reasons.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons });
    if texts.iter().any(|(_, decoded)| decoded.is_err()) {
        outcome.exit_code = 2;
    }
    outcome.lines = lines;
    outcome.add_value("files", json!(files));
    Ok(outcome)
}

/// Returns the name of a file for messages, and its text or the reason why the text cannot be read.
fn read_text_for_check(file: &Path) -> (String, Result<DecodedText, String>) {
    let name = file.display().to_string();
    let bytes = disk::read(file).map_err(|fault| fault.to_string());
    let decoded = bytes.and_then(|bytes| decode(&name, &bytes).map_err(|error| error.to_string()));
    (name, decoded)
}

fn unreadable_report(message: &str) -> FileReport {
    let problem = Problem { line: 1, key: String::new(), message: message.to_owned() };
    FileReport { kind: None, problems: vec![problem], warnings: Vec::new(), descriptions: Vec::new() }
}

/// Returns the purpose for which the files are checked. Without `--for`, a cell file must be complete for a cycle; the
/// files that it names may be missing, because the cell file is written before the calibrations.
fn checked_for(args: &Check) -> CheckedFor<'_> {
    let purpose = match args.purpose {
        None | Some(PurposeName::Cycle) => Some(Purpose::Cycle),
        Some(PurposeName::Robot) => Some(Purpose::Robot),
        Some(PurposeName::Files) => None,
    };
    let may_lack_files = matches!(args.purpose, None | Some(PurposeName::Files));
    CheckedFor { purpose, are_missing_files_allowed: may_lack_files, read: &disk::read_referenced, kss: args.kss }
}

/// Formats a problem with its line, and with its key if it has one.
fn format_problem(Problem { line, key, message }: &Problem) -> String {
    let key = if key.is_empty() { String::new() } else { format!("{key}: ") };
    format!("line {line}: {key}{message}")
}

/// Finds the parts of a recipe's region that are outside of the panel that was taught in this cell.
///
/// # Errors
/// If the outline of the panel is not known: the panel was not taught, was taught with another region, or the taught
/// data cannot be read.
fn region_off_panel((name, text): (&str, &str), cell: &str) -> Result<Vec<Problem>, Fault> {
    let recipe = Recipe::check(name, text)?;
    let files = CellFiles::read(&CellPaths { cell: cell.into(), store: None })?;
    let taught = setup::taught(&files, Path::new(name), &recipe)?;
    let key = "region.corners_px";
    let problem =
        |off: &OffPanel| Problem { line: key_line(text, key), key: key.to_owned(), message: off.reason().message };
    Ok(region_parts_off_panel(&taught.panel, &recipe).iter().map(problem).collect())
}

fn warning(warning: &Problem) -> String {
    format!("warning, {}", format_problem(warning))
}
