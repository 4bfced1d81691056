//! `panelprep check`: are these configuration files right, and what do they say?

use super::args::{Check, PurposeName};
use super::disk;
use super::fault::{CALIBRATION_ADVICE, Fault};
use super::outcome::Outcome;
use crate::cell::Cell;
use crate::check::{FileReport, check_files_for, decode};
use crate::config::{Problem, line_of_key};
use crate::requirements::Purpose;
use crate::verdict::{Judgement, Reason, Verdict};
use serde_json::json;
use std::path::Path;

/// Checks every file; all problems of all files are told, traps too. EthernetKRL files are checked against each other,
/// KRL files as one program. A file that cannot be read is told beside the others, with exit code 2.
///
/// # Errors
/// None; what cannot be read is part of the outcome.
pub fn run(args: &Check) -> Result<Outcome, Fault> {
    let mut files = Vec::new();
    let mut lines = Vec::new();
    let mut reasons = Vec::new();
    let texts: Vec<(String, Result<String, String>)> = args.files.iter().map(|file| named_text(file)).collect();
    let named: Vec<(&str, &str)> =
        texts.iter().filter_map(|(name, text)| Some((name.as_str(), text.as_deref().ok()?))).collect();
    let mut found = check_files_for(&named, purpose(args.purpose), args.kss).into_iter();
    for (name, text) in &texts {
        let report = match text {
            Ok(_) => found.next(),
            Err(message) => Some(unreadable(message)),
        };
        let Some(mut report) = report else { continue };
        report.warnings.extend(calibrations_that_are_not_there(name, report.kind));
        let warnings: Vec<String> = report.warnings.iter().map(warning).collect();
        let ok = report.problems.is_empty();
        lines.push(format!("{name}: {}", if ok { "ok" } else { "not right" }));
        for problem in &report.problems {
            lines.push(match problem.key.is_empty() && text.is_err() {
                // It names the file or the line itself.
                true => format!("  {}", problem.message),
                false => format!("  line {}: {}: {}", problem.line, problem.key, problem.message),
            });
        }
        lines.extend(warnings.iter().chain(&report.says).map(|sentence| format!("  {sentence}")));
        if !ok {
            reasons.push(Reason::new("bad_file", format!("{name} has {} problems", report.problems.len())));
        }
        let says: Vec<&String> = report.says.iter().chain(&warnings).collect();
        files.push(json!({
            "file": name, "ok": ok, "errors": report.problems, "warnings": report.warnings, "says": says
        }));
    }
    let verdict = if reasons.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::of(&Judgement { verdict, reasons });
    if texts.iter().any(|(_, text)| text.is_err()) {
        outcome.exit = 2;
    }
    outcome.words = lines;
    outcome.put("files", json!(files));
    Ok(outcome)
}

/// A file's name in messages, and its text or why it has none.
fn named_text(file: &Path) -> (String, Result<String, String>) {
    let name = file.display().to_string();
    let bytes = disk::read(file).map_err(|fault| fault.to_string());
    let text = bytes.and_then(|bytes| decode(&name, &bytes).map_err(|error| error.to_string()));
    (name, text)
}

fn unreadable(message: &str) -> FileReport {
    let problem = Problem { line: 1, key: String::new(), message: message.to_owned() };
    FileReport { kind: None, problems: vec![problem], warnings: Vec::new(), says: Vec::new() }
}

fn purpose(name: PurposeName) -> Option<Purpose> {
    match name {
        PurposeName::Files => None,
        PurposeName::Robot => Some(Purpose::Robot),
        PurposeName::Cycle => Some(Purpose::Cycle),
    }
}

/// A cell's file may be right before its calibrations are made; nothing that needs one can be done before.
fn calibrations_that_are_not_there(name: &str, kind: Option<&str>) -> Vec<Problem> {
    let text = disk::read_text(Path::new(name)).unwrap_or_default();
    let cell = (kind == Some("cell")).then(|| Cell::check(name, &text).ok()).flatten();
    let away = |(key, file): (&str, &Path)| {
        let key = format!("calibration.{key}");
        let message = format!("{} is not there; {}", file.display(), CALIBRATION_ADVICE);
        (!file.exists()).then(|| Problem { line: line_of_key(&text, &key), key, message })
    };
    cell.iter().flat_map(|cell| cell.calibration().named()).filter_map(away).collect()
}

fn warning(warning: &Problem) -> String {
    format!("warning, line {}: {}: {}", warning.line, warning.key, warning.message)
}
