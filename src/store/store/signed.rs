//! Verifies the signatures of a store: each by its key, all by their chain, and the signed records against the
//! present rows. Rows that were changed together with the store's own chain and head contradict their signed
//! records.

use super::database::Store;
use super::signatures::SignatureRow;
use super::verify::StoreVerification;
use crate::signing::{self, NameClaim, PublicKey, Signed, SignedCycle, Statement, StatementContent, differences};
use panelprep_cell::files::hex;
use panelprep_cell::record::CycleId;
use std::collections::BTreeSet;

impl Store {
    /// Adds contradictions to the signatures, and the number of signatures.
    pub(super) fn verify_signatures(&self, verified: &mut StoreVerification) {
        let rows = match self.signatures() {
            Ok(rows) => rows,
            Err(error) => return verified.differences.push(error.to_string()),
        };
        verified.signatures = rows.len() as u64;
        let mut all = Vec::new();
        for row in &rows {
            match self.blob(&row.record_hash) {
                Ok(bytes) => all.push(signed(row, bytes)),
                Err(error) => verified.differences.push(format!("signature {}: {error}", row.number)),
            }
        }
        let named: BTreeSet<&str> = rows.iter().map(|row| row.public_key.as_str()).collect();
        let keys: Vec<PublicKey> = named.iter().filter_map(|hex| PublicKey::from_hex(hex).ok()).collect();
        let checked = signing::verify(&all, &keys, None);
        verified.differences.extend(checked.differences);
        // A gap at the first numbers is reported below.
        verified
            .differences
            .extend(checked.gaps.into_iter().filter(|(first, _)| *first > 1).map(signing::missing_text));
        for (number, (statement, _)) in &checked.statements {
            verified.differences.extend(self.statement_contradictions(*number, statement));
        }
        for row in &rows {
            let Some((statement, hash)) = checked.statements.get(&row.number) else { continue };
            let same = (row.cycle, row.unix_ms, &row.previous_hash, &row.record_hash, &row.public_key)
                == (statement.cycle(), statement.unix_ms, &statement.previous, hash, &statement.public_key)
                && row.is_of_person == matches!(statement.says, StatementContent::Person(_));
            if !same {
                verified.differences.push(format!("signature {} does not match its signed record", row.number));
            }
        }
        verified.differences.extend(check_no_gaps(&rows));
        verified.keys = keys.iter().map(PublicKey::hex).collect();
    }

    /// The contradictions between the present rows and a statement.
    fn statement_contradictions(&self, number: u64, statement: &Statement) -> Vec<String> {
        let mut found = Vec::new();
        let place = &statement.store;
        let here = if place.link == 0 { Ok(None) } else { self.link_hash(place.link) };
        if place.link > 0 && here.ok().flatten().map(|hash| hex(&hash)).as_ref() != Some(&place.hash) {
            found.push(format!(
                "link {} of the chain differs from the link that signature {number} names",
                place.link
            ));
        }
        if let StatementContent::Cycle(signed) = &statement.says {
            found.extend(self.cycle_contradicts(number, signed));
        }
        found
    }

    fn cycle_contradicts(&self, number: u64, signed: &SignedCycle) -> Vec<String> {
        let CycleId(id) = signed.id;
        let now = match self.content_to_sign(signed.id) {
            Ok(now) => now,
            Err(error) => return vec![format!("cycle {id}, named by signature {number}, cannot be read: {error}")],
        };
        let mut found: Vec<String> = differences(&signed.record, &now.record)
            .into_iter()
            .map(|words| format!("cycle {id} differs from its signed record at {words}"))
            .collect();
        if signed.part.is_some() && now.part != signed.part {
            found.push(format!("cycle {id} differs from its signed record: the signed record names another part"));
        }
        found
    }
}

fn signed(row: &SignatureRow, bytes: Vec<u8>) -> Signed {
    let name = format!("signature {}", row.number);
    Signed { name, bytes, signature: row.signature.clone(), claim: NameClaim::Number(row.number) }
}

/// Checks that numbers have no gaps; the first ones must not be missing either.
fn check_no_gaps(rows: &[SignatureRow]) -> Option<String> {
    let first = rows.first()?.number;
    (first > 1).then(|| format!("signatures 1 to {} are missing", first - 1))
}
