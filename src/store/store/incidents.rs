//! Changes made outside this program, stored as evidence.

use super::database::Store;
use super::error::StoreError;
use rusqlite::params;

pub(super) const TABLES: &str = "
    CREATE TABLE incidents (
        id INTEGER PRIMARY KEY,
        at_unix_s INTEGER NOT NULL,
        found TEXT NOT NULL
    ) STRICT;
";

/// A change that was found at a start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Incident {
    /// Time of the start, s since 1970.
    pub at_unix_s: i64,
    /// Descriptions of the differences.
    pub found: Vec<String>,
}

impl Store {
    /// Stores the changes that were found.
    pub(super) fn store_incident(&mut self, found: &[String]) -> Result<(), StoreError> {
        let (at_unix_s, found) = (self.unix_s(), self.text(&found)?);
        self.commit("write an incident to", |writing| {
            writing
                .execute("INSERT INTO incidents (at_unix_s, found) VALUES (?1, ?2)", params![at_unix_s, found])?;
            writing.chain("incidents", writing.last_insert_rowid())
        })
    }

    /// All incidents, oldest first.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn incidents(&self) -> Result<Vec<Incident>, StoreError> {
        let read = || -> Result<Vec<(i64, String)>, rusqlite::Error> {
            let mut rows = self.connection.prepare("SELECT at_unix_s, found FROM incidents ORDER BY id")?;
            rows.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        let rows = read().map_err(|error| self.database_error("read the incidents of", &error))?;
        rows.into_iter()
            .map(|(at_unix_s, found)| Ok(Incident { at_unix_s, found: self.parse_stored(&found)? }))
            .collect()
    }
}
