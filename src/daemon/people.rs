//! People who log in, for every front that has a log-in: their accounts, the pause after wrong passwords, and the audit trail.
//!
//! One of it serves all fronts, so that whoever tries passwords at two of them is counted once. It reads and writes the store by
//! connections of its own; nothing of the loop waits for it.

use super::hashing::Hashing;
use super::store_access::StoreAccess;
use crate::accounts::{self, Account, AuditEntry, Lockout};
use crate::store::{Store, StoreError};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// What came of a name and a password.
#[derive(Debug, Clone, PartialEq)]
pub enum LogIn {
    /// They are right.
    Right(Account),
    /// They are not, or the account is disabled; in these words for the audit trail.
    Wrong(&'static str),
    /// The account pauses for so many seconds more. The password was not looked at.
    Pauses(f64),
    /// No account has this name's form, or the program is ending.
    Unknown,
}

/// Accounts, pauses and the audit trail of one store.
#[derive(Debug)]
pub struct People {
    store: StoreAccess,
    hashing: Hashing,
    lockout: Mutex<Lockout>,
    begun: Instant,
}

impl People {
    /// Of the store in this folder, which need not exist yet.
    pub fn new(folder: PathBuf) -> Self {
        People {
            store: StoreAccess::new(folder),
            hashing: Hashing::default(),
            lockout: Mutex::default(),
            begun: Instant::now(),
        }
    }

    /// Seconds on a clock that does not jump.
    pub fn now_s(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Who tried wrong passwords lately.
    pub fn lockout(&self) -> MutexGuard<'_, Lockout> {
        // Every change is made whole under the lock.
        self.lockout.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// For how many seconds more this account's password may not be tried, after wrong ones.
    pub fn pauses_s(&self, name: &str) -> Option<f64> {
        self.lockout().pauses_s(name, self.now_s())
    }

    /// Reads the store, on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// Where the store cannot be opened or read.
    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.store.read(read)
    }

    /// Writes a row that no cycle waits for, on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// Where the store cannot be opened or written.
    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.store.write(write)
    }

    /// Keeps a line of the audit trail; where the disk refuses, the service's log has it.
    pub fn audit(&self, entry: &AuditEntry) {
        if let Err(error) = self.write(|store| store.keep_audit(entry)) {
            let (what, who) = (&entry.what, entry.who.as_deref().unwrap_or("nobody who is logged in"));
            tracing::warn!("the audit trail could not be written: {error}; {what} by {who}");
        }
    }

    /// The account, where it may log in by this password. On the calling thread, which computes for a while.
    pub fn judged(&self, name: &str, password: &str) -> Option<Account> {
        let account = match self.read(|store| store.accounts()) {
            Ok(mut accounts) => accounts.remove(name),
            Err(error) => {
                tracing::warn!("nobody can log in: {error}");
                None
            }
        };
        let hash = account.as_ref().map_or("", |account| &account.password_hash);
        let is_right = accounts::is_right(password, hash);
        account.filter(|account| is_right && account.is_enabled)
    }

    /// Works with passwords, one at a time.
    pub async fn hashing<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        self.hashing.run(work).await
    }

    /// Judges a name and a password, and counts a wrong one.
    pub async fn log_in(self: &std::sync::Arc<Self>, name: &str, password: String) -> LogIn {
        if accounts::checked_name(name).is_err() {
            return LogIn::Unknown;
        }
        if let Some(left_s) = self.pauses_s(name) {
            return LogIn::Pauses(left_s);
        }
        let (shared, tried) = (self.clone(), name.to_owned());
        match self.hashing(move || shared.judged(&tried, &password)).await.flatten() {
            Some(account) => {
                self.lockout().right(name);
                LogIn::Right(account)
            }
            None if self.lockout().wrong(name, self.now_s()) => LogIn::Wrong("wrong password; the account pauses"),
            None => LogIn::Wrong("wrong name or password"),
        }
    }
}
