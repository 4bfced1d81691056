//! The alarms of a cycle, with the times from the store.
//!
//! An acknowledgement (who acknowledged which alarm, and when) is a row that is written once and never changed: an
//! alarm that is raised again is a new alarm.

use super::database::{Store, unix_ms};
use super::error::StoreError;
use crate::history::{Acknowledgement, Alarm, AlarmTimes, alarms};
use panelprep_cell::record::{CycleId, CycleRecord};
use rusqlite::params;

pub(super) const TABLES: &str = "
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
        let sql = "SELECT min(unix_ms) FROM (
                 SELECT started_unix_s * 1000 AS unix_ms FROM cycles WHERE id > ?1
                 UNION ALL SELECT unix_ms FROM requests WHERE unix_ms >= ?2 AND request ->> 'answer' = 'done'
                 AND request ->> '$.wanted.for' IN ('reset', 'clear'))";
        let read =
            || self.connection.prepare_cached(sql)?.query_row([record.id.0, after_unix_ms], |row| row.get(0));
        read().map_err(|error| self.database_error("read the times of resets in", &error))
    }

    /// Returns the time at which each finding of a cycle was stored, ms since 1970, in their order.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn finding_times_unix_ms(&self, cycle: CycleId) -> Result<Vec<i64>, StoreError> {
        let read = || -> Result<Vec<i64>, rusqlite::Error> {
            let sql = "SELECT unix_ms FROM findings WHERE cycle_id = ?1 ORDER BY id";
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
    /// If they cannot be read.
    pub fn acknowledgements(&self, cycle: Option<CycleId>) -> Result<Vec<Acknowledgement>, StoreError> {
        let read = || -> Result<Vec<Acknowledgement>, rusqlite::Error> {
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
