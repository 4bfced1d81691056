//! A request to the service, and its reply.

use super::fault::Fault;
use super::outcome::Outcome;
use panelprep_base::geometry::Joints;
use panelprep_service::daemon::{MAX_BYTES, Reply, RequestKind, request_line};
use serde_json::{Map, Value, json};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// How long a stop or an abort is repeated if the service is too busy to accept it.
const RETRY_TIMEOUT: Duration = Duration::from_secs(5);

const RETRY_INTERVAL: Duration = Duration::from_millis(20);

/// Repeats a request for a stop while the service, or the connection to it, is too busy to accept the request.
pub(super) fn send_stop_with_retries(socket: &Path, what: &RequestKind) -> Result<Reply, Fault> {
    let since = Instant::now();
    loop {
        let answered = send_to_service(socket, what);
        let is_busy = match &answered {
            Ok(reply) => reply.reasons.iter().any(|reason| reason.code == "busy"),
            Err(Fault::NoService { .. }) => false,
            Err(_) => true,
        };
        if !is_busy || since.elapsed() >= RETRY_TIMEOUT {
            return answered;
        }
        thread::sleep(RETRY_INTERVAL);
    }
}

pub(super) fn send_to_service(socket: &Path, what: &RequestKind) -> Result<Reply, Fault> {
    let named = |error: std::io::Error| Fault::file_fault(socket, error);
    let mut stream = UnixStream::connect(socket).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => Fault::NoService { socket: socket.to_owned() },
        _ => named(error),
    })?;
    stream.set_read_timeout(Some(RESPONSE_TIMEOUT)).map_err(named)?;
    stream.set_write_timeout(Some(RESPONSE_TIMEOUT)).map_err(named)?;
    let line = request_line(what).map_err(Fault::stage)?;
    // The service answers a line that is too long before it has read the whole line.
    let written = stream.write_all(line.as_bytes());
    let mut answer = Vec::new();
    let read = BufReader::new(stream).take(MAX_BYTES as u64).read_until(b'\n', &mut answer);
    if answer.is_empty() {
        written.and(read.map(drop)).map_err(named)?;
    }
    serde_json::from_slice(&answer).map_err(|error| Fault::file_fault(socket, error))
}

/// Returns the fields of a reply that scripts read.
pub(super) fn object(reply: &Reply) -> Map<String, Value> {
    let Reply { answer, state, phase, epoch, step, cycle_id, verdict, recording, reasons, done, .. } = reply;
    let Reply { panel, pass, film_s, waypoint, of, page, axes_deg, .. } = reply;
    let json = json!({
        "verdict": verdict, "reasons": reasons, "answer": answer, "state": state, "phase": phase, "epoch": epoch, "step": step,
        "cycle_id": cycle_id, "recording": recording, "panel": panel, "pass": pass, "film_s": film_s,
        "waypoint": waypoint, "of": of, "page": page, "done": done,
        "axes_deg": axes_deg,
    });
    json.as_object().cloned().unwrap_or_else(Map::new)
}

/// Converts a reply to an outcome for scripts and for people.
pub(super) fn outcome(reply: &Reply) -> Outcome {
    let Reply { state, cycle_id, verdict, recording, reasons, panel, page, done, .. } = reply;
    let mut outcome = Outcome { exit_code: reply.answer.code(), json: object(reply), lines: vec![] };
    outcome.lines.extend(done.clone());
    if state.is_some() {
        let step = reply.step.map_or(String::new(), |step| format!("; step {step}"));
        outcome.add_line(format!("state: {}{step}", describe_progress(reply)));
    }
    if let Some(cycle) = cycle_id {
        let panel = panel.as_ref().map_or(String::new(), |panel| format!(" of panel {panel}"));
        let verdict = verdict.map_or(String::new(), |verdict| format!(": {}", verdict.keyword()));
        outcome.add_line(format!("cycle {cycle}{panel}{verdict}"));
    }
    if let Some(page) = page {
        outcome.add_line(format!("page: {}", page.display()));
    }
    if let Some(recorded) = recording {
        outcome.add_line(&recorded.message);
    }
    for reason in reasons {
        outcome.add_line(format!("  {} ({})", reason.message, reason.code));
    }
    outcome
}

/// Returns the state and the phase, and the progress of the work in this phase.
pub(super) fn describe_progress(reply: &Reply) -> String {
    let Reply { state, phase, pass, film_s, waypoint, of, .. } = reply;
    let mut parts: Vec<String> = state.iter().chain(phase).cloned().collect();
    parts.extend(pass.filter(|pass| *pass > 0 && phase.is_some()).map(|pass| format!("pass {pass}")));
    parts.extend(film_s.map(|seconds| format!("{seconds:.0} s of film")));
    parts.extend(waypoint.zip(*of).map(|(waypoint, of)| format!("waypoint {waypoint} of {of}")));
    parts.join(", ")
}

/// Returns the state of the service, if one answers.
pub(super) fn service_state(socket: &Path) -> Option<String> {
    send_to_service(socket, &RequestKind::State).ok()?.state.map(|state| state.to_string())
}

/// Returns the arm's axis angles, if a service answers and has them.
pub(super) fn service_axes(socket: &Path) -> Option<Joints> {
    send_to_service(socket, &RequestKind::State).ok()?.axes_deg.map(Joints::from)
}

/// The service answers a start only after it has loaded the taught data.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(60);
