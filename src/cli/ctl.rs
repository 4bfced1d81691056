//! `panelprep ctl`: sends requests to the service, prints its replies, and follows the service with `watch`, `reset
//! --wait` and `start --wait`. These commands request the state several times a second, so that they do not occupy a
//! connection of the socket.
//!
//! `panelprep clear`: clears an abort in a cell that runs without a service. It sends the same request to the state
//! table as `panelprep ctl clear` sends to a service, and exits when the cell is at rest again. So the same conditions
//! apply: the robot responds and is at standstill, and feedbacks confirm that tool and water are off.

use super::args::{Common, Ctl, CtlAsk, CtlStart, Decision};
use super::disk;
use super::fault::Fault;
use super::identify;
use super::live::robot_alone;
use super::output::{Outcome, read_answer_line, write_progress};
use panelprep_base::supervision::{Supervisor, ThreadFault};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{self, At, Robot, State};
use panelprep_devices::cameras::Scanner as _;
use panelprep_service::daemon::{
    self, ClientError, Computing, LinkedTool, LoopEvent, LoopPorts, LoopStart, NoCameras, RemoteScanner, Reply,
    Request, RequestKind, RequestResult, Requester, StoreRecord, current_user, send_to_service,
};
use panelprep_service::setup::{
    self, CellFiles, CellSetup, ProposalLimits, RecipeText, RecipeTextPermission, RecordIn, StartRequest,
};
use panelprep_store::tape::LoopMemoryStart;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Maximum time for which a hold or an abort is repeated if the service is too busy to accept it.
const RETRY_TIMEOUT: Duration = Duration::from_secs(5);

const RETRY_INTERVAL: Duration = Duration::from_millis(20);

/// Repeats a request for a stop while the service, or the connection to it, is too busy to accept the request.
fn send_stop_with_retries(socket: &Path, what: &RequestKind) -> Result<Reply, ClientError> {
    let since = Instant::now();
    loop {
        let answered = send_to_service(socket, what);
        let is_busy = match &answered {
            Ok(reply) => reply.reasons.iter().any(|reason| reason.code == "busy"),
            Err(ClientError::NoService { .. }) => false,
            Err(_) => true,
        };
        if !is_busy || since.elapsed() >= RETRY_TIMEOUT {
            return answered;
        }
        thread::sleep(RETRY_INTERVAL);
    }
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

/// Converts a reply of the service to the outcome of the command.
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

/// Returns a text with state and phase, and with the progress in this phase.
fn describe_progress(reply: &Reply) -> String {
    let Reply { state, phase, pass, film_s, waypoint, of, .. } = reply;
    let mut parts: Vec<String> = state.iter().chain(phase).cloned().collect();
    parts.extend(pass.filter(|pass| *pass > 0 && phase.is_some()).map(|pass| format!("pass {pass}")));
    parts.extend(film_s.map(|seconds| format!("{seconds:.0} s of film")));
    parts.extend(waypoint.zip(*of).map(|(waypoint, of)| format!("waypoint {waypoint} of {of}")));
    parts.join(", ")
}

/// Sends the request and reports the answer.
///
/// # Errors
/// If a file is invalid, or no service responds.
pub fn run(args: &Ctl, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let socket = files.socket();
    match &args.ask {
        CtlAsk::Watch => return print_changes(&socket, common.json),
        CtlAsk::Start(start) => return start_cycle(start, &files, &socket),
        _ => {}
    }
    let what = to_request(&args.ask, &socket)?;
    let reply = match what {
        RequestKind::Table(cycle::Request::Stop | cycle::Request::Abort) => send_stop_with_retries(&socket, &what)?,
        _ => send_to_service(&socket, &what)?,
    };
    match args.ask {
        CtlAsk::Reset { wait: true } if reply.answer == RequestResult::Done => wait_for_idle(&socket),
        _ => Ok(outcome(&reply)),
    }
}

/// Starts a cycle with the recipe that is named, or with the one of the panel in the cell.
fn start_cycle(args: &CtlStart, files: &CellFiles, socket: &Path) -> Result<Outcome, Fault> {
    let part = setup::parse_part_names(args.part.names())?;
    let recipe = match &args.recipe {
        Some(file) => RecipeText { name: file.display().to_string(), text: disk::read_text(file)? },
        None => match confirm_proposal(args, files, socket)? {
            Ok(recipe) => recipe,
            Err(not_started) => return Ok(not_started),
        },
    };
    let request = RequestKind::Start(StartRequest {
        recipe: recipe.name,
        text: recipe.text,
        record: args.record.as_ref().map(|file| record_in(file.as_deref())).transpose()?,
        part,
        another_part: args.count.another_part,
        lost_passes: args.count.lost_passes,
        is_stated_clear: false,
        own_text: RecipeTextPermission::default(),
    });
    let reply = send_to_service(socket, &request)?;
    match args.wait && reply.answer == RequestResult::Done {
        true => wait_for_end(socket, &reply),
        false => Ok(outcome(&reply)),
    }
}

/// Proposes the recipe of the panel in the cell. Returns it if a person types the panel's name, else what is reported
/// instead of a start.
fn confirm_proposal(
    args: &CtlStart,
    files: &CellFiles,
    socket: &Path,
) -> Result<Result<RecipeText, Outcome>, Fault> {
    // If there is no service, this error names its socket.
    send_to_service(socket, &RequestKind::State)?;
    let shot = RemoteScanner::new(socket.to_owned()).capture_3d().map_err(Fault::stage)?;
    let limits = ProposalLimits { serial: args.part.serial.as_deref(), ..ProposalLimits::default() };
    let proposal = setup::propose(files, shot.cloud, &limits)?;
    let mut proposed = identify::report(&proposal);
    let reasons = match proposal.startable() {
        Err(reasons) => reasons,
        Ok((panel, recipe)) => {
            proposed.lines.iter().for_each(|line| write_progress(line));
            write_progress(&format!(
                "Type the panel's name, {panel}, to start a cycle with {}; any other input starts nothing:",
                recipe.name
            ));
            if read_answer_line()?.is_some_and(|answer| answer == panel) {
                return Ok(Ok(recipe.clone()));
            }
            vec![]
        }
    };
    proposed.add_line("nothing was started; name the recipe with --recipe to start a cycle");
    proposed.lines.extend(reasons.iter().map(|reason| format!("  {} ({})", reason.message, reason.code)));
    proposed.add_value("reasons", json!(reasons));
    proposed.exit_code = RequestResult::Refused.code();
    Ok(Err(proposed))
}

fn to_request(ask: &CtlAsk, socket: &Path) -> Result<RequestKind, Fault> {
    Ok(match ask {
        CtlAsk::Hold => RequestKind::Table(cycle::Request::Hold),
        CtlAsk::Unhold { dried, decision } => {
            decision_request(socket, cycle::Request::Unhold { dried: *dried }, *decision)?
        }
        CtlAsk::Stop => RequestKind::Table(cycle::Request::Stop),
        CtlAsk::Abort => RequestKind::Table(cycle::Request::Abort),
        CtlAsk::Clear { decision } => decision_request(socket, cycle::Request::Clear, *decision)?,
        CtlAsk::Reset { .. } => RequestKind::Table(cycle::Request::Reset),
        CtlAsk::Accept { decision } => decision_request(socket, cycle::Request::Accept, *decision)?,
        CtlAsk::NewDisc => RequestKind::NewDisc,
        CtlAsk::State | CtlAsk::Watch | CtlAsk::Start(_) => RequestKind::State,
    })
}

/// Returns the request for a decision at the given step. If the command line states no step, the current state is
/// printed and the person types its step.
fn decision_request(socket: &Path, request: cycle::Request, decision: Decision) -> Result<RequestKind, Fault> {
    if let Some(step) = decision.step {
        return Ok(RequestKind::Decided { request, step });
    }
    let command = daemon::command(request);
    let no_step = || Fault::NoStep { command };
    let now = send_to_service(socket, &RequestKind::State)?;
    let step = now.step.ok_or_else(no_step)?;
    outcome(&now).lines.iter().for_each(|line| write_progress(line));
    write_progress(&format!("Type the step number, {step}, to {command}; any other input changes nothing:"));
    let mut answer = String::new();
    match std::io::stdin().read_line(&mut answer) {
        Ok(_) if answer.trim() == step.to_string() => Ok(RequestKind::Decided { request, step }),
        _ => Err(no_step()),
    }
}

/// Returns the file of the recording with its full path, because the service has another working folder.
fn record_in(file: Option<&Path>) -> Result<RecordIn, Fault> {
    let Some(file) = file else { return Ok(RecordIn::Store) };
    let whole = std::path::absolute(file).map_err(|error| Fault::file_fault(file, error))?;
    // `..` and links are resolved if the folder exists. If it does not exist, the service reports this.
    let folder = whole.parent().and_then(|folder| folder.canonicalize().ok());
    Ok(RecordIn::File(folder.zip(whole.file_name()).map_or(whole.clone(), |(folder, name)| folder.join(name))))
}

/// Interval between two requests for the state.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Time without a reply after which the service is treated as stopped; a service that restarts does not reply for a
/// moment.
const SERVICE_TIMEOUT: Duration = Duration::from_secs(5);

/// Time limit for a reset; it includes the warm-up of the cameras, which may take minutes.
const RESET_TIMEOUT: Duration = Duration::from_secs(600);

/// Prints each change, until the output is closed or the service has stopped.
///
/// # Errors
/// If no service responds.
fn print_changes(socket: &Path, as_json: bool) -> Result<Outcome, Fault> {
    let mut last_line = None;
    loop {
        let reply = state(socket)?;
        let line = if as_json { Value::Object(watched_fields(&reply)).to_string() } else { describe_reply(&reply) };
        if last_line.as_ref() != Some(&line) && writeln!(std::io::stdout(), "{line}").is_err() {
            return Ok(Outcome { exit_code: 0, json: object(&reply), lines: vec![] });
        }
        last_line = Some(line);
        thread::sleep(POLL_INTERVAL);
    }
}

/// Waits for the end of the cycle that was just started, prints each change on standard error, and returns the cycle's
/// verdict.
///
/// # Errors
/// If the service does not respond any more.
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
            return Ok(Outcome { exit_code: exit, ..outcome(&reply) });
        }
        thread::sleep(POLL_INTERVAL);
    }
}

/// Waits for the end of the reset that was just started; the exit code is 3 if the cell does not become idle.
///
/// # Errors
/// If the service does not respond any more.
fn wait_for_idle(socket: &Path) -> Result<Outcome, Fault> {
    let since = Instant::now();
    loop {
        let reply = state(socket)?;
        let is_at = |word: &str| reply.state.as_deref() == Some(word);
        if is_at("resetting") && since.elapsed() < RESET_TIMEOUT {
            thread::sleep(POLL_INTERVAL);
            continue;
        }
        let exit = if is_at("idle") { RequestResult::Done } else { RequestResult::Fault };
        let mut outcome = Outcome { exit_code: exit.code(), ..outcome(&reply) };
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

/// Returns whether the page of the cycle is written; this happens after the end of the cycle.
fn is_page_written(reply: &Reply) -> bool {
    reply.page.is_some()
}

fn state(socket: &Path) -> Result<Reply, ClientError> {
    let since = Instant::now();
    loop {
        match send_to_service(socket, &RequestKind::State) {
            Ok(reply) if reply.state.is_some() => return Ok(reply),
            Ok(reply) if since.elapsed() >= SERVICE_TIMEOUT => return Ok(reply),
            Err(fault) if since.elapsed() >= SERVICE_TIMEOUT => return Err(fault),
            Ok(_) | Err(_) => thread::sleep(POLL_INTERVAL),
        }
    }
}

/// Returns the fields of a reply whose changes are reported: all except the number of requests to the service.
fn watched_fields(reply: &Reply) -> serde_json::Map<String, Value> {
    let mut object = object(reply);
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
    format!("{}{cycle}{panel}{page}{reasons}", describe_progress(reply))
}

/// Time without a message from the robot after which it is treated as not connected.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);

/// Confirms that the cause of the last abort is removed.
///
/// # Errors
/// If a file is invalid, there is no store, a service uses the store, or the store cannot be written.
pub fn clear(common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let cell = Arc::new(CellSetup::new(&files.cell)?);
    // If no store exists, there is nothing to clear, and no store is created.
    drop(files.store()?);
    let mut store = files.store_for_writing()?;
    let recovered = store.recover().map_err(Fault::stage)?;
    if !matches!(recovered.at, At::Aborted { .. }) {
        let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
        outcome.add_line("the last cycle in this store was not aborted; nothing to clear");
        outcome.add_value("state", recovered.at.keyword().into());
        return Ok(outcome);
    }
    let state = store.state().map_err(Fault::stage)?;
    let (mut robot, _simulated) = robot_alone(&files.cell)?;
    let supervisor = Supervisor::default();
    supervisor.add_thread(robot.supervision_handle());
    let lock_step = robot.is_lock_step();
    let mut record = StoreRecord::new(&mut store, None);
    let mut clears = ClearRequester::new(supervisor);
    let ports = LoopPorts {
        robot: &mut robot,
        tool: &mut LinkedTool::default(),
        record: &mut record,
        requests: &mut clears,
        computing: Computing::inline(Box::new(NoCameras), lock_step),
        lock_step,
    };
    let start = LoopStart { cell, cycle: None, state, before: LoopMemoryStart::Boot };
    let ended = daemon::run(start, ports).map_err(Fault::from_loop_error)?.state;
    Ok(clear_outcome(&ended, clears.refusal))
}

fn clear_outcome(ended: &State, refused: Option<Reason>) -> Outcome {
    let at = ended.at;
    let is_clear = at == At::Stopped;
    let reasons = if is_clear { vec![] } else { refused.into_iter().chain(daemon::state_reason(ended)).collect() };
    let verdict = if is_clear { Verdict::Accept } else { Verdict::Aborted };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons });
    outcome.add_value("state", at.keyword().into());
    outcome.lines[0] = match is_clear {
        true => "cleared: the robot is stopped, tool and water are off; the next cycle may start".to_owned(),
        false => format!("not cleared, the cell is {}", at.keyword()),
    };
    outcome
}

/// Requests a clear when the robot has responded, and ends the loop when the cell is at rest afterwards.
struct ClearRequester {
    supervisor: Supervisor,
    started: Instant,
    is_requested: bool,
    refusal: Option<Reason>,
    /// The last state that the loop reported.
    state: State,
}

impl ClearRequester {
    fn new(supervisor: Supervisor) -> Self {
        ClearRequester {
            supervisor,
            started: Instant::now(),
            is_requested: false,
            refusal: None,
            state: State::INITIAL,
        }
    }
}

impl Requester for ClearRequester {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        self.state = *state;
        self.supervisor.check_threads()?;
        let is_there = !matches!(state.facts.robot, Robot::Unknown | Robot::LinkLost);
        let what = match (state.at, self.is_requested) {
            (at, true) if at.is_at_rest() => Some(RequestKind::Leave),
            (At::Aborted { .. }, false) if is_there || self.started.elapsed() >= CONNECT_TIMEOUT => {
                self.is_requested = true;
                Some(RequestKind::Table(cycle::Request::Clear))
            }
            _ => None,
        };
        Ok(what.map(|what| Request::new(what, current_user())))
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        self.refusal = news.refusal_reason(&self.state).or(self.refusal.take());
    }
}
