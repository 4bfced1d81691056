//! `panelprep store verify`: is everything in the store what was written?

use super::args::{Common, StoreCommand, StoreTask, VerifyStore};
use super::fault::Fault;
use super::load::CellFiles;
use super::outcome::Outcome;
use crate::store::{Store, Verified};
use crate::verdict::{Judgement, Reason, Verdict};
use serde_json::json;

/// Does what is asked.
///
/// # Errors
/// Where the cell's file has problems, or there is no store to read.
pub fn run(args: &StoreCommand, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        StoreTask::Verify(args) => verify(args, common),
    }
}

/// A copy somewhere else, `--store`, needs no cell.
fn verify(args: &VerifyStore, common: &Common) -> Result<Outcome, Fault> {
    let folder = match &common.store {
        Some(folder) => folder.clone(),
        None => CellFiles::read(common)?.store_folder().to_owned(),
    };
    let verified = Store::verify(&folder, !args.rows_only).map_err(Fault::stage)?;
    let Verified { found, known, links, files, pruned, signatures, keys } = verified;
    let reason = |words: &String| Reason::new("store_changed", words.clone());
    let verdict = if found.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::of(&Judgement { verdict, reasons: found.iter().map(reason).collect() });
    outcome.say(format!("{}: {links} links of the chain", folder.display()));
    if args.rows_only {
        outcome.say("files were not read");
    } else {
        outcome.say(format!("{files} files are whole, {pruned} were removed as [store] keep says"));
        let by = if keys.is_empty() { String::new() } else { format!(", by {}", keys.join(" and ")) };
        outcome.say(format!("{signatures} signatures of records{by}"));
    }
    known.iter().for_each(|words| outcome.say(format!("known, and cleared by a person: {words}")));
    outcome.put("ok", json!(found.is_empty()));
    outcome.put("found", json!(found));
    outcome.put("known", json!(known));
    outcome.put("links", json!(links));
    outcome.put("files", json!((!args.rows_only).then_some(files)));
    outcome.put("signatures", json!((!args.rows_only).then_some(signatures)));
    outcome.put("public_keys", json!((!args.rows_only).then_some(keys)));
    outcome.put("pruned", json!((!args.rows_only).then_some(pruned)));
    Ok(outcome)
}
