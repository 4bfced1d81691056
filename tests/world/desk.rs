//! The interface between the people of a world and its loop: the service's own queue and request handler, with several
//! users who send requests at the same time.
//!
//! A request that the socket accepts is converted to its line of text and back. In addition, the state is requested, as
//! a page does: in every round of the loop while the cell is idle, so that the handler never waits, otherwise in every
//! fourth round. A model of the queue states which requests must be accepted, which must be refused, and which is next.
//! Each accepted request must be answered, in at most as many rounds as there are requests before it.

use panelprep::cycle::{self, At, State};
use panelprep::daemon::{
    LastWrittenPage, LiveView, LoopEvent, RecordingSwitch, Reply, Request, RequestHandler, RequestKind,
    RequestQueueError, RequestResult, RequestSender, Requester, ServiceParts, read_request, request_line,
    request_queue,
};
use panelprep::record::{CycleId, RequestAuthor, RequestSource};
use panelprep::supervision::{Supervisor, ThreadFault};
use std::path::Path;
use std::sync::mpsc::channel;
use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;

/// User IDs: of the operator who runs the cycles, and below it of people who send any request, and of a page that
/// requests the state.
pub const OPERATOR: u32 = 1_000;
pub const ANOTHER_PERSON: u32 = 1_001;
const PAGE: u32 = 33;
/// User ID of a person at a second screen.
const SECOND: u32 = 1_002;
/// Number of rounds of a busy loop between two requests of a page for the state.
const PAGE_ROUNDS: u64 = 4;

/// Maximum number of waiting requests of one user; `MAX_QUEUED` is the maximum for all users.
const MAX_QUEUED_PER_USER: usize = 8;
const MAX_QUEUED: usize = 32;
/// Maximum number of rounds of the loop until an accepted request is answered.
const MAX_ANSWER_ROUNDS: u32 = 2;

/// The contents of a screen: the number of the state machine's step, and its state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shown {
    step: u64,
    at: At,
}

impl Shown {
    /// Returns the screen contents for this state.
    pub fn from_state(state: &State) -> Self {
        Shown { step: state.step, at: state.at }
    }
}

/// A request that was queued.
struct Waiting {
    uid: u32,
    /// The screen contents on which the decision was based.
    shown: Option<Shown>,
    /// Whether the decision refers to a step that was over when the request was processed.
    is_stale: bool,
    words: String,
    urgent: bool,
    /// Whether the request is still in the queue.
    queued: bool,
    rounds: u32,
    /// Number of rounds in which the answer must arrive.
    at_most: u32,
    reply: oneshot::Receiver<Reply>,
}

/// The queue and the handler of one process.
pub struct Desk {
    handler: RequestHandler,
    sender: RequestSender,
    waiting: Vec<Waiting>,
    rounds: u64,
    /// Whether a person has requested the end of the process; other waiting requests may then be dropped.
    leaves: bool,
    /// Description of the wrong answer, if there was one.
    pub wrong: Option<String>,
    /// Number of processed decisions, whether they refer to the present step or to another one.
    pub decided: u64,
}

impl Desk {
    /// Returns the desk of a new process; `left` is the cycle that an earlier process did not end.
    pub fn new(store: &Path, left: Option<CycleId>) -> Self {
        let (sender, queue) = request_queue();
        let parts = ServiceParts {
            recording: RecordingSwitch::new(store, false),
            supervisor: Supervisor::default(),
            // No pages are written here; they are created from the store at the end.
            pages: channel().0,
            written: LastWrittenPage::default(),
            cameras: None,
            view: LiveView::default(),
        };
        let handler = RequestHandler::new(queue, left, parts);
        Desk { handler, sender, waiting: Vec::new(), rounds: 0, leaves: false, wrong: None, decided: 0 }
    }

    /// Returns whether no request waits except the page's request for the state.
    pub fn is_free(&self) -> bool {
        !self.waiting.iter().any(|waiting| waiting.queued && waiting.uid != PAGE)
    }

    /// Sends a decision of a second screen, based on the contents of this screen.
    pub fn send_decision(&mut self, request: cycle::Request, shown: Shown, carries: bool) {
        let what =
            if carries { RequestKind::Decided { request, step: shown.step } } else { RequestKind::Table(request) };
        self.asks(SECOND, what, Some(shown));
    }

    /// Sends a request as this user.
    pub fn send_request(&mut self, uid: u32, what: RequestKind) {
        self.asks(uid, what, None);
    }

    fn asks(&mut self, uid: u32, what: RequestKind, shown: Option<Shown>) {
        let what = self.through_the_socket(what);
        let (words, urgent) = (format!("{what:?}"), is_urgent(&what));
        self.leaves |= matches!(what, RequestKind::Leave);
        let (reply, answer) = oneshot::channel();
        let who = RequestAuthor { front: RequestSource::Socket, uid: Some(uid), user: None, from: None };
        let others = || self.waiting.iter().filter(|waiting| waiting.queued && !waiting.urgent);
        let (of_user, of_all) = (others().filter(|waiting| waiting.uid == uid).count(), others().count());
        let has_place = urgent || (of_user < MAX_QUEUED_PER_USER && of_all < MAX_QUEUED);
        // A repeated stop of the same person is not queued a second time.
        let is_stop = urgent && !matches!(what, RequestKind::Leave);
        let is_same = is_stop
            && self.waiting.iter().any(|waiting| waiting.queued && waiting.uid == uid && waiting.words == words);
        let before =
            if urgent { self.waiting.iter().filter(|waiting| waiting.urgent).count() } else { self.waiting.len() };
        match (self.sender.send(Request { what, requester: who, reply: Some(reply) }), has_place) {
            (Ok(()), true) => self.waiting.push(Waiting {
                uid,
                shown,
                is_stale: false,
                words,
                urgent,
                queued: !is_same,
                rounds: 0,
                at_most: before as u32 + MAX_ANSWER_ROUNDS,
                reply: answer,
            }),
            (Err(RequestQueueError::Full { .. }), false) => {}
            (sent, _) => {
                self.is_wrong(format!("{words} of user {uid}, where {of_user} of {of_all} wait: {sent:?}"))
            }
        }
        if urgent {
            // An urgent request is processed before the waiting ones.
            self.waiting.iter_mut().filter(|waiting| waiting.queued).for_each(|waiting| waiting.at_most += 1);
        }
    }

    /// Passes a request through the socket's protocol; an accepted request must be unchanged afterwards.
    fn through_the_socket(&mut self, what: RequestKind) -> RequestKind {
        let Ok(line) = request_line(&what) else { return what };
        match read_request(line.as_bytes()) {
            Ok(read) if format!("{read:?}") == format!("{what:?}") => read,
            read => {
                self.is_wrong(format!("{what:?} is {line:?} on the socket, and read as {read:?}"));
                what
            }
        }
    }

    /// Returns the request that the loop receives now.
    pub fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        self.rounds += 1;
        let is_due = state.at.is_at_rest() || self.rounds.is_multiple_of(PAGE_ROUNDS);
        if is_due && !self.waiting.iter().any(|waiting| waiting.uid == PAGE) {
            self.send_request(PAGE, RequestKind::State);
        }
        let request = self.handler.next_request(state)?;
        self.waiting.iter_mut().for_each(|waiting| waiting.rounds += 1);
        let outdated = request.as_ref().filter(|request| matches!(request.what, RequestKind::Outdated { .. }));
        if let Some(request) = outdated {
            // An outdated request is answered immediately.
            self.is_outdated(&request.what, state);
        }
        self.answers();
        if let Some(request) = &request
            && request.requester.front == RequestSource::Socket
            && !matches!(request.what, RequestKind::Outdated { .. })
        {
            let queued = |waiting: &&mut Waiting| waiting.queued;
            let first = self.waiting.iter_mut().filter(queued).min_by_key(|waiting| !waiting.urgent);
            match first {
                Some(first) if first.words == format!("{:?}", request.what) => {
                    first.queued = false;
                    let taken = taken(first, &request.what, state);
                    self.decided += u64::from(first.shown.is_some());
                    if let Some(wrong) = taken {
                        self.is_wrong(wrong);
                    }
                }
                first => {
                    let first = first.map(|first| first.words.clone());
                    self.is_wrong(format!("{:?} was taken, and {first:?} was the first", request.what));
                }
            }
        }
        Ok(request)
    }

    fn is_outdated(&mut self, what: &RequestKind, state: &State) {
        let words = format!("{what:?}");
        let is_it = |waiting: &&mut Waiting| waiting.queued && waiting.shown.is_some() && waiting.words == words;
        let wrong = match self.waiting.iter_mut().find(is_it) {
            Some(waiting) => {
                waiting.queued = false;
                taken(waiting, what, state)
            }
            None => Some(format!("{words} was refused as outdated, and no other decision was made")),
        };
        self.decided += 1;
        if let Some(wrong) = wrong {
            self.is_wrong(wrong);
        }
    }

    fn answers(&mut self) {
        let mut late = None;
        let leaves = self.leaves;
        self.waiting.retain_mut(|waiting| match waiting.reply.try_recv() {
            Ok(reply) => {
                if waiting.is_stale && reply.answer != RequestResult::Refused {
                    late = Some(format!(
                        "{}, decided upon what is over, was answered {:?}",
                        waiting.words, reply.answer
                    ));
                }
                if reply.state.is_none() {
                    late = Some(format!("{} was answered without a state", waiting.words));
                }
                false
            }
            Err(TryRecvError::Closed) if leaves => false,
            Err(TryRecvError::Closed) => {
                late = Some(format!("{} was dropped", waiting.words));
                false
            }
            Err(TryRecvError::Empty) => {
                if waiting.rounds > waiting.at_most {
                    late = Some(format!("{} has no answer after {} rounds", waiting.words, waiting.rounds));
                }
                true
            }
        });
        if let Some(what) = late {
            self.is_wrong(what);
        }
    }

    /// Handles an event that the loop reports.
    pub fn on_news(&mut self, news: LoopEvent) {
        self.handler.on_loop_event(news);
        self.answers();
    }

    fn is_wrong(&mut self, what: String) {
        self.wrong.get_or_insert(what);
    }
}

/// Returns the problem with a processed decision: the state machine must still be in the state on which the decision
/// was based.
fn taken(first: &mut Waiting, what: &RequestKind, state: &State) -> Option<String> {
    let shown = first.shown?;
    let is_good = shown == Shown::from_state(state);
    first.is_stale = !is_good;
    match what {
        RequestKind::Table(request) if !is_good => {
            Some(format!("{request:?} was decided upon {shown:?}, and is asked of {:?}", Shown::from_state(state)))
        }
        RequestKind::Outdated { request, .. } if is_good => {
            Some(format!("{request:?} upon {shown:?} was refused as outdated"))
        }
        _ => None,
    }
}

fn is_urgent(what: &RequestKind) -> bool {
    matches!(what, RequestKind::Leave | RequestKind::Table(cycle::Request::Stop | cycle::Request::Abort))
}
