//! Whose turn it is to write to a store, among the threads of this process: first come, first served.
//!
//! A lock of the file system knows no order: whoever asks again at once takes it again. So a page that keeps a line for each refused
//! request could hold up the loop, whose stop goes on the journal before it is done. Between processes the lock of the head's file
//! decides, as before.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// The turns at one store.
#[derive(Debug, Default)]
pub(super) struct Turns {
    queue: Mutex<Queue>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<u64>,
    next: u64,
}

/// The turn; it is over when this is dropped.
#[derive(Debug)]
pub(super) struct InTurn<'t> {
    turns: &'t Turns,
    number: u64,
}

impl Turns {
    /// Those at the store in this folder.
    pub fn at(store: &Path) -> Arc<Turns> {
        static ALL: Mutex<BTreeMap<PathBuf, Weak<Turns>>> = Mutex::new(BTreeMap::new());
        let key = store.canonicalize().unwrap_or_else(|_| store.to_owned());
        let mut all = ALL.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(turns) = all.get(&key).and_then(Weak::upgrade) {
            return turns;
        }
        all.retain(|_, turns| turns.strong_count() > 0);
        let turns = Arc::new(Turns::default());
        all.insert(key, Arc::downgrade(&turns));
        turns
    }

    /// Waits for the turn, at most so long.
    pub fn take(&self, patience: Duration) -> Option<InTurn<'_>> {
        let until = Instant::now() + patience;
        let mut queue = self.lock();
        let number = queue.next;
        queue.next += 1;
        queue.waiting.push_back(number);
        while queue.waiting.front() != Some(&number) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                self.leave(queue, number);
                return None;
            }
            queue = self.changed.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        Some(InTurn { turns: self, number })
    }

    fn leave(&self, mut queue: MutexGuard<'_, Queue>, number: u64) {
        queue.waiting.retain(|waiting| *waiting != number);
        drop(queue);
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for InTurn<'_> {
    fn drop(&mut self) {
        self.turns.leave(self.turns.lock(), self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// Threads that take turn after turn of 5 ms leave each other one after each of theirs.
    #[test]
    fn who_comes_first_is_served_first() {
        let folder = tempfile::tempdir().expect("a folder");
        let (turns, ends) = (Turns::at(folder.path()), AtomicBool::new(false));
        assert!(Arc::ptr_eq(&turns, &Turns::at(folder.path())));
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    while !ends.load(Ordering::Relaxed) {
                        let _turn = turns.take(Duration::from_secs(60)).expect("a turn");
                        std::thread::sleep(Duration::from_millis(5));
                    }
                });
            }
            for _ in 0..20 {
                // Before it comes at most one turn of each that waits, whoever they are.
                let before = turns.lock().next;
                let turn = turns.take(Duration::from_secs(60)).expect("a turn");
                assert!(turn.number - before < 8 && turns.lock().waiting.front() == Some(&turn.number));
            }
            ends.store(true, Ordering::Relaxed);
        });
    }

    #[test]
    fn who_waits_too_long_leaves_the_others_their_place() {
        let turns = Turns::default();
        let first = turns.take(Duration::ZERO).expect("free");
        assert!(turns.take(Duration::from_millis(5)).is_none());
        drop(first);
        assert!(turns.take(Duration::ZERO).is_some());
    }
}
