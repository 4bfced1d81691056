//! The outbox: one row for each item that the office server must receive, which are the end of a cycle, a signature or
//! a verification. The row is written in the same transaction as the item. Rows are never changed or removed, so that
//! no item can be lost on the way to the office server.
//!
//! Rows are numbered from 1 within an epoch, which has a random name. A new epoch begins with a new store, after rows
//! were found changed or missing, and after a restore: within an epoch, a store never uses a number twice. The progress
//! of sending is not stored in the database (see `daemon/office`).

use super::chain;
use super::commit::{TransactionFailure, WriteTransaction};
use super::database::{Store, unix_ms};
use super::error::StoreError;
use super::prune;
use crate::office::{Body, CycleEnd, ItemEnvelope, Kind, ListEntry, NamedFile, OfficeVerification, Position};
use crate::signing::{self, SignedCycle, Statement};
use panelprep_cell::record::CycleId;
use panelprep_vision::calib::health::Verification;
use rusqlite::{Connection, OptionalExtension, Row, params};
use std::path::Path;

pub(super) const TABLES: &str = "
    CREATE TABLE outbox_epochs (
        id INTEGER PRIMARY KEY,
        epoch TEXT NOT NULL UNIQUE,
        unix_ms INTEGER NOT NULL,
        why TEXT NOT NULL
    ) STRICT;
    CREATE TABLE outbox (
        id INTEGER PRIMARY KEY,
        epoch_id INTEGER NOT NULL REFERENCES outbox_epochs (id),
        number INTEGER NOT NULL,
        kind TEXT NOT NULL,
        row_key INTEGER NOT NULL,
        unix_ms INTEGER NOT NULL,
        UNIQUE (epoch_id, number)
    ) STRICT;
";

/// Begins the first epoch of a new store, in the present transaction. Its row is the first link of the chain.
pub(super) fn begin_first_epoch(connection: &Connection) -> Result<(), rusqlite::Error> {
    connection.execute(
        "INSERT INTO outbox_epochs (epoch, unix_ms, why) VALUES (lower(hex(randomblob(16))), 0, 'new store')",
        [],
    )?;
    let table = chain::hashed_table("outbox_epochs").ok_or(rusqlite::Error::QueryReturnedNoRows)?;
    chain::add_link(connection, chain::ChainPosition::START, table, connection.last_insert_rowid()).map(drop)
}

/// Inserts a row for an item, in the transaction that writes the item.
pub(super) fn insert(
    writing: &mut WriteTransaction<'_>,
    kind: Kind,
    row_key: i64,
    unix_ms: i64,
) -> Result<(), TransactionFailure> {
    writing.execute(
        "INSERT INTO outbox (epoch_id, number, kind, row_key, unix_ms)
         SELECT epoch_id, 1 + coalesce((SELECT max(number) FROM outbox WHERE outbox.epoch_id = last.epoch_id), 0), ?1, ?2, ?3
         FROM (SELECT max(id) AS epoch_id FROM outbox_epochs) AS last",
        params![kind.keyword(), row_key, unix_ms],
    )?;
    writing.chain("outbox", writing.last_insert_rowid())
}

/// A row of the outbox.
struct OutboxRow {
    position: Position,
    kind: String,
    row_key: i64,
    unix_ms: i64,
}

impl OutboxRow {
    fn from_row(row: &Row<'_>) -> Result<Self, rusqlite::Error> {
        let number: i64 = row.get(1)?;
        let position = Position { epoch: row.get(0)?, number: number.unsigned_abs() };
        Ok(OutboxRow { position, kind: row.get(2)?, row_key: row.get(3)?, unix_ms: row.get(4)? })
    }
}

const ROWS: &str = "SELECT epoch, number, kind, row_key, outbox.unix_ms FROM outbox JOIN outbox_epochs ON outbox_epochs.id = epoch_id";

impl Store {
    /// Returns the position of the last row of each epoch, the oldest epoch first.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn outbox_epochs(&self) -> Result<Vec<Position>, StoreError> {
        let sql = "SELECT epoch, coalesce((SELECT max(number) FROM outbox WHERE epoch_id = outbox_epochs.id), 0)
            FROM outbox_epochs ORDER BY id";
        let read = || -> Result<Vec<Position>, rusqlite::Error> {
            let position = |row: &Row<'_>| {
                let number: i64 = row.get(1)?;
                Ok(Position { epoch: row.get(0)?, number: number.unsigned_abs() })
            };
            self.connection.prepare_cached(sql)?.query_map([], position)?.collect()
        };
        read().map_err(|error| self.database_error("read the office's outbox from", &error))
    }

    /// Returns the items after this position, within its epoch and in order, at most `most` items.
    ///
    /// # Errors
    /// If the rows cannot be read, or a row or a file is damaged.
    pub fn outbox_rows_after(&self, after: &Position, most: usize) -> Result<Vec<ItemEnvelope>, StoreError> {
        let failed = |error: rusqlite::Error| self.database_error("read the office's outbox from", &error);
        let sql = format!("{ROWS} WHERE epoch = ?1 AND number > ?2 ORDER BY number LIMIT ?3");
        let mut statement = self.connection.prepare_cached(&sql).map_err(failed)?;
        let [after_number, most] = [after.number, most as u64].map(|it| i64::try_from(it).unwrap_or(i64::MAX));
        let rows =
            statement.query_map(params![after.epoch, after_number, most], OutboxRow::from_row).map_err(failed)?;
        let rows: Vec<OutboxRow> = rows.collect::<Result<_, _>>().map_err(failed)?;
        rows.into_iter().map(|row| self.envelope(row)).collect()
    }

    /// Returns the time at which the item after this position was stored, ms since 1970; `None` if there is no such
    /// item.
    ///
    /// # Errors
    /// If the rows cannot be read.
    pub fn outbox_waits_since(&self, after: &Position) -> Result<Option<i64>, StoreError> {
        let sql = format!("{ROWS} WHERE epoch = ?1 AND number > ?2 ORDER BY number LIMIT 1");
        let number = i64::try_from(after.number).unwrap_or(i64::MAX);
        let read = || {
            self.connection
                .prepare_cached(&sql)?
                .query_row(params![after.epoch, number], OutboxRow::from_row)
                .optional()
        };
        let row = read().map_err(|error| self.database_error("read the office's outbox from", &error))?;
        Ok(row.map(|row| row.unix_ms))
    }

    /// Returns all items with the hash of their content, the oldest first. `archive check` compares them with the items
    /// of the office server.
    ///
    /// # Errors
    /// If the rows cannot be read, or a row or a file is damaged.
    pub fn outbox_list(&self) -> Result<Vec<ListEntry>, StoreError> {
        let mut listed = Vec::new();
        for last in self.outbox_epochs()? {
            let mut after = Position { number: 0, ..last };
            loop {
                let page = self.outbox_rows_after(&after, 500)?;
                let Some(end) = page.last() else { break };
                after = end.position.clone();
                listed.extend(page.iter().map(ItemEnvelope::list_line));
            }
        }
        Ok(listed)
    }

    /// Begins a new epoch in the store in this folder, also while a service writes to it, and stores the reason.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn renew_outbox(folder: &Path, why: &str) -> Result<(), StoreError> {
        Store::open_for_one_row(folder)?.begin_epoch(why)
    }

    pub(super) fn begin_epoch(&mut self, why: &str) -> Result<(), StoreError> {
        let unix_ms = unix_ms(self.clock());
        self.commit("begin a new epoch in", |writing| {
            writing.execute(
                "INSERT INTO outbox_epochs (epoch, unix_ms, why) VALUES (lower(hex(randomblob(16))), ?1, ?2)",
                params![unix_ms, why],
            )?;
            writing.chain("outbox_epochs", writing.last_insert_rowid())
        })
    }

    fn envelope(&self, row: OutboxRow) -> Result<ItemEnvelope, StoreError> {
        let OutboxRow { position, kind, row_key, unix_ms } = row;
        let unknown = || StoreError::Unreadable {
            path: self.path().to_owned(),
            problem: format!(
                "record {} in the queue to the office server has the unknown kind \"{kind}\"; a newer version may have written it: update this program",
                position.number
            ),
        };
        let body = match Kind::from_keyword(&kind).ok_or_else(unknown)? {
            Kind::Cycle => self.cycle_end_row(CycleId(row_key))?,
            Kind::Signature => self.signed_body(row_key)?,
            Kind::Verification => self.verification_body(row_key)?,
        };
        Ok(ItemEnvelope { position, unix_ms, body })
    }

    /// Returns the end of a cycle from the cycle's row alone, so that every program version returns the same content.
    fn cycle_end_row(&self, id: CycleId) -> Result<Body, StoreError> {
        let sql = "SELECT started_unix_s, ended_unix_s, panel, taught_version, recipe_hash, program_version, verdict, reasons
            FROM cycles WHERE id = ?1";
        let part = self.cycle_part(id)?;
        let row = |row: &Row<'_>| {
            let reasons: String = row.get(7)?;
            let end = CycleEnd {
                cycle: id,
                started_unix_s: row.get(0)?,
                ended_unix_s: row.get(1)?,
                panel: row.get(2)?,
                taught_version: row.get(3)?,
                recipe_hash: row.get(4)?,
                program_version: row.get(5)?,
                verdict: row.get(6)?,
                reasons: serde_json::Value::Null,
                part: part.clone(),
            };
            Ok((end, reasons))
        };
        let read = self.connection.query_row(sql, [id.0], row);
        let (end, reasons) = read.map_err(|error| self.database_error("read a cycle of", &error))?;
        let end = CycleEnd { reasons: self.parse_stored(&reasons)?, ..end };
        self.canonical(&end).map(Body::Cycle)
    }

    fn signed_body(&self, number: i64) -> Result<Body, StoreError> {
        let row = self.signature(number)?;
        let statement = self.blob(&row.record_hash)?;
        let read = Statement::read(&statement).map_err(|source| self.signing_error(source))?;
        let files = match &read.says {
            signing::StatementContent::Cycle(cycle) => self.files_for_office(cycle)?,
            signing::StatementContent::Person(_) => Vec::new(),
        };
        Ok(Body::Signature { statement, signature: row.signature, public_key: row.public_key, files })
    }

    /// Returns the files of a record that are sent to the office server: the inputs of the cycle and all pictures, but
    /// no scans and clips.
    fn files_for_office(&self, cycle: &SignedCycle) -> Result<Vec<NamedFile>, StoreError> {
        let removed = prune::removed_files(self)?;
        let blobs = self.blobs.folder();
        let named = |(name, hash): (String, String)| {
            let gone = match blobs.join(&hash).exists() {
                true => None,
                false if removed.contains(&hash) => Some("removed according to [store] keep"),
                false => Some("missing in the cell's store"),
            };
            NamedFile { name, hash, gone: gone.map(str::to_owned) }
        };
        Ok(signing::exported_files(cycle).into_iter().map(named).collect())
    }

    fn verification_body(&self, number: i64) -> Result<Body, StoreError> {
        let all = self.verification_history()?;
        let found = all.into_iter().find(|(id, _)| *id == number);
        let (_, found) =
            found.ok_or_else(|| StoreError::UnknownVerification { path: self.path().to_owned(), number })?;
        // The content of a verification does not contain a strike-out, which may be added later.
        let Verification { subject, error, limit, calibration_hash, at_unix_s, struck: _ } = found;
        self.canonical(&OfficeVerification { subject, error, limit, calibration_hash, at_unix_s })
            .map(Body::Verification)
    }

    fn canonical(&self, value: &impl serde::Serialize) -> Result<Vec<u8>, StoreError> {
        signing::canonical(value).map_err(|source| self.signing_error(source))
    }
}
