//! `panelprep store`: verifies that the content of the store is unchanged, and lists the records that the office server
//! must have. `panelprep backup` and `panelprep restore`: write the cell to one archive file, and restore it from the
//! file.

use super::args::{Backup, BackupPart, Common, RenewStore, Restore, StoreCommand, StoreTask, VerifyStore};
use super::disk;
use super::fault::Fault;
use super::output::Outcome;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::record::CycleId;
use panelprep_service::check::check_file;
use panelprep_service::setup::{CellFiles, clock::now_unix_s};
use panelprep_store::backup::{self, BackupError, Configuration, Permission, Plan, RestoredParts, named_files};
use panelprep_store::office::ListEntry;
use panelprep_store::store::{Restore as SinceBackup, Store, StoreVerification};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Runs one task of `panelprep store`.
///
/// # Errors
/// If the cell file has problems, or there is no store to read.
pub fn run(args: &StoreCommand, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        StoreTask::Verify(args) => verify(args, common),
        StoreTask::List => list(common),
        StoreTask::Renew(args) => renew(args, common),
    }
}

/// Returns the folder of the store. A copy in another folder (`--store`) can be used without a cell file.
fn folder(common: &Common) -> Result<PathBuf, Fault> {
    match &common.store {
        Some(folder) => Ok(folder.clone()),
        None => Ok(CellFiles::read(&common.paths())?.store_folder().to_owned()),
    }
}

fn renew(args: &RenewStore, common: &Common) -> Result<Outcome, Fault> {
    let folder = folder(common)?;
    // The existence of the store is checked first, so that no store is created in a mistyped folder.
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

/// Writes a backup of the cell to an archive file.
///
/// # Errors
/// If a file cannot be read, or the archive file already exists or cannot be written.
pub fn back_up(args: &Backup, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let with = |part| args.only.is_none_or(|only| only == part);
    let configuration = match with(BackupPart::Configuration) {
        true => Some(configuration(&files, &common.cell)?),
        false => None,
    };
    let store = with(BackupPart::Store).then(|| files.store_folder());
    let written =
        backup::write(&args.archive, store, configuration.as_ref(), now_unix_s()).map_err(Fault::stage)?;
    let mut outcome = outcome_from_findings(&written.differences, "store_changed");
    let ok = written.differences.is_empty();
    outcome.add_value("file", json!(ok.then_some(&args.archive)));
    outcome.add_value("entries", json!(written.manifest.entries.len()));
    outcome.add_value("bytes", json!(written.bytes));
    outcome.add_value("links", json!(written.manifest.links));
    if !ok {
        outcome.add_line(
            "no backup was made: the store's content was changed or damaged; `panelprep store verify` lists the differences",
        );
        return Ok(outcome);
    }
    outcome.add_line(format!(
        "{}: {} MB, read back and verified",
        args.archive.display(),
        written.bytes.div_ceil(1_000_000)
    ));
    if let Some(links) = written.manifest.links {
        outcome.add_line(format!(
            "the store: {links} links of its hash chain verified; the backup contains neither pages, which are made \
             again from the store, nor recordings"
        ));
    }
    if let Some(configuration) = &configuration {
        let (named, recipes) = (configuration.named_files.len(), configuration.recipes.len());
        outcome.add_line(format!(
            "the configuration: the cell's file, {} named in the cell's file, {}",
            format_count(named, "file"),
            format_count(recipes, "recipe")
        ));
    }
    for (key, file) in named_files(&files.cell).into_iter().filter(|(_, file)| !file.exists()) {
        outcome.add_line(format!("not in the backup: {key} names {}, which does not exist", file.display()));
    }
    Ok(outcome)
}

fn outcome_from_findings(found: &[String], code: &'static str) -> Outcome {
    let verdict = if found.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let reasons = found.iter().map(|words| Reason::new(code, words.clone())).collect();
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons });
    outcome.add_value("ok", json!(found.is_empty()));
    outcome.add_value("found", json!(found));
    outcome
}

fn configuration(files: &CellFiles, cell: &Path) -> Result<Configuration, Fault> {
    let named = named_files(&files.cell).into_iter().filter(|(_, file)| file.exists()).collect();
    let folder = match cell.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut recipes = Vec::new();
    find_recipes(folder, Path::new(""), &mut recipes)?;
    recipes.sort();
    Ok(Configuration { cell: disk::read_text(cell)?, named_files: named, recipes })
}

/// Number of folder levels below the folder of the cell file in which recipes are searched.
const RECIPE_SEARCH_DEPTH: usize = 2;

/// Finds the recipes in a folder and its subfolders; a file is recognised by its content.
fn find_recipes(folder: &Path, below: &Path, found: &mut Vec<(String, PathBuf)>) -> Result<(), Fault> {
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    for entry in entries.map_err(|error| Fault::file_fault(folder, error))? {
        let (path, relative) = (entry.path(), below.join(entry.file_name()));
        let Some(name) = relative.to_str() else { continue };
        let is_hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
        let kind = entry.file_type().map_err(|error| Fault::file_fault(&path, error))?;
        if is_hidden {
            continue;
        }
        if kind.is_dir() && relative.components().count() <= RECIPE_SEARCH_DEPTH {
            find_recipes(&path, &relative, found)?;
        } else if kind.is_file() && name.ends_with(".toml") {
            let is_recipe = |text: String| check_file(name, &text).kind == Some("recipe");
            if disk::read_text(&path).is_ok_and(is_recipe) {
                found.push((name.to_owned(), path));
            }
        }
    }
    Ok(())
}

/// Returns a count with its noun, for example "1 file" or "2 files".
fn format_count(count: usize, word: &str) -> String {
    if count == 1 { format!("1 {word}") } else { format!("{count} {word}s") }
}

/// Returns a text that states whether parts may have been sanded between the backup and the restore.
fn describe_time_since_backup(since: &SinceBackup) -> String {
    let abraded = if since.is_nothing_abraded {
        "nothing was sanded since the backup: the last cycle in the replaced store is the one that --last-cycle states"
    } else {
        "parts may have been sanded since the backup: each part needs a statement at its first start \
         (`--lost-passes NUMBER`, or `--another-part` for a part without a serial number)"
    };
    format!("new cycles get numbers above {}; {abraded}", since.last_cycle)
}

/// Restores a backup from an archive file.
///
/// # Errors
/// If a part already exists or is in use, or writing to the disk fails. A damaged archive file is an outcome, not an
/// error.
pub fn restore(args: &Restore, common: &Common) -> Result<Outcome, Fault> {
    let with = |part| args.only.is_none_or(|only| only == part);
    let plan = Plan {
        archive: &args.archive,
        cell: &common.cell,
        store: common.store.as_deref(),
        parts: RestoredParts { store: with(BackupPart::Store), configuration: with(BackupPart::Configuration) },
        permission: Permission {
            replace_store: args.replace.contains(&BackupPart::Store),
            replace_configuration: args.replace.contains(&BackupPart::Configuration),
            outside: args.outside,
        },
        last_cycle: args.last_cycle.map(CycleId),
    };
    let restored = match backup::restore(&plan) {
        Ok(restored) => restored,
        Err(error @ BackupError::Damaged { .. }) => {
            let mut outcome = outcome_from_findings(&[error.to_string()], "backup_damaged");
            outcome.add_line("nothing was changed; restore another backup");
            return Ok(outcome);
        }
        Err(error) => return Err(Fault::stage(error)),
    };
    let mut outcome = outcome_from_findings(&restored.differences, "backup_damaged");
    outcome.add_value("store", json!(restored.store));
    outcome.add_value("configuration", json!(restored.configuration));
    outcome.add_value("kept", json!(restored.replaced_files));
    outcome.add_value("links", json!(restored.links));
    if !restored.differences.is_empty() {
        outcome.add_line("nothing was changed; restore another backup");
        return Ok(outcome);
    }
    if let Some(store) = &restored.store {
        outcome.add_line(format!(
            "the store {}: {} links of its hash chain and {} verified",
            store.display(),
            restored.links,
            format_count(restored.files as usize, "file")
        ));
    }
    if let Some(since) = &restored.since_backup {
        outcome.add_value("nothing_abraded", json!(since.is_nothing_abraded));
        outcome.add_line(describe_time_since_backup(since));
    }
    restored.configuration.iter().for_each(|file| outcome.add_line(format!("written: {}", file.display())));
    restored
        .replaced_files
        .iter()
        .for_each(|file| outcome.add_line(format!("the replaced content was moved to {}", file.display())));
    outcome.add_line("verify the cameras (`panelprep calibrate verify`) before the next cycle: the calibrations are those of the backup");
    Ok(outcome)
}
