//! The names of each cycle's part (serial number, work order, operator) as a table that can be searched.
//!
//! The authoritative text is the one that the cycle stores as the file `part`; the chain covers its hash. This table
//! is an index over those texts and is not part of the chain. It is written in the transaction that begins a cycle,
//! made anew for cycles of earlier programs, and `store verify` compares every row with its text.

use super::blobs::Blobs;
use super::commit::TransactionFailure;
use super::database::Store;
use super::error::StoreError;
use panelprep_cell::record::PartNames;
use rusqlite::{Connection, OptionalExtension, params};
use std::collections::BTreeMap;

pub(super) const TABLES: &str = "
    CREATE TABLE cycle_parts (
        cycle_id INTEGER PRIMARY KEY REFERENCES cycles (id),
        serial TEXT,
        work_order TEXT,
        operator TEXT
    ) STRICT;
    CREATE INDEX cycle_parts_by_serial ON cycle_parts (serial COLLATE NOCASE);
";

/// The same table as a temporary table, for a store that is open for reading and was written by an earlier version
/// of this program. It is removed when the store is closed.
const TEMPORARY_TABLE_SQL: &str =
    "CREATE TEMP TABLE cycle_parts (cycle_id INTEGER PRIMARY KEY, serial TEXT, work_order TEXT, operator TEXT)";

/// Returns the part's names from the texts of a new cycle.
pub(super) fn parse_part(file_texts: &[(String, String)]) -> Option<PartNames> {
    let (_, text) = file_texts.iter().find(|(name, _)| name == PartNames::FILE)?;
    PartNames::read(text)
}

/// Writes the names of a cycle's part. Part of a transaction.
pub(super) fn insert(connection: &Connection, cycle: i64, part: &PartNames) -> Result<(), TransactionFailure> {
    Ok(write(connection, cycle, part)?)
}

fn write(connection: &Connection, cycle: i64, part: &PartNames) -> Result<(), rusqlite::Error> {
    connection
        .prepare_cached("INSERT INTO cycle_parts (cycle_id, serial, work_order, operator) VALUES (?1, ?2, ?3, ?4)")?
        .execute(params![cycle, part.serial, part.order, part.operator])
        .map(drop)
}

/// Writes the names of every cycle that has no row. A missing or damaged text gives no names. Part of a
/// transaction.
pub(super) fn fill_missing(connection: &Connection, blobs: &Blobs) -> Result<(), rusqlite::Error> {
    let there = rows(connection)?;
    for (cycle, hash) in cycles_with_part(connection)? {
        if !there.contains_key(&cycle)
            && let Some(part) = text(blobs, &hash)
        {
            write(connection, cycle, &part)?;
        }
    }
    Ok(())
}

/// Returns each cycle that stores a part's text, with the text's hash.
fn cycles_with_part(connection: &Connection) -> Result<Vec<(i64, String)>, rusqlite::Error> {
    let sql =
        "SELECT cycles.id, value ->> 'hash' FROM cycles, json_each(files) WHERE value ->> 'name' = ?1 ORDER BY 1";
    let mut statement = connection.prepare(sql)?;
    statement.query_map([PartNames::FILE], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
}

fn text(blobs: &Blobs, hash: &str) -> Option<PartNames> {
    PartNames::read(&String::from_utf8(blobs.get(hash).ok()?).ok()?)
}

/// Returns the rows of the table by cycle.
fn rows(connection: &Connection) -> Result<BTreeMap<i64, PartNames>, rusqlite::Error> {
    let mut statement = connection.prepare("SELECT cycle_id, serial, work_order, operator FROM cycle_parts")?;
    let part = |row: &rusqlite::Row<'_>| {
        Ok((row.get(0)?, PartNames { serial: row.get(1)?, order: row.get(2)?, operator: row.get(3)? }))
    };
    statement.query_map([], part)?.collect()
}

/// Returns the rows that differ from the stored texts of their cycles, as text.
pub(super) fn differences(connection: &Connection, blobs: &Blobs) -> Result<Vec<String>, rusqlite::Error> {
    let (mut rows, mut found) = (rows(connection)?, Vec::new());
    for (cycle, hash) in cycles_with_part(connection)? {
        let row = rows.remove(&cycle);
        // The check of the files reports a missing or damaged text.
        let Some(part) = text(blobs, &hash) else { continue };
        match row {
            Some(row) if row == part => {}
            Some(_) => found.push(format!(
                "changed: the part of cycle {cycle} differs from the part that was recorded with the cycle"
            )),
            None => found.push(format!("deleted: the part of cycle {cycle} is missing from the table of parts")),
        }
    }
    let more =
        rows.keys().map(|cycle| format!("inserted: a part of cycle {cycle}, with which no part was recorded"));
    found.extend(more);
    Ok(found)
}

impl Store {
    /// The part of a cycle; `None` if none was named.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn cycle_part(&self, cycle: panelprep_cell::record::CycleId) -> Result<Option<PartNames>, StoreError> {
        self.ensure_parts_table()?;
        let sql = "SELECT serial, work_order, operator FROM cycle_parts WHERE cycle_id = ?1";
        let part = |row: &rusqlite::Row<'_>| {
            Ok(PartNames { serial: row.get(0)?, order: row.get(1)?, operator: row.get(2)? })
        };
        let read = || self.connection.prepare_cached(sql)?.query_row([cycle.0], part).optional();
        read().map_err(|error| self.database_error("read the parts of", &error))
    }

    /// Makes sure that there is a table of parts to read, also beside the store of an earlier version of this
    /// program.
    pub(super) fn ensure_parts_table(&self) -> Result<(), StoreError> {
        let made = || -> Result<(), rusqlite::Error> {
            if !self.connection.table_exists(None, "cycle_parts")? {
                self.connection.execute_batch(TEMPORARY_TABLE_SQL)?;
                fill_missing(&self.connection, &self.blobs)?;
            }
            Ok(())
        };
        made().map_err(|error| self.database_error("read the parts of", &error))
    }
}
