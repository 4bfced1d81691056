//! The output of a command: words for a person, or one JSON object.

use super::disk;
use super::fault::Fault;
use super::output::{print_line, write_progress};
use panelprep_base::verdict::{Check, Judgement};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::process::ExitCode;

/// The result of a command, in both forms.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Exit code of the command.
    pub exit_code: u8,
    /// The JSON object for `--json`.
    pub json: Map<String, Value>,
    /// Lines for a person.
    pub lines: Vec<String>,
}

impl Outcome {
    /// Creates an outcome from a judgement: `verdict` and `reasons`, and the words for them.
    pub fn from_judgement(judgement: &Judgement) -> Self {
        let mut json = Map::new();
        json.insert("verdict".to_owned(), json!(judgement.verdict));
        json.insert("reasons".to_owned(), json!(judgement.reasons));
        let reasons = judgement.reasons.iter().map(|reason| format!("  {} ({})", reason.message, reason.code));
        let words = std::iter::once(format!("verdict: {}", judgement.verdict.keyword())).chain(reasons).collect();
        Outcome { exit_code: judgement.verdict.exit_code(), json, lines: words }
    }

    /// Adds the checks on which the judgement is based.
    pub fn add_checks(&mut self, checks: &[Check]) {
        self.add_value("checks", json!(checks));
    }

    /// Adds a value that scripts read.
    pub fn add_value(&mut self, key: &str, value: Value) {
        self.json.insert(key.to_owned(), value);
    }

    /// Adds a line for a person.
    pub fn add_line(&mut self, line: impl Into<String>) {
        self.lines.push(line.into());
    }

    /// Writes the object that `--json` prints to this file, if one is named.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write(&self, file: Option<&Path>) -> Result<(), Fault> {
        file.map_or(Ok(()), |file| disk::write(file, format!("{}\n", Value::Object(self.json.clone()))))
    }

    /// Prints the outcome and returns the exit code.
    pub fn print(&self, as_json: bool) -> ExitCode {
        let text = if as_json { Value::Object(self.json.clone()).to_string() } else { self.lines.join("\n") };
        print_outcome(&text, self.exit_code)
    }
}

/// Prints the result and returns its exit code; if the result cannot be written, this is a disk fault.
fn print_outcome(text: &str, exit: u8) -> ExitCode {
    match print_line(text) {
        Ok(()) => ExitCode::from(exit),
        Err(error) => {
            write_progress(&format!("panelprep: the result cannot be written to standard output: {error}"));
            ExitCode::from(2)
        }
    }
}

/// Prints the fault that stopped a command: words on standard error, and with `--json` also an object.
pub fn print_fault(fault: &Fault, as_json: bool) -> ExitCode {
    write_progress(&format!("panelprep: {fault}"));
    let (exit, code) = fault.code();
    if as_json {
        let reason = json!([{"code": code, "message": fault.to_string()}]);
        return print_outcome(&json!({"verdict": null, "reasons": reason}).to_string(), exit);
    }
    ExitCode::from(exit)
}
