//! The parts that cycles were about, and what earlier cycles did to one.

use super::database::Store;
use super::error::StoreError;
use crate::record::{CycleId, CycleRecord, PART, PartNames, passes};
use rusqlite::params;
use std::collections::BTreeMap;

/// How often a part was abraded in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PassesOfCycle {
    /// The cycle.
    pub cycle: CycleId,
    /// When it began, s since 1970.
    pub started_unix_s: i64,
    /// Passes in which the tool was on the part, or may have been.
    pub passes: usize,
}

impl Store {
    /// The part that a cycle was about; `None` where none was named, or what was kept of it is missing or damaged.
    pub fn part_of(&self, record: &CycleRecord) -> Option<PartNames> {
        let kept = record.files.iter().find(|file| file.name == PART)?;
        self.part(&kept.hash)
    }

    fn part(&self, hash: &str) -> Option<PartNames> {
        PartNames::read(&String::from_utf8(self.blob(hash).ok()?).ok()?)
    }

    fn serial(&self, hash: &str) -> Option<String> {
        self.part(hash)?.serial
    }

    /// The cycles in which the part with this serial number was abraded, or may have been, in order; those before `before`
    /// where it is given.
    ///
    /// # Errors
    /// Where a cycle cannot be read.
    pub fn passes_of_serial(
        &self,
        serial: &str,
        before: Option<CycleId>,
    ) -> Result<Vec<PassesOfCycle>, StoreError> {
        let read = || -> Result<Vec<(CycleId, String)>, rusqlite::Error> {
            let sql = "SELECT cycles.id, value ->> 'hash' FROM cycles, json_each(files)
                WHERE value ->> 'name' = ?1 AND (?2 IS NULL OR cycles.id < ?2) ORDER BY cycles.id";
            let row = |row: &rusqlite::Row<'_>| Ok((row.get(0).map(CycleId)?, row.get(1)?));
            self.connection.prepare(sql)?.query_map(params![PART, before.map(|id| id.0)], row)?.collect()
        };
        let named = read().map_err(|error| self.failed("read the cycles of", &error))?;
        // The same names are the same file.
        let mut is_of: BTreeMap<String, bool> = BTreeMap::new();
        let mut all = Vec::new();
        for (cycle, hash) in named {
            let is_of = is_of.entry(hash).or_insert_with_key(|hash| self.serial(hash).as_deref() == Some(serial));
            if !*is_of {
                continue;
            }
            let record = self.cycle(cycle)?;
            let passes = passes(&record.findings, &record.motions);
            if passes > 0 {
                all.push(PassesOfCycle { cycle, started_unix_s: record.started_unix_s, passes });
            }
        }
        Ok(all)
    }
}
