//! Verifies that the store contains exactly the data that were written. Changed, deleted, inserted, reordered and
//! rolled-back data are reported.
//!
//! Each signature is verified with its public key, all signatures with their chain, and the signed records are compared
//! with the present rows. Rows that were changed together with the store's own chain and head contradict their signed
//! records.

use super::chain::{ChainPosition, HASHED_TABLES, Hash, HashedTable};
use super::database::{DATABASE, Store};
use super::error::StoreError;
use super::flush::{file_hash, log_path};
use super::signatures::SignatureRow;
use super::{chain, head, prune, schema, search};
use crate::signing::{self, NameClaim, PublicKey, Signed, SignedCycle, Statement, StatementContent, differences};
use panelprep_cell::files::hex;
use panelprep_cell::record::CycleId;
use rusqlite::{Connection, Row};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Maximum number of links that a start verifies: all links in a small store, and the links since the last checkpoint
/// in a large one.
const START_VERIFIED_LINKS: i64 = 20_000;
/// Maximum number of differences of the same kind that are listed; further ones are only counted.
const MAX_LISTED_DIFFERENCES: usize = 200;

/// The result of verifying a store.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct StoreVerification {
    /// Differences from the data that were written, as texts.
    pub differences: Vec<String>,
    /// Differences that an earlier start stored as an incident and that can no longer be detected, such as missing
    /// lines.
    pub earlier_differences: Vec<String>,
    /// Number of links in the hash chain.
    pub links: u64,
    /// Number of files that were read and are unchanged.
    pub files: u64,
    /// Number of files that the service has removed according to `[store] keep`.
    pub pruned: u64,
    /// Number of signatures of the cell and of persons; they are verified only together with the files.
    pub signatures: u64,
    /// The public keys of the signatures; more than one if the cell's key was replaced.
    pub keys: Vec<String>,
}

/// How a row or a link differs from what was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum RowFault {
    Changed,
    Missing,
    PutIn,
    Unreadable,
    Twice,
}

/// The state of a walk along the chain.
#[derive(Default)]
struct ChainWalk {
    faults: Vec<(&'static str, RowFault, i64)>,
    links: Vec<String>,
    /// The changed rows, each with the hash of what was written and the hash of the present values.
    changed: Vec<(&'static str, i64, Hash, Hash)>,
    written: BTreeMap<&'static str, Vec<i64>>,
    /// For tables whose columns may be written again: the last hash of each row.
    last: BTreeMap<(&'static str, i64), Hash>,
    count: u64,
}

impl Store {
    /// Verifies the store in this folder, also while a service writes to it; with `files`, also its files and
    /// signatures.
    ///
    /// # Errors
    /// If there is no store, it was written by an earlier program version, or its database cannot be opened. Unreadable
    /// content is a difference, not an error.
    pub fn verify(folder: &Path, files: bool) -> Result<StoreVerification, StoreError> {
        let path = folder.join(DATABASE);
        // The database file is hashed before a connection is opened, because closing the file would release the locks
        // of the connection.
        let log = std::fs::metadata(log_path(&path)).map_or(0, |log| log.len());
        let hash = if log == 0 { file_hash(&path).ok() } else { None };
        let store = match Store::open(folder) {
            Ok(store) => store,
            Err(StoreError::Damaged { problem, .. }) => {
                let found = vec![format!("the database is damaged: {problem}")];
                return Ok(StoreVerification { differences: found, ..StoreVerification::default() });
            }
            Err(error) => return Err(error),
        };
        let begin = || -> Result<ChainPosition, rusqlite::Error> {
            store.connection.execute_batch("BEGIN")?;
            chain::last_link(&store.connection)
        };
        let head_read = head::read_locked(folder, begin);
        let (head_read, last) = match head_read {
            Ok((head_read, last)) => (Ok(head_read), last),
            Err(error) => (Err(error), begin()),
        };
        let mut verified = StoreVerification::default();
        match last {
            Ok(last) => store.verify_rows((head_read, last), hash, &mut verified)?,
            Err(error) => verified.differences.push(format!("the chain cannot be read: {error}")),
        }
        if files {
            store.verify_files(&mut verified);
            store.verify_signatures(&mut verified);
        }
        Ok(verified)
    }

    fn verify_rows(
        &self,
        (head_read, last): (Result<Option<head::HeadRead>, std::io::Error>, ChainPosition),
        hash: Option<Hash>,
        verified: &mut StoreVerification,
    ) -> Result<(), StoreError> {
        let database = head_read.as_ref().ok().copied().flatten().and_then(|read| read.head.database);
        verified.differences.extend(self.end_contradictions(head_read, last)?);
        let (found, links) = self.contradictions_after(ChainPosition::START, true);
        verified.differences.extend(found);
        verified.links = links;
        verified
            .differences
            .extend(schema::differences(&self.connection).unwrap_or_else(|error| vec![error.to_string()]));
        let parts = search::part_differences(&self.connection, &self.blobs);
        verified.differences.extend(parts.unwrap_or_else(|error| {
            vec![format!("the table of parts cannot be read: {error}; check the disk and verify again")]
        }));
        if let (Some(written), Some(found)) = (database, hash)
            && written != found
        {
            verified.differences.push(format!(
                "the file {DATABASE} was changed after the program closed it: its SHA-256 is {}, expected {}",
                hex(&found),
                hex(&written)
            ));
        }
        let incidents = match self.incidents() {
            Ok(incidents) => incidents,
            Err(error) => {
                verified.differences.push(error.to_string());
                return Ok(());
            }
        };
        let is_open = self.is_change_unreviewed();
        for (index, incident) in incidents.iter().enumerate() {
            for words in incident
                .found
                .iter()
                .filter(|words| !verified.differences.contains(words))
                .cloned()
                .collect::<Vec<_>>()
            {
                if is_open && index + 1 == incidents.len() {
                    verified.differences.push(words);
                } else {
                    verified.earlier_differences.push(words);
                }
            }
        }
        Ok(())
    }

    fn verify_files(&self, verified: &mut StoreVerification) {
        match prune::named_files(self, &|_| false) {
            Ok(named) => {
                let removed = prune::removed_files(self).unwrap_or_default();
                let folder = self.folder().join("blobs");
                for hash in named {
                    match self.blob(&hash) {
                        Ok(_) => verified.files += 1,
                        Err(_) if removed.contains(&hash) && !folder.join(&hash).exists() => verified.pruned += 1,
                        Err(StoreError::File { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                            verified
                                .differences
                                .push(format!("the file blobs/{hash} is missing, and no removal was recorded"));
                        }
                        Err(error) => verified.differences.push(error.to_string()),
                    }
                }
            }
            Err(error) => verified.differences.push(error.to_string()),
        }
    }

    /// Returns whether a change of the store was found, and no person has cleared the cell since then.
    fn is_change_unreviewed(&self) -> bool {
        use panelprep_cell::cycle::{At, Cause};
        self.state().is_ok_and(|state| {
            matches!(
                state.at,
                At::Aborted { cause: Cause::StoreChanged } | At::Clearing { cause: Cause::StoreChanged }
            )
        })
    }

    /// Returns contradictions between the end of the chain and the head outside of the database, as texts.
    pub(super) fn end_contradictions(
        &self,
        head_read: Result<Option<head::HeadRead>, std::io::Error>,
        last: ChainPosition,
    ) -> Result<Vec<String>, StoreError> {
        let read = match head_read {
            Ok(Some(read)) => read,
            Ok(None) if last == ChainPosition::START => return Ok(vec![]),
            Ok(None) => return Ok(vec![format!("the head of the chain, {}, is missing", head::FILE)]),
            Err(error) => {
                return Ok(vec![format!("the head of the chain, {}, cannot be read: {error}", head::FILE)]);
            }
        };
        let mut found = Vec::new();
        if read.is_damaged {
            found.push(format!("one of the two copies in {} is damaged", head::FILE));
        }
        let (at, end) = (read.head.position, last.link);
        if read.head.allows_position(last) {
            return Ok(found);
        }
        let here = if at.link == 0 { Ok(Some(ChainPosition::START.hash)) } else { self.link_hash(at.link) };
        found.push(match here {
            _ if at.link > end => format!(
                "rolled back: {} entries at the end of the chain are missing, links {} to {}; the hash in the head \
                 file is {}",
                at.link - end,
                end + 1,
                at.link,
                hex(&at.hash)
            ),
            Ok(Some(hash)) if hash == at.hash => format!(
                "{} entries at the end of the chain were not added by this program, links {} to {end}",
                end - at.link,
                at.link + 1
            ),
            Ok(_) => format!(
                "the chain was rewritten: link {} does not have the hash in the head file, {}",
                at.link,
                hex(&at.hash)
            ),
            Err(error) => format!("the chain cannot be read: {error}"),
        });
        Ok(found)
    }

    pub(super) fn link_hash(&self, link: i64) -> Result<Option<Hash>, rusqlite::Error> {
        use rusqlite::OptionalExtension;
        self.connection.query_row("SELECT hash FROM chain WHERE link = ?1", [link], |row| row.get(0)).optional()
    }

    /// Returns contradictions between the recently written rows and the chain, as texts.
    pub(super) fn recent_contradictions(&self) -> Result<Vec<String>, StoreError> {
        let read = |error: rusqlite::Error| self.database_error("read the chain of", &error);
        let last = chain::last_link(&self.connection).map_err(read)?;
        if last.link <= START_VERIFIED_LINKS {
            return Ok(self.contradictions_after(ChainPosition::START, true).0);
        }
        let sql = "SELECT max(0, link - 1) FROM chain WHERE part = 'checkpoints' ORDER BY link DESC LIMIT 1";
        let from: i64 =
            self.connection.query_row(sql, [], |row| row.get(0)).unwrap_or(last.link - START_VERIFIED_LINKS);
        let hash = self.link_hash(from).map_err(read)?.unwrap_or(ChainPosition::START.hash);
        Ok(self.contradictions_after(ChainPosition { link: from, hash }, false).0)
    }

    /// Verifies the chain after this position. Returns the contradictions as texts, and the number of links that were
    /// read. With `whole`, rows without a link are searched as well.
    fn contradictions_after(&self, from: ChainPosition, whole: bool) -> (Vec<String>, u64) {
        let mut walk = ChainWalk::default();
        let walked = walk
            .chain(&self.connection, from)
            .and_then(|()| if whole { walk.find_rows_without_one_link(&self.connection) } else { Ok(()) });
        let mut found = std::mem::take(&mut walk.links);
        let rest = found.len().saturating_sub(MAX_LISTED_DIFFERENCES);
        found.truncate(MAX_LISTED_DIFFERENCES);
        found.extend(
            (rest > 0).then(|| format!("{rest} further links of the chain do not match the links before them")),
        );
        let count = walk.count;
        found.extend(walk.describe_findings());
        found.extend(walked.err().map(|error| format!("the chain or a row cannot be read: {error}")));
        (found, count)
    }
}

impl ChainWalk {
    /// Reads the links after this position, and the rows to which they belong.
    fn chain(&mut self, connection: &Connection, from: ChainPosition) -> Result<(), rusqlite::Error> {
        let sql = "SELECT link, part, row_key, row_hash, hash FROM chain WHERE link > ?1 ORDER BY link";
        let mut statement = connection.prepare(sql)?;
        let mut rows = statement.query([from.link])?;
        let mut before = from;
        while let Some(row) = rows.next()? {
            before = self.link(connection, before, row)?;
        }
        for ((name, key), row_hash) in std::mem::take(&mut self.last) {
            if let Some(part) = chain::hashed_table(name) {
                self.row(connection, (part, key), row_hash);
            }
        }
        Ok(())
    }

    fn link(
        &mut self,
        connection: &Connection,
        before: ChainPosition,
        row: &Row<'_>,
    ) -> Result<ChainPosition, rusqlite::Error> {
        let (link, name, key): (i64, String, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
        let (row_hash, hash): (Hash, Hash) = (row.get(3)?, row.get(4)?);
        self.count += 1;
        if link != before.link + 1 {
            self.links.push(format!("links {} to {} of the chain are missing", before.link + 1, link - 1));
        }
        let expected = ChainPosition { link: link - 1, ..before }.next_position(&name, key, &row_hash);
        if expected.hash != hash {
            self.links.push(format!("link {link} of the chain was changed or moved"));
        }
        match chain::hashed_table(&name) {
            None => self.links.push(format!("link {link} of the chain names an unknown table: {name}")),
            Some(part) if part.is_replaced => {
                self.last.insert((part.name, key), row_hash);
                self.written.entry(part.name).or_default().push(key);
            }
            Some(part) => {
                self.written.entry(part.name).or_default().push(key);
                self.row(connection, (part, key), row_hash);
            }
        }
        Ok(ChainPosition { link, hash })
    }

    fn row(&mut self, connection: &Connection, (part, key): (&'static HashedTable, i64), row_hash: Hash) {
        let wrong = match chain::row_hash(connection, part, key) {
            Ok(Some(found)) if found == row_hash => return,
            Ok(Some(found)) => {
                self.changed.push((part.name, key, row_hash, found));
                RowFault::Changed
            }
            Ok(None) => RowFault::Missing,
            Err(_) => RowFault::Unreadable,
        };
        self.faults.push((part.name, wrong, key));
    }

    /// Finds rows without a link, and rows with too many links.
    fn find_rows_without_one_link(&mut self, connection: &Connection) -> Result<(), rusqlite::Error> {
        for part in &HASHED_TABLES {
            let mut written = self.written.remove(part.name).unwrap_or_default();
            written.sort_unstable();
            if !part.is_replaced {
                let twice = written.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]);
                self.faults.extend(twice.map(|key| (part.name, RowFault::Twice, key)));
            }
            let HashedTable { table, key, is_written_sql: condition, .. } = part;
            // Read the table without an index, because the index may be damaged independently of the table.
            let sql = format!("SELECT {key} FROM {table} NOT INDEXED WHERE {condition}");
            let mut statement = connection.prepare(&sql)?;
            let mut rows = statement.query([])?;
            while let Some(row) = rows.next()? {
                let key: i64 = row.get(0)?;
                if written.binary_search(&key).is_err() {
                    self.faults.push((part.name, RowFault::PutIn, key));
                }
            }
        }
        Ok(())
    }

    /// Returns all differences as texts; consecutive rows are reported together.
    fn describe_findings(mut self) -> Vec<String> {
        let mut sentences = Vec::new();
        let exchanged: Vec<(&str, i64, i64)> = self
            .changed
            .iter()
            .filter_map(|(part, key, _, found)| {
                let from = |(other, number, written, _): &&(&'static str, i64, Hash, Hash)| {
                    other == part && number != key && written == found
                };
                Some((*part, *key, self.changed.iter().take(MAX_LISTED_DIFFERENCES).find(from)?.1))
            })
            .take(MAX_LISTED_DIFFERENCES)
            .collect();
        for (name, key, from) in &exchanged {
            let words = chain::hashed_table(name).map_or(*name, |part| part.row_term);
            sentences.push(format!("reordered: {words} {key} contains what was written as {words} {from}"));
        }
        self.faults
            .retain(|(name, _, key)| !exchanged.iter().any(|(part, number, _)| part == name && number == key));
        self.faults.sort_unstable();
        let mut index = 0;
        while index < self.faults.len() {
            let (name, wrong, first) = self.faults[index];
            let mut last = first;
            index += 1;
            while let Some((next, same, key)) = self.faults.get(index)
                && (*next, *same, *key) == (name, wrong, last + 1)
            {
                (last, index) = (last + 1, index + 1);
            }
            let words = chain::hashed_table(name).map_or(name, |part| part.row_term);
            let range =
                if first == last { format!("{words} {first}") } else { format!("{words} {first} to {last}") };
            sentences.push(match wrong {
                RowFault::Changed => format!("changed: {range} differs from what was written"),
                RowFault::Missing => format!("deleted: {range} is missing"),
                RowFault::PutIn => format!("inserted: {range} was not written by this program"),
                RowFault::Unreadable => format!("damaged: {range} cannot be read"),
                RowFault::Twice => format!("changed: {range} was written a second time"),
            });
        }
        sentences
    }
}

impl Store {
    /// Verifies the signatures, and adds their number and the contradictions to the result.
    fn verify_signatures(&self, verified: &mut StoreVerification) {
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
        // Missing signatures before the first one are reported by `check_no_gaps` instead.
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

    /// Returns the contradictions between the present rows and a signed statement, as texts.
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

/// Returns a text if signatures before the first present one are missing.
fn check_no_gaps(rows: &[SignatureRow]) -> Option<String> {
    let first = rows.first()?.number;
    (first > 1).then(|| format!("signatures 1 to {} are missing", first - 1))
}
