//! The output of the program: the result of a command as text or as one JSON object, and progress messages on standard
//! error.
//!
//! The reader may close a stream at any time (`| head -1`): this neither ends the command nor changes its exit code.
//!
//! A log event is always one line. Names and texts come from files and clients, and a line feed in them must not begin
//! a line that looks like another event. Under systemd the journal adds the time.

use super::disk;
use super::fault::Fault;
use panelprep_base::verdict::{Check, Judgement};
use serde_json::{Map, Value, json};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::fmt;
use tracing_subscriber::layer::SubscriberExt;

/// Writes a line of the result to standard output.
///
/// # Errors
/// If it cannot be written for another reason than a closed reader, for example because the disk is full.
pub fn print_line(line: &str) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    match writeln!(stdout, "{line}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

/// Reads a line that a person types at the terminal, without leading and trailing white space; `None` at the end of the
/// input.
///
/// # Errors
/// If standard input cannot be read.
pub fn read_answer_line() -> Result<Option<String>, Fault> {
    let mut line = String::new();
    let read =
        io::stdin().read_line(&mut line).map_err(|error| Fault::file_fault("standard input".as_ref(), error))?;
    Ok((read > 0).then(|| line.trim().to_owned()))
}

/// Writes a line of progress, or a problem, to standard error. A failure is ignored, because it could not be reported
/// anywhere.
pub fn write_progress(line: &str) {
    #[expect(
        clippy::let_underscore_must_use,
        reason = "if the output is closed, there is no other place to report the error"
    )]
    let _ = writeln!(io::stderr().lock(), "{line}");
}

/// The result of a command, as text and as JSON.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Exit code of the command.
    pub exit_code: u8,
    /// The JSON object for `--json`.
    pub json: Map<String, Value>,
    /// The lines of text for a person.
    pub lines: Vec<String>,
}

impl Outcome {
    /// Creates an outcome from a judgement, with its verdict and reasons.
    pub fn from_judgement(judgement: &Judgement) -> Self {
        let mut json = Map::new();
        json.insert("verdict".to_owned(), json!(judgement.verdict));
        json.insert("reasons".to_owned(), json!(judgement.reasons));
        let reasons = judgement.reasons.iter().map(|reason| format!("  {} ({})", reason.message, reason.code));
        let words = std::iter::once(format!("verdict: {}", judgement.verdict.keyword())).chain(reasons).collect();
        Outcome { exit_code: judgement.verdict.exit_code(), json, lines: words }
    }

    /// Adds the checks on which the judgement is based to the JSON object.
    pub fn add_checks(&mut self, checks: &[Check]) {
        self.add_value("checks", json!(checks));
    }

    /// Adds a value to the JSON object.
    pub fn add_value(&mut self, key: &str, value: Value) {
        self.json.insert(key.to_owned(), value);
    }

    /// Adds a line to the text.
    pub fn add_line(&mut self, line: impl Into<String>) {
        self.lines.push(line.into());
    }

    /// Writes the JSON object, as `--json` prints it, to this file, if one is named.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write(&self, file: Option<&Path>) -> Result<(), Fault> {
        if let Some(file) = file {
            disk::write(file, format!("{}\n", Value::Object(self.json.clone())))?;
        }
        Ok(())
    }

    /// Prints the outcome and returns the exit code.
    pub fn print(&self, as_json: bool) -> ExitCode {
        let text = if as_json { Value::Object(self.json.clone()).to_string() } else { self.lines.join("\n") };
        print_outcome(&text, self.exit_code)
    }
}

/// Prints the result and returns its exit code; if the result cannot be written, returns the exit code of a disk error.
fn print_outcome(text: &str, exit: u8) -> ExitCode {
    match print_line(text) {
        Ok(()) => ExitCode::from(exit),
        Err(error) => {
            write_progress(&format!("panelprep: the result cannot be written to standard output: {error}"));
            ExitCode::from(2)
        }
    }
}

/// Prints the error that stopped a command: a message on standard error, and with `--json` also an object.
pub fn print_fault(fault: &Fault, as_json: bool) -> ExitCode {
    write_progress(&format!("panelprep: {fault}"));
    let (exit, code) = fault.code();
    if as_json {
        let reason = json!([{"code": code, "message": fault.to_string()}]);
        return print_outcome(&json!({"verdict": null, "reasons": reason}).to_string(), exit);
    }
    ExitCode::from(exit)
}

/// Starts the log. `PANELPREP_LOG` can set another level than `usual`: `error`, `warn`, `info`, `debug`, `trace`,
/// `off`.
pub fn start_log(usual: LevelFilter) {
    let level = std::env::var("PANELPREP_LOG").ok().and_then(|word| word.parse().ok()).unwrap_or(usual);
    let out = || OneLine(std::io::stderr());
    let log = fmt().with_writer(out).with_ansi(false).with_target(false).with_max_level(level);
    // Internal errors of the logger are not printed, because it would use `eprintln!`, which panics if standard error
    // is closed.
    let log = log.log_internal_errors(false);
    // Any network input can cause messages of these libraries, so they are not logged by default.
    let is_of_network = |target: &str| ["opcua", "async_nats"].iter().any(|name| target.starts_with(name));
    let is_told = move |of: &tracing::Metadata<'_>| level >= LevelFilter::DEBUG || !is_of_network(of.target());
    #[expect(
        clippy::let_underscore_must_use,
        reason = "the logger is set once per process; a second call has no effect"
    )]
    let _ = match std::env::var_os("JOURNAL_STREAM") {
        Some(_) => tracing::subscriber::set_global_default(log.without_time().finish().with(filter_fn(is_told))),
        None => tracing::subscriber::set_global_default(log.finish().with(filter_fn(is_told))),
    };
}

/// A writer that writes each event as one line. Each event arrives complete; its control characters, except the one at
/// its end, are escaped.
struct OneLine<W>(W);

impl<W: Write> Write for OneLine<W> {
    fn write(&mut self, event: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(event);
        let inside = text.strip_suffix('\n').unwrap_or(&text);
        let is_plain = |c: char| !c.is_control() && !matches!(c, '\u{2028}' | '\u{2029}');
        if inside.chars().all(is_plain) {
            self.0.write_all(event)?;
        } else {
            let escaped: String = inside
                .chars()
                .map(|c| if is_plain(c) { c.to_string() } else { c.escape_default().to_string() })
                .collect();
            self.0.write_all(escaped.as_bytes())?;
            self.0.write_all(&text.as_bytes()[inside.len()..])?;
        }
        Ok(event.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(event: &str) -> String {
        let mut bytes = Vec::new();
        OneLine(&mut bytes).write_all(event.as_bytes()).expect("memory");
        String::from_utf8(bytes).expect("UTF-8")
    }

    #[test]
    fn an_event_is_always_one_line() {
        assert_eq!(written("INFO anna (uid 7) asks: stop; 25 µm\n"), "INFO anna (uid 7) asks: stop; 25 µm\n");
        let forged = "WARN refused: /tmp/a\n2026-11-22 INFO root (uid 0) asks: abort\r\x1b[2K\u{2028}\n";
        let told = "WARN refused: /tmp/a\\n2026-11-22 INFO root (uid 0) asks: abort\\r\\u{1b}[2K\\u{2028}\n";
        assert_eq!(written(forged), told);
    }
}
