//! Checks that the archive contains everything that the cells have sent: no record number is missing, every content
//! matches its hash, every signature its key, every statement refers to the previous one, and every file is complete.
//! If a cell has supplied a list of its records, the archive must agree with this list.

use super::database::{self, ArchiveError};
use super::files::{ContentFiles, FileState};
use panelprep_cell::cell::CellName;
use panelprep_store::office::{ArchiveSettings, Body, ItemEnvelope, Kind, ListEntry, Message, Position, compare};
use panelprep_store::signing::{CHAIN_START_HASH, Statement};
use std::collections::{BTreeMap, BTreeSet};
use tokio_postgres::{Client, Row};

/// Number of records that are read in one query.
const BATCH_RECORDS: i64 = 500;
/// Maximum number of problems that are listed for a cell; further problems are only counted.
const MAX_LISTED_PROBLEMS: usize = 200;

/// A cell, with the list of its records.
#[derive(Debug, Clone)]
pub struct CellList {
    /// The name of the cell.
    pub cell: CellName,
    /// The cell's list, the output of `panelprep store list`.
    pub entries: Vec<ListEntry>,
}

/// The result of the check for one cell.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CheckedCell {
    /// The name of the cell.
    pub cell: String,
    /// Number of records of the cell.
    pub records: u64,
    /// Number of valid signatures of records.
    pub signatures: u64,
    /// Number of complete files that the records name.
    pub files: u64,
    /// Number of files that the cell had already removed before it sent the record.
    pub missing_in_cell: u64,
    /// Number of records that are in the cell's list with the same hash; `None` without a list.
    pub matching: Option<u64>,
    /// The public keys of the signatures on the cell's statements.
    pub keys: Vec<String>,
    /// The problems, as texts.
    pub problems: Vec<String>,
}

/// Checks all cells in the archive, and all cells that supplied a list.
///
/// # Errors
/// If the database or the folder of files cannot be read.
pub async fn check_archive(
    settings: &ArchiveSettings,
    lists: &[CellList],
) -> Result<Vec<CheckedCell>, ArchiveError> {
    let client = database::open(&settings.database).await?;
    let files = ContentFiles::in_folder(&settings.files);
    let rows = client.query("SELECT DISTINCT cell FROM records", &[]).await;
    let rows = rows.map_err(ArchiveError::database("read its cells"))?;
    let mut cells: BTreeSet<String> = rows.iter().map(|row| row.get(0)).collect();
    cells.extend(lists.iter().map(|list| list.cell.as_str().to_owned()));
    let mut checked = Vec::new();
    for cell in cells {
        let list = lists.iter().find(|list| list.cell.as_str() == cell);
        checked.push(check_cell(&client, &files, &cell, list).await?);
    }
    Ok(checked)
}

async fn check_cell(
    client: &Client,
    files: &ContentFiles,
    cell: &str,
    list: Option<&CellList>,
) -> Result<CheckedCell, ArchiveError> {
    let mut checked = CheckedCell { cell: cell.to_owned(), ..CheckedCell::default() };
    let mut statements = BTreeMap::new();
    let mut office: Vec<ListEntry> = Vec::new();
    let mut after = Position { epoch: String::new(), number: 0 };
    loop {
        let page = read_batch(client, cell, &after).await?;
        if page.is_empty() {
            break;
        }
        for row in &page {
            let listed = check_record(row, cell, &mut checked, &mut statements);
            check_gap(&after, &listed.position, &mut checked.problems);
            after = listed.position.clone();
            if list.is_some() {
                office.push(listed);
            }
        }
    }
    checked.problems.extend(find_chain_breaks(&statements));
    contradictions(client, cell, &mut checked).await?;
    check_files(client, files, cell, &mut checked).await?;
    if let Some(list) = list {
        let compared = compare(&list.entries, &office);
        checked.matching = Some(compared.equal_items);
        checked.problems.extend(compared.differences);
    }
    let rest = checked.problems.len().saturating_sub(MAX_LISTED_PROBLEMS);
    checked.problems.truncate(MAX_LISTED_PROBLEMS);
    checked.problems.extend((rest > 0).then(|| format!("{rest} more problems are not listed")));
    Ok(checked)
}

async fn read_batch(client: &Client, cell: &str, after: &Position) -> Result<Vec<Row>, ArchiveError> {
    let sql = "SELECT epoch, number, kind, unix_ms, hash, content, signature, public_key FROM records
        WHERE cell = $1 AND (epoch, number) > ($2, $3) ORDER BY epoch, number LIMIT $4";
    let number = i64::try_from(after.number).unwrap_or(i64::MAX);
    let rows = client.query(sql, &[&cell, &after.epoch, &number, &BATCH_RECORDS]).await;
    rows.map_err(ArchiveError::database("read its records"))
}

fn position(row: &Row) -> Position {
    Position { epoch: row.get(0), number: row.get::<_, i64>(1).unsigned_abs() }
}

/// The hash of a statement, and the hash of the previous statement that it contains.
type Link = (String, String);

/// Checks a row of the table of records: rebuilds the message, and verifies its hash and its signature.
fn check_record(
    row: &Row,
    cell: &str,
    checked: &mut CheckedCell,
    statements: &mut BTreeMap<u64, Vec<Link>>,
) -> ListEntry {
    let position = position(row);
    let word: String = row.get(2);
    let (unix_ms, hash, content): (i64, String, Vec<u8>) = (row.get(3), row.get(4), row.get(5));
    let (signature, public_key): (Option<Vec<u8>>, Option<String>) = (row.get(6), row.get(7));
    checked.records += 1;
    let name = format!("number {} of epoch {}", position.number, position.epoch);
    let kind = Kind::from_keyword(&word);
    let body = match (kind, signature, public_key) {
        (Some(Kind::Cycle), None, None) => Some(Body::Cycle(content)),
        (Some(Kind::Verification), None, None) => Some(Body::Verification(content)),
        (Some(Kind::Signature), Some(signature), Some(public_key)) => {
            Some(Body::Signature { statement: content, signature, public_key, files: Vec::new() })
        }
        _ => None,
    };
    let Some(body) = body else {
        checked.problems.push(format!("{name}: the kind \"{word}\" does not match the rest of the row"));
        return ListEntry { position, kind: kind.unwrap_or(Kind::Cycle), hash };
    };
    let envelope = ItemEnvelope { position, unix_ms, body };
    let listed = envelope.list_line();
    if listed.hash != hash {
        checked
            .problems
            .push(format!("{name} was changed: its SHA-256 is {}, but {hash} was received", listed.hash));
    }
    match reread_message(cell, envelope) {
        Err(problem) => checked.problems.push(format!("{name}: {problem}")),
        Ok(Some((statement, public_key))) => {
            checked.signatures += 1;
            if !checked.keys.contains(&public_key) {
                checked.keys.push(public_key);
            }
            statements.entry(statement.number).or_default().push((listed.hash.clone(), statement.previous));
        }
        Ok(None) => {}
    }
    listed
}

/// Rebuilds the received message from a stored record and parses it, so that its signature is verified again.
fn reread_message(cell: &str, envelope: ItemEnvelope) -> Result<Option<(Statement, String)>, String> {
    let message = Message { cell: CellName::new(cell)?, envelope };
    let bytes = message.bytes().map_err(|error| error.to_string())?;
    let read = Message::read(&bytes).map_err(|error| error.to_string())?;
    match read.envelope.body {
        Body::Signature { statement, public_key, .. } => {
            let statement = Statement::read(&statement).map_err(|error| error.to_string())?;
            Ok(Some((statement, public_key)))
        }
        Body::Cycle(_) | Body::Verification(_) => Ok(None),
    }
}

fn check_gap(before: &Position, here: &Position, found: &mut Vec<String>) {
    let first = if before.epoch == here.epoch { before.number + 1 } else { 1 };
    let last = here.number - 1;
    if first > last {
        return;
    }
    let numbers = if first == last { format!("record {first}") } else { format!("records {first} to {last}") };
    found.push(format!("{numbers} of epoch {}: not received", here.epoch));
}

/// Finds missing statements, statements without the hash of the previous one, and statements with the same number.
fn find_chain_breaks(statements: &BTreeMap<u64, Vec<Link>>) -> Vec<String> {
    let mut found = Vec::new();
    let mut before: Option<(u64, &str)> = None;
    for (number, links) in statements {
        let hashes: BTreeSet<&str> = links.iter().map(|(hash, _)| hash.as_str()).collect();
        if hashes.len() > 1 {
            found.push(format!(
                "there are {} signed records with the number {number}: the chain was forked: check whether two stores use the key of this cell",
                hashes.len()
            ));
        }
        let expected = match before {
            Some((last, hash)) if last + 1 == *number => Some(hash),
            None if *number == 1 => Some(CHAIN_START_HASH),
            _ => {
                let first = before.map_or(1, |(last, _)| last + 1);
                found.push(format!("signed records {first} to {} are missing", number - 1));
                None
            }
        };
        let Some((hash, previous)) = links.first() else { continue };
        if expected.is_some_and(|expected| expected != previous) {
            found.push(format!(
                "the chain is broken: signed record {number} does not contain the hash of record {}",
                number - 1
            ));
        }
        before = Some((*number, hash));
    }
    found
}

async fn contradictions(client: &Client, cell: &str, checked: &mut CheckedCell) -> Result<(), ArchiveError> {
    let sql = "SELECT epoch, number, hash FROM contradictions WHERE cell = $1 ORDER BY epoch, number";
    let rows = client.query(sql, &[&cell]).await.map_err(ArchiveError::database("read contradictions"))?;
    checked.problems.extend(rows.iter().map(|row| {
        let Position { epoch, number } = position(row);
        let hash: String = row.get(2);
        format!("record {number} of epoch {epoch} was received a second time with other content, SHA-256 {hash}")
    }));
    Ok(())
}

async fn check_files(
    client: &Client,
    files: &ContentFiles,
    cell: &str,
    checked: &mut CheckedCell,
) -> Result<(), ArchiveError> {
    let sql = "SELECT hash, min(name), bool_and(gone IS NOT NULL) FROM record_files WHERE cell = $1 GROUP BY hash";
    let rows = client.query(sql, &[&cell]).await.map_err(ArchiveError::database("read the files of records"))?;
    for row in rows {
        let (hash, name, is_gone): (String, String, bool) = (row.get(0), row.get(1), row.get(2));
        match files.file_state(&hash)? {
            FileState::Whole => checked.files += 1,
            FileState::Missing if is_gone => checked.missing_in_cell += 1,
            FileState::Missing => checked.problems.push(format!("the file {hash}, {name}, was not received")),
            FileState::Damaged(found) => {
                checked.problems.push(format!("the file {hash}, {name}, is damaged: its SHA-256 is {found}"));
            }
        }
    }
    Ok(())
}
