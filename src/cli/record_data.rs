//! The page to read and sign: its data in addition to the cycle's record, read from the store and from the files
//! that the cycle used.

use super::fault::Fault;
use panelprep_base::number_text::{distinguishable_texts, utc_day, utc_text};
use panelprep_cell::accounts::{AuditEntry, RECIPE_CHANGE};
use panelprep_cell::files::content_hash;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::{CycleRecord, KeptFile, name};
use panelprep_service::report::page::Figure;
use panelprep_service::report::record_pdf::{
    AttachedFile, EarlierCycle, Equipment, LastVerification, PrintedSignature, RecordSheet, RecordSources, pdf,
};
use panelprep_store::signing::{Meaning, Statement, cycle_stem};
use panelprep_store::store::{PassesOfCycle, SignatureRow, Store};
use panelprep_vision::calib::health::{self, TOOL_FORCE, Verification};

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
pub fn read(store: &Store, record: &CycleRecord) -> Result<RecordSheet, Fault> {
    let part = store.stored_part(record);
    let recipe_text = text(store, &record.recipe_hash);
    let recipe = recipe_text.and_then(|text| Recipe::check("recipe.toml", &text).ok());
    let earlier = match part.as_ref().and_then(|part| part.serial.as_ref()) {
        Some(serial) => Some(store.passes_by_serial(serial, Some(record.id)).map_err(Fault::stage)?),
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

/// The page with its annex as PDF/A-3, with the signed record inside.
///
/// # Errors
/// If the store no longer has the signed record complete, or the PDF cannot be written.
pub fn document(
    store: &Store,
    (record, figures): (&CycleRecord, &[Figure]),
    row: &SignatureRow,
) -> Result<Vec<u8>, Fault> {
    let sheet = read(store, record)?;
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
    // The coupons measured nothing for a cycle whose recipe asks for no removal.
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

/// The force of a compliant tool, if the cycle pressed with one: it has no file, but its payload and zero are
/// verified.
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

/// A value of a calibration file, in any of its tables.
fn find_value(read: &toml::Table, key: &str) -> Option<String> {
    let tables = std::iter::once(read).chain(read.values().filter_map(toml::Value::as_table));
    tables.filter_map(|table| table.get(key)).find_map(|value| match value {
        toml::Value::String(text) => Some(text.clone()),
        toml::Value::Datetime(day) => Some(day.to_string()),
        _ => None,
    })
}

/// The last verification before the cycle that was not struck out.
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
