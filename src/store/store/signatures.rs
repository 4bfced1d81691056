//! Signatures: the cell's signed statement about each ended cycle, and persons' signatures on it. They are never
//! changed or removed.
//!
//! A statement is stored in a file named by its SHA-256. The row that names the file is written last, in one
//! transaction, so that a signature is complete or does not exist. The previous statement is read before the
//! transaction and compared again in it; therefore the journal of the control loop never waits until a file of the
//! record is on the disk.

use super::chain;
use super::commit::WriteTransaction;
use super::database::{Store, unix_ms};
use super::error::StoreError;
use super::outbox;
use crate::office::Kind;
use crate::signing::{
    CHAIN_START_HASH, CellKey, HEAD_FORMAT, Meaning, PersonSignature, STATEMENT_FORMAT, SignedChainPosition,
    SignedCycle, SignedHead, SigningError, StatedValues, Statement, StatementContent,
};
use panelprep_base::number_text::{check_printable, utc_text};
use panelprep_cell::files::hex;
use panelprep_cell::record::CycleId;
use rusqlite::{Connection, OptionalExtension, Row, params};
use std::path::Path;

pub(super) const TABLES: &str = "
    CREATE TABLE signatures (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER NOT NULL REFERENCES cycles (id),
        kind TEXT NOT NULL,
        unix_ms INTEGER NOT NULL,
        record_hash TEXT NOT NULL,
        previous_hash TEXT NOT NULL,
        signature BLOB NOT NULL,
        public_key TEXT NOT NULL
    ) STRICT;
    CREATE INDEX signatures_by_cycle ON signatures (cycle_id);
";

/// Maximum number of attempts to sign if other processes sign at the same time.
const MAX_SIGN_ATTEMPTS: usize = 10;
/// Maximum length of a name, a user or a remark, characters.
const MAX_TEXT_CHARACTERS: usize = 200;

const CYCLE_SIGNATURE_SQL: &str = "cycle";
const PERSON_SIGNATURE_SQL: &str = "person";

/// A person's request to sign. The caller has authenticated the person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PersonSigningRequest {
    /// The cycle whose record is signed.
    pub cycle: CycleId,
    /// The person's printed name.
    pub name: String,
    /// The account with which the person was authenticated.
    pub user: String,
    /// The meaning of the signature.
    pub meaning: Meaning,
    /// The person's remark, if there is one.
    pub remark: Option<String>,
    /// Values that the cell does not measure, as stated by the person.
    pub values: StatedValues,
}

/// A row of the table of signatures. The file `record_hash` contains the signed statement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SignatureRow {
    /// Number of the signature among all signatures of the cell, from 1.
    pub number: u64,
    /// Number of the cycle.
    pub cycle: CycleId,
    /// Whether a person signed; if not, the cell signed.
    pub is_of_person: bool,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// SHA-256 of the signed statement.
    pub record_hash: String,
    /// SHA-256 of the previous statement.
    pub previous_hash: String,
    /// The signature, 64 bytes.
    pub signature: Vec<u8>,
    /// The public key of the signature, 64 hexadecimal digits.
    pub public_key: String,
}

impl SignatureRow {
    fn from_row(row: &Row<'_>) -> Result<Self, rusqlite::Error> {
        let kind: String = row.get(2)?;
        Ok(SignatureRow {
            number: row.get::<_, i64>(0)?.unsigned_abs(),
            cycle: row.get(1).map(CycleId)?,
            is_of_person: kind == PERSON_SIGNATURE_SQL,
            unix_ms: row.get(3)?,
            record_hash: row.get(4)?,
            previous_hash: row.get(5)?,
            signature: row.get(6)?,
            public_key: row.get(7)?,
        })
    }
}

const COLUMNS: &str = "id, cycle_id, kind, unix_ms, record_hash, previous_hash, signature, public_key";

/// Returns the number of the last signature and the hash of its statement.
fn last_signature(connection: &Connection) -> Result<(i64, String), rusqlite::Error> {
    let sql = "SELECT id, record_hash FROM signatures ORDER BY id DESC LIMIT 1";
    let last = connection.query_row(sql, [], |row| Ok((row.get(0)?, row.get(1)?))).optional()?;
    Ok(last.unwrap_or((0, CHAIN_START_HASH.to_owned())))
}

impl Store {
    /// Signs all ended cycles that are not signed yet, in order, in the store in this folder, also while a service
    /// writes to it. The callback gets the result for each cycle. If one cycle cannot be signed, the others are still
    /// signed.
    ///
    /// # Errors
    /// If the store cannot be opened, or its signatures cannot be read.
    pub fn sign_missing(
        folder: &Path,
        key: &CellKey,
        on_signed: &dyn Fn(CycleId, Result<&SignatureRow, StoreError>),
    ) -> Result<(), StoreError> {
        let mut store = Store::for_signing(folder)?;
        for cycle in store.unsigned_cycles()? {
            match store.sign_cycle(key, cycle) {
                Ok(row) => on_signed(cycle, Ok(&row)),
                Err(error) => on_signed(cycle, Err(error)),
            }
        }
        Ok(())
    }

    /// Signs the record of a cycle for this person, in the store in this folder, also while a service writes to it. The
    /// signature is a separate statement in the cell's chain that contains the hash of the cell's statement. If the
    /// cell has not signed the cycle yet, it signs first.
    ///
    /// # Errors
    /// If the cycle does not exist or has not ended, a text contains unprintable characters, the person has already
    /// signed this record with this meaning, the record does not permit this meaning ([`Meaning`]: a release, or its
    /// withdrawal), or the store cannot be written.
    pub fn sign_by_person(
        folder: &Path,
        key: &CellKey,
        signs: &PersonSigningRequest,
    ) -> Result<SignatureRow, StoreError> {
        let texts = [("name", Some(&signs.name)), ("user", Some(&signs.user)), ("remark", signs.remark.as_ref())];
        for (what, text) in texts.into_iter().chain(signs.values.named()) {
            // The texts are checked because they will be printed.
            let Some(text) = text else { continue };
            check_printable(text, MAX_TEXT_CHARACTERS).map_err(|problem| {
                let found = text.escape_debug().to_string();
                StoreError::Unsignable { what, found, problem }
            })?;
        }
        let mut store = Store::for_signing(folder)?;
        let of_cycle = match store.cell_signature(signs.cycle)? {
            Some(row) => row,
            None => store.sign_cycle(key, signs.cycle)?,
        };
        store.check_not_signed(signs)?;
        store.check_meaning(signs)?;
        let PersonSigningRequest { cycle, name, user, meaning, remark, values } = signs.clone();
        let record_hash = of_cycle.record_hash;
        let says = PersonSignature { cycle, record_hash, name, user, meaning, remark, values };
        store.sign(key, &StatementContent::Person(says))
    }

    /// Signs an ended cycle for the cell.
    ///
    /// # Errors
    /// If the cycle does not exist or has not ended, or the store cannot be written.
    pub fn sign_cycle(&mut self, key: &CellKey, id: CycleId) -> Result<SignatureRow, StoreError> {
        let says = self.content_to_sign(id)?;
        self.sign(key, &StatementContent::Cycle(says))
    }

    /// Returns the present record and part of a cycle, for signing.
    pub(super) fn content_to_sign(&self, id: CycleId) -> Result<SignedCycle, StoreError> {
        let record = self.cycle(id)?;
        if record.judgement.is_none() {
            return Err(StoreError::UnknownCycle {
                path: self.path().to_owned(),
                what: "concluded cycle",
                id: id.0,
            });
        }
        let part = self.stored_part(&record);
        SignedCycle::new(&record, part).map_err(|source| self.signing_error(source))
    }

    fn sign(&mut self, key: &CellKey, says: &StatementContent) -> Result<SignatureRow, StoreError> {
        for _ in 0..MAX_SIGN_ATTEMPTS {
            if let Some(row) = self.try_sign(key, says)? {
                return Ok(row);
            }
        }
        Err(StoreError::SignedMeanwhile { path: self.path().to_owned() })
    }

    /// Tries once to sign the content; `None` if another process has signed meanwhile.
    fn try_sign(&mut self, key: &CellKey, says: &StatementContent) -> Result<Option<SignatureRow>, StoreError> {
        let read = |store: &Store, error: rusqlite::Error| store.database_error("read the signatures of", &error);
        let (before, previous) = last_signature(&self.connection).map_err(|error| read(self, error))?;
        let place = chain::last_link(&self.connection).map_err(|error| read(self, error))?;
        let statement = Statement {
            form: STATEMENT_FORMAT.to_owned(),
            number: before.unsigned_abs() + 1,
            previous: previous.clone(),
            unix_ms: unix_ms(self.clock()),
            public_key: key.public_key().hex(),
            store: SignedChainPosition { link: place.link, hash: hex(&place.hash) },
            says: says.clone(),
        };
        let bytes = statement.canonical().map_err(|source| self.signing_error(source))?;
        let row = SignatureRow {
            number: statement.number,
            cycle: statement.cycle(),
            is_of_person: matches!(says, StatementContent::Person(_)),
            unix_ms: statement.unix_ms,
            record_hash: self.blobs.store_bytes(&bytes).map_err(|error| self.full_disk_or(error))?,
            previous_hash: previous.clone(),
            signature: key.sign(&bytes).to_vec(),
            public_key: statement.public_key,
        };
        let is_written = self.commit("write a signature to", |writing| {
            if last_signature(writing)? != (before, previous.clone()) {
                return Ok(false);
            }
            insert(writing, before + 1, &row)?;
            writing.chain("signatures", before + 1)?;
            outbox::insert(writing, Kind::Signature, before + 1, row.unix_ms)?;
            Ok(true)
        })?;
        Ok(is_written.then_some(row))
    }

    /// Returns all signatures of the cell, in order.
    ///
    /// # Errors
    /// If the signatures cannot be read.
    pub fn signatures(&self) -> Result<Vec<SignatureRow>, StoreError> {
        self.find_signatures("?1 IS NULL", None)
    }

    /// Returns the signatures on a cycle in order: the cell's first, then those of persons.
    ///
    /// # Errors
    /// If the signatures cannot be read.
    pub fn cycle_signatures(&self, id: CycleId) -> Result<Vec<SignatureRow>, StoreError> {
        self.find_signatures("cycle_id = ?1", Some(id.0))
    }

    /// Returns the first signature after this number, and the number of all signatures after it.
    ///
    /// # Errors
    /// If the signatures cannot be read.
    pub fn next_signature(&self, number: u64) -> Result<Option<(SignatureRow, u64)>, StoreError> {
        let number = Some(i64::try_from(number).unwrap_or(i64::MAX));
        let first = "id = (SELECT min(id) FROM signatures WHERE id > ?1)";
        let Some(first) = self.find_signatures(first, number)?.pop() else { return Ok(None) };
        let sql = "SELECT count(*) FROM signatures WHERE id > ?1";
        let count = self.connection.query_row(sql, [number], |row| row.get::<_, i64>(0));
        let count = count.map_err(|error| self.database_error("read the signatures of", &error))?;
        Ok(Some((first, count.unsigned_abs())))
    }

    /// Returns the persons' signatures on a cycle in order, each with its time, ms since 1970.
    ///
    /// # Errors
    /// If the signatures cannot be read, or a statement is damaged.
    pub fn person_signatures(&self, id: CycleId) -> Result<Vec<(i64, PersonSignature)>, StoreError> {
        let mut persons = Vec::new();
        for row in self.cycle_signatures(id)?.into_iter().filter(|row| row.is_of_person) {
            let statement =
                Statement::read(&self.blob(&row.record_hash)?).map_err(|source| self.signing_error(source))?;
            if let StatementContent::Person(person) = statement.says {
                persons.push((row.unix_ms, person));
            }
        }
        Ok(persons)
    }

    /// Returns the present head of the chain of signatures: the head, its canonical JSON, and its signature.
    ///
    /// # Errors
    /// If the signatures cannot be read.
    pub fn signed_head(&self, key: &CellKey) -> Result<(SignedHead, Vec<u8>, [u8; 64]), StoreError> {
        let row = self.signatures()?.pop();
        let head = SignedHead {
            form: HEAD_FORMAT.to_owned(),
            number: row.as_ref().map_or(0, |row| row.number),
            hash: row.map_or(CHAIN_START_HASH.to_owned(), |row| row.record_hash),
            unix_ms: unix_ms(self.clock()),
            public_key: key.public_key().hex(),
        };
        let bytes = crate::signing::canonical(&head).map_err(|source| self.signing_error(source))?;
        let signature = key.sign(&bytes);
        Ok((head, bytes, signature))
    }

    fn find_signatures(&self, condition: &str, value: Option<i64>) -> Result<Vec<SignatureRow>, StoreError> {
        let failed = |error: rusqlite::Error| self.database_error("read the signatures of", &error);
        let sql = format!("SELECT {COLUMNS} FROM signatures WHERE {condition} ORDER BY id");
        let mut statement = self.connection.prepare(&sql).map_err(failed)?;
        let rows = statement.query_map([value], SignatureRow::from_row).map_err(failed)?;
        rows.collect::<Result<_, _>>().map_err(failed)
    }

    pub(super) fn signature(&self, number: i64) -> Result<SignatureRow, StoreError> {
        let sql = format!("SELECT {COLUMNS} FROM signatures WHERE id = ?1");
        let row = self
            .connection
            .prepare_cached(&sql)
            .and_then(|mut row| row.query_row([number], SignatureRow::from_row));
        row.map_err(|error| self.database_error("read a signature of", &error))
    }

    fn cell_signature(&self, id: CycleId) -> Result<Option<SignatureRow>, StoreError> {
        Ok(self.cycle_signatures(id)?.into_iter().find(|row| !row.is_of_person))
    }

    fn unsigned_cycles(&self) -> Result<Vec<CycleId>, StoreError> {
        let read = || -> Result<Vec<CycleId>, rusqlite::Error> {
            let sql = "SELECT id FROM cycles WHERE verdict IS NOT NULL
                AND id NOT IN (SELECT cycle_id FROM signatures WHERE kind = ?1) ORDER BY id";
            self.connection.prepare(sql)?.query_map([CYCLE_SIGNATURE_SQL], |row| row.get(0).map(CycleId))?.collect()
        };
        read().map_err(|error| self.database_error("read the signatures of", &error))
    }

    fn check_not_signed(&self, signs: &PersonSigningRequest) -> Result<(), StoreError> {
        let same =
            |(_, person): &(i64, PersonSignature)| person.user == signs.user && person.meaning == signs.meaning;
        match self.person_signatures(signs.cycle)?.into_iter().find(same) {
            None => Ok(()),
            Some((unix_ms, person)) => Err(StoreError::AlreadySigned {
                name: person.name,
                cycle: signs.cycle.0,
                meaning: signs.meaning.printed_text(),
                at: utc_text(unix_ms.div_euclid(1_000)),
            }),
        }
    }

    /// Checks that the record permits a release, or its withdrawal. If the cycle passed, one person can release the
    /// part (`CycleRecord::is_released_by_one`). After any other verdict, another person must have accepted the
    /// deviation before, and the release needs a remark. No release is possible if the cycle tested no part, or if its
    /// record contradicts its verdict.
    fn check_meaning(&self, signs: &PersonSigningRequest) -> Result<(), StoreError> {
        let refused = |problem: String| {
            Err(StoreError::MeaningNotPermitted {
                cycle: signs.cycle.0,
                meaning: signs.meaning.printed_text(),
                problem,
            })
        };
        let earlier = self.person_signatures(signs.cycle)?;
        let has = |meaning: Meaning, is_other: bool| {
            earlier.iter().any(|(_, one)| one.meaning == meaning && (!is_other || one.user != signs.user))
        };
        match signs.meaning {
            Meaning::InspectedAndReleased => {}
            Meaning::ReleaseWithdrawn if !has(Meaning::InspectedAndReleased, false) => {
                return refused("no person has released it; sign \"inspected and not released\"".to_owned());
            }
            Meaning::ReleaseWithdrawn if signs.remark.is_none() => {
                return refused("state the reason in the remark".to_owned());
            }
            _ => return Ok(()),
        }
        let record = self.cycle(signs.cycle)?;
        if !record.has_examined_part() {
            return refused("this cycle tested no part; test the part in another cycle".to_owned());
        }
        if let Some(contradiction) = record.verdict_contradictions().into_iter().next() {
            return refused(contradiction);
        }
        if record.is_released_by_one() {
            return Ok(());
        }
        let verdict = record.judgement.map_or("none", |judgement| judgement.verdict.keyword());
        if !has(Meaning::DeviationAccepted, true) {
            return refused(format!(
                "the cycle's verdict is {verdict}: another person must first sign \"deviation accepted\""
            ));
        }
        match signs.remark {
            Some(_) => Ok(()),
            None => {
                refused(format!("the cycle's verdict is {verdict}: state the reason of the release in the remark"))
            }
        }
    }

    pub(super) fn signing_error(&self, source: SigningError) -> StoreError {
        StoreError::Signing { path: self.path().to_owned(), source }
    }
}

fn insert(writing: &WriteTransaction<'_>, id: i64, row: &SignatureRow) -> Result<usize, rusqlite::Error> {
    let kind = if row.is_of_person { PERSON_SIGNATURE_SQL } else { CYCLE_SIGNATURE_SQL };
    writing.execute(
        &format!("INSERT INTO signatures ({COLUMNS}) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)"),
        params![
            id,
            row.cycle.0,
            kind,
            row.unix_ms,
            row.record_hash,
            row.previous_hash,
            row.signature,
            row.public_key
        ],
    )
}
