//! The source of requests to the loop, and the loop's reports to this source.

use super::port::{Command, Port};
use crate::daemon::operator_texts;
use crate::daemon::request::Request;
use panelprep_base::supervision::ThreadFault;
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cycle::{self, Id, Refusal, State};
use panelprep_cell::record::CycleId;
use panelprep_store::tape::LoopMemoryStart;

/// The questions and reports of the loop to the source of requests.
#[derive(Debug)]
pub enum RequestCommand {
    /// Requests the next request; `State` is the present state of the cycle. The answer comes within milliseconds, in
    /// every state of the loop.
    Next(State),
    /// Asks whether the loop may accept the result of this action now. In a replay, the result is accepted at the
    /// recorded point.
    LetsIn(Id),
    /// Reports an event that needs no answer.
    Publish(LoopEvent),
}

/// The events that the loop reports.
#[derive(Debug)]
pub enum LoopEvent {
    /// The state table refused this request; an accepted reset may still fail later.
    Refused(cycle::Request, Refusal),
    /// The requested operation cannot begin.
    Unable(Vec<Reason>),
    /// The request is not executed, because the selector switch gives the control to another side.
    NotPermitted(Vec<Reason>),
    /// A cycle began. The event contains the data that the loop keeps from before the cycle.
    Begun(CycleId, LoopMemoryStart),
    /// The cycle has ended with this verdict.
    Concluded(Verdict),
    /// A film is in progress; the value is its present duration, s.
    Filmed(f64),
    /// The change to a new disc was recorded.
    DiscMounted,
    /// The problems that the last check found; empty if there are none.
    Noted(Vec<Reason>),
}

impl LoopEvent {
    /// Returns the reason if this event reports that a request was refused in this state.
    pub fn refusal_reason(self, state: &State) -> Option<Reason> {
        match self {
            LoopEvent::Refused(request, refused) => Some(operator_texts::refusal(request, refused, state)),
            LoopEvent::NotPermitted(reasons) | LoopEvent::Unable(reasons) => reasons.into_iter().next(),
            _ => None,
        }
    }
}

/// The answers of the source of requests.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one answer exists at a time, and it is moved only once")]
pub enum RequestAnswer {
    /// Answer to `Next`: the next request, if there is one. An error reports that a thread of the program failed; the
    /// loop then stops the robot and ends.
    Next(Result<Option<Request>, ThreadFault>),
    /// Answer to `LetsIn`: the ID of the action, if the loop may accept its result now.
    LetsIn(Option<Id>),
    /// The answer to `Publish`.
    Done,
}

impl Command for RequestCommand {
    type Answer = RequestAnswer;
}

/// The commands to the source of requests as functions.
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

/// A simple source of requests: the interface for types that only provide requests.
pub trait Requester {
    /// Returns the next request, or `None` if there is none; `state` is the present state of the cycle.
    ///
    /// # Errors
    /// If a thread of the program failed.
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault>;
    /// Receives an event that the loop reports; does nothing by default.
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
