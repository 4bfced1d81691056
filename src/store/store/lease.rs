//! One writer at a time: a lock on the store's folder, and a queue for the threads of this process that write.
//!
//! The lock is one of the operating system and not SQLite's exclusive mode, which would also exclude readers (a
//! `locate` beside the running daemon) and cannot report the holder. It is not on a file in the folder: if a person
//! removed that file, a second writer could lock a new one. The system releases the lock when its process ends for any
//! reason. `panelprep.lock` names the holder, for messages alone.
//!
//! Threads are served in the order in which they requested the right to write. A lock of the file system has no order:
//! a thread that requests it again immediately may get it again. A page that writes a line for each refused request
//! could therefore delay the loop, which writes a stop to the journal before the stop is executed. Between processes,
//! only the lock of the head's file decides.

use super::error::StoreError;
use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Lock file that names the writer.
const FILE: &str = "panelprep.lock";

/// The lock on the store's folder; dropping it releases the lock.
#[derive(Debug)]
pub struct WriteLease {
    locked: File,
}

impl WriteLease {
    /// Acquires the lock; every other writer is refused until it is released.
    ///
    /// # Errors
    /// If another process, or another store of this process, holds it.
    pub fn acquire(store: &Path) -> Result<Self, StoreError> {
        let at = |doing| {
            let path = store.to_owned();
            move |source| StoreError::File { operation: doing, path, source }
        };
        let folder = File::open(store).map_err(at("open"))?;
        match folder.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder =
                    fs::read_to_string(store.join(FILE)).ok().and_then(|text| text.trim().parse::<u32>().ok());
                let holder = holder.map_or("another process".to_owned(), |id| format!("process {id}"));
                return Err(StoreError::Leased { path: store.to_owned(), holder });
            }
            Err(TryLockError::Error(source)) => return Err(at("lock")(source)),
        }
        if let Err(error) = fs::write(store.join(FILE), format!("{}\n", std::process::id())) {
            // Without this file, only a message is less exact. The service must also start on a full disk.
            tracing::warn!("{} cannot be written: {error}", store.join(FILE).display());
        }
        Ok(WriteLease { locked: folder })
    }
}

impl Drop for WriteLease {
    /// Unlocks explicitly instead of by closing the folder. A child process between its fork and its exec still has a
    /// copy of the descriptor, and with it the lock.
    fn drop(&mut self) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the folder closes next, which also releases a lock that could not be released here"
        )]
        let _ = self.locked.unlock();
    }
}

/// The queue of the threads that wait to write to one store.
#[derive(Debug, Default)]
pub(super) struct WriteQueue {
    queue: Mutex<Queue>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<u64>,
    next: u64,
}

/// The right of one thread to write; dropping this value releases it.
#[derive(Debug)]
pub(super) struct WriteQueueGuard<'t> {
    turns: &'t WriteQueue,
    number: u64,
}

impl WriteQueue {
    /// Returns the queue of the store in this folder.
    pub fn for_folder(store: &Path) -> Arc<WriteQueue> {
        static ALL: Mutex<BTreeMap<PathBuf, Weak<WriteQueue>>> = Mutex::new(BTreeMap::new());
        let key = store.canonicalize().unwrap_or_else(|_| store.to_owned());
        let mut all = ALL.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(turns) = all.get(&key).and_then(Weak::upgrade) {
            return turns;
        }
        all.retain(|_, turns| turns.strong_count() > 0);
        let turns = Arc::new(WriteQueue::default());
        all.insert(key, Arc::downgrade(&turns));
        turns
    }

    /// Waits until this thread is the first in the queue, at most this time; returns `None` after a timeout.
    pub fn acquire(&self, patience: Duration) -> Option<WriteQueueGuard<'_>> {
        let until = Instant::now() + patience;
        let mut queue = self.lock();
        let number = queue.next;
        queue.next += 1;
        queue.waiting.push_back(number);
        while queue.waiting.front() != Some(&number) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                self.leave_queue(queue, number);
                return None;
            }
            queue = self.changed.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        Some(WriteQueueGuard { turns: self, number })
    }

    fn leave_queue(&self, mut queue: MutexGuard<'_, Queue>, number: u64) {
        queue.waiting.retain(|waiting| *waiting != number);
        drop(queue);
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for WriteQueueGuard<'_> {
    fn drop(&mut self) {
        self.turns.leave_queue(self.turns.lock(), self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    fn wait_until_queued(turns: &WriteQueue, count: usize) {
        while turns.lock().waiting.len() < count {
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// A thread that has written and requests the right to write again waits behind all waiting threads.
    #[test]
    fn the_first_writer_is_served_first() {
        let folder = tempfile::tempdir().expect("a folder");
        let (turns, served) = (WriteQueue::for_folder(folder.path()), Mutex::new(Vec::new()));
        assert!(Arc::ptr_eq(&turns, &WriteQueue::for_folder(folder.path())), "one queue for each store");
        let serve = |name| {
            let _turn = turns.acquire(Duration::from_secs(60)).expect("a turn");
            served.lock().expect("whole").push(name);
        };
        let first = turns.acquire(Duration::ZERO).expect("free");
        thread::scope(|scope| {
            scope.spawn(|| serve("second"));
            wait_until_queued(&turns, 2);
            scope.spawn(|| serve("third"));
            wait_until_queued(&turns, 3);
            // The second request must be in the queue before the first thread releases the right to write.
            scope.spawn(|| serve("again"));
            wait_until_queued(&turns, 4);
            drop(first);
        });
        assert_eq!(served.into_inner().expect("whole"), ["second", "third", "again"]);
    }

    #[test]
    fn a_writer_after_its_timeout_leaves_the_queue() {
        let turns = WriteQueue::default();
        let first = turns.acquire(Duration::ZERO).expect("free");
        assert!(turns.acquire(Duration::from_millis(5)).is_none());
        drop(first);
        assert!(turns.acquire(Duration::ZERO).is_some());
    }
}
