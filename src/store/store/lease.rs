//! Only one process writes to a store at a time: a lock on the folder of the store, and a queue for the writing threads
//! of this process.
//!
//! The lock is a lock of the operating system. SQLite's exclusive mode is not used, because it would also exclude
//! readers (such as `locate` beside the running service), and does not state which process holds the lock. The lock is
//! on the folder, not on a file in it: if a person removed such a file, a second writer could lock a new one. The
//! operating system releases the lock when its process ends for any reason. The file `panelprep.lock` states the
//! process that holds the lock; it is only used in messages.
//!
//! Threads write in the order of their requests. A file lock alone has no order: a thread that requests the lock again
//! immediately may get it again. A page that writes an entry for each refused request could therefore delay the control
//! loop, which must write a stop to the journal before the stop is executed. Between processes, only the lock of the
//! head file decides.

use super::error::StoreError;
use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Name of the file that states which process writes to the store.
const FILE: &str = "panelprep.lock";

/// The lock on the folder of the store; it is released when this value is dropped.
#[derive(Debug)]
pub struct WriteLease {
    locked: File,
}

impl WriteLease {
    /// Acquires the lock. Every other writer is refused until it is released.
    ///
    /// # Errors
    /// If another process, or another store of this process, holds the lock.
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
            // This file is only used in messages, and the service must also start on a full disk, so the error is only
            // logged.
            tracing::warn!("{} cannot be written: {error}", store.join(FILE).display());
        }
        Ok(WriteLease { locked: folder })
    }
}

impl Drop for WriteLease {
    /// Unlock explicitly instead of by closing the folder: a child process between fork and exec has a copy of the
    /// descriptor, which would keep the lock.
    fn drop(&mut self) {
        #[expect(
            clippy::let_underscore_must_use,
            reason = "the folder closes next, which also releases a lock that could not be released here"
        )]
        let _ = self.locked.unlock();
    }
}

/// The queue of threads that wait to write to a store.
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

/// The right of one thread to write, which is released when this value is dropped.
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

    /// Waits until this thread is the first in the queue; `None` if this takes longer than `patience`.
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

    /// A thread that has written and requests to write again must wait behind all waiting threads.
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
            // The second thread must be in the queue before the first one releases its right to write.
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
