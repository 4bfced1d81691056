//! `panelprep store`: checks that everything in the store is as written, and lists the records that the office must
//! have.

use super::args::{Common, RenewStore, StoreCommand, StoreTask, VerifyStore};
use super::fault::Fault;
use super::load::CellFiles;
use super::outcome::Outcome;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_store::office::ListEntry;
use panelprep_store::store::{Store, StoreVerification};
use serde_json::json;
use std::path::PathBuf;

/// Runs the requested task.
///
/// # Errors
/// If the cell's file has problems, or there is no store to read.
pub fn run(args: &StoreCommand, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        StoreTask::Verify(args) => verify(args, common),
        StoreTask::List => list(common),
        StoreTask::Renew(args) => renew(args, common),
    }
}

/// Returns the store's folder. A copy in another folder, `--store`, needs no cell's file.
fn folder(common: &Common) -> Result<PathBuf, Fault> {
    match &common.store {
        Some(folder) => Ok(folder.clone()),
        None => Ok(CellFiles::read(common)?.store_folder().to_owned()),
    }
}

fn renew(args: &RenewStore, common: &Common) -> Result<Outcome, Fault> {
    let folder = folder(common)?;
    // A store must not be created in a mistyped folder.
    drop(Store::open(&folder).map_err(Fault::stage)?);
    Store::renew_outbox(&folder, &args.why).map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Pass, reasons: vec![] });
    outcome.add_line("records from now on belong to a new epoch");
    Ok(outcome)
}

fn list(common: &Common) -> Result<Outcome, Fault> {
    let listed = Store::open(&folder(common)?).and_then(|store| store.outbox_list()).map_err(Fault::stage)?;
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Pass, reasons: vec![] });
    outcome.lines.clear();
    for ListEntry { position, kind, hash } in &listed {
        outcome.add_line(format!("{} {:>7} {:<12} {hash}", position.epoch, position.number, kind.keyword()));
    }
    outcome.add_line(format!("{} in all", listed.len()));
    outcome.add_value("records", json!(listed));
    Ok(outcome)
}

fn verify(args: &VerifyStore, common: &Common) -> Result<Outcome, Fault> {
    let folder = folder(common)?;
    let verified = Store::verify(&folder, !args.rows_only).map_err(Fault::stage)?;
    let StoreVerification {
        differences: found,
        earlier_differences: known,
        links,
        files,
        pruned,
        signatures,
        keys,
    } = verified;
    let reason = |words: &String| Reason::new("store_changed", words.clone());
    let verdict = if found.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons: found.iter().map(reason).collect() });
    outcome.add_line(format!("{}: {links} links of the hash chain were checked", folder.display()));
    if args.rows_only {
        outcome.add_line("files were not read");
    } else {
        outcome
            .add_line(format!("{files} files are undamaged, {pruned} were removed by the rules of [store] keep"));
        let by = if keys.is_empty() { String::new() } else { format!(", by {}", keys.join(" and ")) };
        outcome.add_line(format!("{signatures} signatures of records{by}"));
    }
    known.iter().for_each(|words| outcome.add_line(format!("known difference, cleared by a person: {words}")));
    outcome.add_value("ok", json!(found.is_empty()));
    outcome.add_value("found", json!(found));
    outcome.add_value("known", json!(known));
    outcome.add_value("links", json!(links));
    outcome.add_value("files", json!((!args.rows_only).then_some(files)));
    outcome.add_value("signatures", json!((!args.rows_only).then_some(signatures)));
    outcome.add_value("public_keys", json!((!args.rows_only).then_some(keys)));
    outcome.add_value("pruned", json!((!args.rows_only).then_some(pruned)));
    Ok(outcome)
}
