//! The search for cycles: a query of `history` in SQL. The next page begins at a cycle number, not at a row offset, so
//! that new cycles do not shift the pages.
//!
//! The names of each cycle's part (serial number, work order, operator) are in a table that can be searched. The
//! authoritative text is the one that the cycle stores as the file `part`; the chain covers its hash. The table is an
//! index over those texts and is not part of the chain. It is written in the transaction that begins a cycle, and
//! `store verify` compares every row with its text.

use super::blobs::Blobs;
use super::commit::TransactionFailure;
use super::database::Store;
use super::error::StoreError;
use crate::history::{Hit, Hits, Query, RequiredEnd};
use panelprep_base::verdict::Verdict;
use panelprep_cell::record::{CycleId, NO_PART, PartNames};
use rusqlite::types::Value;
use rusqlite::{Connection, OptionalExtension, Row, params, params_from_iter};
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

/// The SQL conditions of a query, with the values of their placeholders in order.
#[derive(Default)]
struct SqlConditions {
    sql: Vec<String>,
    values: Vec<Value>,
}

impl SqlConditions {
    fn add(&mut self, sql: &str, value: Option<impl Into<Value>>) {
        if let Some(value) = value {
            self.sql.push(sql.to_owned());
            self.values.push(value.into());
        }
    }

    /// Adds the condition that a column matches a name, in which `*` matches any characters.
    fn name(&mut self, column: &str, name: Option<&String>) {
        let Some(name) = name else { return };
        if name.contains('*') {
            let pattern = escape_like(name).replace('*', "%");
            self.add(&format!("{column} LIKE ? ESCAPE '\\'"), Some(pattern));
        } else {
            self.add(&format!("{column} = ? COLLATE NOCASE"), Some(name.clone()));
        }
    }

    fn from_query(query: &Query) -> Self {
        let mut all = SqlConditions::default();
        all.name("serial", query.serial.as_ref());
        all.name("work_order", query.order.as_ref());
        all.name("operator", query.operator.as_ref());
        all.name("panel", query.panel.as_ref());
        all.add("started_unix_s >= ?", query.from_unix_s);
        all.add("started_unix_s < ?", query.until_unix_s);
        all.add("cycles.id < ?", query.before_cycle.map(|id| id.0));
        match query.end {
            Some(RequiredEnd::With(verdict)) => all.add("verdict = ?", Some(verdict.keyword().to_owned())),
            Some(RequiredEnd::Running) => all.sql.push("verdict IS NULL".to_owned()),
            None => {}
        }
        for word in &query.words {
            // Only code and message are searched, because the text of the column also contains the names of JSON keys.
            let sql = "EXISTS (SELECT 1 FROM json_each(reasons)
                       WHERE (value ->> 'code') || ' ' || (value ->> 'message') LIKE ? ESCAPE '\\')";
            all.add(sql, Some(format!("%{}%", escape_like(word))));
        }
        all
    }
}

/// Escapes `%`, `_` and `\` for a LIKE pattern.
fn escape_like(text: &str) -> String {
    text.replace('\\', "\\\\").replace('%', "\\%").replace('_', "\\_")
}

/// SQL condition: a motion of the cycle is that of an air-run.
const MOVED_IN_AIR_SQL: &str =
    "EXISTS (SELECT 1 FROM motions WHERE cycle_id = cycles.id AND motion ->> 'path' = 'air')";
/// SQL condition that an air-run was requested.
const REQUESTED_AIR_RUN_SQL: &str = "EXISTS (SELECT 1 FROM requests WHERE cycle_id = cycles.id
    AND json_type(request, '$.wanted.for.air_run') IS NOT NULL AND request ->> 'answer' = 'done')";

impl Store {
    /// Returns the cycles that match a query, the newest first.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn search(&self, query: &Query) -> Result<Hits, StoreError> {
        let read = |error: rusqlite::Error| self.database_error("search the cycles of", &error);
        let SqlConditions { sql, mut values } = SqlConditions::from_query(query);
        let condition = if sql.is_empty() { "TRUE".to_owned() } else { sql.join(" AND ") };
        let sql = format!(
            "SELECT cycles.id, started_unix_s, ended_unix_s, panel, verdict, reasons, serial, work_order, operator,
                    {MOVED_IN_AIR_SQL} OR {REQUESTED_AIR_RUN_SQL}
             FROM cycles LEFT JOIN cycle_parts ON cycle_id = cycles.id
             WHERE {condition} ORDER BY cycles.id DESC LIMIT ?"
        );
        // One more row than the size of the page shows whether there is another page.
        values.push(Value::Integer(query.page_size() as i64 + 1));
        let mut statement = self.connection.prepare_cached(&sql).map_err(read)?;
        let rows = statement.query_map(params_from_iter(values), columns).map_err(read)?;
        let mut rows = rows.collect::<Result<Vec<_>, _>>().map_err(read)?;
        let is_more = rows.len() > query.page_size();
        rows.truncate(query.page_size());
        let hits = rows.into_iter().map(|(hit, texts)| self.hit(hit, texts)).collect::<Result<Vec<_>, _>>()?;
        let next = hits.last().filter(|_| is_more).map(|hit| hit.cycle);
        Ok(Hits { hits, next })
    }

    /// Returns the number of ended cycles for each verdict, without air-runs and cycles without a part.
    ///
    /// # Errors
    /// If the cycles cannot be read.
    pub fn verdict_counts(&self) -> Result<Vec<(Verdict, u32)>, StoreError> {
        let sql = format!(
            "SELECT verdict, count(*) FROM cycles WHERE verdict IS NOT NULL AND NOT ({MOVED_IN_AIR_SQL} OR {REQUESTED_AIR_RUN_SQL})
             AND coalesce(reasons ->> '$[0].code', '') <> '{NO_PART}'
             GROUP BY verdict ORDER BY verdict"
        );
        let read = || -> Result<Vec<(String, u32)>, rusqlite::Error> {
            let mut statement = self.connection.prepare_cached(&sql)?;
            statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        let rows = read().map_err(|error| self.database_error("count the cycles of", &error))?;
        rows.into_iter().map(|(word, count)| Ok((self.parse_stored(&format!("\"{word}\""))?, count))).collect()
    }

    /// Returns the hit with its verdict and its reasons, which are parsed from their texts.
    fn hit(&self, hit: Hit, [verdict, reasons]: [Option<String>; 2]) -> Result<Hit, StoreError> {
        let verdict = verdict.map(|word| self.parse_stored(&format!("\"{word}\""))).transpose()?;
        let reasons = reasons.map(|text| self.parse_stored(&text)).transpose()?.unwrap_or_default();
        Ok(Hit { verdict, reasons, ..hit })
    }
}

fn columns(row: &Row<'_>) -> Result<(Hit, [Option<String>; 2]), rusqlite::Error> {
    let hit = Hit {
        cycle: CycleId(row.get(0)?),
        started_unix_s: row.get(1)?,
        ended_unix_s: row.get(2)?,
        panel: row.get(3)?,
        part: PartNames { serial: row.get(6)?, order: row.get(7)?, operator: row.get(8)? },
        verdict: None,
        is_air_run: row.get(9)?,
        reasons: Vec::new(),
    };
    Ok((hit, [row.get(4)?, row.get(5)?]))
}

/// Returns the part's names from the texts of a new cycle.
pub(super) fn parse_part(file_texts: &[(String, String)]) -> Option<PartNames> {
    let (_, text) = file_texts.iter().find(|(name, _)| name == PartNames::FILE)?;
    PartNames::read(text)
}

/// Inserts the names of a cycle's part, in the present transaction.
pub(super) fn insert_part(connection: &Connection, cycle: i64, part: &PartNames) -> Result<(), TransactionFailure> {
    let sql = "INSERT INTO cycle_parts (cycle_id, serial, work_order, operator) VALUES (?1, ?2, ?3, ?4)";
    connection.prepare_cached(sql)?.execute(params![cycle, part.serial, part.order, part.operator])?;
    Ok(())
}

/// Returns the cycles that store a text of their part, each with the hash of this text.
fn cycles_with_part(connection: &Connection) -> Result<Vec<(i64, String)>, rusqlite::Error> {
    let sql =
        "SELECT cycles.id, value ->> 'hash' FROM cycles, json_each(files) WHERE value ->> 'name' = ?1 ORDER BY 1";
    let mut statement = connection.prepare(sql)?;
    statement.query_map([PartNames::FILE], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
}

fn part_text(blobs: &Blobs, hash: &str) -> Option<PartNames> {
    PartNames::read(&String::from_utf8(blobs.get(hash).ok()?).ok()?)
}

/// Returns the rows of the table of parts, by cycle.
fn part_rows(connection: &Connection) -> Result<BTreeMap<i64, PartNames>, rusqlite::Error> {
    let mut statement = connection.prepare("SELECT cycle_id, serial, work_order, operator FROM cycle_parts")?;
    let part = |row: &rusqlite::Row<'_>| {
        Ok((row.get(0)?, PartNames { serial: row.get(1)?, order: row.get(2)?, operator: row.get(3)? }))
    };
    statement.query_map([], part)?.collect()
}

/// Returns a text for each row that differs from the stored text of its cycle.
pub(super) fn part_differences(connection: &Connection, blobs: &Blobs) -> Result<Vec<String>, rusqlite::Error> {
    let (mut rows, mut found) = (part_rows(connection)?, Vec::new());
    for (cycle, hash) in cycles_with_part(connection)? {
        let row = rows.remove(&cycle);
        // The verification of the files reports a missing or damaged text.
        let Some(part) = part_text(blobs, &hash) else { continue };
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
    /// Returns the names of a cycle's part; `None` if no name was stated.
    ///
    /// # Errors
    /// If the names cannot be read.
    pub fn cycle_part(&self, cycle: panelprep_cell::record::CycleId) -> Result<Option<PartNames>, StoreError> {
        let sql = "SELECT serial, work_order, operator FROM cycle_parts WHERE cycle_id = ?1";
        let part = |row: &rusqlite::Row<'_>| {
            Ok(PartNames { serial: row.get(0)?, order: row.get(1)?, operator: row.get(2)? })
        };
        let read = || self.connection.prepare_cached(sql)?.query_row([cycle.0], part).optional();
        read().map_err(|error| self.database_error("read the parts of", &error))
    }
}
