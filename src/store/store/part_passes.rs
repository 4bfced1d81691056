//! The work of earlier cycles on one part.

use super::database::Store;
use super::error::StoreError;
use panelprep_cell::record::{CycleId, CycleRecord, LostPasses, PartNames, removed_bound_um, touching_passes};
use rusqlite::{OptionalExtension, params};

/// Number of abrasions of a part in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassesOfCycle {
    /// The cycle.
    pub cycle: CycleId,
    /// Start of the cycle, s since 1970.
    pub started_unix_s: i64,
    /// Number of passes in which the tool was on the part, or may have been.
    pub passes: usize,
    /// The upper 95 % bound of the removal anywhere on the part by its end, µm; `None` if it is not known.
    pub removed_um: Option<f64>,
}

/// Returns a serial number without differences that do not mean another part: blanks around it, and upper or lower
/// case.
pub(super) fn normalised_serial(serial: &str) -> String {
    serial.trim().to_uppercase()
}

impl Store {
    /// The part of a cycle, from the text that the cycle stores; `None` if none was named, or if that text is missing
    /// or damaged.
    pub fn stored_part(&self, record: &CycleRecord) -> Option<PartNames> {
        let kept = record.files.iter().find(|file| file.name == PartNames::FILE)?;
        PartNames::read(&String::from_utf8(self.blob(&kept.hash).ok()?).ok()?)
    }

    /// The passes in lost cycles that the start of this cycle stated; 0 if it stated none.
    ///
    /// # Errors
    /// If the statement is missing or damaged in the store: it is then not known how many passes count.
    pub fn lost_passes(&self, cycle: CycleId) -> Result<u8, StoreError> {
        let sql =
            "SELECT value ->> 'hash' FROM cycles, json_each(files) WHERE cycles.id = ?1 AND value ->> 'name' = ?2";
        let read = || -> Result<Option<String>, rusqlite::Error> {
            self.connection
                .prepare_cached(sql)?
                .query_row(params![cycle.0, LostPasses::FILE], |row| row.get(0))
                .optional()
        };
        let Some(hash) = read().map_err(|error| self.database_error("read a cycle of", &error))? else {
            return Ok(0);
        };
        let text = String::from_utf8(self.blob(&hash)?).unwrap_or_default();
        let stated = LostPasses::read(&text).ok_or_else(|| StoreError::Unreadable {
            path: self.path().to_owned(),
            problem: format!("the passes in lost cycles that the start of cycle {cycle} stated"),
        })?;
        Ok(stated.passes)
    }

    /// The cycles in which the part with this serial number was abraded, or may have been, in order; only those
    /// before `before` if it is given. Passes in lost cycles count for the cycle whose start stated them.
    ///
    /// # Errors
    /// If a cycle cannot be read.
    pub fn passes_by_serial(
        &self,
        serial: &str,
        before: Option<CycleId>,
    ) -> Result<Vec<PassesOfCycle>, StoreError> {
        self.ensure_parts_table()?;
        let read = || -> Result<Vec<CycleId>, rusqlite::Error> {
            let sql = "SELECT cycle_id, serial FROM cycle_parts WHERE serial NOTNULL AND (?1 IS NULL OR cycle_id < ?1) ORDER BY 1";
            let mut statement = self.connection.prepare(sql)?;
            let all = statement.query_map(params![before.map(|id| id.0)], |row| Ok((row.get(0)?, row.get(1)?)))?;
            // A blank, or upper instead of lower case, does not mean another part. SQL compares the case of ASCII
            // letters only.
            let is_it = |row: &Result<(i64, String), _>| {
                row.as_ref().map_or(true, |(_, found): &(i64, String)| {
                    normalised_serial(found) == normalised_serial(serial)
                })
            };
            all.filter(is_it).map(|row| row.map(|(id, _)| CycleId(id))).collect()
        };
        let cycles = read().map_err(|error| self.database_error("read the cycles of", &error))?;
        let mut all = Vec::new();
        for cycle in cycles {
            let record = self.cycle(cycle)?;
            let own = touching_passes(&record.findings, &record.motions);
            let lost = usize::from(self.lost_passes(cycle)?);
            let passes = own + lost;
            if passes > 0 {
                // The statement contains no depth.
                let removed_um = removed_bound_um(&record.findings, own).filter(|_| lost == 0);
                let started_unix_s = record.started_unix_s;
                all.push(PassesOfCycle { cycle, started_unix_s, passes, removed_um });
            }
        }
        Ok(all)
    }
}
