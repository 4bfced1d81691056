//! Passwords are hashed one at a time.

use std::thread;
use tokio::sync::{Semaphore, oneshot};

/// Whoever works with passwords waits here for a turn.
#[derive(Debug)]
pub(super) struct Hashing(Semaphore);

impl Default for Hashing {
    fn default() -> Self {
        Hashing(Semaphore::new(1))
    }
}

impl Hashing {
    /// Works with passwords, one at a time, on a thread that ends with it: a hash takes 19 MiB and most of a processor, and each
    /// thread that lives on would keep as much. `None` where the program ends.
    pub async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let _turn = self.0.acquire().await.ok()?;
        let (tell, told) = oneshot::channel();
        let hash = move || drop(tell.send(work()));
        thread::Builder::new().name("password".to_owned()).spawn(hash).ok()?;
        told.await.ok()
    }
}
