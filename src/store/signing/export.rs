//! An exported record: a folder of statements with their signatures, and the files that they name.
//!
//! The names are `cycle-7.json` with `cycle-7.sig`; `cycle-7-signature-12.json` with its `.sig` for a statement
//! that a person signed (12 is its number); `cycle-7.pdf` with `cycle-7-page.json` and `.sig`, which name its
//! SHA-256; and `files/` with each file under its SHA-256. The cameras' original data is not exported: it is large,
//! and the store keeps it.

use super::chain::{Signed, VerificationResult, verify};
use super::key::PublicKey;
use super::names::{cycle_from_page_name, parse_claim};
use super::page::differing_pages;
use super::statement::{SignedCycle, StatementContent, named_files};
use std::collections::BTreeMap;

/// The content of an exported folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ExportContent {
    /// Bytes by name: the `.json` and `.sig` files.
    pub statements: BTreeMap<String, Vec<u8>>,
    /// SHA-256 of the files in `files/`, by name; `None` if there is no such folder, which is then not checked.
    pub files: Option<BTreeMap<String, String>>,
    /// SHA-256 of the PDF pages, by name.
    pub pdfs: BTreeMap<String, String>,
}

/// Lists the files of a cycle that are exported: recipe, cell, calibrations, part, pictures; each with its
/// description and its hash.
pub fn exported_files(cycle: &SignedCycle) -> Vec<(String, String)> {
    named_files(cycle).into_iter().filter(|(name, _)| !name.starts_with("shot ")).collect()
}

/// Verifies a folder with these public keys, and with the head if it is given, as [`verify`] does.
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
    found.extend(differing_pages(&pages, &export.pdfs, &verified, keys));
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
