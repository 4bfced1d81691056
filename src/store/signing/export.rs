//! An exported record: a folder with statements, their signatures, and the files that they name.
//!
//! The file names are `cycle-7.json` with `cycle-7.sig` for the cell's statement; `cycle-7-signature-12.json` with its
//! `.sig` for the signature of a person (12 is its number); `cycle-7.pdf` with `cycle-7-page.json` and `.sig`, which
//! contain the SHA-256 of the PDF; and `files/`, in which each file is named by its SHA-256. The cameras' original data
//! are not exported, because they are large and stay in the store.
//!
//! The PDF contains the signed record, so the record cannot contain the hash of the PDF. Instead, a separate signed
//! statement ([`SignedPage`]) contains the SHA-256 of the PDF and of the cell's record of the cycle. It is not part of
//! the hash chain: a new PDF is made after each signature of a person, and the PDF only shows what the records contain.

use super::canonical::canonical;
use super::chain::{NameClaim, Signed, VerificationResult, verify};
use super::key::{CellKey, PublicKey, SigningError};
use super::statement::{SignedCycle, Statement, StatementContent, named_files, read};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::CycleId;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The files of an exported folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ExportContent {
    /// Contents of the `.json` and `.sig` files, by file name.
    pub statements: BTreeMap<String, Vec<u8>>,
    /// SHA-256 of the files in `files/`, by file name; `None` if this folder does not exist, and its files are not
    /// checked.
    pub files: Option<BTreeMap<String, String>>,
    /// SHA-256 of the PDF files, by file name.
    pub pdfs: BTreeMap<String, String>,
}

/// Returns the description and the hash of each file of a cycle that is exported: recipe, cell, calibrations, part,
/// pictures.
pub fn exported_files(cycle: &SignedCycle) -> Vec<(String, String)> {
    named_files(cycle).into_iter().filter(|(name, _)| !name.starts_with("shot ")).collect()
}

/// Verifies an exported folder with these public keys and, if it is given, with the head, as [`verify`] does.
pub fn verify_export(export: &ExportContent, keys: &[PublicKey], head: Option<&Signed>) -> VerificationResult {
    let (mut found, mut all) = (Vec::new(), Vec::new());
    let is_page = |name: &str| name.rsplit_once('.').is_some_and(|(stem, _)| cycle_from_page_name(stem).is_some());
    let (pages, statements): (BTreeMap<&str, &[u8]>, BTreeMap<&str, &[u8]>) = export
        .statements
        .iter()
        .map(|(name, bytes)| (name.as_str(), bytes.as_slice()))
        .partition(|(name, _)| is_page(name));
    for (name, bytes) in &statements {
        let Some(stem) = name.strip_suffix(".json") else {
            let json = name.strip_suffix(".sig").map(|stem| format!("{stem}.json"));
            found.extend(
                json.filter(|json| !statements.contains_key(json.as_str()))
                    .map(|json| format!("{json} is missing; its signature {name} exists")),
            );
            continue;
        };
        match statements.get(format!("{stem}.sig").as_str()) {
            Some(signature) => all.push(Signed {
                name: (*name).to_owned(),
                bytes: bytes.to_vec(),
                signature: signature.to_vec(),
                claim: parse_claim(stem),
            }),
            None => found.push(format!("{stem}.sig, the signature of {name}, is missing")),
        }
    }
    let mut verified = verify(&all, keys, head);
    found.append(&mut verified.differences);
    if let Some(files) = &export.files {
        for (statement, _) in verified.statements.values() {
            if let StatementContent::Cycle(cycle) = &statement.says {
                found.extend(differing_files(cycle, files));
            }
        }
    }
    found.extend(find_page_differences(&pages, &export.pdfs, &verified, keys));
    VerificationResult { differences: found, ..verified }
}

fn differing_files(cycle: &SignedCycle, files: &BTreeMap<String, String>) -> Vec<String> {
    let wrong = |(what, hash): (String, String)| match files.get(&hash) {
        Some(found) if *found == hash => None,
        Some(found) => {
            Some(format!("files/{hash}, {what} of cycle {}, was changed: its SHA-256 is {found}", cycle.id))
        }
        None => Some(format!("files/{hash}, {what} of cycle {}, is missing", cycle.id)),
    };
    exported_files(cycle).into_iter().filter_map(wrong).collect()
}

/// Identifier of the format of a signed page.
const PAGE_FORMAT: &str = "panelprep-page-1";

/// The cell's signed statement about a PDF.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignedPage {
    /// The identifier of the format.
    pub form: String,
    /// Number of the cycle.
    pub cycle: CycleId,
    /// SHA-256 of the cell's record of the cycle.
    pub record_hash: String,
    /// The number of the last statement about this cycle that the PDF shows: the cell's own, or the signature of a
    /// person.
    pub shows_number: u64,
    /// SHA-256 of the PDF.
    pub pdf_sha256: String,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// The public key of the signature, 64 hexadecimal digits.
    pub public_key: String,
}

impl SignedPage {
    /// Returns the statement about this PDF, and its signature. `shows_number` is the number of the last statement that
    /// the PDF shows.
    ///
    /// # Errors
    /// If JSON cannot represent the statement.
    pub fn sign(
        pdf: &[u8],
        (cycle, record_hash, shows_number): (CycleId, &str, u64),
        unix_ms: i64,
        key: &CellKey,
    ) -> Result<(Vec<u8>, Vec<u8>), SigningError> {
        let page = SignedPage {
            form: PAGE_FORMAT.to_owned(),
            cycle,
            record_hash: record_hash.to_owned(),
            shows_number,
            pdf_sha256: content_hash(pdf),
            unix_ms,
            public_key: key.public_key().hex(),
        };
        let bytes = canonical(&page)?;
        let signature = key.sign(&bytes).to_vec();
        Ok((bytes, signature))
    }

    fn read(bytes: &[u8]) -> Result<Self, SigningError> {
        let page: SignedPage = read(bytes)?;
        match page.form.as_str() {
            PAGE_FORMAT => Ok(page),
            other => Err(SigningError::form_error(format!(
                "the field \"form\" is \"{other}\", expected \"{PAGE_FORMAT}\""
            ))),
        }
    }
}

/// Returns a text for each PDF or signed page that is not valid. Each PDF needs a signed page with the hashes of this
/// PDF and of the cell's record. `pages` are the `.json` and `.sig` files of signed pages by name, `pdfs` the SHA-256
/// of each PDF by name.
fn find_page_differences(
    pages: &BTreeMap<&str, &[u8]>,
    pdfs: &BTreeMap<String, String>,
    verified: &VerificationResult,
    keys: &[PublicKey],
) -> Vec<String> {
    let stems = pages.keys().filter_map(|name| name.rsplit_once('.')).map(|(stem, _)| stem);
    let cycles =
        stems.filter_map(cycle_from_page_name).chain(pdfs.keys().filter_map(|name| cycle_from_pdf_name(name)));
    let cycles: BTreeSet<CycleId> = cycles.collect();
    cycles.into_iter().flat_map(|cycle| page_difference(cycle, (pages, pdfs), verified, keys)).collect()
}

fn page_difference(
    cycle: CycleId,
    (pages, pdfs): (&BTreeMap<&str, &[u8]>, &BTreeMap<String, String>),
    verified: &VerificationResult,
    keys: &[PublicKey],
) -> Vec<String> {
    let (stem, pdf) = (page_stem(cycle), pdf_name(cycle));
    let [json, sig] = ["json", "sig"].map(|ending| format!("{stem}.{ending}"));
    let (Some(bytes), Some(signature)) = (pages.get(json.as_str()), pages.get(sig.as_str())) else {
        let missing = if pages.contains_key(json.as_str()) { sig } else { json };
        return vec![format!("{missing} is missing: without it {pdf} cannot be verified")];
    };
    let signs = keys.iter().find(|key| key.is_valid_signature(bytes, signature));
    let page = match (signs, SignedPage::read(bytes)) {
        (None, _) => return vec![format!("{json} was changed, or was signed with a key that was not given")],
        (_, Err(error)) => return vec![format!("{json}: {error}")],
        (Some(key), Ok(page)) if page.public_key == key.hex() => page,
        (Some(_), Ok(page)) => {
            return vec![format!(
                "{json} was signed with another key than the key that it names, {}",
                page.public_key
            )];
        }
    };
    if page.cycle != cycle {
        return vec![format!("{json} belongs to cycle {}: the file was exchanged", page.cycle)];
    }
    let mut found = Vec::new();
    match pdfs.get(&pdf) {
        None => found.push(format!("{pdf} is missing; its signed page {json} exists")),
        Some(hash) if *hash != page.pdf_sha256 => {
            found.push(format!(
                "{pdf} was changed: its SHA-256 is {hash}, the signed SHA-256 is {}",
                page.pdf_sha256
            ));
        }
        Some(_) => {}
    }
    let of_cycle = || verified.statements.iter().filter(|(_, (statement, _))| statement.cycle() == cycle);
    let is_record = |statement: &Statement, hash: &str| {
        matches!(statement.says, StatementContent::Cycle(_)) && *hash == page.record_hash
    };
    let last = of_cycle().map(|(number, _)| *number).max().unwrap_or(0);
    if !of_cycle().any(|(_, (statement, hash))| is_record(statement, hash)) {
        let record = cycle_stem(cycle);
        found.push(format!("{json} does not belong to {record}.json, or {record}.json is missing or was changed"));
    } else if last > page.shows_number {
        found.push(format!("{pdf} is older than signed record number {last} of this cycle: export the page again"));
    }
    found
}

/// Returns the file name, without extension, of the cell's statement about a cycle.
pub fn cycle_stem(cycle: CycleId) -> String {
    format!("cycle-{cycle}")
}

/// Returns the file name, without extension, of a person's signature on a cycle.
pub fn person_signature_stem(cycle: CycleId, number: u64) -> String {
    format!("cycle-{cycle}-signature-{number}")
}

/// Returns the file name, without extension, of the signed page of a cycle.
pub fn page_stem(cycle: CycleId) -> String {
    format!("cycle-{cycle}-page")
}

/// Returns the file name of a cycle's PDF.
pub fn pdf_name(cycle: CycleId) -> String {
    format!("cycle-{cycle}.pdf")
}

/// Returns the cycle of a signed page, from its file name without extension; `None` if it is not the name of a signed
/// page.
fn cycle_from_page_name(stem: &str) -> Option<CycleId> {
    let number = stem.strip_suffix("-page")?.strip_prefix("cycle-")?;
    number.parse().ok().map(CycleId)
}

/// Returns the cycle of a PDF, from its file name; `None` if it is not the name of a cycle's PDF.
fn cycle_from_pdf_name(name: &str) -> Option<CycleId> {
    name.strip_suffix(".pdf")?.strip_prefix("cycle-")?.parse().ok().map(CycleId)
}

/// Returns what a file name without extension states about its statement.
fn parse_claim(stem: &str) -> NameClaim {
    let Some(rest) = stem.strip_prefix("cycle-") else { return NameClaim::Nothing };
    match rest.split_once("-signature-") {
        Some((_, number)) => number.parse().map_or(NameClaim::Nothing, NameClaim::Number),
        None => rest.parse().map_or(NameClaim::Nothing, |id| NameClaim::Cycle(CycleId(id))),
    }
}
