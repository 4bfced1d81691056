//! The time at which each finding was stored. A row is written in the transaction of its finding; findings of
//! earlier versions of this program have none.

use super::commit::{TransactionFailure, WriteTransaction};
use super::database::Store;
use super::error::StoreError;
use panelprep_cell::record::CycleId;

pub(super) const TABLES: &str = "
    CREATE TABLE finding_times (
        finding_id INTEGER PRIMARY KEY REFERENCES findings (id),
        unix_ms INTEGER NOT NULL
    ) STRICT;
";

/// Writes the time at which a finding was stored. Part of the finding's transaction.
pub(super) fn insert(
    writing: &mut WriteTransaction<'_>,
    finding: i64,
    unix_ms: i64,
) -> Result<(), TransactionFailure> {
    let sql = "INSERT INTO finding_times (finding_id, unix_ms) VALUES (?1, ?2)";
    writing.execute(sql, [finding, unix_ms])?;
    writing.chain("finding_times", finding)
}

impl Store {
    /// The time at which each finding of a cycle was stored, ms since 1970, in their order; `None` for those of an
    /// earlier program.
    ///
    /// # Errors
    /// If they cannot be read.
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
}
