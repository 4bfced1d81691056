//! `panelprep ctl`: one question to the service, and its answer.

use super::args::{Common, Ctl, CtlAsk};
use super::disk;
use super::fault::Fault;
use super::load::CellFiles;
use super::outcome::Outcome;
use crate::daemon::{MOST_BYTES, RecordIn, Reply, Wish};
use serde_json::{Map, json};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// The service answers a start once it has loaded what was taught.
const PATIENCE: Duration = Duration::from_secs(60);

/// Asks, and tells what was answered.
///
/// # Errors
/// Where a file is not what it must be, or no service answers.
pub fn run(args: &Ctl, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let reply = ask(&files.socket(), &wish(&args.ask)?)?;
    Ok(outcome(&reply))
}

/// How the service stands, where one answers.
pub(super) fn state_of(socket: &Path) -> Option<String> {
    ask(socket, &Wish::State {}).ok()?.state.map(|state| state.to_string())
}

fn wish(ask: &CtlAsk) -> Result<Wish, Fault> {
    Ok(match ask {
        CtlAsk::Start { recipe, record } => Wish::Start {
            recipe: recipe.display().to_string(),
            text: disk::read_text(recipe)?,
            record: record.as_ref().map(|file| record_in(file.as_deref())).transpose()?,
        },
        CtlAsk::Hold => Wish::Hold {},
        CtlAsk::Unhold { dried } => Wish::Unhold { dried: *dried },
        CtlAsk::Stop => Wish::Stop {},
        CtlAsk::Abort => Wish::Abort {},
        CtlAsk::Clear => Wish::Clear {},
        CtlAsk::Reset => Wish::Reset {},
        CtlAsk::Accept => Wish::Accept {},
        CtlAsk::NewDisc => Wish::NewDisc {},
        CtlAsk::State => Wish::State {},
    })
}

/// The service stands in a folder of its own, so a file goes to it by its whole path.
fn record_in(file: Option<&Path>) -> Result<RecordIn, Fault> {
    let Some(file) = file else { return Ok(RecordIn::Store) };
    let whole = std::path::absolute(file).map_err(|error| Fault::file(file, error))?;
    // Without .. and links, as far as the folder is there; where it is not, the service says so.
    let folder = whole.parent().and_then(|folder| folder.canonicalize().ok());
    Ok(RecordIn::File(folder.zip(whole.file_name()).map_or(whole.clone(), |(folder, name)| folder.join(name))))
}

fn ask(socket: &Path, wish: &Wish) -> Result<Reply, Fault> {
    let named = |error: std::io::Error| Fault::file(socket, error);
    let mut stream = UnixStream::connect(socket).map_err(|error| match error.kind() {
        ErrorKind::NotFound | ErrorKind::ConnectionRefused => Fault::NoService { socket: socket.to_owned() },
        _ => named(error),
    })?;
    stream.set_read_timeout(Some(PATIENCE)).map_err(named)?;
    stream.set_write_timeout(Some(PATIENCE)).map_err(named)?;
    let line = serde_json::to_string(wish).map_err(Fault::stage)? + "\n";
    // A line that is too long is answered before it is read whole.
    let written = stream.write_all(line.as_bytes());
    let mut answer = Vec::new();
    let read = BufReader::new(stream).take(MOST_BYTES as u64).read_until(b'\n', &mut answer);
    if answer.is_empty() {
        written.and(read.map(drop)).map_err(named)?;
    }
    serde_json::from_slice(&answer).map_err(|error| Fault::file(socket, error))
}

fn outcome(reply: &Reply) -> Outcome {
    let Reply { answer, state, phase, epoch, cycle_id, verdict, recording, reasons } = reply;
    let json = json!({
        "verdict": verdict, "reasons": reasons, "answer": answer, "state": state, "phase": phase, "epoch": epoch,
        "cycle_id": cycle_id, "recording": recording,
    });
    let mut outcome =
        Outcome { exit: answer.code(), json: json.as_object().cloned().unwrap_or_else(Map::new), words: vec![] };
    if let Some(state) = state {
        let phase = phase.as_ref().map_or(String::new(), |phase| format!(", {phase}"));
        outcome.say(format!("state: {state}{phase}"));
    }
    if let Some(cycle) = cycle_id {
        let verdict = verdict.map_or(String::new(), |verdict| format!(": {}", verdict.word()));
        outcome.say(format!("cycle {cycle}{verdict}"));
    }
    if let Some(recorded) = recording {
        outcome.say(&recorded.message);
    }
    for reason in reasons {
        outcome.say(format!("  {} ({})", reason.message, reason.code));
    }
    outcome
}
