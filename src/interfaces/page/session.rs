//! A person's session with a page: the number of times that the person saved, and whether the person is done.

use axum::Json;
use axum::response::{IntoResponse, Response};
use serde_json::json;
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot;

/// The number of savings, and the channel that signals that the person is done.
pub(super) struct Session(Mutex<(u32, Option<oneshot::Sender<()>>)>);

impl Session {
    /// Creates a session in which nothing was saved yet, and the receiver that is notified when the session ends.
    pub fn new() -> (Self, oneshot::Receiver<()>) {
        let (tell, done) = oneshot::channel();
        (Session(Mutex::new((0, Some(tell)))), done)
    }

    /// Counts one save.
    pub fn count_save(&self) {
        self.lock().0 += 1;
    }

    /// Returns how often the person saved.
    pub fn save_count(&self) -> u32 {
        self.lock().0
    }

    /// Signals, once, that the person is done.
    pub fn end(&self) -> Response {
        if let Some(tell) = self.lock().1.take() {
            #[expect(clippy::let_underscore_must_use, reason = "fails if the session has already ended")]
            let _ = tell.send(());
        }
        Json(json!({ "done": true })).into_response()
    }

    fn lock(&self) -> MutexGuard<'_, (u32, Option<oneshot::Sender<()>>)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
