//! The alarms of a cycle, with the times from the store.
//!
//! The time of a finding is stored in the same transaction as the finding; findings of earlier program versions have no
//! time. An acknowledgement (the alarm, the person, the time) is a row that is written once and never changed: an alarm
//! that is raised again is a new alarm.

use super::commit::{TransactionFailure, WriteTransaction};
use super::database::{Store, unix_ms};
use super::error::StoreError;
use crate::history::{Acknowledgement, Alarm, AlarmTimes, alarms};
use panelprep_cell::record::{CycleId, CycleRecord};
use rusqlite::{params, params_from_iter};

pub(super) const FINDING_TIME_TABLES: &str = "
    CREATE TABLE finding_times (
        finding_id INTEGER PRIMARY KEY REFERENCES findings (id),
        unix_ms INTEGER NOT NULL
    ) STRICT;
";

pub(super) const ACKNOWLEDGEMENT_TABLES: &str = "
    CREATE TABLE acknowledgements (
        id INTEGER PRIMARY KEY,
        unix_ms INTEGER NOT NULL,
        cycle_id INTEGER REFERENCES cycles (id),
        code TEXT NOT NULL,
        raised_unix_ms INTEGER NOT NULL,
        who TEXT NOT NULL
    ) STRICT;
    CREATE INDEX acknowledgements_by_cycle ON acknowledgements (cycle_id);
";

impl Store {
    /// Returns the alarms of a cycle in the order in which they were raised, with their acknowledgements.
    ///
    /// # Errors
    /// If the cycle does not exist, or cannot be read.
    pub fn alarms(&self, cycle: CycleId) -> Result<Vec<Alarm>, StoreError> {
        let record = self.cycle(cycle)?;
        let times = AlarmTimes {
            findings_unix_ms: self.finding_times_unix_ms(cycle)?,
            settled_unix_ms: self.settled_unix_ms(&record)?,
        };
        Ok(alarms(&record, &times, &self.acknowledgements(Some(cycle))?))
    }

    /// Returns the time after the end of a cycle at which a person first reset or cleared the cell, or the next cycle
    /// began, ms since 1970.
    fn settled_unix_ms(&self, record: &CycleRecord) -> Result<Option<i64>, StoreError> {
        let Some(ended_unix_s) = record.ended_unix_s else { return Ok(None) };
        // The end of the cycle is stored in whole seconds: a request in the same second may have been earlier.
        let after_unix_ms = (ended_unix_s + 1) * 1_000;
        // A store of an earlier version of this program has no table of requests.
        let (asked, count) = match self.has_table("requests")? {
            true => (
                "UNION ALL SELECT unix_ms FROM requests WHERE unix_ms >= ?2 AND request ->> 'answer' = 'done'
                 AND request ->> '$.wanted.for' IN ('reset', 'clear')",
                2,
            ),
            false => ("", 1),
        };
        let sql = format!(
            "SELECT min(unix_ms) FROM (SELECT started_unix_s * 1000 AS unix_ms FROM cycles WHERE id > ?1 {asked})"
        );
        let values = [record.id.0, after_unix_ms];
        let read = || {
            self.connection.prepare_cached(&sql)?.query_row(params_from_iter(&values[..count]), |row| row.get(0))
        };
        read().map_err(|error| self.database_error("read the times of resets in", &error))
    }

    /// Returns the time at which each finding of a cycle was stored, ms since 1970, in the order of the findings;
    /// `None` for findings of an earlier program version.
    ///
    /// # Errors
    /// If the times cannot be read.
    pub fn finding_times_unix_ms(&self, cycle: CycleId) -> Result<Vec<Option<i64>>, StoreError> {
        let read = || -> Result<Vec<Option<i64>>, rusqlite::Error> {
            let sql = match self.connection.table_exists(None, "finding_times")? {
                true => {
                    "SELECT unix_ms FROM findings LEFT JOIN finding_times ON finding_id = findings.id
                     WHERE cycle_id = ?1 ORDER BY findings.id"
                }
                false => "SELECT NULL FROM findings WHERE cycle_id = ?1 ORDER BY id",
            };
            self.connection.prepare_cached(sql)?.query_map([cycle.0], |row| row.get(0))?.collect()
        };
        read().map_err(|error| self.database_error("read the times of findings in", &error))
    }

    /// Stores the acknowledgement of an alarm, with the present time.
    ///
    /// # Errors
    /// If the store is open for reading only or cannot be written, or the cycle does not exist.
    pub fn acknowledge(&mut self, acknowledgement: &Acknowledgement) -> Result<(), StoreError> {
        let unix_ms = unix_ms(self.clock());
        let Acknowledgement { cycle, code, raised_unix_ms, who, .. } = acknowledgement;
        self.commit("write an acknowledgement to", |writing| {
            writing.execute(
                "INSERT INTO acknowledgements (unix_ms, cycle_id, code, raised_unix_ms, who)
                 VALUES (?1, ?2, ?3, ?4, ?5)",
                params![unix_ms, cycle.map(|id| id.0), code, raised_unix_ms, who],
            )?;
            writing.chain("acknowledgements", writing.last_insert_rowid())
        })
    }

    /// Returns the acknowledgements of a cycle's alarms, the oldest first; `None` for the alarms between cycles.
    ///
    /// # Errors
    /// If the acknowledgements cannot be read.
    pub fn acknowledgements(&self, cycle: Option<CycleId>) -> Result<Vec<Acknowledgement>, StoreError> {
        let read = || -> Result<Vec<Acknowledgement>, rusqlite::Error> {
            if !self.connection.table_exists(None, "acknowledgements")? {
                return Ok(Vec::new());
            }
            let sql = "SELECT unix_ms, cycle_id, code, raised_unix_ms, who FROM acknowledgements
                       WHERE cycle_id IS ?1 ORDER BY id";
            let row = |row: &rusqlite::Row<'_>| {
                Ok(Acknowledgement {
                    unix_ms: row.get(0)?,
                    cycle: row.get::<_, Option<i64>>(1)?.map(CycleId),
                    code: row.get(2)?,
                    raised_unix_ms: row.get(3)?,
                    who: row.get(4)?,
                })
            };
            self.connection.prepare_cached(sql)?.query_map([cycle.map(|id| id.0)], row)?.collect()
        };
        read().map_err(|error| self.database_error("read the acknowledgements of", &error))
    }
}

/// Inserts the time at which a finding is stored, in the transaction of the finding.
pub(super) fn insert_finding_time(
    writing: &mut WriteTransaction<'_>,
    finding: i64,
    unix_ms: i64,
) -> Result<(), TransactionFailure> {
    let sql = "INSERT INTO finding_times (finding_id, unix_ms) VALUES (?1, ?2)";
    writing.execute(sql, [finding, unix_ms])?;
    writing.chain("finding_times", finding)
}
