//! `panelprep archive`: the office's side of the records.

use super::args::{Archive, ArchiveTask, CheckArchive, RunArchive};
use super::disk;
use super::fault::Fault;
use super::outcome::Outcome;
use crate::archive::{self, ArchiveError, CellList, CheckedCell};
use crate::cell::CellName;
use crate::office::{ArchiveSettings, Listed};
use crate::store::Store;
use crate::verdict::{Judgement, Reason, Verdict};
use serde::Deserialize;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::path::Path;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;

/// Does what is asked.
///
/// # Errors
/// Where the settings have problems, or the archive cannot be used.
pub fn run(args: &Archive) -> Result<Outcome, Fault> {
    match &args.what {
        ArchiveTask::Run(args) => serve(args),
        ArchiveTask::Check(args) => check(args),
    }
}

fn settings(file: &Path) -> Result<ArchiveSettings, Fault> {
    let text = disk::read_text(file)?;
    ArchiveSettings::check(&file.display().to_string(), &text).map_err(Fault::stage)
}

fn runtime() -> Result<Runtime, Fault> {
    Builder::new_current_thread().enable_io().enable_time().build().map_err(Fault::stage)
}

fn serve(args: &RunArchive) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let mut signals = Signals::new([SIGTERM, SIGINT]).map_err(Fault::stage)?;
    let (tell, told) = oneshot::channel();
    let wait = move || {
        if signals.forever().next().is_some() && tell.send(()).is_err() {
            tracing::debug!("the archive had ended by itself");
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(wait).map_err(Fault::stage)?;
    let ended = async { drop(told.await) };
    runtime()?.block_on(archive::run(&settings, ended)).map_err(Fault::stage)?;
    let mut outcome = Outcome::of(&Judgement { verdict: Verdict::Pass, reasons: vec![] });
    outcome.words = vec!["the archive has ended".to_owned()];
    Ok(outcome)
}

fn check(args: &CheckArchive) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let lists = args.cells.iter().map(|named| list(named)).collect::<Result<Vec<CellList>, Fault>>()?;
    let checked = runtime()?.block_on(archive::check(&settings, &lists)).map_err(Fault::stage)?;
    let reason = |cell: &str, words: &String| Reason::new("archive_differs", format!("cell {cell}: {words}"));
    let reasons = checked.iter().flat_map(|one| one.found.iter().map(|words| reason(&one.cell, words)));
    let reasons: Vec<Reason> = reasons.collect();
    let verdict = if reasons.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::of(&Judgement { verdict, reasons });
    if checked.is_empty() {
        outcome.say("the archive has no records yet");
    }
    for one in &checked {
        outcome.say(words(one));
        outcome.say(format!(
            "  signed by {}",
            if one.keys.is_empty() { "nobody".to_owned() } else { one.keys.join(" and ") }
        ));
    }
    let cells = checked.iter().map(|one| {
        let CheckedCell { cell, records, signatures, files, gone, same, keys, found } = one;
        json!({ "cell": cell, "records": records, "signatures": signatures, "files": files, "gone": gone, "same": same,
            "public_keys": keys, "found": found })
    });
    outcome.put("cells", cells.collect());
    Ok(outcome)
}

fn words(one: &CheckedCell) -> String {
    let CheckedCell { cell, records, signatures, files, gone, same, .. } = one;
    let same =
        same.map_or("not compared with the cell".to_owned(), |same| format!("{same} are the same in the cell"));
    let gone = if *gone > 0 { format!(", {gone} the cell no longer had") } else { String::new() };
    format!("cell {cell}: {records} records, {same}; {signatures} signatures hold; {files} files are whole{gone}")
}

/// A cell's list, from its store or from the file that `store list --json` wrote.
fn list(named: &str) -> Result<CellList, Fault> {
    #[derive(Deserialize)]
    struct Written {
        records: Vec<Listed>,
    }
    let unfit = |problem: String| Fault::stage(ArchiveError::Unfit { path: named.into(), problem });
    let Some((name, place)) = named.split_once('=') else {
        return Err(unfit(
            "allowed is the cell's name, = and its store's folder or the file of its list".to_owned(),
        ));
    };
    let cell = CellName::new(name).map_err(unfit)?;
    let place = Path::new(place);
    let listed = if place.is_dir() {
        Store::open(place).and_then(|store| store.outbox_list()).map_err(Fault::stage)?
    } else {
        let text = disk::read_text(place)?;
        let written: Written = serde_json::from_str(&text)
            .map_err(|error| unfit(format!("it is no list of `panelprep store list --json`: {error}")))?;
        written.records
    };
    Ok(CellList { cell, listed })
}
