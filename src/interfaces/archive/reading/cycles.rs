//! Cycles of all cells, the newest first, and one of them with its records.

use super::reader::Reader;
use crate::archive::error::ArchiveError;
use panelprep_store::signing::{SignedCycle, Statement, StatementContent};

/// A search; an empty field does not restrict it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CycleQuery {
    /// The cell's name.
    pub cell: String,
    /// The panel's name.
    pub panel: String,
    /// The part's serial number, in upper or lower case.
    pub serial: String,
    /// The verdict's word.
    pub verdict: String,
    /// Only cycles from this time on, s since 1970.
    pub from_unix_s: Option<i64>,
    /// Only cycles before this time, s since 1970.
    pub until_unix_s: Option<i64>,
    /// Only cycles that are older than this one, the last cycle of an earlier page: its start time, cell and number.
    pub before: Option<(i64, String, i64)>,
    /// The maximum number of cycles.
    pub limit: i64,
}

/// A cycle.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct CycleRow {
    /// The cell.
    pub cell: String,
    /// Its number there.
    pub cycle: i64,
    /// Time at which the cycle began, s since 1970.
    pub started_unix_s: i64,
    /// Time at which it ended, s since 1970.
    pub ended_unix_s: Option<i64>,
    /// The panel.
    pub panel: String,
    /// The part's serial number.
    pub serial: Option<String>,
    /// The work order.
    pub work_order: Option<String>,
    /// The operator.
    pub operator: Option<String>,
    /// The verdict's word.
    pub verdict: String,
    /// The verdict's reasons as JSON: code and message.
    pub reasons: String,
    /// SHA-256 of the recipe.
    pub recipe_hash: String,
    /// The program's version.
    pub program_version: String,
}

/// A signature of a cycle's record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordSignature {
    /// The number of the statement among all statements of its cell.
    pub statement: i64,
    /// Its SHA-256.
    pub record_hash: String,
    /// Time of the signature, ms since 1970.
    pub unix_ms: i64,
    /// The person's printed name and what the signature means; `None` for the cell itself.
    pub person: Option<(String, String)>,
}

/// A cycle with its signed statements.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// The cycle.
    pub row: CycleRow,
    /// Signatures, in order.
    pub signed: Vec<RecordSignature>,
    /// The content of the cell's own statement; `None` if it has not arrived.
    pub statement: Option<SignedCycle>,
}

const COLUMNS: &str = "cell, cycle, started_unix_s, ended_unix_s, panel, serial, work_order, operator, verdict, reasons, recipe_hash, program_version";

fn cycle_row(row: &tokio_postgres::Row) -> CycleRow {
    CycleRow {
        cell: row.get(0),
        cycle: row.get(1),
        started_unix_s: row.get(2),
        ended_unix_s: row.get(3),
        panel: row.get(4),
        serial: row.get(5),
        work_order: row.get(6),
        operator: row.get(7),
        verdict: row.get(8),
        reasons: row.get(9),
        recipe_hash: row.get(10),
        program_version: row.get(11),
    }
}

impl Reader {
    /// Returns the cycles that match, the newest first.
    ///
    /// # Errors
    /// If the database does not answer.
    pub async fn cycles(&self, query: &CycleQuery) -> Result<Vec<CycleRow>, ArchiveError> {
        let CycleQuery { cell, panel, serial, verdict, from_unix_s, until_unix_s, before, limit } = query;
        let serial = serial.to_lowercase();
        let (before_s, before_cell, before_cycle) = before.clone().unwrap_or((i64::MAX, String::new(), i64::MAX));
        let (from_s, until_s) = (from_unix_s.unwrap_or(i64::MIN), until_unix_s.unwrap_or(i64::MAX));
        let mut values: Vec<&(dyn tokio_postgres::types::ToSql + Sync)> =
            vec![&before_s, &before_cell, &before_cycle, &from_s, &until_s, limit];
        // The query contains only the conditions that were requested, so that the server chooses the index by them.
        let mut conditions = String::new();
        for (column, value) in [("cell", cell), ("panel", panel), ("lower(serial)", &serial), ("verdict", verdict)]
        {
            if !value.is_empty() {
                values.push(value);
                conditions += &format!(" AND {column} = ${}", values.len());
            }
        }
        let sql = format!(
            "SELECT {COLUMNS} FROM cycles WHERE started_unix_s <= $1 AND (started_unix_s, cell, cycle) < ($1, $2, $3)
             AND started_unix_s >= $4 AND started_unix_s < $5{conditions}
             ORDER BY started_unix_s DESC, cell DESC, cycle DESC LIMIT $6"
        );
        Ok(self.rows(&sql, &values).await?.iter().map(cycle_row).collect())
    }

    /// Returns a cycle of a cell with its signed statements; if several cycles have the same number, the newest one.
    ///
    /// # Errors
    /// If the database does not answer.
    pub async fn record(&self, cell: &str, cycle: i64) -> Result<Option<Record>, ArchiveError> {
        let sql = format!(
            "SELECT {COLUMNS} FROM cycles WHERE cell = $1 AND cycle = $2 ORDER BY started_unix_s DESC LIMIT 1"
        );
        let rows = self.rows(&sql, &[&cell, &cycle]).await?;
        let Some(row) = rows.first().map(cycle_row) else { return Ok(None) };
        let sql =
            "SELECT statement, record_hash, unix_ms, name, meaning FROM signatures WHERE cell = $1 AND cycle = $2
            ORDER BY statement";
        let signed = self.rows(sql, &[&cell, &cycle]).await?.into_iter().map(|row| RecordSignature {
            statement: row.get(0),
            record_hash: row.get(1),
            unix_ms: row.get(2),
            person: row.get::<_, Option<String>>(3).zip(row.get::<_, Option<String>>(4)),
        });
        let signed: Vec<RecordSignature> = signed.collect();
        let mut statement = None;
        if let Some(own) = signed.iter().rfind(|one| one.person.is_none()) {
            let sql = "SELECT content FROM records JOIN signatures USING (cell, epoch, number)
                WHERE signatures.cell = $1 AND statement = $2 AND record_hash = $3 LIMIT 1";
            let rows = self.rows(sql, &[&cell, &own.statement, &own.record_hash]).await?;
            let content: Option<Vec<u8>> = rows.first().map(|row| row.get(0));
            statement =
                content.and_then(|content| Statement::read(&content).ok()).and_then(|read| match read.says {
                    StatementContent::Cycle(cycle) => Some(cycle),
                    StatementContent::Person(_) => None,
                });
        }
        Ok(Some(Record { row, signed, statement }))
    }

    /// Returns the names of all panels that have cycles, and the names of all cells.
    ///
    /// # Errors
    /// If the database does not answer.
    pub async fn names(&self) -> Result<(Vec<String>, Vec<String>), ArchiveError> {
        // Finds each next name through the index, so that a table of a million cycles is not read for ten names.
        let panels = "WITH RECURSIVE name AS (SELECT min(panel) AS panel FROM cycles
            UNION ALL SELECT (SELECT min(panel) FROM cycles WHERE panel > name.panel) FROM name WHERE name.panel IS NOT NULL)
            SELECT panel FROM name WHERE panel IS NOT NULL LIMIT 1000";
        let panels = self.rows(panels, &[]).await?.iter().map(|row| row.get(0)).collect();
        let cells = self.rows("SELECT DISTINCT cell FROM epochs ORDER BY cell", &[]).await?;
        Ok((panels, cells.iter().map(|row| row.get(0)).collect()))
    }
}
