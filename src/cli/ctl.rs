//! `panelprep ctl`: sends requests to the service and shows its replies.

use super::args::{Common, Ctl, CtlAsk, Decision};
use super::disk;
use super::fault::Fault;
use super::follow;
use super::load::CellFiles;
use super::outcome::Outcome;
use super::output::write_progress;
use super::part;
use super::service_request::{outcome, send_stop_with_retries, send_to_service};
use panelprep_cell::cycle::Request;
use panelprep_service::daemon::{self, RecipeTextPermission, RecordIn, RequestKind, RequestResult, StartRequest};
use std::path::Path;

/// Sends the request and reports the answer.
///
/// # Errors
/// If a file is invalid, or no service answers.
pub fn run(args: &Ctl, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let socket = files.socket();
    if matches!(args.ask, CtlAsk::Watch) {
        return follow::print_changes(&socket, common.json);
    }
    let what = to_request(&args.ask, &socket)?;
    let reply = match what {
        RequestKind::Table(Request::Stop | Request::Abort) => send_stop_with_retries(&socket, &what)?,
        _ => send_to_service(&socket, &what)?,
    };
    match args.ask {
        CtlAsk::Start { wait: true, .. } if reply.answer == RequestResult::Done => {
            follow::wait_for_end(&socket, &reply)
        }
        CtlAsk::Reset { wait: true } if reply.answer == RequestResult::Done => follow::to_idle(&socket),
        _ => Ok(outcome(&reply)),
    }
}

fn to_request(ask: &CtlAsk, socket: &Path) -> Result<RequestKind, Fault> {
    Ok(match ask {
        CtlAsk::Start { recipe, record, part, count, .. } => RequestKind::Start(StartRequest {
            recipe: recipe.display().to_string(),
            text: disk::read_text(recipe)?,
            record: record.as_ref().map(|file| record_in(file.as_deref())).transpose()?,
            part: part::parse_part_names(part.names())?,
            another_part: count.another_part,
            lost_passes: count.lost_passes,
            is_stated_clear: false,
            own_text: RecipeTextPermission::default(),
        }),
        CtlAsk::Hold => RequestKind::Table(Request::Hold),
        CtlAsk::Unhold { dried, decision } => {
            decision_request(socket, Request::Unhold { dried: *dried }, *decision)?
        }
        CtlAsk::Stop => RequestKind::Table(Request::Stop),
        CtlAsk::Abort => RequestKind::Table(Request::Abort),
        CtlAsk::Clear { decision } => decision_request(socket, Request::Clear, *decision)?,
        CtlAsk::Reset { .. } => RequestKind::Table(Request::Reset),
        CtlAsk::Accept { decision } => decision_request(socket, Request::Accept, *decision)?,
        CtlAsk::NewDisc => RequestKind::NewDisc,
        CtlAsk::State | CtlAsk::Watch => RequestKind::State,
    })
}

/// Returns a decision on the step that the person names. If no step is named, the step that is shown now is used, and
/// the person types its number.
fn decision_request(socket: &Path, request: Request, decision: Decision) -> Result<RequestKind, Fault> {
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

/// The service has its own working folder, so a file is passed to it by its full path.
fn record_in(file: Option<&Path>) -> Result<RecordIn, Fault> {
    let Some(file) = file else { return Ok(RecordIn::Store) };
    let whole = std::path::absolute(file).map_err(|error| Fault::file_fault(file, error))?;
    // Resolves `..` and links if the folder exists. If it does not, the service reports this.
    let folder = whole.parent().and_then(|folder| folder.canonicalize().ok());
    Ok(RecordIn::File(folder.zip(whole.file_name()).map_or(whole.clone(), |(folder, name)| folder.join(name))))
}
