//! The search for cycles: a query of `history` in SQL. The next page begins at a cycle's number and not at a count
//! of rows. Cycles that begin meanwhile therefore shift no page.

use super::database::Store;
use super::error::StoreError;
use crate::history::{Hit, Hits, Query, RequiredEnd};
use panelprep_base::verdict::Verdict;
use panelprep_cell::record::{CycleId, NO_PART, PartNames};
use rusqlite::types::Value;
use rusqlite::{Row, params_from_iter};

/// Conditions with the values of their placeholders, in order.
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

    /// A name in which `*` matches any characters.
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
            // The column's text also contains the names of its keys.
            let sql = "EXISTS (SELECT 1 FROM json_each(reasons)
                       WHERE (value ->> 'code') || ' ' || (value ->> 'message') LIKE ? ESCAPE '\\')";
            all.add(sql, Some(format!("%{}%", escape_like(word))));
        }
        all
    }
}

/// The text in the form for use inside LIKE.
fn escape_like(text: &str) -> String {
    text.replace('\\', "\\\\").replace('%', "\\%").replace('_', "\\_")
}

/// SQL condition that the path was run in the air: a motion states it …
const MOVED_IN_AIR_SQL: &str =
    "EXISTS (SELECT 1 FROM motions WHERE cycle_id = cycles.id AND motion ->> 'path' = 'air')";
/// … or the run in the air was requested, which stores of earlier versions of this program do not record.
const REQUESTED_AIR_RUN_SQL: &str = "EXISTS (SELECT 1 FROM requests WHERE cycle_id = cycles.id
    AND json_type(request, '$.wanted.for.air_run') IS NOT NULL AND request ->> 'answer' = 'done')";

impl Store {
    /// Searches the cycles, the newest first.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn search(&self, query: &Query) -> Result<Hits, StoreError> {
        self.ensure_parts_table()?;
        let read = |error: rusqlite::Error| self.database_error("search the cycles of", &error);
        let SqlConditions { sql, mut values } = SqlConditions::from_query(query);
        let condition = if sql.is_empty() { "TRUE".to_owned() } else { sql.join(" AND ") };
        let asked = if self.has_table("requests")? { REQUESTED_AIR_RUN_SQL } else { "FALSE" };
        let sql = format!(
            "SELECT cycles.id, started_unix_s, ended_unix_s, panel, verdict, reasons, serial, work_order, operator,
                    {MOVED_IN_AIR_SQL} OR {asked}
             FROM cycles LEFT JOIN cycle_parts ON cycle_id = cycles.id
             WHERE {condition} ORDER BY cycles.id DESC LIMIT ?"
        );
        // One additional row shows whether there is another page.
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

    /// The number of cycles that ended with each verdict, without runs in the air and without cycles that found no part.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn verdict_counts(&self) -> Result<Vec<(Verdict, u32)>, StoreError> {
        let asked = if self.has_table("requests")? { REQUESTED_AIR_RUN_SQL } else { "FALSE" };
        let sql = format!(
            "SELECT verdict, count(*) FROM cycles WHERE verdict IS NOT NULL AND NOT ({MOVED_IN_AIR_SQL} OR {asked})
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

    /// Adds the verdict and the reasons, which are decoded from their texts.
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
