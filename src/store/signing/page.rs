//! The signed hash of a cycle's page as PDF.
//!
//! The PDF contains the signed record, so the record cannot name the PDF. A small statement beside the PDF does: it
//! names the SHA-256 of the PDF and that of the cell's record of the cycle, and is signed as every record is. It is not
//! a link of the chain: the page is made anew after each signature of a person, and the records themselves contain what
//! it shows.

use super::canonical::canonical;
use super::chain::VerificationResult;
use super::error::SigningError;
use super::key::{CellKey, PublicKey};
use super::names::{cycle_from_page_name, cycle_from_pdf_name, cycle_stem, page_stem, pdf_name};
use super::statement::{Statement, StatementContent, read};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::CycleId;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Identifier of the format of a signed page.
const PAGE_FORMAT: &str = "panelprep-page-1";

/// The cell's statement about a page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignedPage {
    /// The form.
    pub form: String,
    /// The cycle.
    pub cycle: CycleId,
    /// SHA-256 of the cell's record of the cycle.
    pub record_hash: String,
    /// The number of the last record of this cycle that the page shows: the cell's record, or one that a person
    /// signed.
    pub shows_number: u64,
    /// SHA-256 of the PDF.
    pub pdf_sha256: String,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// The key that signed the page, 64 hexadecimal digits.
    pub public_key: String,
}

impl SignedPage {
    /// Returns the bytes of the statement about this PDF, and their signature. `shows_number` is the last record
    /// that the PDF shows.
    ///
    /// # Errors
    /// If JSON cannot hold it.
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

/// Lists the pages of an export that differ from what was signed. Each PDF needs a signed page that names this PDF
/// and the cell's record. `pages` are the `.json` and `.sig` files of signed pages by name, `pdfs` the SHA-256 of
/// each PDF by name.
pub(super) fn differing_pages(
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
