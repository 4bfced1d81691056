//! Requests on their way to the loop, in the order of their urgency.
//!
//! A stop, an abort and a signal go before everything else and always find a place. Of other requests only a few of each
//! user wait at one time, so that nobody who sends requests without end can take the loop's turns from the others.

use super::request::Request;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Requests of one user, and of all users, that wait for the loop. Urgent ones are not counted.
const MOST_OF_USER: usize = 8;
const MOST: usize = 32;

/// The end of the queue where requests are put in, from any thread.
#[derive(Debug, Clone)]
pub struct RequestSender(Arc<Shared>);

/// The end where the loop takes them out. Once it is dropped, no request is taken any more.
#[derive(Debug)]
pub struct RequestQueue(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    inside: Mutex<Inside>,
    came: Condvar,
}

#[derive(Debug, Default)]
struct Inside {
    urgent: VecDeque<Request>,
    others: VecDeque<Request>,
    is_closed: bool,
}

/// Why a request was not taken.
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
        /// Of the same user, or of all users.
        waiting: usize,
    },
}

/// Both ends of a new queue.
pub fn request_queue() -> (RequestSender, RequestQueue) {
    let shared = Arc::new(Shared::default());
    (RequestSender(shared.clone()), RequestQueue(shared))
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        // Every change is made whole under the lock.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RequestSender {
    /// Puts a request in its place.
    ///
    /// # Errors
    /// Where the loop has ended or too many requests wait.
    pub fn send(&self, request: Request) -> Result<(), NotTaken> {
        let mut inside = self.0.lock();
        if inside.is_closed {
            return Err(NotTaken::Ended);
        }
        if request.what.is_urgent() {
            inside.urgent.push_back(request);
        } else {
            let of_user = inside.others.iter().filter(|other| other.who == request.who).count();
            let waiting = if of_user < MOST_OF_USER { inside.others.len() } else { of_user };
            if of_user >= MOST_OF_USER || waiting >= MOST {
                return Err(NotTaken::Full { waiting });
            }
            inside.others.push_back(request);
        }
        drop(inside);
        self.0.came.notify_one();
        Ok(())
    }
}

impl RequestQueue {
    /// The most urgent request; waits at most this long for one.
    pub fn next(&self, patience: Duration) -> Option<Request> {
        let until = Instant::now() + patience;
        let mut inside = self.0.lock();
        loop {
            let request = inside.urgent.pop_front().or_else(|| inside.others.pop_front());
            let left = until.saturating_duration_since(Instant::now());
            if request.is_some() || left.is_zero() {
                return request;
            }
            inside = self.0.came.wait_timeout(inside, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for RequestQueue {
    fn drop(&mut self) {
        let mut inside = self.0.lock();
        inside.is_closed = true;
        // Dropping a request tells whoever waits for its reply that there is none.
        (inside.urgent, inside.others) = Default::default();
    }
}

#[cfg(test)]
mod tests {
    use super::super::request::What;
    use super::*;
    use crate::cycle::Request::{Abort, Hold, Stop};
    use crate::record::{Front, Who};

    #[test]
    fn what_stops_goes_first_and_always_finds_a_place() {
        let (sender, queue) = request_queue();
        let send = |uid, request| {
            let who = Who { front: Front::Socket, uid: Some(uid), user: None };
            sender.send(Request::new(What::Table(request), who))
        };
        let next = || match queue.next(Duration::ZERO) {
            Some(Request { what: What::Table(request), .. }) => Some(request),
            _ => None,
        };
        for _ in 0..MOST_OF_USER {
            assert_eq!(send(7, Hold), Ok(()));
        }
        assert_eq!(send(7, Hold), Err(NotTaken::Full { waiting: MOST_OF_USER }));
        assert_eq!(send(8, Hold), Ok(()), "another user is not kept out");
        let taken = (9..100).filter(|uid| send(*uid, Hold).is_ok()).count();
        assert_eq!(taken, MOST - MOST_OF_USER - 1);
        for stops in [Stop, Abort].into_iter().cycle().take(200) {
            assert_eq!(send(7, stops), Ok(()));
        }
        for stops in [Stop, Abort].into_iter().cycle().take(200) {
            assert_eq!(next(), Some(stops), "before all that waited longer");
        }
        assert_eq!(next(), Some(Hold));
        assert_eq!(send(7, Hold), Ok(()), "a place is free again");
        drop(queue);
        assert_eq!(send(7, Hold), Err(NotTaken::Ended));
    }
}
