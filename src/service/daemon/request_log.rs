//! Records requests: the request, its author, and its result.

use super::ports::{LoopEvent, RecordCommand, RobotPort};
use super::running::LoopMemory;
use super::{DaemonError, operator_texts};
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Event, Refusal, Request};
use panelprep_cell::record::{Answer, Clock, RequestAuthor, RequestRecord, RequestSource, RequestedAction};

impl LoopMemory<'_> {
    /// Records a request after an event's effects: what the event requested, and whether it was refused. A reset
    /// that fails later is a separate line, since it was accepted before.
    pub(super) fn record_request(
        &mut self,
        event: Event,
        refused: Option<(Request, Refusal)>,
    ) -> Result<(), DaemonError> {
        let answer = |refusal: Refusal| match refusal {
            Refusal::NotNow | Refusal::Review | Refusal::Undried => Answer::Refused,
            Refusal::Robot(_) | Refusal::Failed(_) => Answer::Failed,
        };
        let why =
            |request, refusal| (answer(refusal), vec![operator_texts::refusal(request, refusal, &self.state)]);
        match (event, refused) {
            (Event::Asked(request), None) => {
                let remarks = std::mem::take(&mut self.remarks);
                self.record_answer(RequestedAction::For(request), self.requester.clone(), (Answer::Done, remarks))
            }
            (Event::Asked(request), Some((_, refusal))) => {
                self.remarks.clear();
                let outcome = why(request, refusal);
                self.record_answer(RequestedAction::For(request), self.requester.clone(), outcome)
            }
            (Event::Reported(_), Some((request, refusal))) => {
                let outcome = why(request, refusal);
                self.record_answer(
                    RequestedAction::For(request),
                    RequestAuthor::from_source(RequestSource::Program),
                    outcome,
                )
            }
            (Event::Reported(_), None) => Ok(()),
        }
    }

    /// Records one request with its answer.
    pub(super) fn record_answer(
        &mut self,
        wanted: RequestedAction,
        who: RequestAuthor,
        (answer, reasons): (Answer, Vec<Reason>),
    ) -> Result<(), DaemonError> {
        let asked =
            RequestRecord { unix_ms: 0, wanted, who: Some(who), answer: Some(answer), reasons, findings: None };
        Ok(self.ports.record.perform_and_forget(RecordCommand::Asked(asked))?)
    }

    /// Records that a new disc was mounted, if the cell is at rest.
    pub(super) fn new_disc(&mut self) -> Result<(), DaemonError> {
        if self.state.at.is_at_rest() {
            self.ports.record.perform_and_forget(RecordCommand::MountDisc)?;
            self.ports.requests.publish(LoopEvent::DiscMounted);
            return self.record_answer(RequestedAction::NewDisc, self.requester.clone(), (Answer::Done, vec![]));
        }
        let message = "a disc can be changed only while the cell is at rest: held, idle or stopped";
        let reasons = vec![Reason::new("not_now", message)];
        self.ports.requests.publish(LoopEvent::Unable(reasons.clone()));
        self.record_answer(RequestedAction::NewDisc, self.requester.clone(), (Answer::Refused, reasons))
    }

    /// Records the clock's time: when a cycle begins, and when it is concluded.
    pub(super) fn record_clock(&mut self) -> Result<(), DaemonError> {
        let clock = match self.lock_step {
            true => {
                let since = self.ports.robot.now().since_start();
                Clock::Simulated { at_ms: u64::try_from(since.as_millis()).unwrap_or(u64::MAX) }
            }
            false => Clock::Wall,
        };
        Ok(self.ports.record.perform_and_forget(RecordCommand::Clock(clock))?)
    }
}
