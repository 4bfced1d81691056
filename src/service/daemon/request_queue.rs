//! The queue of requests to the loop, ordered by their urgency.
//!
//! A stop, an abort and a signal have priority over all other requests and are always accepted. Of the other requests,
//! only a few of each user wait at the same time, so that a client that sends requests continuously cannot block the
//! other clients.
//!
//! An urgent request is also sent directly to the robot when it enters the queue: the abort message waits neither for
//! the loop nor for a disk for which the loop waits. Afterwards the loop takes the request from the queue, writes it to
//! the journal and does everything else that belongs to a stop.

use super::request::{Reply, Request, RequestKind};
use panelprep_devices::robot::StopLine;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// Maximum number of waiting requests of one user, and below it of all users. Urgent requests are not counted.
const MAX_QUEUED_PER_USER: usize = 8;
const MAX_QUEUED: usize = 32;

/// The sending end of the queue; any thread may use it.
#[derive(Debug, Clone)]
pub struct RequestSender(Arc<Shared>);

/// The receiving end of the queue, for the loop. After it is dropped, no further requests are accepted.
#[derive(Debug)]
pub struct RequestQueue(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    inside: Mutex<Inside>,
    arrived: Condvar,
    stop_line: OnceLock<StopLine>,
}

#[derive(Debug, Default)]
struct Inside {
    /// The urgent requests, each with the reply channels of other clients that sent the same stop or abort.
    urgent: VecDeque<(Request, Followers)>,
    others: VecDeque<Request>,
    /// The reply channels of the other clients that sent the same urgent request as the one that was taken last.
    followers: Followers,
    is_closed: bool,
}

/// Reply channels of further clients that sent the same request.
type Followers = Vec<oneshot::Sender<Reply>>;

impl Inside {
    /// Adds an urgent request. Repeated stops, or repeated aborts, of the same person are merged into one request, so
    /// that a person who sends them continuously cannot block the others. Signals are not merged, because they are
    /// counted.
    fn push_urgent(&mut self, request: Request) {
        let is_same = |(waiting, _): &&mut (Request, Followers)| match (&waiting.what, &request.what) {
            (RequestKind::Table(one), RequestKind::Table(other)) => {
                one == other && waiting.requester == request.requester
            }
            _ => false,
        };
        match self.urgent.iter_mut().find(is_same) {
            Some((_, followers)) => followers.extend(request.reply),
            None => self.urgent.push_back((request, Vec::new())),
        }
    }

    fn pop_urgent(&mut self) -> Option<Request> {
        let (request, followers) = self.urgent.pop_front()?;
        self.followers = followers;
        Some(request)
    }

    /// Returns the next non-urgent request whose client still waits, or that needs no reply.
    fn pop_waiting(&mut self) -> Option<Request> {
        loop {
            let request = self.others.pop_front()?;
            if !request.reply.as_ref().is_some_and(oneshot::Sender::is_closed) {
                return Some(request);
            }
            if !matches!(request.what, RequestKind::State) {
                tracing::warn!(
                    "request not executed: {}; the client no longer waits for the reply",
                    request.what.describe()
                );
            }
        }
    }
}

/// The reason why a request was not added to the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RequestQueueError {
    /// The loop has ended.
    #[error("the service has ended; start it again")]
    Ended,
    /// Too many requests are waiting.
    #[error(
        "{waiting} requests are already waiting for a reply; try again later (stop and abort are always accepted)"
    )]
    Full {
        /// The number of waiting requests of this user, or of all users.
        waiting: usize,
    },
}

/// Creates a new queue; returns its sending end and its receiving end.
pub fn request_queue() -> (RequestSender, RequestQueue) {
    let shared = Arc::new(Shared::default());
    (RequestSender(shared.clone()), RequestQueue(shared))
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Inside> {
        // A poisoned lock is harmless, because every change under this lock is complete.
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RequestSender {
    /// Adds a request to the queue according to its urgency.
    ///
    /// # Errors
    /// If the loop has ended, or too many requests are waiting.
    pub fn send(&self, request: Request) -> Result<(), RequestQueueError> {
        let mut inside = self.0.lock();
        if inside.is_closed {
            return Err(RequestQueueError::Ended);
        }
        let is_urgent = request.what.is_urgent();
        if is_urgent {
            inside.push_urgent(request);
        } else {
            // The limit of each user is checked first, so that a client with many requests does not block the operator.
            let of_user = inside.others.iter().filter(|other| other.requester == request.requester).count();
            let waiting = if of_user < MAX_QUEUED_PER_USER { inside.others.len() } else { of_user };
            if of_user >= MAX_QUEUED_PER_USER || waiting >= MAX_QUEUED {
                return Err(RequestQueueError::Full { waiting });
            }
            inside.others.push_back(request);
        }
        drop(inside);
        // The request must be in the queue before the robot's answer to the abort message arrives, so that the loop
        // knows the cause of the stop.
        if let Some(line) = self.0.stop_line.get().filter(|_| is_urgent) {
            line.stop();
        }
        self.0.arrived.notify_one();
        Ok(())
    }

    /// Sets the connection by which urgent requests reach the robot directly. Only the first call has an effect.
    pub fn set_urgent_line(&self, line: StopLine) {
        #[expect(clippy::let_underscore_must_use, reason = "a program has one robot")]
        let _ = self.0.stop_line.set(line);
    }
}

impl RequestQueue {
    /// Returns the most urgent request; waits at most this time for one. Requests whose client no longer waits are
    /// discarded and never executed late, because the operator was informed of the failure and may be at the panel.
    /// Stop and Abort are executed in any case.
    pub fn next(&self, patience: Duration) -> Option<Request> {
        let until = Instant::now() + patience;
        let mut inside = self.0.lock();
        loop {
            let request = inside.pop_urgent().or_else(|| inside.pop_waiting());
            let left = until.saturating_duration_since(Instant::now());
            if request.is_some() || left.is_zero() {
                return request;
            }
            inside = self.0.arrived.wait_timeout(inside, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl RequestQueue {
    /// Removes and returns the reply channels of the other clients that sent the same urgent request as the one taken
    /// last.
    pub fn take_followers(&self) -> Vec<oneshot::Sender<Reply>> {
        std::mem::take(&mut self.0.lock().followers)
    }
}

impl Drop for RequestQueue {
    fn drop(&mut self) {
        let mut inside = self.0.lock();
        inside.is_closed = true;
        // If a request is dropped, its client is informed that there is no reply.
        (inside.urgent, inside.others, inside.followers) = Default::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cycle;
    use panelprep_cell::cycle::Request::{Abort, Hold, Stop};
    use panelprep_cell::record::{RequestAuthor, RequestSource};
    use panelprep_devices::mock::{ChannelFile, Clock, Controller, MockServer, Ports, Setup, UnconnectedWorld};
    use panelprep_devices::robot::{Address, BlockingLink};
    use panelprep_kuka::eki::{CELLCMD, CELLSTAT, ClockMode, Epoch, LinkLimits, Report};

    /// Returns a controller that runs by the wall clock, and the connection to it.
    fn linked() -> (MockServer, BlockingLink) {
        let [commands, states] = [CELLCMD, CELLSTAT].map(|text| ChannelFile::parse(text).expect("a shipped file"));
        let setup = Setup { clock: Clock::Free, ..Setup::new(commands, states) };
        let server = MockServer::start(
            Controller::new(setup, Box::new(UnconnectedWorld)).expect("fits"),
            Ports::free_ports(),
        );
        let server = server.expect("starts");
        let (command_port, state_port) = (server.command_address().port(), server.state_address().port());
        let address = Address { host: "127.0.0.1".to_owned(), command_port, state_port };
        (server, BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts"))
    }

    fn receives(link: &mut BlockingLink, is_it: impl Fn(&Report) -> bool) -> bool {
        (0..100).any(|_| link.next(Duration::from_secs(5)).is_some_and(|report| is_it(&report)))
    }

    /// The loop does not take the request, as if it waited for its disk. The robot is stopped nevertheless. A hold
    /// waits for the loop.
    #[test]
    fn a_stop_goes_to_the_robot_before_the_loop_sees_it() {
        let (_server, mut link) = linked();
        let (sender, queue) = request_queue();
        sender.set_urgent_line(link.stop_line());
        assert!(receives(&mut link, |report| matches!(report, Report::Connected { .. })));
        for (request, stops) in [(Hold, false), (Stop, true), (Abort, true)] {
            let epoch = link.open_epoch_above(Epoch(0)).expect("it rests");
            assert!(receives(&mut link, |report| *report == Report::EpochOpened { epoch }));
            sender
                .send(Request::new(RequestKind::Table(request), RequestAuthor::from_source(RequestSource::Socket)))
                .expect("a place");
            let stands = |report: &Report| matches!(report, Report::Standstill { .. });
            assert_eq!(
                (0..5).any(|_| link.next(Duration::from_secs(1)).is_some_and(|report| stands(&report))),
                stops
            );
            if !stops {
                link.abort().expect("connected");
                assert!(receives(&mut link, stands));
            }
        }
        assert!(queue.next(Duration::ZERO).is_some(), "the loop finds them later");
    }

    #[test]
    fn the_same_stop_of_the_same_person_is_one_request_with_many_replies() {
        let (sender, queue) = request_queue();
        let press = |request| {
            let (reply, answer) = oneshot::channel();
            let who = RequestAuthor { front: RequestSource::Socket, uid: Some(7), user: None, from: None };
            sender
                .send(Request { what: RequestKind::Table(request), requester: who, reply: Some(reply) })
                .expect("a place");
            answer
        };
        let (mut answers, other) = ([press(Stop), press(Stop), press(Stop)], press(Abort));
        let first = queue.next(Duration::ZERO).expect("waits");
        let reply = || Reply::refused(crate::daemon::RequestResult::Done, vec![]);
        first.reply.expect("somebody waits").send(reply()).expect("heard");
        let followers = queue.take_followers();
        assert_eq!(followers.len(), 2);
        followers.into_iter().for_each(|follower| follower.send(reply()).expect("heard"));
        assert!(answers.iter_mut().all(|answer| answer.try_recv().is_ok()));
        assert!(matches!(queue.next(Duration::ZERO).map(|request| request.what), Some(RequestKind::Table(Abort))));
        assert!(queue.take_followers().is_empty() && queue.next(Duration::ZERO).is_none());
        drop(other);
    }

    #[test]
    fn without_a_waiting_client_only_a_stop_is_executed() {
        let (sender, queue) = request_queue();
        let who = || RequestAuthor { front: RequestSource::Socket, uid: Some(7), user: None, from: None };
        for request in [cycle::Request::Reset, Stop, cycle::Request::Clear, Hold] {
            let (reply, answer) = oneshot::channel();
            let what = RequestKind::Table(request);
            sender.send(Request { what, requester: who(), reply: Some(reply) }).expect("a place");
            if request == Hold {
                // The client of this request still waits for its reply.
                std::mem::forget(answer);
            }
        }
        let next = || queue.next(Duration::ZERO).map(|request| request.what.describe());
        assert_eq!([next(), next(), next()], [Some("stop".to_owned()), Some("hold".to_owned()), None]);
    }

    #[test]
    fn urgent_requests_come_first_and_are_always_accepted() {
        let (sender, queue) = request_queue();
        let send = |uid, request| {
            let who = RequestAuthor { front: RequestSource::Socket, uid: Some(uid), user: None, from: None };
            sender.send(Request::new(RequestKind::Table(request), who))
        };
        let next = || match queue.next(Duration::ZERO) {
            Some(Request { what: RequestKind::Table(request), .. }) => Some(request),
            _ => None,
        };
        for _ in 0..MAX_QUEUED_PER_USER {
            assert_eq!(send(7, Hold), Ok(()));
        }
        assert_eq!(send(7, Hold), Err(RequestQueueError::Full { waiting: MAX_QUEUED_PER_USER }));
        assert_eq!(send(8, Hold), Ok(()), "another user is not kept out");
        let taken = (9..100).filter(|uid| send(*uid, Hold).is_ok()).count();
        assert_eq!(taken, MAX_QUEUED - MAX_QUEUED_PER_USER - 1);
        for stops in [Stop, Abort].into_iter().cycle().take(200) {
            assert_eq!(send(7, stops), Ok(()));
            assert_eq!(send(8, stops), Ok(()));
        }
        for stops in [Stop, Stop, Abort, Abort] {
            assert_eq!(next(), Some(stops), "before all that waited longer, once of each user");
        }
        assert_eq!(next(), Some(Hold));
        assert_eq!(send(7, Hold), Ok(()), "a place is free again");
        drop(queue);
        assert_eq!(send(7, Hold), Err(RequestQueueError::Ended));
    }
}
