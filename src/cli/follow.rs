//! Follows the service: `panelprep ctl watch`, `panelprep ctl reset --wait` and `panelprep ctl start --wait`.
//!
//! It requests the state a few times a second, so that a follower does not occupy a connection of the socket.

use super::fault::Fault;
use super::outcome::Outcome;
use super::output::write_progress;
use super::service_request;
use panelprep_service::daemon::{Reply, RequestKind, RequestResult};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// Interval between two queries.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// If the service does not answer within this time, it is considered gone; a service that restarts may be away for
/// a moment.
const SERVICE_TIMEOUT: Duration = Duration::from_secs(5);

/// A reset warms the cameras up, which may need minutes.
const RESET_TIMEOUT: Duration = Duration::from_secs(600);

/// Prints each change until the output has no reader or the service is gone.
///
/// # Errors
/// If no service answers.
pub fn print_changes(socket: &Path, as_json: bool) -> Result<Outcome, Fault> {
    let mut last_line = None;
    loop {
        let reply = state(socket)?;
        let line = if as_json { Value::Object(watched_fields(&reply)).to_string() } else { describe_reply(&reply) };
        if last_line.as_ref() != Some(&line) && writeln!(std::io::stdout(), "{line}").is_err() {
            return Ok(Outcome { exit_code: 0, json: service_request::object(&reply), lines: vec![] });
        }
        last_line = Some(line);
        thread::sleep(POLL_INTERVAL);
    }
}

/// Waits for the end of the cycle that was just begun, reports each change on standard error, and ends with the
/// cycle's verdict.
///
/// # Errors
/// If the service does not answer any more.
pub fn wait_for_end(socket: &Path, begun: &Reply) -> Result<Outcome, Fault> {
    let mut last_line = None;
    loop {
        let reply = state(socket)?;
        let line = describe_reply(&reply);
        if last_line.as_ref() != Some(&line) {
            write_progress(&line);
        }
        last_line = Some(line);
        let is_other = reply.cycle_id != begun.cycle_id;
        if is_other {
            return Err(Fault::OtherCycle { waited_for: begun.cycle_id, found: reply.cycle_id });
        }
        let rests = matches!(reply.state.as_deref(), Some("stopped" | "complete" | "aborted"));
        if let (Some(verdict), true, true) = (reply.verdict, rests, is_page_written(&reply)) {
            let exit = verdict.exit_code();
            return Ok(Outcome { exit_code: exit, ..service_request::outcome(&reply) });
        }
        thread::sleep(POLL_INTERVAL);
    }
}

/// Waits for the end of a reset that was just begun; the exit code is 3 if the reset does not lead to idle.
///
/// # Errors
/// If the service does not answer any more.
pub fn to_idle(socket: &Path) -> Result<Outcome, Fault> {
    let since = Instant::now();
    loop {
        let reply = state(socket)?;
        let is_at = |word: &str| reply.state.as_deref() == Some(word);
        if is_at("resetting") && since.elapsed() < RESET_TIMEOUT {
            thread::sleep(POLL_INTERVAL);
            continue;
        }
        let exit = if is_at("idle") { RequestResult::Done } else { RequestResult::Fault };
        let mut outcome = Outcome { exit_code: exit.code(), ..service_request::outcome(&reply) };
        if is_at("resetting") {
            let words = "the reset did not finish within";
            outcome.add_line(format!(
                "{words} {} s; `panelprep ctl state` shows its progress",
                RESET_TIMEOUT.as_secs()
            ));
        }
        return Ok(outcome);
    }
}

/// Whether the page is written: this happens after the cycle's end.
fn is_page_written(reply: &Reply) -> bool {
    reply.page.is_some()
}

fn state(socket: &Path) -> Result<Reply, Fault> {
    let since = Instant::now();
    loop {
        match service_request::send_to_service(socket, &RequestKind::State) {
            Ok(reply) if reply.state.is_some() => return Ok(reply),
            Ok(reply) if since.elapsed() >= SERVICE_TIMEOUT => return Ok(reply),
            Err(fault) if since.elapsed() >= SERVICE_TIMEOUT => return Err(fault),
            Ok(_) | Err(_) => thread::sleep(POLL_INTERVAL),
        }
    }
}

/// The fields that are watched for changes, without the number of requests to the service.
fn watched_fields(reply: &Reply) -> serde_json::Map<String, Value> {
    let mut object = service_request::object(reply);
    object.remove("answer");
    object.insert("recording".to_owned(), json!(reply.recording.as_ref().map(|recorded| &recorded.message)));
    object
}

fn describe_reply(reply: &Reply) -> String {
    let verdict = reply.verdict.map_or(String::new(), |verdict| format!(": {}", verdict.keyword()));
    let cycle = reply.cycle_id.map_or(String::new(), |cycle| format!("; cycle {cycle}{verdict}"));
    let panel = reply.panel.as_ref().map_or(String::new(), |panel| format!(" of panel {panel}"));
    let page = reply.page.as_ref().map_or(String::new(), |page| format!("; page {}", page.display()));
    let reasons: Vec<&str> = reply.reasons.iter().map(|reason| reason.message.as_str()).collect();
    let reasons = if reasons.is_empty() { String::new() } else { format!("; {}", reasons.join("; ")) };
    format!("{}{cycle}{panel}{page}{reasons}", service_request::describe_progress(reply))
}
