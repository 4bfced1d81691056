//! The wear of the present disc: the area that it swept, path by path, and the time of mounting.

use super::database::Store;
use super::error::StoreError;
use panelprep_cell::record::CycleId;
use rusqlite::params;

/// A row is the area swept by one path, or a new disc, which has swept nothing.
pub(super) const TABLES: &str = "
    CREATE TABLE discs (
        id INTEGER PRIMARY KEY,
        cycle_id INTEGER REFERENCES cycles (id),
        at_unix_s INTEGER NOT NULL,
        is_new INTEGER NOT NULL,
        swept_mm2 REAL NOT NULL
    ) STRICT;
";

impl Store {
    /// Records the area of the panel that the disc in use swept, mm².
    ///
    /// # Errors
    /// If the store is open for reading or cannot be written, or the area is not a number.
    pub fn wear_disc(&mut self, cycle: Option<CycleId>, swept_mm2: f64) -> Result<(), StoreError> {
        if !swept_mm2.is_finite() {
            return Err(StoreError::NotFinite { name: "area swept by the disc".to_owned() });
        }
        self.store_disc(cycle, false, swept_mm2)
    }

    /// Records that a new disc was mounted.
    ///
    /// # Errors
    /// If the store is open for reading or cannot be written.
    pub fn mount_disc(&mut self) -> Result<(), StoreError> {
        self.store_disc(None, true, 0.0)
    }

    fn store_disc(&mut self, cycle: Option<CycleId>, is_new: bool, swept_mm2: f64) -> Result<(), StoreError> {
        self.require_writable()?;
        let at_unix_s = self.unix_s();
        self.commit("write the disc's wear to", |writing| {
            writing.execute(
                "INSERT INTO discs (cycle_id, at_unix_s, is_new, swept_mm2) VALUES (?1, ?2, ?3, ?4)",
                params![cycle.map(|id| id.0), at_unix_s, is_new, swept_mm2],
            )?;
            writing.chain("discs", writing.last_insert_rowid())
        })
    }

    /// The area that the disc in use has swept since it was mounted, mm².
    ///
    /// # Errors
    /// If it cannot be read; a store of an earlier program has no disc records, and the error states this.
    pub fn disc_worn_mm2(&self) -> Result<f64, StoreError> {
        self.connection
            .query_row(
                "SELECT coalesce(sum(swept_mm2), 0.0) FROM discs
                 WHERE id > (SELECT coalesce(max(id), 0) FROM discs WHERE is_new)",
                [],
                |row| row.get(0),
            )
            .map_err(|error| self.database_error("read the disc's wear from", &error))
    }
}
