//! The people who log in, for every interface with a log-in: their accounts, the temporary lock after wrong passwords,
//! and the audit trail.
//!
//! One instance serves all interfaces, so that the attempts of a person at two interfaces are counted together. It
//! reads and writes the store through its own connections; the loop never waits for it. Passwords are hashed one at a
//! time.
//!
//! [`FailedLogins`] limits the entries about failed log-ins, in the cell and in the office server. If there are many in
//! one minute, only some of them get an entry. The number of the others is written at the end of the minute, even if no
//! other log-in follows.

use panelprep_cell::accounts;
use panelprep_cell::accounts::{Account, AuditEntry, LineLimit, Lockout, MaxLinesPerMinute};
use panelprep_cell::files::content_hash;
use panelprep_store::store::{Store, StoreError};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, oneshot};

/// The result of a log-in attempt with a name and a password.
#[derive(Debug, Clone, PartialEq)]
pub enum LoginResult {
    /// Name and password are correct.
    Right(Account),
    /// The name or the password is wrong, or the account is disabled; the text is for the audit trail.
    Wrong(&'static str),
    /// Log-ins to the account are blocked for this number of seconds. The password was not checked.
    Pauses(f64),
    /// The name does not have the form of an account name, or the program is ending.
    Unknown,
}

/// Returns a stamp that identifies the present state of an account: it changes if the account gets another role or a
/// new password, or is disabled.
pub(super) fn account_stamp(account: &Account) -> String {
    let Account { role, password_hash, is_enabled, .. } = account;
    let digest = content_hash(format!("{}\n{is_enabled}\n{password_hash}", role.keyword()).as_bytes());
    digest.chars().take(16).collect()
}

/// The accounts, temporary locks and audit trail of one store.
#[derive(Debug)]
pub struct AccountService {
    store: StoreAccess,
    hashing: PasswordHashing,
    lockout: Mutex<Lockout>,
    /// Limits the number of entries about failed log-ins in the audit trail.
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
        // A poisoned lock is harmless, because every change under this lock is complete.
        self.lockout.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the remaining time for which log-ins to this account are blocked after wrong passwords, s.
    pub fn pauses_s(&self, name: &str) -> Option<f64> {
        self.lock_lockout().pauses_s((name, true), self.now_s())
    }

    /// Opens the store and reads from it. The call blocks while it waits for the disk.
    ///
    /// # Errors
    /// If the store cannot be opened or read.
    pub fn read<T>(&self, read: impl FnOnce(&Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.store.read(read)
    }

    /// Opens the store and writes to it. The call blocks while it waits for the disk; no cycle waits for it.
    ///
    /// # Errors
    /// If the store cannot be opened or written.
    pub fn write<T>(&self, write: impl FnOnce(&mut Store) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.store.write(write)
    }

    /// Adds an entry to the audit trail; if the disk cannot be written, the entry is written to the service's log.
    pub fn audit(&self, entry: &AuditEntry) {
        if let Err(error) = self.write(|store| store.store_audit(entry)) {
            let (what, who) =
                (&entry.what, entry.who.as_deref().unwrap_or("an unknown person who is not logged in"));
            tracing::warn!("the audit trail could not be written: {error}; lost entry: {what} by {who}");
        }
    }

    /// Adds an entry about a failed log-in to the audit trail. If there are many, they are only counted, so that they
    /// do not fill the disk, and their number is written at the end of the minute. The call blocks while it waits for
    /// the disk.
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

    /// Starts a thread that waits for this time and then writes the number of failed log-ins without an entry. At most
    /// one such thread is started per minute.
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
            tracing::warn!(
                "the number of failed log-ins could not be stored: {error}; it is stored with the next \
                            failed log-in"
            );
        }
    }

    fn account(&self, name: &str) -> Option<Account> {
        match self.read(|store| store.accounts()) {
            Ok(mut accounts) => accounts.remove(name),
            Err(error) => {
                tracing::warn!(
                    "log-in is not possible, because the accounts cannot be read: {error}; check the disk \
                                and the store"
                );
                None
            }
        }
    }

    /// Checks a name and a password, and counts a wrong password. The call blocks during the computation, which is
    /// slow. Call it only within [`AccountService::hashing`], so that each attempt takes the results of earlier
    /// attempts into account.
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

    /// Runs work with passwords, one task at a time.
    pub async fn hashing<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        self.hashing.run(work).await
    }

    /// Checks a name and a password after earlier attempts have been checked, and counts a wrong password.
    pub async fn attempt_login(self: &Arc<Self>, name: &str, password: String) -> LoginResult {
        if accounts::checked_name(name).is_err() {
            return LoginResult::Unknown;
        }
        // An attempt for a locked account does not delay the attempts of other people.
        if let Some(left_s) = self.pauses_s(name) {
            return LoginResult::Pauses(left_s);
        }
        let (shared, tried) = (self.clone(), name.to_owned());
        self.hashing(move || shared.check_password(&tried, &password)).await.unwrap_or(LoginResult::Unknown)
    }
}

/// Returns the entry with the number of failed log-ins that have no entry; `last` is the last of them.
fn left_out_line(left_out: u64, last: &AuditEntry) -> AuditEntry {
    let line = AuditEntry::for_completed_action(None, None, last.from.clone(), &last.what);
    AuditEntry { refused: Some(left_out_text(left_out)), ..line }
}

/// Runs work with passwords, one task at a time; further tasks wait.
#[derive(Debug)]
pub(super) struct PasswordHashing(Semaphore);

impl Default for PasswordHashing {
    fn default() -> Self {
        PasswordHashing(Semaphore::new(1))
    }
}

impl PasswordHashing {
    /// Runs a task with passwords after all earlier ones, on a new thread that ends with the task. A hash needs 19 MiB
    /// and most of the time of a processor, and a thread that stays alive would keep this memory. Returns `None` if the
    /// program ends.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let _turn = self.0.acquire().await.ok()?;
        let (sender, result) = oneshot::channel();
        let hash = move || drop(sender.send(work()));
        thread::Builder::new().name("password".to_owned()).spawn(hash).ok()?;
        result.await.ok()
    }
}

/// Maximum number of failed log-ins per minute that get an entry.
const MAX_LINES: MaxLinesPerMinute = MaxLinesPerMinute { done: 0, refused: 20 };

/// Counts the failed log-ins of the present minute.
#[derive(Debug)]
pub(super) struct FailedLogins {
    lines: Mutex<LineLimit>,
    begun: Instant,
}

/// What must be written to the audit trail after a failed log-in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counted {
    /// Number of failed log-ins without an entry in the minute before, to be written first.
    pub left_out: Option<u64>,
    /// Whether this log-in gets an entry.
    pub is_written: bool,
    /// Time after which [`FailedLogins::over`] must be called; `None` if a call is already scheduled or not needed.
    pub report_after: Option<Duration>,
}

impl FailedLogins {
    /// Creates a counter without failed log-ins; its first minute begins at this time.
    pub fn new(begun: Instant) -> Self {
        FailedLogins { lines: Mutex::new(LineLimit::new(MAX_LINES, 0)), begun }
    }

    /// Counts a failed log-in.
    pub fn count(&self) -> Counted {
        self.count_at(self.now_ms())
    }

    /// Returns the number of failed log-ins without an entry in the last complete minute, if it was not yet returned.
    pub fn over(&self) -> Option<u64> {
        self.lines().end_elapsed_minute(self.now_ms())
    }

    fn count_at(&self, now_ms: u64) -> Counted {
        let mut lines = self.lines();
        let left_out = lines.end_elapsed_minute(now_ms);
        let is_written = lines.admit_line(true);
        // The first log-in without an entry schedules the report of all log-ins without an entry in this minute.
        let is_first = !is_written && lines.left_out() == 1;
        let report_after = is_first.then(|| Duration::from_millis(lines.remaining_ms(now_ms)));
        Counted { left_out, is_written, report_after }
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    fn lines(&self) -> MutexGuard<'_, LineLimit> {
        // A poisoned lock is harmless, because every change under this lock is complete.
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the text of an entry with the number of failed log-ins that have no entry.
pub(super) fn left_out_text(left_out: u64) -> String {
    format!("further failed log-ins within a minute that have no entry of their own: {left_out}")
}

/// Connections to the store in a folder, for reading and writing.
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
    // If a reader panicked, its connection is lost, and the next reader opens a new one.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six simultaneous attempts are checked one after the other; the account is locked before the sixth is checked.
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

    /// A thousand failed log-ins within a minute give twenty entries. The others are only counted, and their number is
    /// written at the end of the minute.
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

    /// The number of log-ins without an entry is written at the end of the minute, although no other log-in follows.
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
            lines.iter().filter_map(|line| line.entry.refused.clone()).any(|refused| {
                refused == "further failed log-ins within a minute that have no entry of their own: 5"
            })
        };
        while !counted() {
            assert!(begun.elapsed() < Duration::from_secs(60), "the count is lost");
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Expected values, calculated by hand: 20 of 25 log-ins get an entry. The 21st, at 300 ms, schedules the report at
    /// 60,000 ms. The later log-ins of this minute schedule no further report.
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
