//! Verifications of calibrations: each is kept, none is changed.

use super::error::StoreError;
use super::{DATABASE, Store};
use crate::calib::health::Verification;
use crate::files::content_hash;
use rusqlite::{Connection, OpenFlags, params};
use std::path::Path;

pub(super) const TABLES: &str = "
    CREATE TABLE verifications (
        id INTEGER PRIMARY KEY,
        subject TEXT NOT NULL,
        error_mm REAL NOT NULL,
        limit_mm REAL NOT NULL,
        calibration_hash TEXT NOT NULL,
        at_unix_s INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX verifications_by_subject ON verifications (subject);
";

/// The name of the calibration files that a verification used: of the camera's intrinsics and its mount, or of the
/// tool, in this order.
pub fn calibration_hash(texts: &[&str]) -> String {
    let hashes: Vec<String> = texts.iter().map(|text| content_hash(text.as_bytes())).collect();
    content_hash(hashes.join(" ").as_bytes())
}

impl Store {
    /// Keeps a verification in the store in this folder, also while a service writes to it: one row in a transaction of
    /// its own, for which SQLite makes either wait for the other. A store that is missing or of an earlier program is
    /// made, as its only writer.
    ///
    /// # Errors
    /// Where the store cannot be opened or written, or a number is not finite.
    pub fn keep_verification_in(folder: &Path, verification: &Verification) -> Result<Self, StoreError> {
        let mut store = match Store::create(folder) {
            Err(StoreError::Leased { .. }) => Store::beside_the_writer(folder)?,
            opened => opened?,
        };
        store.insert_verification(verification)?;
        Ok(store)
    }

    fn beside_the_writer(folder: &Path) -> Result<Self, StoreError> {
        let mut store = Store::open(folder)?;
        let path = folder.join(DATABASE);
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let failed = |error: rusqlite::Error| StoreError::database("open", &path, &error);
        store.connection = Connection::open_with_flags(&path, flags).map_err(failed)?;
        store.connection.pragma_update(None, "synchronous", "FULL").map_err(failed)?;
        Ok(store)
    }

    /// Keeps a verification.
    ///
    /// # Errors
    /// Where the store is open for reading or cannot be written, or a number is not finite.
    pub fn keep_verification(&mut self, verification: &Verification) -> Result<(), StoreError> {
        self.writable()?;
        self.insert_verification(verification)
    }

    fn insert_verification(&mut self, verification: &Verification) -> Result<(), StoreError> {
        if !(verification.error_mm.is_finite() && verification.limit_mm.is_finite()) {
            return Err(StoreError::NotFinite { name: "verification".to_owned() });
        }
        self.connection
            .execute(
                "INSERT INTO verifications (subject, error_mm, limit_mm, calibration_hash, at_unix_s)
                 VALUES (?1, ?2, ?3, ?4, ?5)",
                params![
                    verification.subject,
                    verification.error_mm,
                    verification.limit_mm,
                    verification.calibration_hash,
                    verification.at_unix_s
                ],
            )
            .map_err(|error| self.failed("write a verification to", &error))?;
        Ok(())
    }

    /// All verifications of a subject, in the order in which they were kept.
    ///
    /// # Errors
    /// Where they cannot be read; a store of an earlier program has none, and says so.
    pub fn verifications(&self, subject: &str) -> Result<Vec<Verification>, StoreError> {
        let failed = |error: rusqlite::Error| self.failed("read verifications from", &error);
        let mut statement = self
            .connection
            .prepare(
                "SELECT subject, error_mm, limit_mm, calibration_hash, at_unix_s FROM verifications
                 WHERE subject = ?1 ORDER BY id",
            )
            .map_err(failed)?;
        let rows = statement.query_map([subject], |row| {
            Ok(Verification {
                subject: row.get(0)?,
                error_mm: row.get(1)?,
                limit_mm: row.get(2)?,
                calibration_hash: row.get(3)?,
                at_unix_s: row.get(4)?,
            })
        });
        rows.map_err(failed)?.collect::<Result<_, _>>().map_err(failed)
    }

    /// The newest verification of a subject; `None` where it was never verified.
    ///
    /// # Errors
    /// As [`Store::verifications`].
    pub fn last_verification(&self, subject: &str) -> Result<Option<Verification>, StoreError> {
        Ok(self.verifications(subject)?.pop())
    }
}
