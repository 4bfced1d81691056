//! A cycle's page from the data in the store: written to a file, and made again by `panelprep page N`; and a
//! description for a terminal of what the cycle did to the panel, which grids it abraded and how much it removed.
//!
//! The page has a section about how long the cycle's clips and scans are kept. The page to read and sign has data in
//! addition to the cycle's record, read from the store and from the files that the cycle used.

use super::args::{Common, PageOf};
use super::fault::Fault;
use super::load::CellFiles;
use super::output::Outcome;
use super::{disk, part, recording};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals, utc_day, utc_text};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::accounts::{AuditEntry, RECIPE_CHANGE};
use panelprep_cell::cell::{Date, Retention, RetentionTime};
use panelprep_cell::files::content_hash;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{self, AbradedGrid, CycleId, CycleRecord, KeptFile, PathRemoval, RecordingFile, name};
use panelprep_service::daemon::{self, RecordingResult};
use panelprep_service::report::cycle_page;
use panelprep_service::report::page::{Figure, Page, Row, Section};
use panelprep_service::report::record_pdf::{
    AttachedFile, EarlierCycle, Equipment, LastVerification, PrintedSignature, RecordSheet, RecordSources,
    html as sheet_html, pdf,
};
use panelprep_store::signing::{Meaning, Statement, cycle_stem};
use panelprep_store::store::{PassesOfCycle, PrunedFiles, SignatureRow, Store};
use panelprep_store::tape;
use panelprep_vision::calib::health::{self, TOOL_FORCE, Verification};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

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
    pub fn read(store: &Store, cycle: CycleId) -> Result<Self, Fault> {
        let record = store.cycle(cycle).map_err(Fault::stage)?;
        let shown = record.findings.iter().flat_map(|finding| &finding.pictures);
        let pictures = shown.filter_map(|picture| Some((picture.hash.clone(), store.blob(&picture.hash).ok()?)));
        let pictures = pictures.collect();
        let pruned = store.pruned_files(cycle).map_err(Fault::stage)?;
        let part = part::section(store, &record);
        let sheet = read_sheet(store, &record)?;
        Ok(StoredCycle { record, pruned, pictures, part, sheet })
    }

    /// Writes the page into its store, with the result of the recording and how long clips and scans are kept.
    ///
    /// # Errors
    /// If writing to the disk fails.
    pub fn write(&self, keep: &Retention, file: &Path, recorded: Option<&RecordingResult>) -> Result<(), Fault> {
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
    ) -> Result<(), Fault> {
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
    pub fn write_pictures(&self, folder: &Path) -> Result<(), Fault> {
        remove_numbered(folder).map_err(|error| Fault::file_fault(folder, error))?;
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
    let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let made = utc_text(i64::try_from(unix_s).unwrap_or_default());
    format!("This page was made on {made} by panelprep {} from the store.", env!("CARGO_PKG_VERSION"))
}

/// Returns the state of a cycle's recording, read from its file; `None` if the cycle was not recorded.
pub fn recording_status(store: &Path, record: &CycleRecord) -> Option<RecordingResult> {
    let file = match record.recording.as_ref()? {
        RecordingFile::InStore => daemon::recording_file(store, record.id),
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
pub fn make_missing_pages(files: &CellFiles, made: &dyn Fn(CycleId, Result<PathBuf, Fault>)) -> Result<(), Fault> {
    let store = files.store()?;
    for cycle in store.ended_cycles().map_err(Fault::stage)? {
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
fn read_sheet(store: &Store, record: &CycleRecord) -> Result<RecordSheet, Fault> {
    let part = store.stored_part(record);
    let recipe_text = text(store, &record.recipe_hash);
    let recipe = recipe_text.and_then(|text| Recipe::check("recipe.toml", &text).ok());
    let earlier = match part.as_ref().and_then(|part| part.serial.as_ref()) {
        Some(serial) => Some(store.sanding_passes_by_serial(serial, Some(record.id)).map_err(Fault::stage)?),
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
pub fn sheet_document(
    store: &Store,
    (record, figures): (&CycleRecord, &[Figure]),
    row: &SignatureRow,
) -> Result<Vec<u8>, Fault> {
    let sheet = read_sheet(store, record)?;
    let stem = cycle_stem(record.id);
    let bytes = store.blob(&row.record_hash).map_err(Fault::stage)?;
    Statement::read(&bytes).map_err(Fault::stage)?;
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
    pdf(&sheet, figures, &attached, row.unix_ms.div_euclid(1_000)).map_err(Fault::stage)
}

fn text(store: &Store, hash: &str) -> Option<String> {
    String::from_utf8(store.blob(hash).ok()?).ok()
}

fn earlier_cycle(PassesOfCycle { cycle, started_unix_s, passes, .. }: &PassesOfCycle) -> EarlierCycle {
    EarlierCycle { cycle: cycle.0, started_unix_s: *started_unix_s, passes: *passes }
}

/// Returns who approved the recipe's text last before the cycle, and on which day; `None` if the audit trail of this
/// store has no such approval.
fn recipe_approval(store: &Store, record: &CycleRecord) -> Result<Option<String>, Fault> {
    let changes = store.audit_of_subjects(RECIPE_CHANGE, "").map_err(Fault::stage)?;
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
) -> Result<Vec<Equipment>, Fault> {
    let mut all = Vec::new();
    // If the recipe requests no removal, the cycle did not use the removal model that was measured on coupons.
    let is_used = |name: &str| name != "removal" || recipe.is_none_or(|recipe| recipe.removal().is_some());
    for (name, what, subject) in EQUIPMENT.into_iter().filter(|(name, ..)| is_used(name)) {
        let Some(KeptFile { hash, .. }) = record.files.iter().find(|file| file.name == name) else { continue };
        let read = text(store, hash).and_then(|text| text.parse::<toml::Table>().ok()).unwrap_or_default();
        let verified = match subject {
            Some(subject) => verification_before(store, record, subject)?.as_ref().map(describe_verification),
            None => None,
        };
        all.push(Equipment {
            what: what.to_owned(),
            serial: find_value(&read, "serial"),
            calibrated: find_value(&read, "date"),
            hash: hash.clone(),
            verified,
        });
    }
    all.extend(force(store, record)?);
    Ok(all)
}

/// Returns the force of a compliant tool, if the cycle used one: it has no file, but its payload and zero are verified.
fn force(store: &Store, record: &CycleRecord) -> Result<Option<Equipment>, Fault> {
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
fn verification_before(store: &Store, record: &CycleRecord, subject: &str) -> Result<Option<Verification>, Fault> {
    let all = store.verifications(subject).map_err(Fault::stage)?;
    Ok(all.into_iter().rev().find(|one| one.struck.is_none() && one.at_unix_s <= record.started_unix_s))
}

fn describe_verification(one: &Verification) -> LastVerification {
    let unit = health::unit(&one.subject);
    let [error, limit] = distinguishable_texts(one.error, one.limit, 2);
    LastVerification { day: utc_day(one.at_unix_s), error: format!("{error} {unit} (limit {limit} {unit})") }
}

fn signatures(store: &Store, record: &CycleRecord) -> Result<Vec<PrintedSignature>, Fault> {
    let persons = store.person_signatures(record.id).map_err(Fault::stage)?;
    let mut persons = persons.into_iter();
    let mut all = Vec::new();
    for row in store.cycle_signatures(record.id).map_err(Fault::stage)? {
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

/// Makes the page, and reports what the store no longer has of the cycle.
///
/// # Errors
/// If there is no such cycle, it cannot be read back, or writing to the disk fails.
pub fn run_page(args: &PageOf, common: &Common) -> Result<Outcome, Fault> {
    let files = CellFiles::read(common)?;
    let kept = StoredCycle::read(&files.store()?, CycleId(args.cycle))?;
    let page = args.out.clone().unwrap_or_else(|| page_file(files.store_folder(), CycleId(args.cycle)));
    kept.write(files.cell.retention(), &page, recording_status(files.store_folder(), &kept.record).as_ref())?;
    let found: Vec<Reason> =
        kept.describe_missing_figures().map(|words| Reason::new("picture_missing", words)).collect();
    let ok = found.is_empty();
    let verdict = if ok { Verdict::Pass } else { Verdict::Fail };
    let mut outcome = Outcome::from_judgement(&Judgement { verdict, reasons: found.clone() });
    // The verdict of this command is not the verdict of the cycle.
    outcome.lines[0] = match ok {
        true => "the page is complete".to_owned(),
        false => "the page was made, but data of the cycle is missing or damaged in the store:".to_owned(),
    };
    outcome.add_value("ok", json!(ok));
    outcome.add_value("found", json!(found));
    outcome.add_value("cycle_id", json!(args.cycle));
    outcome.add_value("cycle_verdict", json!(kept.record.judgement.as_ref().map(|judgement| judgement.verdict)));
    outcome.add_value("report", json!(page));
    outcome.add_line(match &kept.record.judgement {
        Some(judgement) => format!("the cycle's verdict: {}", judgement.verdict.keyword()),
        None => "the cycle has not ended: this page does not show its final result".to_owned(),
    });
    outcome.add_line(format!("page: {}", page.display()));
    Ok(outcome)
}

/// Describes each grid with the passes that touched it; unknown facts are marked as such.
pub fn describe_grids(record: &CycleRecord) -> Vec<String> {
    let mut passes: BTreeMap<(String, u8), bool> = BTreeMap::new();
    for AbradedGrid { grid, pass, how } in record::abraded_grids(&record.findings, &record.motions) {
        let grid = grid.unwrap_or_else(|| "any grid".to_owned());
        *passes.entry((grid, pass)).or_default() |= how.is_certain();
    }
    let mut grids: BTreeMap<&str, [usize; 2]> = BTreeMap::new();
    for ((grid, _), is_sure) in &passes {
        grids.entry(grid).or_default()[usize::from(!is_sure)] += 1;
    }
    let words = |(grid, [sure, perhaps]): (&&str, &[usize; 2])| match (sure, perhaps) {
        (sure, 0) => format!("{grid} ×{sure}"),
        (0, _) => format!("{grid} possibly (not confirmed)"),
        (sure, _) => format!("{grid} ×{sure}, possibly once more (not confirmed)"),
    };
    grids.iter().map(words).collect()
}

/// Describes the removal of each path, a line for each; empty if the recipe does not request a removal.
pub fn removed(record: &CycleRecord) -> Vec<String> {
    let line = |path: PathRemoval| {
        format!(
            "removed in pass {}: mean {} µm over the treated grids; at most {} µm so far at any point of the part (95 % bound)",
            path.pass,
            fixed_decimals(path.mean_um, 1),
            fixed_decimals(path.bound_um, 1)
        )
    };
    record::path_removals(&record.findings).into_iter().map(line).collect()
}

/// Returns the removal of each path for scripts.
pub fn removed_json(record: &CycleRecord) -> Value {
    let path = |path: PathRemoval| json!({"pass": path.pass, "mean_um": path.mean_um, "bound_um": path.bound_um});
    record::path_removals(&record.findings).into_iter().map(path).collect()
}
