//! The people who log in, for every interface that has a log-in: their accounts, the pause after wrong passwords, and
//! the audit trail.
//!
//! One instance serves all interfaces, so that the attempts of a person at two interfaces are counted together. It
//! reads and writes the store through its own connections; no part of the loop waits for it. Passwords are hashed one
//! at a time.
//!
//! [`FailedLogins`] limits the lines about failed log-ins, at the cell and at the office: if there are many, only some
//! of them have a line, and the number of the others is written when the minute is over, even if no other log-in
//! follows.

use panelprep_cell::accounts;
use panelprep_cell::accounts::{Account, AuditEntry, LineLimit, Lockout, MaxLinesPerMinute};
use panelprep_cell::files::content_hash;
use panelprep_store::store::{Store, StoreError};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, oneshot};

/// The result of a log-in with a name and a password.
#[derive(Debug, Clone, PartialEq)]
pub enum LoginResult {
    /// Name and password are correct.
    Right(Account),
    /// The name or the password is wrong, or the account is disabled; the text is for the audit trail.
    Wrong(&'static str),
    /// Log-in to the account is blocked for this many more seconds. The password was not checked.
    Pauses(f64),
    /// The name does not have the form of an account name, or the program is ending.
    Unknown,
}

/// Identifies an account during one of its sessions: the stamp changes if the account gets another role or a new
/// password, or is disabled.
pub(super) fn account_stamp(account: &Account) -> String {
    let Account { role, password_hash, is_enabled, .. } = account;
    let digest = content_hash(format!("{}\n{is_enabled}\n{password_hash}", role.keyword()).as_bytes());
    digest.chars().take(16).collect()
}

/// The accounts, log-in pauses and audit trail of one store.
#[derive(Debug)]
pub struct AccountService {
    store: StoreAccess,
    hashing: PasswordHashing,
    lockout: Mutex<Lockout>,
    /// The limit of lines about failed log-ins in the audit trail.
    failed_logins: FailedLogins,
    started: Instant,
}

impl AccountService {
    /// Creates the access to the accounts of the store in this folder, which need not exist yet.
    pub fn new(folder: PathBuf) -> Self {
        AccountService {
            store: StoreAccess::new(folder),
            hashing: PasswordHashing::default(),
            lockout: Mutex::default(),
            failed_logins: FailedLogins::new(Instant::now()),
            started: Instant::now(),
        }
    }

    /// Returns the time of a monotonic clock, s.
    pub fn now_s(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Locks the recent attempts with wrong passwords.
    fn lock_lockout(&self) -> MutexGuard<'_, Lockout> {
        // A poisoned lock is harmless: every change under it is complete.
        self.lockout.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the remaining seconds for which this account's log-in is blocked after wrong passwords.
    pub fn pauses_s(&self, name: &str) -> Option<f64> {
        self.lock_lockout().pauses_s((name, true), self.now_s())
    }

    /// Reads the store on the calling thread, which may wait for the disk.
    ///
    /// # Errors
    /// If the store cannot be opened or read.
    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.store.read(read)
    }

    /// Writes a row on the calling thread, which may wait for the disk; no cycle waits for such a row.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.store.write(write)
    }

    /// Writes a line of the audit trail; if the disk cannot be written, the line is written to the service's log.
    pub fn audit(&self, entry: &AuditEntry) {
        if let Err(error) = self.write(|store| store.store_audit(entry)) {
            let (what, who) = (&entry.what, entry.who.as_deref().unwrap_or("a person who is not logged in"));
            tracing::warn!("the audit trail could not be written: {error}; lost entry: {what} by {who}");
        }
    }

    /// Writes a line about a failed log-in, or only counts it if there are many, so that attempts do not fill the disk.
    /// The number of failed log-ins without a line is written when the minute is over. Runs on the calling thread.
    pub fn audit_failed_login(self: &Arc<Self>, entry: &AuditEntry) {
        let counted = self.failed_logins.count();
        if let Some(left_out) = counted.left_out {
            self.audit(&left_out_line(left_out, entry));
        }
        if counted.is_written {
            self.audit(entry);
        }
        if let Some(after) = counted.report_after {
            self.report_left_out_later(after, entry.clone());
        }
    }

    /// Waits for this time on a separate thread, then writes the number of failed log-ins without a line. At most one
    /// such thread waits for each minute.
    fn report_left_out_later(self: &Arc<Self>, after: Duration, last: AuditEntry) {
        let people = Arc::downgrade(self);
        let wait = move || {
            thread::sleep(after);
            let Some(people) = people.upgrade() else { return };
            if let Some(left_out) = people.failed_logins.over() {
                people.audit(&left_out_line(left_out, &last));
            }
        };
        if let Err(error) = thread::Builder::new().name("log-ins".to_owned()).spawn(wait) {
            tracing::warn!("the number of wrong log-ins is written only with the next wrong one: {error}");
        }
    }

    fn account(&self, name: &str) -> Option<Account> {
        match self.read(|store| store.accounts()) {
            Ok(mut accounts) => accounts.remove(name),
            Err(error) => {
                tracing::warn!("log-in is not possible, because the accounts cannot be read: {error}");
                None
            }
        }
    }

    /// Checks a name and a password, and counts a wrong password. The computation takes a while on the calling thread.
    /// Call it only within [`AccountService::hashing`], so that each attempt takes the results of earlier attempts into
    /// account.
    pub fn check_password(&self, name: &str, password: &str) -> LoginResult {
        let account = self.account(name);
        let who = (name, account.is_some());
        if let Some(left_s) = self.lock_lockout().pauses_s(who, self.now_s()) {
            return LoginResult::Pauses(left_s);
        }
        let hash = account.as_ref().map_or("", |account| &account.password_hash);
        let is_right = accounts::is_correct_password(password, hash);
        match account.filter(|account| is_right && account.is_enabled) {
            Some(account) => {
                self.lock_lockout().record_success(name);
                LoginResult::Right(account)
            }
            None if self.lock_lockout().record_failure(who, self.now_s()) => {
                LoginResult::Wrong("wrong password; the account is locked temporarily")
            }
            None => LoginResult::Wrong("wrong name or password"),
        }
    }

    /// Runs work with passwords, one piece at a time.
    pub async fn hashing<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        self.hashing.run(work).await
    }

    /// Checks a name and a password when it is their turn, and counts a wrong password.
    pub async fn attempt_login(self: &Arc<Self>, name: &str, password: String) -> LoginResult {
        if accounts::checked_name(name).is_err() {
            return LoginResult::Unknown;
        }
        // An attempt for an account whose log-in is blocked does not delay the attempts of others.
        if let Some(left_s) = self.pauses_s(name) {
            return LoginResult::Pauses(left_s);
        }
        let (shared, tried) = (self.clone(), name.to_owned());
        self.hashing(move || shared.check_password(&tried, &password)).await.unwrap_or(LoginResult::Unknown)
    }
}

/// Returns the line that states the number of failed log-ins without a line of their own; `last` was one of them.
fn left_out_line(left_out: u64, last: &AuditEntry) -> AuditEntry {
    let line = AuditEntry::for_completed_action(None, None, last.from.clone(), &last.what);
    AuditEntry { refused: Some(left_out_text(left_out)), ..line }
}

/// Limits the work with passwords to one at a time; the others wait here for their turn.
#[derive(Debug)]
pub(super) struct PasswordHashing(Semaphore);

impl Default for PasswordHashing {
    fn default() -> Self {
        PasswordHashing(Semaphore::new(1))
    }
}

impl PasswordHashing {
    /// Runs work with passwords, one piece at a time, on a thread that ends with the work. A hash needs 19 MiB and most
    /// of the time of a processor, and a thread that stays alive would retain this memory. Returns `None` if the
    /// program ends.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let _turn = self.0.acquire().await.ok()?;
        let (sender, result) = oneshot::channel();
        let hash = move || drop(sender.send(work()));
        thread::Builder::new().name("password".to_owned()).spawn(hash).ok()?;
        result.await.ok()
    }
}

/// Maximum number of failed log-ins per minute that have their own line.
const MAX_LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 0, refused: 20 };

/// The failed log-ins of this minute.
#[derive(Debug)]
pub(super) struct FailedLogins {
    lines: Mutex<LineLimit>,
    begun: Instant,
}

/// The consequences of a failed log-in for the audit trail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counted {
    /// Number of lines that were left out in the minute before, to be written first.
    pub left_out: Option<u64>,
    /// Whether this log-in has its own line.
    pub is_written: bool,
    /// Time after which [`FailedLogins::over`] must be called; `None` if a call is already due or not needed.
    pub report_after: Option<Duration>,
}

impl FailedLogins {
    /// Creates a count without failed log-ins; the first minute began at this time.
    pub fn new(begun: Instant) -> Self {
        FailedLogins { lines: Mutex::new(LineLimit::new(MAX_LINES, 0)), begun }
    }

    /// Counts a failed log-in.
    pub fn count(&self) -> Counted {
        self.count_at(self.now_ms())
    }

    /// Returns the number of lines that were left out in the last complete minute, if it was not yet returned.
    pub fn over(&self) -> Option<u64> {
        self.lines().end_elapsed_minute(self.now_ms())
    }

    fn count_at(&self, now_ms: u64) -> Counted {
        let mut lines = self.lines();
        let left_out = lines.end_elapsed_minute(now_ms);
        let is_written = lines.admit_line(true);
        // The first line that is left out requests the report of all that are left out in this minute.
        let is_first = !is_written && lines.left_out() == 1;
        let report_after = is_first.then(|| Duration::from_millis(lines.remaining_ms(now_ms)));
        Counted { left_out, is_written, report_after }
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    fn lines(&self) -> MutexGuard<'_, LineLimit> {
        // A poisoned lock is harmless: every change under it is complete.
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Describes the lines that were left out.
pub(super) fn left_out_text(left_out: u64) -> String {
    format!("further wrong log-ins within a minute, without a line of their own: {left_out}")
}

/// Connections to the store in a folder.
#[derive(Debug)]
struct StoreAccess {
    folder: PathBuf,
    reader: Mutex<Option<Store>>,
    writer: Mutex<Option<Store>>,
}

impl StoreAccess {
    pub fn new(folder: PathBuf) -> Self {
        StoreAccess { folder, reader: Mutex::default(), writer: Mutex::default() }
    }

    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut reader = lock(&self.reader);
        let store = match reader.take() {
            Some(store) => store,
            None => Store::open(&self.folder)?,
        };
        let result = read(&store);
        *reader = Some(store);
        result
    }

    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        let mut writer = lock(&self.writer);
        let mut store = match writer.take() {
            Some(store) => store,
            None => Store::open_for_accounts(&self.folder)?,
        };
        let result = write(&mut store);
        *writer = Some(store);
        result
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // If a reader panicked, its connection is gone, and the next reader opens another.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simultaneous attempts are checked one after the other, and the sixth one is not checked any more.
    #[tokio::test]
    async fn the_sixth_of_six_simultaneous_wrong_passwords_is_not_checked() {
        let folder = tempfile::tempdir().expect("a folder");
        let people = Arc::new(AccountService::new(folder.path().join("store")));
        let tries = (0..6).map(|_| {
            let people = people.clone();
            tokio::spawn(async move { people.attempt_login("anna", "wrong horse".to_owned()).await })
        });
        let mut came = Vec::new();
        for tried in tries.collect::<Vec<_>>() {
            came.push(tried.await.expect("it ends"));
        }
        let paused = came.iter().filter(|came| matches!(came, LoginResult::Pauses(_))).count();
        assert_eq!(paused, 1, "{came:?}");
        let again = people.attempt_login("anna", "wrong horse".to_owned()).await;
        assert!(matches!(again, LoginResult::Pauses(left_s) if left_s > 50.0), "it pauses on: {again:?}");
    }

    /// A thousand failed log-ins within a minute give twenty lines; the others are only counted, and their number is
    /// written when the minute is over.
    #[test]
    fn many_failed_logins_give_few_lines() {
        let folder = tempfile::tempdir().expect("a folder");
        drop(Store::create(&folder.path().join("store")).expect("a store"));
        let people = Arc::new(AccountService::new(folder.path().join("store")));
        let line =
            AuditEntry::for_completed_action(Some("engineer".to_owned()), None, "10.0.0.1".to_owned(), "log in");
        let line = AuditEntry { refused: Some("wrong name or password".to_owned()), ..line };
        (0..1_000).for_each(|_| people.audit_failed_login(&line));
        let lines = people.read(|store| store.audit(None, 2_000)).expect("read").len();
        assert_eq!(lines, 20);
    }

    /// The number of log-ins without a line is written when the minute is over, although no other log-in follows.
    #[test]
    fn left_out_logins_are_written_when_their_minute_is_over() {
        let folder = tempfile::tempdir().expect("a folder");
        drop(Store::create(&folder.path().join("store")).expect("a store"));
        let mut people = AccountService::new(folder.path().join("store"));
        let begun = Instant::now();
        let minute_began = begun.checked_sub(Duration::from_secs(55)).expect("the computer runs for a minute");
        people.failed_logins = FailedLogins::new(minute_began);
        let people = Arc::new(people);
        let line =
            AuditEntry::for_completed_action(Some("engineer".to_owned()), None, "10.0.0.1".to_owned(), "log in");
        (0..25).for_each(|_| people.audit_failed_login(&line));
        let counted = || {
            let lines = people.read(|store| store.audit(None, 100)).expect("read");
            lines
                .iter()
                .filter_map(|line| line.entry.refused.clone())
                .any(|refused| refused == "further wrong log-ins within a minute, without a line of their own: 5")
        };
        while !counted() {
            assert!(begun.elapsed() < Duration::from_secs(60), "the count is lost");
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Calculated by hand: 20 of 25 log-ins have a line. The 21st, at 300 ms, requests the report at 60,000 ms. No
    /// later one in this minute requests another report.
    #[test]
    fn the_first_line_that_is_left_out_requests_the_report() {
        let failed = FailedLogins::new(Instant::now());
        let counted: Vec<Counted> = (0..25).map(|_| failed.count_at(300)).collect();
        assert!(counted[..20].iter().all(|one| one.is_written && one.report_after.is_none()));
        assert!(counted[20..].iter().all(|one| !one.is_written));
        assert_eq!(counted[20].report_after, Some(Duration::from_millis(59_700)));
        assert!(counted[21..].iter().all(|one| one.report_after.is_none()));
        assert_eq!(failed.lines().end_elapsed_minute(59_999), None, "the minute is not over");
        assert_eq!(failed.lines().end_elapsed_minute(60_000), Some(5));
        assert_eq!(failed.lines().end_elapsed_minute(120_000), None, "it is reported once");
    }
}
