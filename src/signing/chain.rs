//! Verifies signed statements together: each by its signature, all by their chain, and the chain's end by a head that
//! was stored elsewhere. Names each statement that was changed, is missing, was exchanged for another, or was rolled
//! back.

use super::key::PublicKey;
use super::statement::{BEGIN, SignedHead, Statement, StatementContent, hash};
use crate::record::CycleId;
use std::collections::BTreeMap;

/// A statement and its signature, as they were found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signed {
    /// Name of the statement in messages, such as its file.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The 64 bytes of its signature.
    pub signature: Vec<u8>,
    /// The claim that the statement's name makes.
    pub claim: Claim,
}

/// The claim that a statement's name makes about the statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Claim {
    /// Nothing.
    Nothing,
    /// The cell's statement of this cycle.
    Cycle(CycleId),
    /// This number.
    Number(u64),
}

/// The result of a verification.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Verified {
    /// Differences from what was signed, in words.
    pub found: Vec<String>,
    /// Missing statement numbers before the last one, as ranges (first, last). They are a finding if the set must
    /// be complete, and none if only a part of the chain was handed on.
    pub gaps: Vec<(u64, u64)>,
    /// The statements with a valid signature, by their numbers, each with its SHA-256.
    pub statements: BTreeMap<u64, (Statement, String)>,
}

/// A statement with a valid signature.
struct Whole<'s> {
    name: &'s str,
    statement: Statement,
    hash: String,
}

/// Verifies these statements with these public keys. If a `head` is given, it must be signed too, and the
/// statements must be complete from the cell's first to the one that the head names. Without a head, missing
/// numbers are listed separately from findings: a person who has the record of one cycle does not have the records
/// of other cycles in between.
pub fn verify(all: &[Signed], keys: &[PublicKey], head: Option<&Signed>) -> Verified {
    let mut verified = Verified::default();
    let mut whole: BTreeMap<u64, Whole<'_>> = BTreeMap::new();
    for signed in all {
        match read(signed, keys) {
            Err(problem) => verified.found.push(problem),
            Ok(one) => {
                verified.found.extend(misplaced(signed, &one.statement));
                match whole.get(&one.statement.number) {
                    Some(other) if other.hash == one.hash => {
                        verified.found.push(format!("{} and {} contain the same record", other.name, one.name));
                    }
                    Some(other) => verified.found.push(format!(
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
    verified.found.extend(broken(&whole));
    verified.gaps = gaps(&whole);
    verified.found.extend(unbound(&whole));
    verified.found.extend(unearned(&whole));
    if let Some(head) = head {
        verified.found.extend(std::mem::take(&mut verified.gaps).into_iter().map(missing));
        verified.found.extend(beyond(&whole, head, keys));
    }
    let statements = whole.into_iter().map(|(number, one)| (number, (one.statement, one.hash)));
    verified.statements = statements.collect();
    verified
}

fn read<'s>(signed: &'s Signed, keys: &[PublicKey]) -> Result<Whole<'s>, String> {
    let Signed { name, bytes, signature, .. } = signed;
    let signs = keys.iter().find(|key| key.verifies(bytes, signature));
    let statement = Statement::read(bytes);
    match (signs, statement) {
        (Some(key), Ok(statement)) if statement.public_key == key.hex() => {
            Ok(Whole { name, statement, hash: hash(bytes) })
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

/// Returns a finding if the statement contradicts the claim that its name makes.
fn misplaced(signed: &Signed, statement: &Statement) -> Option<String> {
    let is_there = match (signed.claim, &statement.says) {
        (Claim::Nothing, _) => true,
        (Claim::Number(number), _) => statement.number == number,
        (Claim::Cycle(id), StatementContent::Cycle(cycle)) => cycle.id == id,
        (Claim::Cycle(_), StatementContent::Person(_)) => false,
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

/// Returns the missing numbers, from the first number of the cell to the last one present.
fn gaps(whole: &BTreeMap<u64, Whole<'_>>) -> Vec<(u64, u64)> {
    let before = std::iter::once(0).chain(whole.keys().copied());
    let between = before.zip(whole.keys()).filter(|(before, number)| before + 1 < **number);
    between.map(|(before, number)| (before + 1, number - 1)).collect()
}

/// Returns a finding for each statement that names a different predecessor than the one present.
fn broken(whole: &BTreeMap<u64, Whole<'_>>) -> Vec<String> {
    let mut found = Vec::new();
    let mut before: Option<&Whole<'_>> = None;
    for one in whole.values() {
        let (number, name) = (one.statement.number, one.name);
        let expected = match before {
            _ if number == 1 => Some(BEGIN),
            Some(before) if before.statement.number + 1 == number => Some(before.hash.as_str()),
            // Without the predecessor, its hash is not known.
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

/// The words for a gap in a chain that must be complete.
pub fn missing((first, last): (u64, u64)) -> String {
    match first == last {
        true => format!("record number {first} is missing"),
        false => format!("records number {first} to {last} are missing"),
    }
}

/// The words for a gap if only a part of the chain was handed on.
pub fn not_here((first, last): (u64, u64)) -> String {
    match first == last {
        true => format!("record number {first} is not in this folder"),
        false => format!("records number {first} to {last} are not in this folder"),
    }
}

/// Signatures of persons that name a different record than the one present.
fn unbound(whole: &BTreeMap<u64, Whole<'_>>) -> Vec<String> {
    let mut found = Vec::new();
    for one in whole.values() {
        let StatementContent::Person(person) = &one.statement.says else { continue };
        let of_cycle = |other: &&Whole<'_>| match &other.statement.says {
            StatementContent::Cycle(cycle) => {
                cycle.id == person.cycle && other.statement.number < one.statement.number
            }
            StatementContent::Person(_) => false,
        };
        let records: Vec<&Whole<'_>> = whole.values().filter(of_cycle).collect();
        if !records.is_empty() && records.iter().all(|record| record.hash != person.record_hash) {
            found.push(format!(
                "{}: {} signed another version of the record of cycle {}",
                one.name, person.name, person.cycle
            ));
        }
    }
    found
}

/// Records with a better verdict than their findings allow.
fn unearned(whole: &BTreeMap<u64, Whole<'_>>) -> Vec<String> {
    let mut found = Vec::new();
    for one in whole.values() {
        let StatementContent::Cycle(cycle) = &one.statement.says else { continue };
        match cycle.cycle_record() {
            Ok(record) => {
                found.extend(record.unearned().into_iter().map(|words| format!("{}: {words}", one.name)));
            }
            Err(error) => {
                found.push(format!("{}: cannot compare the verdict with the findings: {error}", one.name))
            }
        }
    }
    found
}

/// Lists what the head contains but the statements do not.
fn beyond(whole: &BTreeMap<u64, Whole<'_>>, signed: &Signed, keys: &[PublicKey]) -> Vec<String> {
    let name = &signed.name;
    if !keys.iter().any(|key| key.verifies(&signed.bytes, &signed.signature)) {
        return vec![format!("the chain head {name} was changed: the signature does not match its content")];
    }
    let head = match SignedHead::read(&signed.bytes) {
        Ok(head) => head,
        Err(error) => return vec![format!("the chain head {name}: {error}")],
    };
    let mut found = Vec::new();
    if whole.is_empty() && head.number > 0 {
        found.push(missing((1, head.number)));
    }
    let last = whole.keys().next_back().copied().unwrap_or(0);
    if last < head.number && last > 0 {
        found.push(format!(
            "rolled back: the chain head {name} is at record number {}; {}",
            head.number,
            missing((last + 1, head.number))
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
