//! The tables' version: looked at before anything is written, raised step by step.

use super::error::StoreError;
use super::{cycles, discs, journal, motions, teaching, verifications};
use rusqlite::{Connection, TransactionBehavior};
use std::path::Path;

/// The newest schema that this program knows. 1: taught panels. 2: cycles, findings, journal, motions.
/// 3: verifications. 4: discs. 5: strikes of verifications.
pub(super) const SCHEMA: i64 = 5;

/// The database's version; 0 is an empty one. Nothing is written: a database that is not ours stays as it is.
pub(super) fn version(connection: &Connection, path: &Path) -> Result<i64, StoreError> {
    let failed = |error: rusqlite::Error| StoreError::database("open", path, &error);
    match read(connection).map_err(failed)? {
        (0, 0) => Ok(0),
        (found, _) if (1..=SCHEMA).contains(&found) => Ok(found),
        (found, _) if found > SCHEMA => Err(StoreError::Newer { path: path.to_owned(), found, known: SCHEMA }),
        _ => Err(StoreError::Foreign { path: path.to_owned() }),
    }
}

/// The schema's version and the number of tables and indices.
fn read(connection: &Connection) -> Result<(i64, i64), rusqlite::Error> {
    let version = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    let entries = connection.query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0))?;
    Ok((version, entries))
}

/// SQLite's own look at every page; what it finds wrong.
pub(super) fn check(connection: &Connection, path: &Path) -> Result<(), StoreError> {
    let damaged = |problem: String| StoreError::Damaged { path: path.to_owned(), problem };
    let found: Result<String, _> = connection.pragma_query_value(None, "quick_check", |row| row.get(0));
    match found {
        Ok(word) if word == "ok" => Ok(()),
        Ok(problem) => Err(damaged(problem)),
        Err(error) => Err(damaged(error.to_string())),
    }
}

/// Sets the database to survive a power cut and brings its tables up to date, whole or not at all.
pub(super) fn prepare(connection: &mut Connection) -> Result<(), rusqlite::Error> {
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", "ON")?;
    let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let (found, _) = read(&transaction)?;
    if found < 1 {
        transaction.execute_batch(teaching::TABLES)?;
    }
    if found < 2 {
        transaction.execute_batch(cycles::TABLES)?;
        transaction.execute_batch(journal::TABLES)?;
        transaction.execute_batch(motions::TABLES)?;
    }
    if found < 3 {
        transaction.execute_batch(verifications::TABLES)?;
    }
    if found < 4 {
        transaction.execute_batch(discs::TABLES)?;
    }
    if found < 5 {
        transaction.execute_batch(verifications::STRIKES)?;
    }
    transaction.pragma_update(None, "user_version", SCHEMA)?;
    transaction.commit()
}
