//! Accounts and the audit trail. Both are append-only: a changed account is a new row, and the newest row of a name holds.

use super::database::{Store, unix_ms};
use super::error::StoreError;
use crate::accounts::{Account, AuditEntry};
use rusqlite::params;
use std::collections::BTreeMap;
use std::path::Path;

pub(super) const TABLES: &str = "
    CREATE TABLE accounts (
        id INTEGER PRIMARY KEY,
        unix_ms INTEGER NOT NULL,
        account TEXT NOT NULL
    ) STRICT;
    CREATE TABLE audit (
        id INTEGER PRIMARY KEY,
        unix_ms INTEGER NOT NULL,
        entry TEXT NOT NULL
    ) STRICT;
";

/// A line of the audit trail with its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NumberedEntry {
    /// Its number, from 1.
    pub number: i64,
    /// The line.
    pub entry: AuditEntry,
}

impl Store {
    /// Opens the store for rows that no cycle waits for: as its only writer, or beside the one that there is.
    ///
    /// # Errors
    /// Where there is no store beside a writer, or it cannot be opened.
    pub fn for_people(folder: &Path) -> Result<Self, StoreError> {
        Store::for_one_row(folder)
    }

    /// Keeps a new account or what is changed of one, together with the line of the audit trail that says so.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn keep_account(&mut self, account: &Account, entry: &AuditEntry) -> Result<(), StoreError> {
        let unix_ms = unix_ms(self.clock());
        let (account, entry) = (self.text(account)?, self.text(&AuditEntry { unix_ms, ..entry.clone() })?);
        self.commit("write an account to", |writing| {
            writing
                .execute("INSERT INTO accounts (unix_ms, account) VALUES (?1, ?2)", params![unix_ms, account])?;
            writing.chain("accounts", writing.last_insert_rowid())?;
            writing.execute("INSERT INTO audit (unix_ms, entry) VALUES (?1, ?2)", params![unix_ms, entry])?;
            writing.chain("audit", writing.last_insert_rowid())
        })
    }

    /// Every account as it is now, by name.
    ///
    /// # Errors
    /// Where they cannot be read.
    pub fn accounts(&self) -> Result<BTreeMap<String, Account>, StoreError> {
        if !self.has_table("accounts")? {
            return Ok(BTreeMap::new());
        }
        let rows = self.texts("SELECT id, account FROM accounts ORDER BY id", &[])?;
        let account = |(_, text): &(i64, String)| {
            let account: Account = self.parsed(text)?;
            Ok((account.name.clone(), account))
        };
        rows.iter().map(account).collect()
    }

    /// Keeps a line of the audit trail. Its time is set here.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub fn keep_audit(&mut self, entry: &AuditEntry) -> Result<(), StoreError> {
        let unix_ms = unix_ms(self.clock());
        let entry = self.text(&AuditEntry { unix_ms, ..entry.clone() })?;
        self.commit("write the audit trail of", |writing| {
            writing.execute("INSERT INTO audit (unix_ms, entry) VALUES (?1, ?2)", params![unix_ms, entry])?;
            writing.chain("audit", writing.last_insert_rowid())
        })
    }

    /// At most so many lines of the audit trail, the newest first; with `before`, only lines with a lower number.
    ///
    /// # Errors
    /// Where they cannot be read.
    pub fn audit(&self, before: Option<i64>, most: usize) -> Result<Vec<NumberedEntry>, StoreError> {
        if !self.has_table("audit")? {
            return Ok(Vec::new());
        }
        let sql = "SELECT id, entry FROM audit WHERE id < ?1 ORDER BY id DESC LIMIT ?2";
        let (before, most) = (before.unwrap_or(i64::MAX), i64::try_from(most).unwrap_or(i64::MAX));
        let rows = self.texts(sql, &[&before, &most])?;
        rows.iter().map(|(number, text)| Ok(NumberedEntry { number: *number, entry: self.parsed(text)? })).collect()
    }

    fn texts(&self, sql: &str, values: &[&dyn rusqlite::ToSql]) -> Result<Vec<(i64, String)>, StoreError> {
        let read = || -> Result<Vec<_>, rusqlite::Error> {
            let mut rows = self.connection.prepare(sql)?;
            rows.query_map(values, |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        read().map_err(|error| self.failed("read the people of", &error))
    }
}
