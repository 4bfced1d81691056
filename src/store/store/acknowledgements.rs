//! Who acknowledged which alarm, and when. A row is written once and never changed: an alarm that is raised again
//! is a new alarm.

use super::database::{Store, unix_ms};
use super::error::StoreError;
use crate::history::Acknowledgement;
use panelprep_cell::record::CycleId;
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
    /// Stores a person's acknowledgement of an alarm; its time is set here.
    ///
    /// # Errors
    /// If the store is open for reading or cannot be written, or has no such cycle.
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

    /// The acknowledgements of a cycle's alarms, or with `None` of those outside of cycles, oldest first.
    ///
    /// # Errors
    /// If they cannot be read; a store of an earlier program has none.
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
