//! `panelprep ctl`: questions to the service, and its answers.

use super::args::{Common, Ctl, CtlAsk, PartArguments};
use super::disk;
use super::fault::Fault;
use super::follow;
use super::load::CellFiles;
use super::outcome::Outcome;
use super::part;
use crate::cycle::Request;
use crate::daemon::{Exit, MOST_BYTES, PartNames, RecordIn, Reply, StartRequest, What, request_line};
use crate::geometry::Joints;
use serde_json::{Map, Value, json};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// The service answers a start once it has loaded what was taught.
const PATIENCE: Duration = Duration::from_secs(60);
/// A stop or an abort that met a service without a place for it is asked again for so long.
const INSISTS: Duration = Duration::from_secs(5);
const AGAIN: Duration = Duration::from_millis(20);

/// Asks, and tells what was answered.
///
/// # Errors
/// Where a file is not what it must be, or no service answers.
pub fn run(args: &Ctl, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let socket = files.socket();
    if matches!(args.ask, CtlAsk::Watch) {
        return follow::watch(&socket, common.json);
    }
    let what = what(&args.ask)?;
    let reply = match what {
        What::Table(Request::Stop | Request::Abort) => insist(&socket, &what)?,
        _ => ask(&socket, &what)?,
    };
    match args.ask {
        CtlAsk::Start { wait: true, .. } if reply.answer == Exit::Done => follow::to_the_end(&socket, &reply),
        CtlAsk::Reset { wait: true } if reply.answer == Exit::Done => follow::to_idle(&socket),
        _ => Ok(outcome(&reply)),
    }
}

/// How the service stands, where one answers.
pub(super) fn state_of(socket: &Path) -> Option<String> {
    ask(socket, &What::State).ok()?.state.map(|state| state.to_string())
}

/// Where the arm's axes stand, where a service answers and knows it.
pub(super) fn axes_of(socket: &Path) -> Option<Joints> {
    ask(socket, &What::State).ok()?.axes_deg.map(Joints::from)
}

fn what(ask: &CtlAsk) -> Result<What, Fault> {
    Ok(match ask {
        CtlAsk::Start { recipe, record, part, .. } => What::Start(StartRequest {
            recipe: recipe.display().to_string(),
            text: disk::read_text(recipe)?,
            record: record.as_ref().map(|file| record_in(file.as_deref())).transpose()?,
            part: part::checked(names(part))?,
        }),
        CtlAsk::Hold => What::Table(Request::Hold),
        CtlAsk::Unhold { dried } => What::Table(Request::Unhold { dried: *dried }),
        CtlAsk::Stop => What::Table(Request::Stop),
        CtlAsk::Abort => What::Table(Request::Abort),
        CtlAsk::Clear => What::Table(Request::Clear),
        CtlAsk::Reset { .. } => What::Table(Request::Reset),
        CtlAsk::Accept => What::Table(Request::Accept),
        CtlAsk::NewDisc => What::NewDisc,
        CtlAsk::State | CtlAsk::Watch => What::State,
    })
}

fn names(part: &PartArguments) -> PartNames {
    let PartArguments { serial, order, operator } = part.clone();
    PartNames { serial, order, operator }
}

/// The service stands in a folder of its own, so a file goes to it by its whole path.
fn record_in(file: Option<&Path>) -> Result<RecordIn, Fault> {
    let Some(file) = file else { return Ok(RecordIn::Store) };
    let whole = std::path::absolute(file).map_err(|error| Fault::file(file, error))?;
    // Without .. and links, as far as the folder is there; where it is not, the service says so.
    let folder = whole.parent().and_then(|folder| folder.canonicalize().ok());
    Ok(RecordIn::File(folder.zip(whole.file_name()).map_or(whole.clone(), |(folder, name)| folder.join(name))))
}

/// Asks for a stop again and again while the service, or the way to it, is too busy to take it.
fn insist(socket: &Path, what: &What) -> Result<Reply, Fault> {
    let since = Instant::now();
    loop {
        let answered = ask(socket, what);
        let is_busy = match &answered {
            Ok(reply) => reply.reasons.iter().any(|reason| reason.code == "busy"),
            Err(Fault::NoService { .. }) => false,
            Err(_) => true,
        };
        if !is_busy || since.elapsed() >= INSISTS {
            return answered;
        }
        thread::sleep(AGAIN);
    }
}

pub(super) fn ask(socket: &Path, what: &What) -> Result<Reply, Fault> {
    let named = |error: std::io::Error| Fault::file(socket, error);
    let mut stream = UnixStream::connect(socket).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => Fault::NoService { socket: socket.to_owned() },
        _ => named(error),
    })?;
    stream.set_read_timeout(Some(PATIENCE)).map_err(named)?;
    stream.set_write_timeout(Some(PATIENCE)).map_err(named)?;
    let line = request_line(what).map_err(Fault::stage)?;
    // A line that is too long is answered before it is read whole.
    let written = stream.write_all(line.as_bytes());
    let mut answer = Vec::new();
    let read = BufReader::new(stream).take(MOST_BYTES as u64).read_until(b'\n', &mut answer);
    if answer.is_empty() {
        written.and(read.map(drop)).map_err(named)?;
    }
    serde_json::from_slice(&answer).map_err(|error| Fault::file(socket, error))
}

/// What scripts read of an answer.
pub(super) fn object(reply: &Reply) -> Map<String, Value> {
    let Reply { answer, state, phase, epoch, cycle_id, verdict, recording, reasons, done, .. } = reply;
    let Reply { panel, pass, film_s, waypoint, of, page, axes_deg, .. } = reply;
    let json = json!({
        "verdict": verdict, "reasons": reasons, "answer": answer, "state": state, "phase": phase, "epoch": epoch,
        "cycle_id": cycle_id, "recording": recording, "panel": panel, "pass": pass, "film_s": film_s,
        "waypoint": waypoint, "of": of, "page": page, "done": done,
        "axes_deg": axes_deg,
    });
    json.as_object().cloned().unwrap_or_else(Map::new)
}

/// An answer, for scripts and for people.
pub(super) fn outcome(reply: &Reply) -> Outcome {
    let Reply { state, cycle_id, verdict, recording, reasons, panel, page, done, .. } = reply;
    let mut outcome = Outcome { exit: reply.answer.code(), json: object(reply), words: vec![] };
    outcome.words.extend(done.clone());
    if state.is_some() {
        outcome.say(format!("state: {}", place(reply)));
    }
    if let Some(cycle) = cycle_id {
        let panel = panel.as_ref().map_or(String::new(), |panel| format!(" of panel {panel}"));
        let verdict = verdict.map_or(String::new(), |verdict| format!(": {}", verdict.word()));
        outcome.say(format!("cycle {cycle}{panel}{verdict}"));
    }
    if let Some(page) = page {
        outcome.say(format!("page: {}", page.display()));
    }
    if let Some(recorded) = recording {
        outcome.say(&recorded.message);
    }
    for reason in reasons {
        outcome.say(format!("  {} ({})", reason.message, reason.code));
    }
    outcome
}

/// State and phase, and how far the work in it is.
pub(super) fn place(reply: &Reply) -> String {
    let Reply { state, phase, pass, film_s, waypoint, of, .. } = reply;
    let mut parts: Vec<String> = state.iter().chain(phase).cloned().collect();
    parts.extend(pass.filter(|pass| *pass > 0 && phase.is_some()).map(|pass| format!("pass {pass}")));
    parts.extend(film_s.map(|seconds| format!("{seconds:.0} s of film")));
    parts.extend(waypoint.zip(*of).map(|(waypoint, of)| format!("waypoint {waypoint} of {of}")));
    parts.join(", ")
}
