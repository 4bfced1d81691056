//! The source of requests, and the reports about them.

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
    /// Asks for the next request, in this state. The answer comes within milliseconds, in every state of the loop.
    Next(State),
    /// Asks whether the available result of this piece of work may enter the loop now. A replay lets it enter at the
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
    /// A cycle began; the event contains the data that the loop retains from before the cycle.
    Begun(CycleId, LoopMemoryStart),
    /// The cycle has its verdict.
    Concluded(Verdict),
    /// A film is in progress; this is the duration of the part seen so far, s.
    Filmed(f64),
    /// The change to a new disc was recorded.
    DiscMounted,
    /// The result of the last check: the problems found; empty if there are none.
    Noted(Vec<Reason>),
}

impl LoopEvent {
    /// Returns why a request in this state was refused, if this event states it.
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
    /// Answer to `LetsIn`: the same piece of work, if its result may enter now.
    LetsIn(Option<Id>),
    /// The answer to `Publish`.
    Done,
}

impl Command for RequestCommand {
    type Answer = RequestAnswer;
}

/// The commands as functions.
pub trait RequestPort: Port<RequestCommand> {
    /// See [`RequestCommand::Next`].
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

/// A source of requests: the simple interface for types that need nothing else.
pub trait Requester {
    /// Returns the present request, in this state.
    ///
    /// # Errors
    /// If a thread of the program failed.
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault>;
    /// Receives the loop's reports. A requester that needs no reports leaves this out.
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
