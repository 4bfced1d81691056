//! Hashes passwords, one at a time.

use std::thread;
use tokio::sync::{Semaphore, oneshot};

/// Limits the work with passwords to one at a time; the others wait here for their turn.
#[derive(Debug)]
pub(super) struct PasswordHashing(Semaphore);

impl Default for PasswordHashing {
    fn default() -> Self {
        PasswordHashing(Semaphore::new(1))
    }
}

impl PasswordHashing {
    /// Runs work with passwords, one at a time, on a thread that ends with the work. A hash needs 19 MiB and most of a
    /// processor, and a thread that stays alive would retain as much memory. Returns `None` if the program ends.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let _turn = self.0.acquire().await.ok()?;
        let (sender, result) = oneshot::channel();
        let hash = move || drop(sender.send(work()));
        thread::Builder::new().name("password".to_owned()).spawn(hash).ok()?;
        result.await.ok()
    }
}
