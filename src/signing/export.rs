//! An exported record: a folder of statements with their signatures, and the files that they name.
//!
//! The names are `cycle-7.json` with `cycle-7.sig`, `cycle-7-signature-12.json` with its `.sig` for what a person signed (12
//! is its number), and `files/` with each file under its SHA-256. What cameras gave is not exported: it is large, and the
//! store keeps it.

use super::chain::{Claim, Signed, Verified, verify};
use super::key::PublicKey;
use super::statement::{Said, SignedCycle, files_of};
use crate::record::CycleId;
use std::collections::BTreeMap;

/// What a folder has.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Export {
    /// Bytes by name: the `.json` and `.sig` files.
    pub statements: BTreeMap<String, Vec<u8>>,
    /// SHA-256 of the bytes by name, of what lies in `files/`; `None` where there is no such folder, which is then not
    /// looked at.
    pub files: Option<BTreeMap<String, String>>,
}

/// The name without its ending, of the cell's statement of a cycle.
pub fn cycle_stem(cycle: CycleId) -> String {
    format!("cycle-{cycle}")
}

/// The same of what a person signed of it.
pub fn person_stem(cycle: CycleId, number: u64) -> String {
    format!("cycle-{cycle}-signature-{number}")
}

/// The files of a cycle that are exported: recipe, cell, calibrations, part, pictures; each with what it is and its hash.
pub fn exported_files(cycle: &SignedCycle) -> Vec<(String, String)> {
    files_of(cycle).into_iter().filter(|(name, _)| !name.starts_with("shot ")).collect()
}

/// Verifies a folder with these public keys, and with the head where it is given, as [`verify`] does.
pub fn verify_export(export: &Export, keys: &[PublicKey], head: Option<&Signed>) -> Verified {
    let (mut found, mut all) = (Vec::new(), Vec::new());
    for (name, bytes) in &export.statements {
        let Some(stem) = name.strip_suffix(".json") else {
            let json = name.strip_suffix(".sig").map(|stem| format!("{stem}.json"));
            found.extend(
                json.filter(|json| !export.statements.contains_key(json))
                    .map(|json| format!("{json} is missing; its signature {name} is there")),
            );
            continue;
        };
        match export.statements.get(&format!("{stem}.sig")) {
            Some(signature) => all.push(Signed {
                name: name.clone(),
                bytes: bytes.clone(),
                signature: signature.clone(),
                claim: claim(stem),
            }),
            None => found.push(format!("{stem}.sig, the signature of {name}, is missing")),
        }
    }
    let mut verified = verify(&all, keys, head);
    found.append(&mut verified.found);
    if let Some(files) = &export.files {
        for (statement, _) in verified.statements.values() {
            if let Said::Cycle(cycle) = &statement.says {
                found.extend(wrong_files(cycle, files));
            }
        }
    }
    Verified { found, ..verified }
}

fn wrong_files(cycle: &SignedCycle, files: &BTreeMap<String, String>) -> Vec<String> {
    let wrong = |(what, hash): (String, String)| match files.get(&hash) {
        Some(found) if *found == hash => None,
        Some(found) => {
            Some(format!("files/{hash}, {what} of cycle {}, was changed: its SHA-256 is {found}", cycle.id))
        }
        None => Some(format!("files/{hash}, {what} of cycle {}, is missing", cycle.id)),
    };
    exported_files(cycle).into_iter().filter_map(wrong).collect()
}

/// What a file's name claims.
fn claim(stem: &str) -> Claim {
    let Some(rest) = stem.strip_prefix("cycle-") else { return Claim::Nothing };
    match rest.split_once("-signature-") {
        Some((_, number)) => number.parse().map_or(Claim::Nothing, Claim::Number),
        None => rest.parse().map_or(Claim::Nothing, |id| Claim::Cycle(CycleId(id))),
    }
}
