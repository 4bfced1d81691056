//! Verifications of calibrations; rows are never changed. An invalid verification can be struck out: it is kept, with
//! the person and the reason.

use super::database::{DATABASE, Store};
use super::error::StoreError;
use super::head::HeadFile;
use super::{flush, outbox};
use crate::office::Kind;
use panelprep_cell::files::content_hash;
use panelprep_vision::calib::health::{Strike, Verification};
use rusqlite::{Connection, OpenFlags, params};
use std::collections::BTreeMap;
use std::path::Path;

/// A strike-out names its verification; a verification can be struck out only once.
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
    CREATE TABLE verification_strikes (
        verification_id INTEGER PRIMARY KEY REFERENCES verifications (id),
        by TEXT NOT NULL,
        why TEXT NOT NULL,
        at_unix_s INTEGER NOT NULL
    ) STRICT;
";

/// Returns the hash of the calibration files that were verified: of the camera's intrinsics and mount in this order, or
/// of the tool.
pub fn calibration_hash(texts: &[&str]) -> String {
    let hashes: Vec<String> = texts.iter().map(|text| content_hash(text.as_bytes())).collect();
    content_hash(hashes.join(" ").as_bytes())
}

impl Store {
    /// Stores a verification in the store in this folder, also while a service writes to it. The row is written in its
    /// own transaction; SQLite makes the two writers wait for each other. If no service writes to the store, a missing
    /// store is created, and the tables of an earlier program version are updated. Returns the store and the number of
    /// the verification.
    ///
    /// # Errors
    /// If the store cannot be opened or written, or a number is not finite.
    pub fn store_verification_in(folder: &Path, verification: &Verification) -> Result<(Self, i64), StoreError> {
        let mut store = Store::open_for_one_row(folder)?;
        let number = store.insert_verification(verification)?;
        Ok((store, number))
    }

    /// Strikes out a verification in the store in this folder, also while a service writes to it. The verification is
    /// kept, with the person who struck it out and the reason.
    ///
    /// # Errors
    /// If the store cannot be opened or written, or the verification does not exist or is already struck out.
    pub fn strike_out_in(folder: &Path, number: i64, strike: &Strike) -> Result<(Self, Verification), StoreError> {
        // The store must already exist: a mistyped folder name must not create a new store.
        drop(Store::open(folder)?);
        let mut store = Store::open_for_one_row(folder)?;
        let all = store.verification_history()?;
        let path = || store.path().to_owned();
        let Some((_, found)) = all.into_iter().find(|(id, _)| *id == number) else {
            return Err(StoreError::UnknownVerification { path: path(), number });
        };
        if let Some(Strike { by, .. }) = found.struck {
            return Err(StoreError::AlreadyStruck { path: path(), number, by });
        }
        store.commit("strike out a verification in", |writing| {
            writing.execute(
                "INSERT INTO verification_strikes (verification_id, by, why, at_unix_s) VALUES (?1, ?2, ?3, ?4)",
                params![number, strike.by, strike.why, strike.at_unix_s],
            )?;
            writing.chain("verification_strikes", number)
        })?;
        Ok((store, Verification { struck: Some(strike.clone()), ..found }))
    }

    pub(super) fn open_for_one_row(folder: &Path) -> Result<Self, StoreError> {
        match Store::create(folder) {
            Err(StoreError::Leased { .. }) => Store::open_beside_writer(folder),
            opened => opened,
        }
    }

    pub(super) fn open_beside_writer(folder: &Path) -> Result<Self, StoreError> {
        let path = folder.join(DATABASE);
        flush::flush_after_kill(&path)?;
        let mut store = Store::open(folder)?;
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let failed = |error: rusqlite::Error| StoreError::database("open", &path, &error);
        store.connection = Connection::open_with_flags(&path, flags).map_err(failed)?;
        store.connection.pragma_update(None, "synchronous", "FULL").map_err(failed)?;
        store.head = Some(HeadFile::open(folder).map_err(|source| StoreError::File {
            operation: "open the head of",
            path,
            source,
        })?);
        Ok(store)
    }

    /// Stores a verification.
    ///
    /// # Errors
    /// If the store is open for reading only or cannot be written, or a number is not finite.
    pub fn store_verification(&mut self, verification: &Verification) -> Result<(), StoreError> {
        self.require_writable()?;
        self.insert_verification(verification).map(drop)
    }

    /// Inserts a verification and returns its number.
    fn insert_verification(&mut self, verification: &Verification) -> Result<i64, StoreError> {
        if !(verification.error.is_finite() && verification.limit.is_finite()) {
            return Err(StoreError::NotFinite { name: "verification".to_owned() });
        }
        self.commit("write a verification to", |writing| {
            writing.execute(
                "INSERT INTO verifications (subject, error_mm, limit_mm, calibration_hash, at_unix_s)
                 VALUES (?1, ?2, ?3, ?4, ?5)",
                params![
                    verification.subject,
                    verification.error,
                    verification.limit,
                    verification.calibration_hash,
                    verification.at_unix_s
                ],
            )?;
            let number = writing.last_insert_rowid();
            writing.chain("verifications", number)?;
            outbox::insert(writing, Kind::Verification, number, verification.at_unix_s.saturating_mul(1_000))?;
            Ok(number)
        })
    }

    /// Returns all verifications of a device, in the order in which they were stored.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn verifications(&self, subject: &str) -> Result<Vec<Verification>, StoreError> {
        let all = self.verification_history()?.into_iter();
        Ok(all.map(|(_, verification)| verification).filter(|it| it.subject == subject).collect())
    }

    /// Returns all verifications with their numbers, in the order in which they were stored.
    ///
    /// # Errors
    /// The errors of [`Store::verifications`].
    pub fn verification_history(&self) -> Result<Vec<(i64, Verification)>, StoreError> {
        let failed = |error: rusqlite::Error| self.database_error("read verifications from", &error);
        let mut statement = self
            .connection
            .prepare(
                "SELECT id, subject, error_mm, limit_mm, calibration_hash, at_unix_s FROM verifications ORDER BY id",
            )
            .map_err(failed)?;
        let strikes = self.strikes_by_verification()?;
        let rows = statement.query_map([], |row| {
            let number: i64 = row.get(0)?;
            let verification = Verification {
                subject: row.get(1)?,
                error: row.get(2)?,
                limit: row.get(3)?,
                calibration_hash: row.get(4)?,
                at_unix_s: row.get(5)?,
                struck: strikes.get(&number).cloned(),
            };
            Ok((number, verification))
        });
        rows.map_err(failed)?.collect::<Result<_, _>>().map_err(failed)
    }

    /// Returns the strike-outs by the number of their verification.
    fn strikes_by_verification(&self) -> Result<BTreeMap<i64, Strike>, StoreError> {
        let failed = |error: rusqlite::Error| self.database_error("read strikes from", &error);
        let mut statement = self
            .connection
            .prepare("SELECT verification_id, by, why, at_unix_s FROM verification_strikes")
            .map_err(failed)?;
        let rows = statement.query_map([], |row| {
            Ok((row.get(0)?, Strike { by: row.get(1)?, why: row.get(2)?, at_unix_s: row.get(3)? }))
        });
        rows.map_err(failed)?.collect::<Result<_, _>>().map_err(failed)
    }

    /// Returns the newest verification of a device, struck out or not; `None` if the device was never verified.
    ///
    /// # Errors
    /// The errors of [`Store::verifications`].
    pub fn newest_verification(&self, subject: &str) -> Result<Option<Verification>, StoreError> {
        Ok(self.verifications(subject)?.pop())
    }
}
