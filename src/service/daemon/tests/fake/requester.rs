//! A requester that follows a script.

use super::super::super::*;
use panelprep_base::supervision::ThreadFault;
use panelprep_cell::cycle::{self, At, Refusal, State};
use panelprep_cell::record::{RequestAuthor, RequestSource};
use std::collections::VecDeque;

/// Limit of the loop's iterations; a cycle needs fewer.
const MAX_ITERATIONS: usize = 200_000;

type When = Box<dyn Fn(&State) -> bool>;

/// Makes each request once, in order, when its time has come, and leaves when nothing more can happen.
pub struct Asks {
    script: VecDeque<(When, cycle::Request)>,
    /// The request that is made in every iteration while a cycle runs; the next field counts these requests.
    flood: Option<cycle::Request>,
    asked: usize,
    pub refusals: Vec<(cycle::Request, Refusal)>,
}

impl Asks {
    pub fn nothing() -> Self {
        Asks { script: VecDeque::new(), flood: None, asked: 0, refusals: Vec::new() }
    }

    pub fn without_end(self, request: cycle::Request) -> Self {
        Asks { flood: Some(request), ..self }
    }

    pub fn one_cycle() -> Self {
        Asks::one_cycle_by(cycle::Request::Start { max_passes: 2, max_moves: 3, dries: false })
    }

    pub fn one_cycle_by(start: cycle::Request) -> Self {
        let asks = Asks::nothing();
        let ready = |state: &State| state.facts.robot == panelprep_cell::cycle::Robot::Ready;
        asks.with(ready, cycle::Request::Reset).with(|state| state.at == At::Idle, start)
    }

    pub fn one_air_run() -> Self {
        let ready = |state: &State| state.facts.robot == panelprep_cell::cycle::Robot::Ready;
        Asks::nothing()
            .with(ready, cycle::Request::Reset)
            .with(|state| state.at == At::Idle, cycle::Request::AirRun { max_moves: 3 })
    }

    pub fn with(mut self, when: impl Fn(&State) -> bool + 'static, request: cycle::Request) -> Self {
        self.script.push_back((Box::new(when), request));
        self
    }
}

impl Requester for Asks {
    fn next_request(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let what = match self.script.pop_front_if(|(when, _)| when(state)) {
            Some((_, request)) => Some(RequestKind::Table(request)),
            None => match state.at {
                At::Complete { .. } | At::Aborted { .. } => Some(RequestKind::Leave),
                At::Held(_) | At::Stopped if self.script.is_empty() => Some(RequestKind::Leave),
                At::Execute(_) if self.flood.is_some() => {
                    self.asked += 1;
                    assert!(self.asked < MAX_ITERATIONS, "nothing else has its turn");
                    self.flood.map(RequestKind::Table)
                }
                _ => None,
            },
        };
        Ok(what.map(|what| Request::new(what, RequestAuthor::from_source(RequestSource::Command))))
    }

    fn on_loop_event(&mut self, news: LoopEvent) {
        if let LoopEvent::Refused(request, refusal) = news {
            self.refusals.push((request, refusal));
        }
    }
}
