//! `panelprep record`: signs and exports records, verifies them with only the public key, and exports the head of their
//! hash chain.

use super::args::{
    Common, ExportRecord, HeadOfRecords, MeaningName, RecordCommand, RecordTask, SignRecord, VerifyRecord,
};
use super::disk;
use super::fault::{Fault, RecordFault};
use super::output::Outcome;
use panelprep_base::number_text::utc_text;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::CycleId;
use panelprep_service::daemon::current_user;
use panelprep_service::setup::{CellFiles, RecordPdf, key, sign_by_person, sign_missing, signed_pdf};
use panelprep_store::signing::{
    self, CellKey, ExportContent, Meaning, NameClaim, PublicKey, Signed, StatedValues, Statement, StatementContent,
};
use panelprep_store::store::{self, PersonSigningRequest, SignatureRow, Store};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const HEAD_FILE_NAME: &str = "head.json";
const PUBLIC_KEY_FILE_NAME: &str = "public-key.pem";
const FILES_FOLDER_NAME: &str = "files";

/// Runs one task of `panelprep record`.
///
/// # Errors
/// If a file cannot be read or written, or the store has no cycle with this number.
pub fn run(args: &RecordCommand, common: &Common) -> Result<Outcome, Fault> {
    match &args.what {
        RecordTask::Sign(args) => sign(args, common),
        RecordTask::Export(args) => export(args, common),
        RecordTask::Verify(args) => verify(args, common),
        RecordTask::Head(args) => head(args, common),
    }
}

fn sign(args: &SignRecord, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let who = current_user();
    let user = who.user.or(who.uid.map(|uid| format!("user {uid}"))).unwrap_or_else(|| "not known".to_owned());
    let meaning = match args.meaning {
        MeaningName::Released => Meaning::InspectedAndReleased,
        MeaningName::NotReleased => Meaning::InspectedAndNotReleased,
        MeaningName::Reviewed => Meaning::Reviewed,
        MeaningName::DeviationAccepted => Meaning::DeviationAccepted,
        MeaningName::ReleaseWithdrawn => Meaning::ReleaseWithdrawn,
    };
    let SignRecord { name, remark, water, lamp, ambient, abrasive, .. } = args.clone();
    let values = StatedValues { water, lamp, ambient, abrasive };
    // The existence of the store is checked first, so that no store is created in a mistyped folder.
    drop(files.store()?);
    let cycle = CycleId(args.cycle);
    let row = sign_by_person(&files, &PersonSigningRequest { cycle, name, user, meaning, remark, values })?;
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines = vec![format!(
        "cycle {}: {} by {}, as record number {}",
        args.cycle,
        meaning.printed_text(),
        args.name,
        row.number
    )];
    outcome.add_value("number", json!(row.number));
    outcome.add_value("hash", json!(row.record_hash));
    outcome.add_value("cycle_id", json!(args.cycle));
    Ok(outcome)
}

fn export(args: &ExportRecord, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let store = files.store()?;
    let cycles = match args.all {
        true => store.ended_cycles().map_err(Fault::stage)?,
        false => args.cycles.iter().map(|cycle| CycleId(*cycle)).collect(),
    };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines.clear();
    let key = key(&files)?;
    // All cycles are checked before anything is written: each must exist and have ended.
    let all = cycles.into_iter().map(|cycle| Ok((cycle, signed_rows(&files, &store, cycle)?)));
    let all = all.collect::<Result<Vec<_>, Fault>>()?;
    let mut written = Vec::new();
    for (cycle, rows) in all {
        if let Some(RecordPdf { pdf, page, signature }) = signed_pdf(&store, &key, &rows)? {
            let stem = signing::page_stem(cycle);
            let names = [signing::pdf_name(cycle), format!("{stem}.json"), format!("{stem}.sig")];
            for (name, bytes) in names.into_iter().zip([pdf, page, signature]) {
                let file = args.out.join(name);
                disk::write(&file, bytes)?;
                written.push(file);
            }
        }
        for row in rows {
            written.extend(export_row(&store, &row, &args.out)?);
        }
        outcome.add_line(format!(
            "cycle {cycle}: {}",
            args.out.join(format!("{}.json", signing::cycle_stem(cycle))).display()
        ));
    }
    written.push(args.out.join(PUBLIC_KEY_FILE_NAME));
    let keys = store_public_keys(files.store_folder())?;
    let pem = keys.iter().map(PublicKey::to_pem).collect::<Result<String, _>>().map_err(Fault::stage)?;
    disk::write(&args.out.join(PUBLIC_KEY_FILE_NAME), pem)?;
    written.extend(write_head(&store, &key, &args.out.join(HEAD_FILE_NAME))?.1);
    outcome.add_line(format!(
        "public key {}: {}",
        key.public_key().hex(),
        args.out.join(PUBLIC_KEY_FILE_NAME).display()
    ));
    outcome.add_value("files", json!(written));
    outcome.add_value("public_key", json!(key.public_key().hex()));
    Ok(outcome)
}

/// Returns the signatures of a cycle; a cycle that is over and not yet signed is signed now.
fn signed_rows(files: &CellFiles, store: &Store, cycle: CycleId) -> Result<Vec<SignatureRow>, Fault> {
    let record = store.cycle(cycle).map_err(Fault::stage)?;
    if record.judgement.is_some() && store.cycle_signatures(cycle).map_err(Fault::stage)?.is_empty() {
        sign_missing(files, &|signed| tracing::info!("{}", signed.unwrap_or_else(|problem| problem)))?;
    }
    let rows = store.cycle_signatures(cycle).map_err(Fault::stage)?;
    match rows.is_empty() {
        true => Err(RecordFault::NotSigned { cycle: cycle.0 }.into()),
        false => Ok(rows),
    }
}

/// Writes a signed statement and its signature; for the statement of a cycle also the files that it names.
fn export_row(store: &Store, row: &SignatureRow, out: &Path) -> Result<Vec<PathBuf>, Fault> {
    let bytes = store.blob(&row.record_hash).map_err(Fault::stage)?;
    let stem = match row.is_of_person {
        false => signing::cycle_stem(row.cycle),
        true => signing::person_signature_stem(row.cycle, row.number),
    };
    let [json, signature] = ["json", "sig"].map(|ending| out.join(format!("{stem}.{ending}")));
    disk::write(&json, &bytes)?;
    disk::write(&signature, &row.signature)?;
    let mut written = vec![json, signature];
    if let StatementContent::Cycle(cycle) = Statement::read(&bytes).map_err(Fault::stage)?.says {
        for (_, hash) in signing::exported_files(&cycle) {
            // A missing or incomplete file is skipped here; `record verify` reports it.
            if let Ok(bytes) = store.blob(&hash) {
                let file = out.join(FILES_FOLDER_NAME).join(&hash);
                disk::write(&file, bytes)?;
                written.push(file);
            }
        }
    }
    Ok(written)
}

fn write_head(store: &Store, key: &CellKey, file: &Path) -> Result<(signing::SignedHead, Vec<PathBuf>), Fault> {
    let (head, bytes, signature) = store.signed_head(key).map_err(Fault::stage)?;
    disk::write(file, bytes)?;
    let beside = file.with_extension("sig");
    disk::write(&beside, signature)?;
    Ok((head, vec![file.to_owned(), beside]))
}

fn head(args: &HeadOfRecords, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(&common.paths())?;
    let (store, key) = (files.store()?, key(&files)?);
    let (head, written) = match &args.out {
        Some(file) => write_head(&store, &key, file)?,
        None => (store.signed_head(&key).map_err(Fault::stage)?.0, vec![]),
    };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict: Verdict::Accept, reasons: vec![] });
    outcome.lines = vec![match head.number {
        0 => "this store contains no signed record".to_owned(),
        number => format!(
            "record number {number}, SHA-256 {}, signed at {}",
            head.hash,
            utc_text(head.unix_ms.div_euclid(1_000))
        ),
    }];
    outcome.add_line(format!("public key {}", head.public_key));
    written.iter().for_each(|file| outcome.add_line(format!("written: {}", file.display())));
    outcome.add_value("number", json!(head.number));
    outcome.add_value("hash", json!(head.hash));
    outcome.add_value("public_key", json!(head.public_key));
    outcome.add_value("files", json!(written));
    Ok(outcome)
}

fn verify(args: &VerifyRecord, common: &Common) -> Result<Outcome, Fault> {
    let keys = match &args.public_key {
        Some(file) => {
            PublicKey::parse_all(&disk::read_text(file)?).map_err(|error| Fault::file_fault(file, error))?
        }
        None => store_public_keys(&store_folder(common)?)
            .map_err(|error| RecordFault::NoPublicKey { problem: error.to_string() })?,
    };
    let mut export = ExportContent::default();
    for path in &args.files {
        read_export(path, &mut export)?;
    }
    let head = args.head.as_deref().map(read_signed).transpose()?;
    if export.statements.is_empty() && head.is_none() {
        return Err(Fault::file_fault(&args.files[0], "contains no signed record: it contains no .json file"));
    }
    let mut verified = signing::verify_export(&export, &keys, head.as_ref());
    if args.all {
        verified.differences.extend(std::mem::take(&mut verified.gaps).into_iter().map(signing::missing_text));
    }
    let remarks: Vec<String> = verified.gaps.iter().copied().map(signing::partial_chain_text).collect();
    let reason = |words: &String| Reason::new("record_changed", words.clone());
    let verdict = if verified.differences.is_empty() { Verdict::Pass } else { Verdict::Fail };
    let mut outcome =
        Outcome::from_judgement(&Judgement { verdict, reasons: verified.differences.iter().map(reason).collect() });
    for (statement, hash) in verified.statements.values() {
        outcome.add_line(describe_statement(statement, hash));
    }
    remarks.iter().for_each(|words| outcome.add_line(words));
    outcome.add_line(match &export.files {
        Some(files) => format!("{} files in the folder files/ next to the records were read", files.len()),
        None => "no folder files/ exists next to the records: pictures and inputs were not checked".to_owned(),
    });
    outcome.add_value("ok", json!(verified.differences.is_empty()));
    outcome.add_value("found", json!(verified.differences));
    outcome.add_value("remarks", json!(remarks));
    outcome.add_value(
        "records",
        json!(
            verified
                .statements
                .iter()
                .map(|(number, (statement, hash))| json!({
                    "number": number, "cycle_id": statement.cycle(), "hash": hash, "unix_ms": statement.unix_ms,
                }))
                .collect::<Vec<_>>()
        ),
    );
    outcome.add_value("files", json!(export.files.as_ref().map(BTreeMap::len)));
    Ok(outcome)
}

/// Returns one line that describes a signed statement.
fn describe_statement(statement: &Statement, hash: &str) -> String {
    let at = utc_text(statement.unix_ms.div_euclid(1_000));
    match &statement.says {
        StatementContent::Cycle(cycle) => {
            format!(
                "record number {}: cycle {}, signed by the cell at {at}, SHA-256 {hash}",
                statement.number, cycle.id
            )
        }
        StatementContent::Person(person) => format!(
            "record number {}: cycle {}, {} by {} ({}) at {at}, SHA-256 {hash}",
            statement.number,
            person.cycle,
            person.meaning.printed_text(),
            person.name,
            person.user
        ),
    }
}

/// Returns the public keys in the store: the current key, and the keys with which earlier records were signed.
fn store_public_keys(store: &Path) -> Result<Vec<PublicKey>, Fault> {
    let mut keys = store::public_keys(store).map_err(Fault::stage)?;
    for row in Store::open(store).map_err(Fault::stage)?.signatures().map_err(Fault::stage)? {
        let key = PublicKey::from_hex(&row.public_key).map_err(Fault::stage)?;
        if !keys.contains(&key) {
            keys.push(key);
        }
    }
    Ok(keys)
}

fn store_folder(common: &Common) -> Result<PathBuf, Fault> {
    match &common.store {
        Some(folder) => Ok(folder.clone()),
        None => CellFiles::read(&common.paths())
            .map(|files| files.store_folder().to_owned())
            .map_err(|error| RecordFault::NoPublicKey { problem: error.to_string() }.into()),
    }
}

/// Reads a record, or all records in a folder, with their files.
fn read_export(path: &Path, export: &mut ExportContent) -> Result<(), Fault> {
    if !path.exists() {
        return Err(Fault::file_fault(path, "does not exist"));
    }
    let is_folder = path.is_dir();
    let folder = if is_folder { path } else { path.parent().unwrap_or(Path::new("")) };
    let named = if is_folder { list_folder(path)? } else { with_verification_files(path) };
    for file in named {
        let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let is_head = is_folder && file.file_stem().is_some_and(|stem| stem == "head");
        // A missing signature of a named record is a finding of the verification, not an error.
        let is_there = is_folder || ending == "json" || file.exists();
        if ["json", "sig"].contains(&ending) && !is_head && is_there {
            export.statements.insert(name, disk::read(&file)?);
        } else if ending == "pdf" {
            export.pdfs.insert(name, content_hash(&disk::read(&file)?));
        }
    }
    let files = folder.join(FILES_FOLDER_NAME);
    if files.is_dir() {
        let all = export.files.get_or_insert_default();
        for file in list_folder(&files)? {
            let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            all.insert(name, content_hash(&disk::read(&file)?));
        }
    }
    Ok(())
}

/// Returns the files that are needed to verify a named file of an export: the record and its signature and, if there is
/// a PDF, the PDF and the signed page.
fn with_verification_files(file: &Path) -> Vec<PathBuf> {
    let (record, pdf) = (file.with_extension("json"), file.with_extension("pdf"));
    let mut all = vec![record.clone(), record.with_extension("sig")];
    if let (Some(stem), true) = (file.file_stem().map(|stem| stem.to_string_lossy().into_owned()), pdf.exists()) {
        let page = file.with_file_name(format!("{stem}-page.json"));
        all.extend([page.clone(), page.with_extension("sig")].into_iter().filter(|file| file.exists()));
        all.push(pdf);
    }
    all
}

fn list_folder(folder: &Path) -> Result<Vec<PathBuf>, Fault> {
    let read = || std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>();
    let mut all = read().map_err(|error| Fault::file_fault(folder, error))?;
    all.sort();
    Ok(all)
}

fn read_signed(file: &Path) -> Result<Signed, Fault> {
    let name = file.display().to_string();
    Ok(Signed {
        name,
        bytes: disk::read(file)?,
        signature: disk::read(&file.with_extension("sig"))?,
        claim: NameClaim::Nothing,
    })
}
