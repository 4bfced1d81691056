//! `panelprep ctl`: questions to the service, and its answers.

use super::args::{Common, Ctl, CtlAsk};
use super::asking::{ask, insist, outcome};
use super::disk;
use super::fault::Fault;
use super::follow;
use super::load::CellFiles;
use super::outcome::Outcome;
use super::part;
use crate::cycle::Request;
use crate::daemon::{Exit, RecordIn, StartRequest, What};
use std::path::Path;

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

fn what(ask: &CtlAsk) -> Result<What, Fault> {
    Ok(match ask {
        CtlAsk::Start { recipe, record, part, .. } => What::Start(StartRequest {
            recipe: recipe.display().to_string(),
            text: disk::read_text(recipe)?,
            record: record.as_ref().map(|file| record_in(file.as_deref())).transpose()?,
            part: part::checked(part.names())?,
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

/// The service stands in a folder of its own, so a file goes to it by its whole path.
fn record_in(file: Option<&Path>) -> Result<RecordIn, Fault> {
    let Some(file) = file else { return Ok(RecordIn::Store) };
    let whole = std::path::absolute(file).map_err(|error| Fault::file(file, error))?;
    // Without .. and links, as far as the folder is there; where it is not, the service says so.
    let folder = whole.parent().and_then(|folder| folder.canonicalize().ok());
    Ok(RecordIn::File(folder.zip(whole.file_name()).map_or(whole.clone(), |(folder, name)| folder.join(name))))
}
