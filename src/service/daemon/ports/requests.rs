//! The source of requests, and the loop's reports to it.

use super::port::{Command, Port};
use crate::daemon::operator_texts;
use crate::daemon::request::Request;
use panelprep_base::supervision::ThreadFault;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{self, Id, Refusal, State};
use panelprep_cell::record::CycleId;
use panelprep_store::tape::LoopMemoryStart;

/// The loop's questions and reports.
#[derive(Debug)]
pub enum RequestCommand {
    /// Asks for the next request; `State` is the present state of the cycle. The answer comes within milliseconds, in
    /// every state of the loop.
    Next(State),
    /// Asks whether the loop may accept the result of this piece of work now. In a replay, it is accepted at the
    /// recorded point.
    LetsIn(Id),
    /// Reports something that needs no answer.
    Publish(LoopEvent),
}

/// The reports of the loop.
#[derive(Debug)]
pub enum LoopEvent {
    /// The state table refused this request; an accepted reset may still fail later.
    Refused(cycle::Request, Refusal),
    /// The requested operation cannot begin.
    Unable(Vec<Reason>),
    /// The request is not executed, because another side commands the cell.
    NotPermitted(Vec<Reason>),
    /// A cycle began; the event contains the data that the loop keeps from before the cycle.
    Begun(CycleId, LoopMemoryStart),
    /// The cycle has its verdict.
    Concluded(Verdict),
    /// A film is in progress; this is the duration of the part seen so far, s.
    Filmed(f64),
    /// The change to a new disc was recorded.
    DiscMounted,
    /// The problems that the last check found; empty if there are none.
    Noted(Vec<Reason>),
}

impl LoopEvent {
    /// Returns the reason if this event states that a request was refused in this state.
    pub fn refusal_reason(self, state: &State) -> Option<Reason> {
        match self {
            LoopEvent::Refused(request, refused) => Some(operator_texts::refusal(request, refused, state)),
            LoopEvent::NotPermitted(reasons) | LoopEvent::Unable(reasons) => reasons.into_iter().next(),
            _ => None,
        }
    }
}

/// Answer to a request.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one answer exists at a time, and it is moved only once")]
pub enum RequestAnswer {
    /// Answer to `Next`: a request, or none. An error reports that a thread of the program failed: the loop stops the
    /// robot and ends.
    Next(Result<Option<Request>, ThreadFault>),
    /// Answer to `LetsIn`: the same piece of work, if the loop may accept its result now.
    LetsIn(Option<Id>),
    /// The answer to `Publish`.
    Done,
}

impl Command for RequestCommand {
    type Answer = RequestAnswer;
}

/// The commands of the source as functions.
pub trait RequestPort: Port<RequestCommand> {
    /// Returns the next request; see [`RequestCommand::Next`].
    ///
    /// # Errors
    /// If a thread of the program failed.
    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        match self.perform(RequestCommand::Next(*state)) {
            RequestAnswer::Next(next) => next,
            _ => Ok(None),
        }
    }

    /// See [`RequestCommand::LetsIn`].
    fn admit_requests(&mut self, result: Id) -> bool {
        matches!(self.perform(RequestCommand::LetsIn(result)), RequestAnswer::LetsIn(Some(_)))
    }

    /// See [`RequestCommand::Publish`].
    fn publish(&mut self, news: LoopEvent) {
        self.perform(RequestCommand::Publish(news));
    }
}

impl<P: Port<RequestCommand> + ?Sized> RequestPort for P {}

/// A source of requests: the simple interface for types that only provide requests.
pub trait Requester {
    /// Returns the next request, or `None` if there is none; `state` is the present state of the cycle.
    ///
    /// # Errors
    /// If a thread of the program failed.
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault>;
    /// Receives a report of the loop; does nothing by default.
    fn on_loop_event(&mut self, _news: LoopEvent) {}
}

impl<R: Requester> Port<RequestCommand> for R {
    fn perform(&mut self, command: RequestCommand) -> RequestAnswer {
        match command {
            RequestCommand::Next(state) => RequestAnswer::Next(self.next_request(&state)),
            RequestCommand::LetsIn(result) => RequestAnswer::LetsIn(Some(result)),
            RequestCommand::Publish(news) => {
                self.on_loop_event(news);
                RequestAnswer::Done
            }
        }
    }
}
