//! Letters on their way to the desk, in the order of their urgency.
//!
//! A stop, an abort and a signal go before everything else and always find a place. Of other requests only a few of each
//! user wait at one time: whoever asks without end takes no turns of the loop from the others.

use super::caller::Caller;
use super::desk::{Asked, Letter};
use crate::cycle::Request;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Requests of one user, and of all of them, that wait for the loop; those that stop are not counted.
const MOST_OF_USER: usize = 8;
const MOST: usize = 32;

/// Where letters are put; any thread may.
#[derive(Debug, Clone)]
pub struct Letters(Arc<Shared>);

/// Where the desk takes them; once it is gone, no letter is taken any more.
#[derive(Debug)]
pub struct Inbox(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    inside: Mutex<Inside>,
    came: Condvar,
}

#[derive(Debug, Default)]
struct Inside {
    urgent: VecDeque<Letter>,
    others: VecDeque<Letter>,
    is_closed: bool,
}

/// Why a letter was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotTaken {
    /// The loop has ended.
    #[error("the service has ended")]
    Ended,
    /// Too many wait.
    #[error(
        "{waiting} requests wait for an answer already; ask again when they were answered (stop and abort always get through)"
    )]
    Full {
        /// Of the same user, or of all.
        waiting: usize,
    },
}

/// Both ends.
pub fn letters() -> (Letters, Inbox) {
    let shared = Arc::new(Shared::default());
    (Letters(shared.clone()), Inbox(shared))
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        // Every change is made whole under the lock.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Letters {
    /// Puts a letter in its place.
    ///
    /// # Errors
    /// Where the loop has ended or too many letters wait.
    pub fn send(&self, letter: Letter) -> Result<(), NotTaken> {
        let mut inside = self.0.lock();
        if inside.is_closed {
            return Err(NotTaken::Ended);
        }
        match letter.caller().filter(|_| !is_urgent(&letter)) {
            None => inside.urgent.push_back(letter),
            Some(caller) => {
                let of_user = inside.others.iter().filter(|other| other.caller() == Some(caller)).count();
                let waiting = if of_user < MOST_OF_USER { inside.others.len() } else { of_user };
                if of_user >= MOST_OF_USER || waiting >= MOST {
                    return Err(NotTaken::Full { waiting });
                }
                inside.others.push_back(letter);
            }
        }
        drop(inside);
        self.0.came.notify_one();
        Ok(())
    }
}

impl Inbox {
    /// The most urgent letter; waits so long for one.
    pub fn next(&self, patience: Duration) -> Option<Letter> {
        let until = Instant::now() + patience;
        let mut inside = self.0.lock();
        loop {
            let letter = inside.urgent.pop_front().or_else(|| inside.others.pop_front());
            let left = until.saturating_duration_since(Instant::now());
            if letter.is_some() || left.is_zero() {
                return letter;
            }
            inside = self.0.came.wait_timeout(inside, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        let mut inside = self.0.lock();
        inside.is_closed = true;
        // Who waits for an answer hears that there is none.
        (inside.urgent, inside.others) = Default::default();
    }
}

fn is_urgent(letter: &Letter) -> bool {
    match letter {
        Letter::Signal => true,
        Letter::Asked { asked, .. } => matches!(asked, Asked::For(Request::Stop | Request::Abort)),
    }
}

impl Letter {
    fn caller(&self) -> Option<&Caller> {
        match self {
            Letter::Signal => None,
            Letter::Asked { who, .. } => Some(who),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::sync::oneshot;

    fn letter(uid: u32, asked: Asked) -> Letter {
        Letter::Asked { asked, who: Caller { uid: Some(uid), user: None }, reply: oneshot::channel().0 }
    }

    fn request(letter: Option<Letter>) -> Option<Request> {
        match letter {
            Some(Letter::Asked { asked: Asked::For(request), .. }) => Some(request),
            _ => None,
        }
    }

    #[test]
    fn what_stops_goes_first_and_always_finds_a_place() {
        let (letters, inbox) = letters();
        let hold = |uid| letters.send(letter(uid, Asked::For(Request::Hold)));
        for _ in 0..MOST_OF_USER {
            assert_eq!(hold(7), Ok(()));
        }
        assert_eq!(hold(7), Err(NotTaken::Full { waiting: MOST_OF_USER }));
        assert_eq!(hold(8), Ok(()), "another user is not kept out");
        let taken = (9..100).filter(|uid| hold(*uid).is_ok()).count();
        assert_eq!(taken, MOST - MOST_OF_USER - 1);
        for stops in [Request::Stop, Request::Abort].into_iter().cycle().take(200) {
            assert_eq!(letters.send(letter(7, Asked::For(stops))), Ok(()));
        }
        for stops in [Request::Stop, Request::Abort].into_iter().cycle().take(200) {
            assert_eq!(request(inbox.next(Duration::ZERO)), Some(stops), "before all that waited longer");
        }
        assert_eq!(request(inbox.next(Duration::ZERO)), Some(Request::Hold));
        assert_eq!(hold(7), Ok(()), "a place is free again");
        drop(inbox);
        assert_eq!(hold(7), Err(NotTaken::Ended));
    }
}
