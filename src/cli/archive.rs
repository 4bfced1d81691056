//! `panelprep archive` and `panelprep fleet`: the archive and the web page of the office server.

use super::args::{Archive, ArchiveAccount, ArchiveTask, CheckArchive, Fleet, OfferRecipe, RunArchive};
use super::fault::Fault;
use super::output::Outcome;
use super::{disk, user};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::accounts::Role;
use panelprep_cell::cell::CellName;
use panelprep_cell::recipe::Recipe;
use panelprep_interfaces::archive::reading::{OfficeAccount, Reader};
use panelprep_interfaces::archive::{self, CellList, CheckedCell};
use panelprep_service::daemon::{FleetAddress, serve_fleet};
use panelprep_service::setup::clock::now_unix_s;
use panelprep_store::office::{ArchiveSettings, ListEntry, RecipeOffer};
use panelprep_store::store::Store;
use serde::Deserialize;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::path::Path;
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::oneshot;

/// Runs one task of `panelprep archive`.
///
/// # Errors
/// If the settings file has problems, or the archive cannot be used.
pub fn run(args: &Archive) -> Result<Outcome, Fault> {
    match &args.what {
        ArchiveTask::Run(args) => serve(args),
        ArchiveTask::Check(args) => run_check(args),
        ArchiveTask::Account(args) => account(args),
        ArchiveTask::Offer(args) => run_offer(args),
    }
}

fn settings(file: &Path) -> Result<ArchiveSettings, Fault> {
    let text = disk::read_text(file)?;
    ArchiveSettings::check(&file.display().to_string(), &text).map_err(Fault::stage)
}

/// Maximum time for which the program waits at exit for host name lookups in progress.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(1);

/// Runs this future to its end on a new async runtime.
fn run_to_end<T, E: std::error::Error + Send + Sync + 'static>(
    doing: impl Future<Output = Result<T, E>>,
) -> Result<T, Fault> {
    let runtime = Builder::new_current_thread().enable_io().enable_time().build().map_err(Fault::stage)?;
    let done = runtime.block_on(doing).map_err(Fault::stage);
    runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
    done
}

fn serve(args: &RunArchive) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let ended = shutdown_signal()?;
    run_to_end(archive::run(&settings, ended))?;
    Ok(message_outcome("the archive has stopped"))
}

/// Serves the web page of the office server.
///
/// # Errors
/// If the settings file has problems, or the address of the page is not available.
pub fn run_fleet(args: &Fleet) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let ended = shutdown_signal()?;
    let on_listening = |address: &FleetAddress| {
        tracing::info!("web page of the office server: {}", address.url);
        if let Some(fingerprint) = &address.fingerprint {
            tracing::info!("SHA-256 of the page's self-signed certificate: {fingerprint}");
        }
    };
    run_to_end(serve_fleet(&settings, on_listening, ended))?;
    Ok(message_outcome("the web page of the office server has stopped"))
}

fn account(args: &ArchiveAccount) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let printed_name = args.printed_name.clone().unwrap_or_else(|| args.name.clone());
    let account =
        user::check_account((&args.name, &printed_name), Role::Viewer, &user::read_new_password(&args.name)?)?;
    let account = OfficeAccount { name: account.name, printed_name, password_hash: account.password_hash };
    run_to_end(Reader::new(&settings).store_account(&account))?;
    Ok(message_outcome(&format!("account {}: may view the web page of the office server", account.name)))
}

fn run_offer(args: &OfferRecipe) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let text = disk::read_text(&args.recipe)?;
    let recipe = Recipe::check(&args.recipe.display().to_string(), &text).map_err(Fault::stage)?;
    let who = (args.by.as_str(), args.why.as_str());
    let offer = RecipeOffer::new(recipe.panel(), &text, who, now_unix_s() * 1_000);
    let offer = offer.map_err(|error| Fault::file_fault(&args.recipe, error))?;
    run_to_end(archive::publish_offer(&settings, &offer))?;
    Ok(message_outcome(&format!(
        "the recipe with SHA-256 {} for panel {} is offered to every cell that has run this panel",
        offer.hash(),
        offer.panel
    )))
}

fn message_outcome(words: &str) -> Outcome {
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Pass, reasons: vec![] });
    outcome.lines = vec![words.to_owned()];
    outcome
}

fn shutdown_signal() -> Result<impl Future<Output = ()>, Fault> {
    let mut signals = Signals::new([SIGTERM, SIGINT]).map_err(Fault::stage)?;
    let (tell, told) = oneshot::channel();
    let wait = move || {
        if signals.forever().next().is_some() && tell.send(()).is_err() {
            tracing::debug!("signal ignored: the command has already ended");
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(wait).map_err(Fault::stage)?;
    Ok(async { drop(told.await) })
}

fn run_check(args: &CheckArchive) -> Result<Outcome, Fault> {
    let settings = settings(&args.settings)?;
    let lists = args.cells.iter().map(|named| list(named)).collect::<Result<Vec<CellList>, Fault>>()?;
    let checked = run_to_end(archive::check_archive(&settings, &lists))?;
    let reason = |cell: &str, words: &String| Reason::new("archive_differs", format!("cell {cell}: {words}"));
    let reasons = checked.iter().flat_map(|one| one.problems.iter().map(|words| reason(&one.cell, words)));
    let reasons: Vec<Reason> = reasons.collect();
    let verdict = if reasons.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons });
    if checked.is_empty() {
        outcome.add_line("the archive has no records yet");
    }
    for one in &checked {
        outcome.add_line(describe_cell(one));
        outcome.add_line(format!(
            "  signed by {}",
            if one.keys.is_empty() { "no key".to_owned() } else { one.keys.join(" and ") }
        ));
    }
    let cells = checked.iter().map(|one| {
        let CheckedCell { cell, records, signatures, files, missing_in_cell: gone, matching: same, keys, problems: found } = one;
        json!({ "cell": cell, "records": records, "signatures": signatures, "files": files, "gone": gone, "same": same,
            "public_keys": keys, "found": found })
    });
    outcome.add_value("cells", cells.collect());
    Ok(outcome)
}

fn describe_cell(one: &CheckedCell) -> String {
    let CheckedCell { cell, records, signatures, files, missing_in_cell: gone, matching: same, .. } = one;
    let same = same
        .map_or("not compared with the cell".to_owned(), |same| format!("{same} identical to those of the cell"));
    let gone = if *gone > 0 { format!(", {gone} files no longer exist in the cell") } else { String::new() };
    format!("cell {cell}: {records} records, {same}; {signatures} signatures valid; {files} files undamaged{gone}")
}

/// Reads a cell's list of records, from its store or from the file that `store list --json` wrote.
fn list(named: &str) -> Result<CellList, Fault> {
    #[derive(Deserialize)]
    struct WrittenAccount {
        records: Vec<ListEntry>,
    }
    let unfit = |problem: String| Fault::file_fault(Path::new(named), problem);
    let Some((name, place)) = named.split_once('=') else {
        return Err(unfit(
            "valid: CELL=STORE_OR_LIST, the cell's name and the folder of its store or the file of its list"
                .to_owned(),
        ));
    };
    let cell = CellName::new(name).map_err(unfit)?;
    if place.is_empty() {
        return Err(unfit(
            "the text after = is missing; name the folder of the cell's store or the file of its list".to_owned(),
        ));
    }
    let place = Path::new(place);
    let listed = if place.is_dir() {
        Store::open(place).and_then(|store| store.outbox_list()).map_err(Fault::stage)?
    } else {
        let text = disk::read_text(place)?;
        let written: WrittenAccount = serde_json::from_str(&text).map_err(|error| {
            unfit(format!("the file is not a list from `panelprep store list --json`: {error}"))
        })?;
        written.records
    };
    Ok(CellList { cell, entries: listed })
}
