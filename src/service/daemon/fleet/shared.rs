//! What all pages share: the archive's reader, and the people who are logged in.

use crate::daemon::failed_logins::{FailedLogins, words};
use crate::daemon::hashing::PasswordHashing;
use crate::daemon::web::Sessions;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use panelprep_cell::accounts::{self, Lockout};
use panelprep_interfaces::archive::ArchiveError;
use panelprep_interfaces::archive::reading::Reader;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Time without a request for a page after which a session ends, s.
const IDLE_S: f64 = 8.0 * 3_600.0;
/// Largest number of sessions of one account.
const SESSIONS: usize = 5;

/// What all pages share. All clones share the same data.
#[derive(Clone)]
pub(super) struct Shared(Arc<SharedParts>);

struct SharedParts {
    reader: Reader,
    is_tls: bool,
    started: Instant,
    sessions: Mutex<Sessions>,
    lockout: Mutex<Lockout>,
    hashing: PasswordHashing,
    failed_logins: FailedLogins,
}

impl Shared {
    pub fn new(reader: Reader, is_tls: bool) -> Self {
        Shared(Arc::new(SharedParts {
            reader,
            is_tls,
            started: Instant::now(),
            sessions: Mutex::new(Sessions::new(IDLE_S, SESSIONS)),
            lockout: Mutex::default(),
            hashing: PasswordHashing::default(),
            failed_logins: FailedLogins::new(Instant::now()),
        }))
    }

    pub fn reader(&self) -> &Reader {
        &self.0.reader
    }

    pub fn is_tls(&self) -> bool {
        self.0.is_tls
    }

    pub fn now_s(&self) -> f64 {
        self.0.started.elapsed().as_secs_f64()
    }

    pub fn sessions(&self) -> MutexGuard<'_, Sessions> {
        self.0.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock_lockout(&self) -> MutexGuard<'_, Lockout> {
        self.0.lockout.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Logs a wrong log-in, or only counts it if there are many. The number of those without a line is logged when the
    /// minute is over.
    pub fn log_failed_login(&self, name: &str) {
        let counted = self.0.failed_logins.count();
        let left_out = |count: Option<u64>| count.into_iter().for_each(|count| tracing::warn!("{}", words(count)));
        left_out(counted.left_out);
        if counted.is_written {
            tracing::warn!("{}: wrong name or password at the office's page", name.escape_debug());
        }
        if let Some(after) = counted.report_after {
            let shared = self.clone();
            tokio::spawn(async move {
                tokio::time::sleep(after).await;
                left_out(shared.0.failed_logins.over());
            });
        }
    }

    /// Checks a password against an account's hash when it is its turn, and counts a wrong password. For an unknown or
    /// another account the check takes the same time. Returns `None` if the program is ending.
    pub async fn check_password(
        &self,
        name: String,
        password: String,
        hash: Option<String>,
    ) -> Option<PasswordCheck> {
        let shared = self.clone();
        let judge = move || {
            let who = (name.as_str(), hash.is_some());
            if let Some(left_s) = shared.lock_lockout().pauses_s(who, shared.now_s()) {
                return PasswordCheck::Pauses(left_s);
            }
            match accounts::is_correct_password(&password, hash.as_deref().unwrap_or_default()) {
                true => shared.lock_lockout().record_success(&name),
                false => {
                    shared.lock_lockout().record_failure(who, shared.now_s());
                    return PasswordCheck::Wrong;
                }
            }
            PasswordCheck::Right
        };
        self.0.hashing.run(judge).await
    }
}

/// The outcome of a password check.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PasswordCheck {
    Right,
    Wrong,
    /// The password was not checked: log-in to the account is blocked for this many more seconds.
    Pauses(f64),
}

/// Returns the page's text for an archive that does not answer.
pub(super) fn archive_error_page(error: &ArchiveError) -> Response {
    tracing::warn!("{error}");
    (StatusCode::SERVICE_UNAVAILABLE, format!("The archive cannot be read now: {error}. Load the page again."))
        .into_response()
}
