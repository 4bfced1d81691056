//! Verifies signed statements: each statement by its signature, all statements by their hash chain, and the end of the
//! chain by a head that was stored elsewhere. The result names each statement that was changed, is missing, was
//! exchanged or was rolled back.

use super::key::PublicKey;
use super::statement::{CHAIN_START_HASH, SignedHead, Statement, StatementContent, hash};
use panelprep_cell::record::CycleId;
use std::collections::BTreeMap;

/// A statement and its signature, not yet verified.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signed {
    /// Name of the statement in messages, such as its file name.
    pub name: String,
    /// The bytes of the statement.
    pub bytes: Vec<u8>,
    /// The 64 bytes of the signature.
    pub signature: Vec<u8>,
    /// What the file name states about the statement.
    pub claim: NameClaim,
}

/// What a file name states about its statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NameClaim {
    /// The file name states nothing about the statement.
    Nothing,
    /// It is the cell's statement about this cycle.
    Cycle(CycleId),
    /// It is the statement with this number.
    Number(u64),
}

/// The result of a verification.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VerificationResult {
    /// Contradictions to what was signed, as texts.
    pub differences: Vec<String>,
    /// Ranges (first, last) of missing statement numbers before the last statement. They are contradictions only if the
    /// chain must be complete, not if only a part of it was exported.
    pub gaps: Vec<(u64, u64)>,
    /// The statements with a valid signature and their SHA-256, by statement number.
    pub statements: BTreeMap<u64, (Statement, String)>,
}

/// A statement with a valid signature.
struct ValidStatement<'s> {
    name: &'s str,
    statement: Statement,
    hash: String,
}

/// Verifies statements with these public keys. With a `head`, the head is verified too, and the statements must be
/// complete, from the first one to the one that the head names. Without a head, missing numbers are returned as gaps
/// instead of differences: a person who has the record of one cycle does not have those of the other cycles.
pub fn verify(all: &[Signed], keys: &[PublicKey], head: Option<&Signed>) -> VerificationResult {
    let mut verified = VerificationResult::default();
    let mut whole: BTreeMap<u64, ValidStatement<'_>> = BTreeMap::new();
    for signed in all {
        match read(signed, keys) {
            Err(problem) => verified.differences.push(problem),
            Ok(one) => {
                verified.differences.extend(check_claim(signed, &one.statement));
                match whole.get(&one.statement.number) {
                    Some(other) if other.hash == one.hash => {
                        verified
                            .differences
                            .push(format!("{} and {} contain the same record", other.name, one.name));
                    }
                    Some(other) => verified.differences.push(format!(
                        "{} and {} both have the record number {}: the chain was forked",
                        other.name, one.name, one.statement.number
                    )),
                    None => {
                        whole.insert(one.statement.number, one);
                    }
                }
            }
        }
    }
    verified.differences.extend(find_broken_links(&whole));
    verified.gaps = gaps(&whole);
    verified.differences.extend(find_unbound_signatures(&whole));
    verified.differences.extend(find_unearned_verdicts(&whole));
    if let Some(head) = head {
        verified.differences.extend(std::mem::take(&mut verified.gaps).into_iter().map(missing_text));
        verified.differences.extend(missing_from_statements(&whole, head, keys));
    }
    let statements = whole.into_iter().map(|(number, one)| (number, (one.statement, one.hash)));
    verified.statements = statements.collect();
    verified
}

fn read<'s>(signed: &'s Signed, keys: &[PublicKey]) -> Result<ValidStatement<'s>, String> {
    let Signed { name, bytes, signature, .. } = signed;
    let signs = keys.iter().find(|key| key.is_valid_signature(bytes, signature));
    let statement = Statement::read(bytes);
    match (signs, statement) {
        (Some(key), Ok(statement)) if statement.public_key == key.hex() => {
            Ok(ValidStatement { name, statement, hash: hash(bytes) })
        }
        (Some(_), Ok(statement)) => {
            Err(format!("{name} was signed with another key than the key that it names, {}", statement.public_key))
        }
        (Some(_), Err(error)) => Err(format!("{name}: {error}")),
        (None, Ok(statement)) if keys.iter().all(|key| key.hex() != statement.public_key) => Err(format!(
            "{name} was changed, or was signed with a key that was not given; it names the key {}",
            statement.public_key
        )),
        (None, _) => Err(format!("{name} was changed: the signature does not match its content")),
    }
}

/// Returns a text if the statement contradicts its file name.
fn check_claim(signed: &Signed, statement: &Statement) -> Option<String> {
    let is_there = match (signed.claim, &statement.says) {
        (NameClaim::Nothing, _) => true,
        (NameClaim::Number(number), _) => statement.number == number,
        (NameClaim::Cycle(id), StatementContent::Cycle(cycle)) => cycle.id == id,
        (NameClaim::Cycle(_), StatementContent::Person(_)) => false,
    };
    let words = |number, cycle| {
        format!(
            "{} contains record number {number} of cycle {cycle}, not the record in its file name: the file was \
             exchanged",
            signed.name
        )
    };
    (!is_there).then(|| words(statement.number, statement.cycle()))
}

/// Returns the ranges of missing numbers between 1 and the last statement.
fn gaps(whole: &BTreeMap<u64, ValidStatement<'_>>) -> Vec<(u64, u64)> {
    let before = std::iter::once(0).chain(whole.keys().copied());
    let between = before.zip(whole.keys()).filter(|(before, number)| before + 1 < **number);
    between.map(|(before, number)| (before + 1, number - 1)).collect()
}

/// Returns a text for each statement that does not contain the hash of the previous statement.
fn find_broken_links(whole: &BTreeMap<u64, ValidStatement<'_>>) -> Vec<String> {
    let mut found = Vec::new();
    let mut before: Option<&ValidStatement<'_>> = None;
    for one in whole.values() {
        let (number, name) = (one.statement.number, one.name);
        let expected = match before {
            _ if number == 1 => Some(CHAIN_START_HASH),
            Some(before) if before.statement.number + 1 == number => Some(before.hash.as_str()),
            // If the previous statement is missing, the hash cannot be compared.
            Some(_) | None => None,
        };
        if expected.is_some_and(|expected| expected != one.statement.previous) {
            found.push(format!(
                "the chain is broken: {name}, record number {number}, does not contain the hash of record number {}",
                number - 1
            ));
        }
        before = Some(one);
    }
    found
}

/// Returns the text about missing numbers in a chain that must be complete.
pub fn missing_text((first, last): (u64, u64)) -> String {
    match first == last {
        true => format!("record number {first} is missing"),
        false => format!("records number {first} to {last} are missing"),
    }
}

/// Returns the text about missing numbers if only a part of the chain was exported.
pub fn partial_chain_text((first, last): (u64, u64)) -> String {
    match first == last {
        true => format!("record number {first} is not in this folder"),
        false => format!("records number {first} to {last} are not in this folder"),
    }
}

/// Returns a text for each person's signature that belongs to another version of the cycle's record.
fn find_unbound_signatures(whole: &BTreeMap<u64, ValidStatement<'_>>) -> Vec<String> {
    let mut found = Vec::new();
    for one in whole.values() {
        let StatementContent::Person(person) = &one.statement.says else { continue };
        let of_cycle = |other: &&ValidStatement<'_>| match &other.statement.says {
            StatementContent::Cycle(cycle) => {
                cycle.id == person.cycle && other.statement.number < one.statement.number
            }
            StatementContent::Person(_) => false,
        };
        let records: Vec<&ValidStatement<'_>> = whole.values().filter(of_cycle).collect();
        if !records.is_empty() && records.iter().all(|record| record.hash != person.record_hash) {
            found.push(format!(
                "{}: {} signed another version of the record of cycle {}",
                one.name, person.name, person.cycle
            ));
        }
    }
    found
}

/// Returns a text for each record whose verdict is better than its findings allow.
fn find_unearned_verdicts(whole: &BTreeMap<u64, ValidStatement<'_>>) -> Vec<String> {
    let mut found = Vec::new();
    for one in whole.values() {
        let StatementContent::Cycle(cycle) = &one.statement.says else { continue };
        match cycle.cycle_record() {
            Ok(record) => {
                found.extend(
                    record.verdict_contradictions().into_iter().map(|words| format!("{}: {words}", one.name)),
                );
            }
            Err(error) => {
                found.push(format!("{}: cannot compare the verdict with the findings: {error}", one.name))
            }
        }
    }
    found
}

/// Verifies the head and compares the statements with it; returns the contradictions as texts.
fn missing_from_statements(
    whole: &BTreeMap<u64, ValidStatement<'_>>,
    signed: &Signed,
    keys: &[PublicKey],
) -> Vec<String> {
    let name = &signed.name;
    if !keys.iter().any(|key| key.is_valid_signature(&signed.bytes, &signed.signature)) {
        return vec![format!("the chain head {name} was changed: the signature does not match its content")];
    }
    let head = match SignedHead::read(&signed.bytes) {
        Ok(head) => head,
        Err(error) => return vec![format!("the chain head {name}: {error}")],
    };
    let mut found = Vec::new();
    if whole.is_empty() && head.number > 0 {
        found.push(missing_text((1, head.number)));
    }
    let last = whole.keys().next_back().copied().unwrap_or(0);
    if last < head.number && last > 0 {
        found.push(format!(
            "rolled back: the chain head {name} is at record number {}; {}",
            head.number,
            missing_text((last + 1, head.number))
        ));
    }
    if let Some(one) = whole.get(&head.number).filter(|one| one.hash != head.hash) {
        found.push(format!(
            "{} differs from record number {} that the chain head {name} names",
            one.name, head.number
        ));
    }
    found
}
