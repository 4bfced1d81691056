//! `panelprep check`: are these configuration files right, and what do they say?

use super::args::Check;
use super::disk;
use super::fault::Fault;
use super::outcome::Outcome;
use crate::check::check_file;
use crate::verdict::{Judgement, Reason, Verdict};
use serde_json::json;

/// Checks every file; all problems of all files are told.
///
/// # Errors
/// Where a file cannot be read.
pub fn run(args: &Check) -> Result<Outcome, Fault> {
    let mut files = Vec::new();
    let mut lines = Vec::new();
    let mut reasons = Vec::new();
    for file in &args.files {
        let name = file.display().to_string();
        let report = check_file(&name, &disk::read_text(file)?);
        let ok = report.problems.is_empty();
        lines.push(format!("{name}: {}", if ok { "ok" } else { "not right" }));
        for problem in &report.problems {
            lines.push(format!("  line {}: {}: {}", problem.line, problem.key, problem.message));
        }
        lines.extend(report.says.iter().map(|sentence| format!("  {sentence}")));
        if !ok {
            reasons.push(Reason::new("bad_file", format!("{name} has {} problems", report.problems.len())));
        }
        files.push(json!({"file": name, "ok": ok, "errors": report.problems, "says": report.says}));
    }
    let verdict = if reasons.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::of(&Judgement { verdict, reasons });
    outcome.words = lines;
    outcome.put("files", json!(files));
    Ok(outcome)
}
