//! The source of requests, and the reports about them.

use super::port::{Command, Port};
use crate::cycle::{self, Id, Refusal, State};
use crate::daemon::operator_texts;
use crate::daemon::request::Request;
use crate::record::CycleId;
use crate::supervision::ThreadFault;
use crate::tape::Begin;
use crate::verdict::{Reason, Verdict};

/// The loop's questions and reports.
#[derive(Debug)]
pub enum RequestCommand {
    /// Asks for the next request, in this state. The answer comes within milliseconds, in every state of the loop.
    Next(State),
    /// Asks whether the result of this piece of work may enter the loop, now that it is available. A replay lets it
    /// in at the recorded point.
    LetsIn(Id),
    /// Reports something that needs no answer.
    Publish(LoopEvent),
}

/// The reports of the loop.
#[derive(Debug)]
pub enum LoopEvent {
    /// The table refused this request; a reset may fail later.
    Refused(cycle::Request, Refusal),
    /// The requested operation cannot begin.
    Unable(Vec<Reason>),
    /// The request is not executed, because another side commands the cell.
    NotPermitted(Vec<Reason>),
    /// A cycle began; contains what the loop remembers from the time before the cycle.
    Begun(CycleId, Begin),
    /// The cycle has its verdict.
    Concluded(Verdict),
    /// A film is under way: this many seconds of it were seen.
    Filmed(f64),
    /// The change to a new disc was recorded.
    DiscMounted,
    /// The last check: the reasons for which something is not as it should be, or no reasons.
    Noted(Vec<Reason>),
}

impl LoopEvent {
    /// Returns why a request in this state was not done, if this report states it.
    pub fn why_refused(self, state: &State) -> Option<Reason> {
        match self {
            LoopEvent::Refused(request, refused) => Some(operator_texts::refusal(request, refused, state)),
            LoopEvent::NotPermitted(reasons) | LoopEvent::Unable(reasons) => reasons.into_iter().next(),
            _ => None,
        }
    }
}

/// What is answered.
#[derive(Debug)]
pub enum RequestAnswer {
    /// To `Next`: a request, or none. An error reports that a thread of the program failed: the loop stops the
    /// robot and ends.
    Next(Result<Option<Request>, ThreadFault>),
    /// To `LetsIn`: the same piece of work, if its result enters now.
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
    fn admit(&mut self, result: Id) -> bool {
        matches!(self.perform(RequestCommand::LetsIn(result)), RequestAnswer::LetsIn(Some(_)))
    }

    /// See [`RequestCommand::Publish`].
    fn publish(&mut self, news: LoopEvent) {
        self.perform(RequestCommand::Publish(news));
    }
}

impl<P: Port<RequestCommand> + ?Sized> RequestPort for P {}

/// The source of requests, for all types that need no more than this.
pub trait Requester {
    /// Returns the present request, in this state.
    ///
    /// # Errors
    /// If a thread of the program failed.
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault>;
    /// Receives the loop's reports. A requester that needs no reports leaves this out.
    fn on_news(&mut self, _news: LoopEvent) {}
}

impl<R: Requester> Port<RequestCommand> for R {
    fn perform(&mut self, command: RequestCommand) -> RequestAnswer {
        match command {
            RequestCommand::Next(state) => RequestAnswer::Next(self.next_request(&state)),
            RequestCommand::LetsIn(result) => RequestAnswer::LetsIn(Some(result)),
            RequestCommand::Publish(news) => {
                self.on_news(news);
                RequestAnswer::Done
            }
        }
    }
}
