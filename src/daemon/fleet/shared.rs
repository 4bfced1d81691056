//! What all pages share: the archive's reader, and who is logged in.

use crate::accounts::{self, Lockout};
use crate::archive::ArchiveError;
use crate::archive::reading::Reader;
use crate::daemon::hashing::Hashing;
use crate::daemon::web::Sessions;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A session ends after so long without a page, s.
const IDLE_S: f64 = 8.0 * 3_600.0;
/// Sessions of one account.
const SESSIONS: usize = 5;

/// Clones are the same one.
#[derive(Clone)]
pub(super) struct Shared(Arc<SharedParts>);

struct SharedParts {
    reader: Reader,
    is_tls: bool,
    began: Instant,
    sessions: Mutex<Sessions>,
    lockout: Mutex<Lockout>,
    hashing: Hashing,
}

impl Shared {
    pub fn new(reader: Reader, is_tls: bool) -> Self {
        Shared(Arc::new(SharedParts {
            reader,
            is_tls,
            began: Instant::now(),
            sessions: Mutex::new(Sessions::new(IDLE_S, SESSIONS)),
            lockout: Mutex::default(),
            hashing: Hashing::default(),
        }))
    }

    pub fn reader(&self) -> &Reader {
        &self.0.reader
    }

    pub fn is_tls(&self) -> bool {
        self.0.is_tls
    }

    pub fn now_s(&self) -> f64 {
        self.0.began.elapsed().as_secs_f64()
    }

    pub fn sessions(&self) -> MutexGuard<'_, Sessions> {
        self.0.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn lockout(&self) -> MutexGuard<'_, Lockout> {
        self.0.lockout.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the password is right; another account, or none, takes as long.
    pub async fn is_right(&self, password: String, hash: String) -> bool {
        self.0.hashing.run(move || accounts::is_right(&password, &hash)).await.unwrap_or(false)
    }
}

/// What a page says where the archive does not answer.
pub(super) fn failed(error: &ArchiveError) -> Response {
    tracing::warn!("{error}");
    (StatusCode::SERVICE_UNAVAILABLE, format!("The archive cannot be read now: {error}. Load the page again."))
        .into_response()
}
