//! Cycles as `history` reads them: the record, the part and the disc of one cycle, and the cycles of a panel in
//! order.

use super::database::Store;
use super::error::StoreError;
use crate::history::{DiscWear, PastCycle, TrendPoint};
use panelprep_base::verdict::Limit;
use panelprep_cell::record::CycleId;

/// Numbers of cycles and of paths in contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleCounts {
    /// Number of cycles that have ended.
    pub ended: i64,
    /// Number of ended cycles with the verdict pass.
    pub passed: i64,
    /// Number of paths in contact that began.
    pub contacts: i64,
}

impl Store {
    /// The counts of all cycles.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn cycle_counts(&self) -> Result<CycleCounts, StoreError> {
        let sql = "SELECT (SELECT count(*) FROM cycles WHERE verdict IS NOT NULL),
            (SELECT count(*) FROM cycles WHERE verdict = 'pass'),
            (SELECT count(*) FROM motions WHERE motion ->> 'path' = 'contact')";
        let counts = |row: &rusqlite::Row<'_>| {
            Ok(CycleCounts { ended: row.get(0)?, passed: row.get(1)?, contacts: row.get(2)? })
        };
        self.connection
            .query_row(sql, [], counts)
            .map_err(|error| self.database_error("count the cycles of", &error))
    }

    /// A cycle with its part and its wear of the disc.
    ///
    /// # Errors
    /// If there is no such cycle, or it cannot be read back.
    pub fn past_cycle(&self, id: CycleId) -> Result<PastCycle, StoreError> {
        Ok(PastCycle { record: self.cycle(id)?, part: self.cycle_part(id)?, disc: self.disc_wear_of_cycle(id)? })
    }

    /// The last cycles of a panel that are over, at most `most`, the oldest first.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn past_cycles(&self, panel: &str, most: usize) -> Result<Vec<PastCycle>, StoreError> {
        let most = i64::try_from(most).unwrap_or(i64::MAX);
        let read = || -> Result<Vec<CycleId>, rusqlite::Error> {
            let sql = "SELECT id FROM cycles WHERE panel = ?1 AND verdict IS NOT NULL ORDER BY id DESC LIMIT ?2";
            let mut rows = self.connection.prepare_cached(sql)?;
            rows.query_map(rusqlite::params![panel, most], |row| row.get(0).map(CycleId))?.collect()
        };
        let ids = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        ids.into_iter().rev().map(|id| self.past_cycle(id)).collect()
    }

    /// The names of all panels in cycles.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn cycle_panels(&self) -> Result<Vec<String>, StoreError> {
        let read = || -> Result<Vec<String>, rusqlite::Error> {
            let sql = "SELECT DISTINCT panel FROM cycles ORDER BY panel";
            self.connection.prepare_cached(sql)?.query_map([], |row| row.get(0))?.collect()
        };
        read().map_err(|error| self.database_error("read the panels of", &error))
    }

    /// The last verifications of a subject that are not struck out, at most `most`, the oldest first.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn verification_points(&self, subject: &str, most: usize) -> Result<Vec<TrendPoint>, StoreError> {
        let all = self.verifications(subject)?;
        let points = all.into_iter().filter(|it| it.struck.is_none()).map(|it| TrendPoint {
            cycle: None,
            at_unix_s: it.at_unix_s,
            serial: None,
            value: it.error,
            limit: Limit::AtMost(it.limit),
        });
        let mut points: Vec<TrendPoint> = points.collect();
        points.drain(..points.len().saturating_sub(most));
        Ok(points)
    }

    /// A cycle's wear of the disc; `None` if there was none.
    fn disc_wear_of_cycle(&self, id: CycleId) -> Result<Option<DiscWear>, StoreError> {
        let read = || -> Result<Option<DiscWear>, rusqlite::Error> {
            if !self.connection.table_exists(None, "discs")? {
                return Ok(None);
            }
            // The wear of an interrupted path is corrected afterwards, by a second row of the same cycle.
            let sql = "SELECT sum(swept_mm2), max(id) FROM discs WHERE cycle_id = ?1";
            let swept = self
                .connection
                .prepare_cached(sql)?
                .query_row([id.0], |row| Ok((row.get::<_, Option<f64>>(0)?, row.get::<_, Option<i64>>(1)?)))?;
            let (Some(swept_mm2), Some(last)) = swept else { return Ok(None) };
            let sql = "SELECT sum(swept_mm2) FROM discs
                       WHERE id <= ?1 AND id > (SELECT coalesce(max(id), 0) FROM discs WHERE is_new AND id <= ?1)";
            let worn_mm2 = self.connection.prepare_cached(sql)?.query_row([last], |row| row.get(0))?;
            Ok(Some(DiscWear { swept_mm2, worn_mm2 }))
        };
        read().map_err(|error| self.database_error("read the disc's wear from", &error))
    }
}
