//! `panelprep check`: are these configuration files right, and what do they say?

use super::args::Check;
use super::disk;
use super::fault::Fault;
use super::outcome::Outcome;
use crate::check::check_files;
use crate::config::Problem;
use crate::verdict::{Judgement, Reason, Verdict};
use serde_json::json;

/// Checks every file; all problems of all files are told, traps too. EthernetKRL files are checked against each other.
///
/// # Errors
/// Where a file cannot be read.
pub fn run(args: &Check) -> Result<Outcome, Fault> {
    let mut files = Vec::new();
    let mut lines = Vec::new();
    let mut reasons = Vec::new();
    let mut texts = Vec::new();
    for file in &args.files {
        texts.push((file.display().to_string(), disk::read_text(file)?));
    }
    let named: Vec<(&str, &str)> = texts.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    for ((name, _), report) in named.iter().zip(check_files(&named)) {
        let warnings: Vec<String> = report.warnings.iter().map(warning).collect();
        let ok = report.problems.is_empty();
        lines.push(format!("{name}: {}", if ok { "ok" } else { "not right" }));
        for problem in &report.problems {
            lines.push(format!("  line {}: {}: {}", problem.line, problem.key, problem.message));
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
    outcome.words = lines;
    outcome.put("files", json!(files));
    Ok(outcome)
}

fn warning(warning: &Problem) -> String {
    format!("warning, line {}: {}: {}", warning.line, warning.key, warning.message)
}
