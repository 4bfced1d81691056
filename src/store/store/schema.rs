//! The schema: its number is checked before any write, and the tables are created and updated step by step.

use super::chain::ChainPosition;
use super::error::StoreError;
use super::{
    alarms, chain, cycles, journal, motions, outbox, people, prune, requests, search, signatures, teaching,
    verifications,
};
use rusqlite::Connection;
use std::path::Path;
use std::sync::OnceLock;

/// The steps from each schema to the next one; schema 0 is an empty database. A released step is never changed: a later
/// version of this program adds one.
const STEPS: [fn(&Connection) -> Result<(), rusqlite::Error>; 1] = [create_tables];
/// The newest schema that this program supports.
pub(super) const SCHEMA: i64 = STEPS.len() as i64;

/// Returns the schema of the database; 0 for an empty database. Nothing is written: a database of another program stays
/// unchanged.
pub(super) fn version(connection: &Connection, path: &Path) -> Result<i64, StoreError> {
    let failed = |error: rusqlite::Error| StoreError::database("open", path, &error);
    match read(connection).map_err(failed)? {
        (0, 0) => Ok(0),
        (found, _) if (1..=SCHEMA).contains(&found) => Ok(found),
        (found, _) if found > SCHEMA => Err(StoreError::Newer { path: path.to_owned(), found, known: SCHEMA }),
        _ => Err(StoreError::Foreign { path: path.to_owned() }),
    }
}

/// Reads the number of the schema, and the number of tables and indices.
fn read(connection: &Connection) -> Result<(i64, i64), rusqlite::Error> {
    let version = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let entries = connection.query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0))?;
    Ok((version, entries))
}

/// Maximum size of a database that is checked page by page when it is opened, because the check needs a second for each
/// 200 MB. In every database, the rows that are read are compared with the chain, and `panelprep store verify` checks
/// the whole database.
const MAX_CHECKED_BYTES: u64 = 64 << 20;

/// Runs SQLite's own check of every page, except in a database above `MAX_CHECKED_BYTES`. Returns an error if a page
/// is damaged.
pub(super) fn check_pages(connection: &Connection, path: &Path) -> Result<(), StoreError> {
    if std::fs::metadata(path).is_ok_and(|file| file.len() > MAX_CHECKED_BYTES) {
        return Ok(());
    }
    let damaged = |problem: String| StoreError::Damaged { path: path.to_owned(), problem };
    let found: Result<String, _> = connection.pragma_query_value(None, "quick_check", |row| row.get(0));
    match found {
        Ok(word) if word == "ok" => Ok(()),
        Ok(problem) => Err(damaged(problem)),
        Err(error) => Err(damaged(error.to_string())),
    }
}

/// Configures the database to survive a power cut.
pub(super) fn prepare(connection: &Connection) -> Result<(), rusqlite::Error> {
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", "ON")
}

/// Refuses a store of an earlier schema: only a start of the service updates its tables.
pub(super) fn require_current(found: i64, folder: &Path) -> Result<(), StoreError> {
    match found < SCHEMA {
        true => Err(StoreError::Older { path: folder.to_owned(), found, known: SCHEMA }),
        false => Ok(()),
    }
}

/// Performs the missing steps in the present transaction. Returns the chain's end if anything was changed.
pub(super) fn update(transaction: &Connection) -> Result<Option<ChainPosition>, rusqlite::Error> {
    let (found, _) = read(transaction)?;
    if found == SCHEMA {
        return Ok(None);
    }
    STEPS.iter().skip(usize::try_from(found).unwrap_or(0)).try_for_each(|step| step(transaction))?;
    transaction.pragma_update(None, "user_version", SCHEMA)?;
    chain::last_link(transaction).map(Some)
}

/// Creates the tables of schema 1 in an empty database, and the first epoch of the rows for the office.
fn create_tables(connection: &Connection) -> Result<(), rusqlite::Error> {
    for tables in [
        teaching::TABLES,
        cycles::TABLES,
        journal::TABLES,
        motions::TABLES,
        verifications::TABLES,
        requests::TABLES,
        people::TABLES,
        search::TABLES,
        alarms::TABLES,
        signatures::TABLES,
        outbox::TABLES,
        prune::TABLES,
        chain::TABLES,
    ] {
        connection.execute_batch(tables)?;
    }
    outbox::begin_first_epoch(connection)
}

/// Returns the differences between the tables and indices of the database and those of this program, without SQLite's
/// own.
pub(super) fn differences(connection: &Connection) -> Result<Vec<String>, rusqlite::Error> {
    let (ours, found) = (own_schema_entries()?, entries(connection)?);
    let gone = ours
        .iter()
        .filter(|entry| !found.contains(entry))
        .map(|(name, _)| format!("{name} was changed or is missing"));
    let more = found.iter().filter(|(name, _)| !ours.iter().any(|(own, _)| own == name));
    let more = more.map(|(name, _)| format!("{name} does not belong to this program"));
    let mut problems: Vec<String> =
        gone.chain(more).map(|words| format!("in the database's schema: {words}")).collect();
    let check: String = connection.query_row("PRAGMA integrity_check", [], |row| row.get(0))?;
    problems.extend((check != "ok").then(|| format!("the database is damaged: {check}")));
    Ok(problems)
}

/// Returns the tables and indices of this program's own schema, which is created once per process.
fn own_schema_entries() -> Result<&'static [(String, String)], rusqlite::Error> {
    static OWN: OnceLock<Vec<(String, String)>> = OnceLock::new();
    if let Some(known) = OWN.get() {
        return Ok(known);
    }
    let ours = Connection::open_in_memory()?;
    update(&ours)?;
    let made = entries(&ours)?;
    Ok(OWN.get_or_init(|| made))
}

/// Returns the name and the SQL text of each table, index, view and trigger; the text is without spaces.
fn entries(connection: &Connection) -> Result<Vec<(String, String)>, rusqlite::Error> {
    let sql = "SELECT type || ' ' || name, coalesce(sql, '') FROM sqlite_master WHERE name NOT LIKE 'sqlite_%'";
    let entry = |row: &rusqlite::Row<'_>| {
        let text: String = row.get(1)?;
        Ok((row.get(0)?, text.split_whitespace().collect()))
    };
    connection.prepare(sql)?.query_map([], entry)?.collect()
}
