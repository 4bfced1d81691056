//! Accounts, the audit trail, and incidents (changes of the store by other programs). All tables are append-only: a
//! changed account is a new row, and the newest row of a name is valid. Lists are read page by page, the newest entry
//! first.

use super::database::{Store, unix_ms};
use super::error::StoreError;
use panelprep_cell::accounts::{Account, AuditEntry};
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
    CREATE TABLE incidents (
        id INTEGER PRIMARY KEY,
        at_unix_s INTEGER NOT NULL,
        found TEXT NOT NULL
    ) STRICT;
";

/// An entry of the audit trail with its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NumberedEntry {
    /// Number of the entry, from 1.
    pub number: i64,
    /// The entry of the audit trail.
    pub entry: AuditEntry,
}

/// A position in the audit trail or in the list of requests. The order is by time and, within one millisecond, by
/// number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrailPosition {
    /// Time of the entry, ms since 1970.
    pub unix_ms: i64,
    /// Number of the entry in its table, from 1.
    pub number: i64,
}

impl TrailPosition {
    /// The position after all entries.
    pub const END: TrailPosition = TrailPosition { unix_ms: i64::MAX, number: i64::MAX };
}

/// An incident: changes by another program that were found at a start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Incident {
    /// Time of the start, s since 1970.
    pub at_unix_s: i64,
    /// The changes, as texts.
    pub found: Vec<String>,
}

impl Store {
    /// Opens the store to write rows that do not belong to a cycle, also while another process writes to it.
    ///
    /// # Errors
    /// If the store cannot be opened, or another process is about to create it.
    pub fn open_for_accounts(folder: &Path) -> Result<Self, StoreError> {
        Store::open_for_one_row(folder)
    }

    /// Stores a new or changed account, together with the entry of the audit trail about it.
    ///
    /// # Errors
    /// If the rows cannot be written.
    pub fn store_account(&mut self, account: &Account, entry: &AuditEntry) -> Result<(), StoreError> {
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

    /// Returns the present state of all accounts, by name.
    ///
    /// # Errors
    /// If the accounts cannot be read.
    pub fn accounts(&self) -> Result<BTreeMap<String, Account>, StoreError> {
        let rows = self.texts("SELECT id, account FROM accounts ORDER BY id", &[])?;
        let account = |(_, text): &(i64, String)| {
            let account: Account = self.parse_stored(text)?;
            Ok((account.name.clone(), account))
        };
        rows.iter().map(account).collect()
    }

    /// Stores an entry of the audit trail, with the present time.
    ///
    /// # Errors
    /// If the entry cannot be written.
    pub fn store_audit(&mut self, entry: &AuditEntry) -> Result<(), StoreError> {
        let unix_ms = unix_ms(self.clock());
        let entry = self.text(&AuditEntry { unix_ms, ..entry.clone() })?;
        self.commit("write the audit trail of", |writing| {
            writing.execute("INSERT INTO audit (unix_ms, entry) VALUES (?1, ?2)", params![unix_ms, entry])?;
            writing.chain("audit", writing.last_insert_rowid())
        })
    }

    /// Returns the newest entries of the audit trail, at most `most`, the newest first; with `before`, only entries
    /// before this position. Requests to the cell are in their own table ([`Store::requests`]).
    ///
    /// # Errors
    /// If the entries cannot be read.
    pub fn audit(&self, before: Option<TrailPosition>, most: usize) -> Result<Vec<NumberedEntry>, StoreError> {
        let sql =
            "SELECT id, entry FROM audit WHERE (unix_ms, id) < (?1, ?2) ORDER BY unix_ms DESC, id DESC LIMIT ?3";
        let before = before.unwrap_or(TrailPosition::END);
        self.entries(sql, &[&before.unix_ms, &before.number, &i64::try_from(most).unwrap_or(i64::MAX)])
    }

    /// Returns the entries of the audit trail about performed actions with the name `what` whose object begins with
    /// `subject_begins`, the newest first. Refused actions are not included.
    ///
    /// # Errors
    /// If the entries cannot be read.
    pub fn audit_of_subjects(&self, what: &str, subject_begins: &str) -> Result<Vec<NumberedEntry>, StoreError> {
        let sql = "SELECT id, entry FROM audit WHERE entry ->> 'what' = ?1 AND entry ->> 'refused' IS NULL
            AND substr(entry ->> 'subject', 1, length(?2)) = ?2 ORDER BY id DESC";
        self.entries(sql, &[&what, &subject_begins])
    }

    fn entries(&self, sql: &str, values: &[&dyn rusqlite::ToSql]) -> Result<Vec<NumberedEntry>, StoreError> {
        let rows = self.texts(sql, values)?;
        rows.iter()
            .map(|(number, text)| Ok(NumberedEntry { number: *number, entry: self.parse_stored(text)? }))
            .collect()
    }

    fn texts(&self, sql: &str, values: &[&dyn rusqlite::ToSql]) -> Result<Vec<(i64, String)>, StoreError> {
        let read = || -> Result<Vec<_>, rusqlite::Error> {
            let mut rows = self.connection.prepare(sql)?;
            rows.query_map(values, |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        };
        read().map_err(|error| self.database_error("read the accounts or the audit trail of", &error))
    }

    /// Stores an incident with the changes that were found.
    pub(super) fn store_incident(&mut self, found: &[String]) -> Result<(), StoreError> {
        let (at_unix_s, found) = (self.unix_s(), self.text(&found)?);
        self.commit("write an incident to", |writing| {
            writing
                .execute("INSERT INTO incidents (at_unix_s, found) VALUES (?1, ?2)", params![at_unix_s, found])?;
            writing.chain("incidents", writing.last_insert_rowid())
        })
    }

    /// Returns all incidents, the oldest first.
    ///
    /// # Errors
    /// If the incidents cannot be read.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_row_of_an_account_is_valid_and_the_trail_is_searched_by_subject() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::create(&folder.path().join("store")).expect("a store");
        let line = |what: &str, subject: &str, refused: Option<&str>| AuditEntry {
            subject: Some(subject.to_owned()),
            refused: refused.map(str::to_owned),
            ..AuditEntry::for_completed_action(None, None, "terminal".to_owned(), what)
        };
        let account = Account {
            name: "eva".to_owned(),
            printed_name: "Eva".to_owned(),
            role: panelprep_cell::accounts::Role::Viewer,
            password_hash: String::new(),
            is_enabled: true,
        };
        store.store_account(&account, &line("change account", "eva", None)).expect("kept");
        let changed = Account { is_enabled: false, ..account };
        store.store_account(&changed, &line("change account", "eva", None)).expect("kept");
        assert_eq!(store.accounts().expect("read"), BTreeMap::from([("eva".to_owned(), changed)]));
        for (what, subject, refused) in [
            ("change recipe", "door.toml: first", None),
            ("log in", "door.toml: x", None),
            ("change recipe", "door.toml.bak: x", None),
            ("change recipe", "door.toml: wrong", Some("line 1")),
            ("change recipe", "door.toml: more rows", None),
        ] {
            store.store_audit(&line(what, subject, refused)).expect("kept");
        }
        let found = store.audit_of_subjects("change recipe", "door.toml: ").expect("read");
        assert_eq!(found.iter().map(|line| line.number).collect::<Vec<_>>(), [7, 3]);
        let [newest, before] = &store.audit(None, 2).expect("read")[..] else { panic!("two") };
        assert_eq!((newest.number, before.number, before.entry.refused.as_deref()), (7, 6, Some("line 1")));
        let oldest = store.audit(None, 9).expect("read")[6].clone();
        let position = TrailPosition { unix_ms: oldest.entry.unix_ms, number: oldest.number };
        assert_eq!(store.audit(Some(position), 9).expect("read"), []);
        assert!(before.entry.unix_ms > 0, "the time is set by the store");
        drop(store);
        let verified = Store::verify(&folder.path().join("store"), true).expect("verified");
        assert_eq!(verified.differences, [] as [String; 0]);
    }

    /// Five entries have the same time, and the sixth has an earlier time because the clock was set back. Pages of two
    /// entries contain each entry once.
    #[test]
    fn pages_contain_each_line_of_one_millisecond_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut store = Store::create(&folder.path().join("store")).expect("a store");
        let line = AuditEntry::for_completed_action(None, None, "terminal".to_owned(), "log in");
        store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(2_000);
        (0..5).for_each(|_| store.store_audit(&line).expect("kept"));
        store.clock = || std::time::UNIX_EPOCH + std::time::Duration::from_millis(1_999);
        store.store_audit(&line).expect("kept");
        let (mut before, mut pages) = (None, Vec::new());
        loop {
            let page = store.audit(before, 2).expect("read");
            let Some(last) = page.last() else { break };
            before = Some(TrailPosition { unix_ms: last.entry.unix_ms, number: last.number });
            pages.push(page.iter().map(|line| line.number).collect::<Vec<_>>());
        }
        assert_eq!(pages, [[5, 4], [3, 2], [1, 6]]);
    }
}
