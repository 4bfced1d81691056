//! The alarms of a cycle, with the times that the store contains for them.

use super::database::Store;
use super::error::StoreError;
use crate::history::{Alarm, AlarmTimes, alarms};
use panelprep_cell::record::{CycleId, CycleRecord};
use rusqlite::params_from_iter;

impl Store {
    /// The alarms of a cycle in the order in which they were raised, with their acknowledgements.
    ///
    /// # Errors
    /// If there is no such cycle, or it cannot be read back.
    pub fn alarms(&self, cycle: CycleId) -> Result<Vec<Alarm>, StoreError> {
        let record = self.cycle(cycle)?;
        let times = AlarmTimes {
            findings_unix_ms: self.finding_times_unix_ms(cycle)?,
            settled_unix_ms: self.settled_unix_ms(&record)?,
        };
        Ok(alarms(&record, &times, &self.acknowledgements(Some(cycle))?))
    }

    /// Returns the time, ms since 1970, at which a person first reset or cleared the cell after the end of a cycle,
    /// or the next cycle began.
    fn settled_unix_ms(&self, record: &CycleRecord) -> Result<Option<i64>, StoreError> {
        let Some(ended_unix_s) = record.ended_unix_s else { return Ok(None) };
        // The end is stored in whole seconds: a request in that second may have been before it.
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
}
