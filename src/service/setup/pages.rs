//! What a cycle leaves: its page from the data in the store, written to a file and made again if it is missing; and its
//! signed record with the cell's key, the signatures of the cell and of people, and the page as PDF.
//!
//! The page has a section about how long the cycle's clips and scans are kept. The page to read and sign has data in
//! addition to the cycle's record, read from the store and from the files that the cycle used.

use super::cell_files::CellFiles;
use super::clock::now_unix_s;
use super::fault::SetupFault;
use super::recording::{self, RecordingResult, recording_file};
use super::{disk, part};
use crate::report::cycle_page;
use crate::report::page::{Figure, Page, Row, Section};
use crate::report::record_pdf::{
    AttachedFile, EarlierCycle, Equipment, LastVerification, PrintedSignature, RecordSheet, RecordSources,
    html as sheet_html, pdf,
};
use panelprep_base::number_text::{distinguishable_texts, utc_day, utc_text};
use panelprep_base::verdict::Verdict;
use panelprep_cell::accounts::{AuditEntry, RECIPE_CHANGE};
use panelprep_cell::cell::{Date, Retention, RetentionTime};
use panelprep_cell::files::content_hash;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{CycleId, CycleRecord, KeptFile, RecordingFile, name};
use panelprep_store::signing::{CellKey, Meaning, SignedPage, Statement, cycle_stem};
use panelprep_store::store::{
    self, KeyLocation, PassesOfCycle, PersonSigningRequest, PrunedFiles, SignatureRow, Store, calibration_hash,
};
use panelprep_store::tape;
use panelprep_vision::calib::health::{self, TOOL_FORCE, Verification};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The stored data of a cycle, with its pictures by their hash.
pub struct StoredCycle {
    /// The record.
    pub record: CycleRecord,
    /// Data that was removed from the cycle.
    pub pruned: Option<PrunedFiles>,
    pictures: BTreeMap<String, Vec<u8>>,
    /// The section about the part, if it was named.
    part: Option<Section>,
    /// The page to read and sign.
    sheet: RecordSheet,
}

impl StoredCycle {
    /// Reads a cycle back. A missing or damaged picture is left out; the page reports this.
    ///
    /// # Errors
    /// If there is no such cycle, or it cannot be read back.
    pub fn read(store: &Store, cycle: CycleId) -> Result<Self, SetupFault> {
        let record = store.cycle(cycle).map_err(SetupFault::stage)?;
        let shown = record.findings.iter().flat_map(|finding| &finding.pictures);
        let pictures = shown.filter_map(|picture| Some((picture.hash.clone(), store.blob(&picture.hash).ok()?)));
        let pictures = pictures.collect();
        let pruned = store.pruned_files(cycle).map_err(SetupFault::stage)?;
        let part = part::section(store, &record);
        let sheet = read_sheet(store, &record)?;
        Ok(StoredCycle { record, pruned, pictures, part, sheet })
    }

    /// Writes the page into its store, with the result of the recording and how long clips and scans are kept.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write(
        &self,
        keep: &Retention,
        file: &Path,
        recorded: Option<&RecordingResult>,
    ) -> Result<(), SetupFault> {
        self.write_with(file, recorded, retention_section(keep, &self.record, self.pruned).into_iter().collect())
    }

    /// Writes the page, with `more` and the result of the recording at its end.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write_with(
        &self,
        file: &Path,
        recorded: Option<&RecordingResult>,
        more: Vec<Section>,
    ) -> Result<(), SetupFault> {
        disk::write_durable(file, self.html(recorded, more))
    }

    /// Returns the page as HTML. `more` and the result of the cycle's recording are at its end.
    pub fn html(&self, recorded: Option<&RecordingResult>, more: Vec<Section>) -> String {
        let page = cycle_page(&self.record, &self.pictures);
        let recorded = recorded.map(recording::section);
        let first = sheet_html(&self.sheet);
        let sections = self.part.iter().cloned().chain(page.sections).chain(more).chain(recorded).collect();
        Page { first, sections, made: describe_page_version(), ..page }.html()
    }

    /// Returns the pictures that the store has, in order, each only once.
    pub fn stored_figures(&self) -> impl Iterator<Item = Figure> + '_ {
        let mut shown = BTreeSet::new();
        let all = self.record.findings.iter().flat_map(|finding| &finding.pictures);
        let all = all.filter(move |picture| shown.insert(picture.hash.clone()));
        all.filter_map(|picture| {
            Some(Figure { caption: picture.caption.clone(), jpeg: self.pictures.get(&picture.hash)?.clone() })
        })
    }

    /// Describes the pictures that the page shows and that are missing or damaged in the store.
    pub fn describe_missing_figures(&self) -> impl Iterator<Item = String> + '_ {
        let shown = self.record.findings.iter().flat_map(|finding| &finding.pictures);
        let missing = shown.filter(|picture| !self.pictures.contains_key(&picture.hash));
        missing
            .map(|picture| format!("the picture {} (SHA-256 {}) is missing or damaged", picture.name, picture.hash))
    }

    /// Writes the pictures into a folder, numbered in order; those of an earlier cycle in the folder are removed.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write_pictures(&self, folder: &Path) -> Result<(), SetupFault> {
        remove_numbered(folder).map_err(|error| SetupFault::file_fault(folder, error))?;
        let named = self.record.findings.iter().flat_map(|finding| {
            finding.pictures.iter().map(|picture| {
                let pass = if finding.pass > 0 { format!("_pass{}", finding.pass) } else { String::new() };
                (format!("{}{pass}", picture.name), &picture.hash)
            })
        });
        for (index, (name, hash)) in named.enumerate() {
            if let Some(jpeg) = self.pictures.get(hash) {
                disk::write(&folder.join(format!("{:02}_{name}.jpg", index + 1)), jpeg)?;
            }
        }
        Ok(())
    }
}

/// Removes the pictures that [`StoredCycle::write_pictures`] wrote, `01_….jpg`, and nothing else.
fn remove_numbered(folder: &Path) -> Result<(), std::io::Error> {
    if !folder.is_dir() {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder)? {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        let name = name.to_string_lossy();
        let number = name.split_once('_').filter(|_| name.ends_with(".jpg")).map(|(number, _)| number);
        if number.is_some_and(|number| number.len() == 2 && number.bytes().all(|digit| digit.is_ascii_digit())) {
            std::fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// Returns a text that states when and by which version a page was made: the only line in which two pages of the same
/// cycle differ.
fn describe_page_version() -> String {
    let made = utc_text(now_unix_s());
    format!("This page was made on {made} by panelprep {} from the store.", env!("CARGO_PKG_VERSION"))
}

/// Returns the state of a cycle's recording, read from its file; `None` if the cycle was not recorded.
pub fn recording_status(store: &Path, record: &CycleRecord) -> Option<RecordingResult> {
    let file = match record.recording.as_ref()? {
        RecordingFile::InStore => recording_file(store, record.id),
        RecordingFile::Named(file) => PathBuf::from(file),
    };
    let name = file.display().to_string();
    let checked = panelprep_base::disk::open(&file).map_err(|error| error.to_string());
    let checked =
        checked.and_then(|out| tape::check_recording(BufReader::new(out)).map_err(|error| error.to_string()));
    Some(match checked {
        Ok(checked) => RecordingResult::complete_recording(name, checked.entries),
        Err(why) => RecordingResult::incomplete_recording(name, &why),
    })
}

/// Makes the pages of finished cycles that have none or only an incomplete one, because the program or the power
/// ended between a verdict and its page. Each is reported through `made`; one that cannot be made does not prevent
/// the others.
///
/// # Errors
/// If the store cannot be read.
pub fn make_missing_pages(
    files: &CellFiles,
    made: &dyn Fn(CycleId, Result<PathBuf, SetupFault>),
) -> Result<(), SetupFault> {
    let store = files.store()?;
    for cycle in store.ended_cycles().map_err(SetupFault::stage)? {
        let page = page_file(files.store_folder(), cycle);
        if !is_page_complete(&page) {
            let kept = StoredCycle::read(&store, cycle);
            let recorded = |kept: &StoredCycle| recording_status(files.store_folder(), &kept.record);
            let written = kept.and_then(|kept| kept.write(files.cell.retention(), &page, recorded(&kept).as_ref()));
            made(cycle, written.map(|()| page));
        }
    }
    Ok(())
}

/// Returns whether a page is complete to its last line.
fn is_page_complete(page: &Path) -> bool {
    let end = || -> std::io::Result<Vec<u8>> {
        let mut file = panelprep_base::disk::open(page)?;
        let from = file.metadata()?.len().saturating_sub(PAGE_END.len() as u64);
        file.seek(SeekFrom::Start(from))?;
        let mut end = Vec::new();
        file.read_to_end(&mut end)?;
        Ok(end)
    };
    end().is_ok_and(|end| end == PAGE_END)
}

/// The last line of a page.
const PAGE_END: &[u8] = b"</html>\n";

/// Returns the page of a cycle; for a cycle in progress, as it is so far.
///
/// # Errors
/// If there is no such cycle, or it cannot be read back.
pub fn cycle_html(files: &CellFiles, cycle: CycleId) -> Result<String, SetupFault> {
    // An existing page also contains the result of the recording. The rest of an incomplete page would be missing.
    let written = disk::read_text(&page_file(files.store_folder(), cycle));
    if let Some(text) = written.ok().filter(|text| text.as_bytes().ends_with(PAGE_END)) {
        return Ok(text);
    }
    Ok(StoredCycle::read(&files.store()?, cycle)?.html(None, vec![]))
}

/// Returns the path of a cycle's page in its store.
pub fn page_file(store: &Path, cycle: CycleId) -> PathBuf {
    store.join("reports").join(format!("cycle-{:06}.html", cycle.0))
}

/// Returns the section; `None` if everything is kept for ever.
fn retention_section(keep: &Retention, record: &CycleRecord, pruned: Option<PrunedFiles>) -> Option<Section> {
    if keep.is_unlimited() && pruned.is_none() {
        return None;
    }
    let verdict = record.judgement.as_ref().map(|judgement| judgement.verdict);
    let (of, which) = match verdict {
        Some(Verdict::Pass | Verdict::Accept) => (keep.passed, "passed"),
        _ => (keep.failed, "did not pass"),
    };
    let kept = match verdict {
        None | Some(Verdict::Review) => "for ever: a person has not yet decided about the result".to_owned(),
        _ => describe_retention(of, which),
    };
    let mut rows = vec![Row::new("page and record", "for ever", ""), Row::new("clips and scans", kept, "")];
    if let Some(pruned) = pruned {
        let day = pruned.at_unix_s.map_or(String::new(), |at| format!(" on {}", Date::from_unix_s(at)));
        let removed = format!("{} files, {} MB, removed{day}", pruned.files, pruned.bytes / 1_000_000);
        rows.push(Row::new("clips and scans of this cycle", removed, ""));
    }
    let text = "How long the data of this cycle is kept, by [store] keep in the cell's file. The store's hash chain still \
                lists removed files."
        .to_owned();
    Some(Section { heading: "Kept".to_owned(), text, rows, figures: vec![] })
}

fn describe_retention(of: RetentionTime, which: &str) -> String {
    let days = of.days.map(|days| format!("{days} days before the newest cycle"));
    let cycles = of.cycles.map(|cycles| format!("while the cycle is among the newest {cycles} that {which}"));
    let limits: Vec<String> = days.into_iter().chain(cycles).collect();
    if limits.is_empty() { "for ever".to_owned() } else { limits.join(", and ") }
}

/// The key of each of the cell's files, its name in words, and the verification by which it is judged.
const EQUIPMENT: [(&str, &str, Option<&str>); 7] = [
    ("scanner", "scanner, lens", Some("scanner")),
    ("base_from_camera", "scanner, mount", Some("scanner")),
    ("flange_camera", "flange camera, lens", Some("flange_camera")),
    ("flange_from_camera", "flange camera, mount", Some("flange_camera")),
    ("flange_from_tool", "tool", Some("tool")),
    ("robot_correction", "robot, correction", None),
    ("removal", "removal, coupons", None),
];

/// Reads the page of a cycle.
///
/// # Errors
/// If the store cannot be read.
fn read_sheet(store: &Store, record: &CycleRecord) -> Result<RecordSheet, SetupFault> {
    let part = store.stored_part(record);
    let recipe_text = text(store, &record.recipe_hash);
    let recipe = recipe_text.and_then(|text| Recipe::check("recipe.toml", &text).ok());
    let earlier = match part.as_ref().and_then(|part| part.serial.as_ref()) {
        Some(serial) => Some(store.sanding_passes_by_serial(serial, Some(record.id)).map_err(SetupFault::stage)?),
        None => None,
    };
    let earlier: Option<Vec<EarlierCycle>> = earlier.map(|all| all.iter().map(earlier_cycle).collect());
    let approval = recipe_approval(store, record)?;
    let equipment = collect_equipment(store, record, recipe.as_ref())?;
    let signatures = signatures(store, record)?;
    Ok(RecordSheet::from_sources(&RecordSources {
        record,
        part: part.as_ref(),
        recipe: recipe.as_ref(),
        recipe_approval: approval.as_deref(),
        equipment: &equipment,
        earlier: earlier.as_deref(),
        signatures: &signatures,
    }))
}

/// Returns the page with its annex as PDF/A-3, with the signed record inside.
///
/// # Errors
/// If the store no longer has the signed record complete, or the PDF cannot be written.
fn sheet_document(store: &Store, kept: &StoredCycle, row: &SignatureRow) -> Result<Vec<u8>, SetupFault> {
    let stem = cycle_stem(kept.record.id);
    let bytes = store.blob(&row.record_hash).map_err(SetupFault::stage)?;
    Statement::read(&bytes).map_err(SetupFault::stage)?;
    let attached = [
        AttachedFile {
            name: format!("{stem}.json"),
            description: "The signed record: canonical JSON (RFC 8785)".to_owned(),
            mime_type: "application/json",
            bytes,
        },
        AttachedFile {
            name: format!("{stem}.sig"),
            description: "The cell's ed25519 signature of the record".to_owned(),
            mime_type: "application/octet-stream",
            bytes: row.signature.clone(),
        },
    ];
    let figures: Vec<Figure> = kept.stored_figures().collect();
    pdf(&kept.sheet, &figures, &attached, row.unix_ms.div_euclid(1_000)).map_err(SetupFault::stage)
}

fn text(store: &Store, hash: &str) -> Option<String> {
    String::from_utf8(store.blob(hash).ok()?).ok()
}

fn earlier_cycle(PassesOfCycle { cycle, started_unix_s, passes, .. }: &PassesOfCycle) -> EarlierCycle {
    EarlierCycle { cycle: cycle.0, started_unix_s: *started_unix_s, passes: *passes }
}

/// Returns who approved the recipe's text last before the cycle, and on which day; `None` if the audit trail of this
/// store has no such approval.
fn recipe_approval(store: &Store, record: &CycleRecord) -> Result<Option<String>, SetupFault> {
    let changes = store.audit_of_subjects(RECIPE_CHANGE, "").map_err(SetupFault::stage)?;
    let is_this = |entry: &AuditEntry| {
        let is_before = entry.unix_ms.div_euclid(1_000) <= record.started_unix_s;
        is_before && entry.after.as_ref().is_some_and(|text| content_hash(text.as_bytes()) == record.recipe_hash)
    };
    let approved = changes.into_iter().map(|line| line.entry).find(is_this);
    Ok(approved.map(|entry| {
        let who = entry.who.as_deref().unwrap_or("a person who is not named");
        format!("approved by {who}, {}", utc_day(entry.unix_ms.div_euclid(1_000)))
    }))
}

fn collect_equipment(
    store: &Store,
    record: &CycleRecord,
    recipe: Option<&Recipe>,
) -> Result<Vec<Equipment>, SetupFault> {
    let mut all = Vec::new();
    // If the recipe requests no removal, the cycle did not use the removal model that was measured on coupons.
    let is_used = |name: &str| name != "removal" || recipe.is_none_or(|recipe| recipe.removal().is_some());
    for (name, what, subject) in EQUIPMENT.into_iter().filter(|(name, ..)| is_used(name)) {
        let Some(KeptFile { hash, .. }) = record.files.iter().find(|file| file.name == name) else { continue };
        let read = text(store, hash).and_then(|text| text.parse::<toml::Table>().ok()).unwrap_or_default();
        let last = match subject {
            Some(subject) => verification_before(store, record, subject)?,
            None => None,
        };
        let used = subject.and_then(|subject| calibration_in_use(store, record, subject));
        let verified = last.filter(|last| used.as_ref() == Some(&last.calibration_hash));
        all.push(Equipment {
            what: what.to_owned(),
            serial: find_value(&read, "serial"),
            calibrated: find_value(&read, "date"),
            hash: hash.clone(),
            verified: verified.as_ref().map(describe_verification),
        });
    }
    all.extend(force(store, record)?);
    Ok(all)
}

/// Returns the hash by which verifications of this subject refer to the calibrations that the cycle used; `None` if the
/// store no longer has one of them.
fn calibration_in_use(store: &Store, record: &CycleRecord, subject: &str) -> Option<String> {
    let own = EQUIPMENT.into_iter().filter(|(.., of)| *of == Some(subject)).map(|(name, ..)| name);
    // Only the fixed camera is verified without the robot.
    let arm = (subject != "scanner").then_some("robot_correction");
    let hash = |name| Some(&record.files.iter().find(|file| file.name == name)?.hash);
    let texts: Option<Vec<String>> = own.chain(arm).filter_map(hash).map(|hash| text(store, hash)).collect();
    Some(calibration_hash(&texts?.iter().map(String::as_str).collect::<Vec<_>>()))
}

/// Returns the force of a compliant tool, if the cycle used one: it has no file, but its payload and zero are verified.
fn force(store: &Store, record: &CycleRecord) -> Result<Option<Equipment>, SetupFault> {
    let mut findings = record.findings.iter().filter(|finding| finding.number(name::FORCE_MEAN).is_some());
    let Some(one) = findings.next().and(verification_before(store, record, TOOL_FORCE)?) else { return Ok(None) };
    Ok(Some(Equipment {
        what: "tool, force".to_owned(),
        serial: None,
        calibrated: None,
        hash: one.calibration_hash.clone(),
        verified: Some(describe_verification(&one)),
    }))
}

/// Returns a value of a calibration file, in any of its tables.
fn find_value(read: &toml::Table, key: &str) -> Option<String> {
    let tables = std::iter::once(read).chain(read.values().filter_map(toml::Value::as_table));
    tables.filter_map(|table| table.get(key)).find_map(|value| match value {
        toml::Value::String(text) => Some(text.clone()),
        toml::Value::Datetime(day) => Some(day.to_string()),
        _ => None,
    })
}

/// Returns the last verification before the cycle that was not struck out.
fn verification_before(
    store: &Store,
    record: &CycleRecord,
    subject: &str,
) -> Result<Option<Verification>, SetupFault> {
    let all = store.verifications(subject).map_err(SetupFault::stage)?;
    Ok(all.into_iter().rev().find(|one| one.struck.is_none() && one.at_unix_s <= record.started_unix_s))
}

fn describe_verification(one: &Verification) -> LastVerification {
    let unit = health::unit(&one.subject);
    let [error, limit] = distinguishable_texts(one.error, one.limit, 2);
    LastVerification { day: utc_day(one.at_unix_s), error: format!("{error} {unit} (limit {limit} {unit})") }
}

fn signatures(store: &Store, record: &CycleRecord) -> Result<Vec<PrintedSignature>, SetupFault> {
    let persons = store.person_signatures(record.id).map_err(SetupFault::stage)?;
    let mut persons = persons.into_iter();
    let mut all = Vec::new();
    for row in store.cycle_signatures(record.id).map_err(SetupFault::stage)? {
        let person = if row.is_of_person { persons.next() } else { None };
        let hash = row.record_hash.get(..16).unwrap_or_default();
        let key = row.public_key.get(..16).unwrap_or_default();
        let person = person.map(|(_, person)| person);
        let values = person.as_ref().map(|one| one.values.clone()).unwrap_or_default();
        all.push(PrintedSignature {
            name: person.as_ref().map_or("the cell".to_owned(), |one| format!("{} ({})", one.name, one.user)),
            time: utc_text(row.unix_ms.div_euclid(1_000)),
            meaning: person.as_ref().map_or("confirms that the cycle took place as recorded".to_owned(), |one| {
                let remark = one.remark.as_ref().map(|remark| format!(": {remark}")).unwrap_or_default();
                format!("{}{remark}", one.meaning.printed_text())
            }),
            chain_position: format!("number {}, SHA-256 {hash}…, key {key}…", row.number),
            is_deciding: person.as_ref().is_some_and(|one| {
                let decides =
                    [Meaning::InspectedAndReleased, Meaning::InspectedAndNotReleased, Meaning::ReleaseWithdrawn];
                decides.contains(&one.meaning)
            }),
            values,
        });
    }
    Ok(all)
}

/// The name under which systemd provides the cell's key, with `LoadCredential=`.
const CREDENTIAL: &str = "panelprep-record-key";

/// A cycle's page as PDF, with the part that the cell signs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordPdf {
    /// The PDF.
    pub pdf: Vec<u8>,
    /// The signed page, which contains the SHA-256 of the PDF.
    pub page: Vec<u8>,
    /// The signature of the signed page.
    pub signature: Vec<u8>,
}

/// Returns the key with which this cell signs: the file that the cell's file names, else a credential, else one in the
/// store.
///
/// # Errors
/// If it cannot be read or made.
pub fn key(files: &CellFiles) -> Result<CellKey, SetupFault> {
    let credential = std::env::var_os("CREDENTIALS_DIRECTORY").map(|folder| PathBuf::from(folder).join(CREDENTIAL));
    let place = match (files.cell.record_key(), credential.filter(|file| file.exists())) {
        (Some(file), _) => KeyLocation::File(file.to_owned()),
        (None, Some(file)) => KeyLocation::Provided(file),
        (None, None) => KeyLocation::InStore,
    };
    store::cell_key(files.store_folder(), &place).map_err(SetupFault::stage)
}

/// Signs every finished cycle that is unsigned, and reports each as text; a warning is reported as such.
///
/// # Errors
/// If the key or the store cannot be used.
pub fn sign_missing(files: &CellFiles, report: &dyn Fn(Result<String, String>)) -> Result<(), SetupFault> {
    let key = key(files)?;
    let each = |cycle, signed: Result<&SignatureRow, store::StoreError>| match signed {
        Ok(row) => report(Ok(format!(
            "the record of cycle {cycle} was signed: record number {}, SHA-256 {}",
            row.number, row.record_hash
        ))),
        Err(error) => report(Err(format!("the record of cycle {cycle} could not be signed: {error}"))),
    };
    Store::sign_missing(files.store_folder(), &key, &each).map_err(SetupFault::stage)
}

/// Signs the record of a cycle as this person and makes the cycle's page again, which then shows the signature. This
/// is for interfaces that have already identified the person.
///
/// # Errors
/// If the cycle is not over, the person has already signed with this meaning, or the store or the page cannot be
/// written.
pub fn sign_by_person(files: &CellFiles, signs: &PersonSigningRequest) -> Result<SignatureRow, SetupFault> {
    let row = Store::sign_by_person(files.store_folder(), &key(files)?, signs).map_err(SetupFault::stage)?;
    let page = page_file(files.store_folder(), signs.cycle);
    let kept = StoredCycle::read(&files.store()?, signs.cycle)?;
    kept.write(files.cell.retention(), &page, recording_status(files.store_folder(), &kept.record).as_ref())?;
    Ok(row)
}

/// Returns the signed record of a cycle with its page as PDF/A-3; `None` if the cycle is not signed yet.
///
/// # Errors
/// As [`signed_pdf`], and if the key or the store cannot be read.
pub fn cycle_pdf(files: &CellFiles, cycle: CycleId) -> Result<Option<RecordPdf>, SetupFault> {
    let (store, key) = (files.store()?, key(files)?);
    let rows = store.cycle_signatures(cycle).map_err(SetupFault::stage)?;
    signed_pdf(&store, &key, &rows)
}

/// Makes the page of a cycle as PDF, with all signatures of that cycle and what the cell signs for it. `None` if
/// the cell has not signed the cycle.
///
/// # Errors
/// If the store no longer has the signed record complete, or the PDF cannot be written.
pub fn signed_pdf(store: &Store, key: &CellKey, rows: &[SignatureRow]) -> Result<Option<RecordPdf>, SetupFault> {
    let (Some(row), Some(last)) = (rows.iter().find(|row| !row.is_of_person), rows.last()) else { return Ok(None) };
    let kept = StoredCycle::read(store, row.cycle)?;
    let pdf = sheet_document(store, &kept, row)?;
    let shows = (row.cycle, row.record_hash.as_str(), last.number);
    let (page, signature) = SignedPage::sign(&pdf, shows, last.unix_ms, key).map_err(SetupFault::stage)?;
    Ok(Some(RecordPdf { pdf, page, signature }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::testing::write_cell;
    use panelprep_store::store::CycleStart;

    /// The verification of an earlier calibration is no evidence for the one that the cycle used.
    #[test]
    fn equipment_is_verified_only_by_its_own_calibration() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::create(&folder.path().join("store")).expect("a store");
        let file_texts = [("flange_from_tool", "tool"), ("robot_correction", "arm")];
        let cycle = store.begin_cycle(&CycleStart {
            panel: "door".to_owned(),
            taught_version: "1".to_owned(),
            recipe_text: String::new(),
            file_texts: file_texts.map(|(name, text)| (name.to_owned(), text.to_owned())).into(),
            recording: None,
            is_air_run: false,
        });
        let record = store.cycle(cycle.expect("begun")).expect("stored");
        let mut tool_after = |texts: &[&str]| {
            let verification = Verification {
                subject: "tool".to_owned(),
                error: 0.1,
                limit: 0.5,
                calibration_hash: calibration_hash(texts),
                at_unix_s: 0,
                struck: None,
            };
            store.store_verification(&verification).expect("kept");
            let all = collect_equipment(&store, &record, None).expect("read");
            all.into_iter().find(|one| one.what == "tool").expect("in use").verified
        };
        assert!(tool_after(&["earlier tool", "arm"]).is_none());
        assert!(tool_after(&["tool"]).is_none(), "another correction of the arm");
        assert!(tool_after(&["tool", "arm"]).is_some());
    }

    /// A page that was not written to its end is made from the store, which this cell does not have.
    #[test]
    fn an_incomplete_page_is_not_shown() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = write_cell(folder.path(), "", &[]);
        let page = page_file(files.store_folder(), CycleId(7));
        let shown = |text: &str| {
            disk::write(&page, text).expect("written");
            cycle_html(&files, CycleId(7))
        };
        assert_eq!(shown("<html>a</html>\n").expect("complete"), "<html>a</html>\n");
        assert!(shown("<html>a</ht").is_err());
    }
}
