//! Somebody who asks by a script.

use super::super::super::*;
use crate::cycle::{self, At, Refusal, State};
use crate::record::{Front, Who};
use crate::supervision::ThreadFault;
use std::collections::VecDeque;

type When = Box<dyn Fn(&State) -> bool>;

/// Somebody who asks each thing once, in order, when its time has come, and leaves where nothing more can happen.
pub struct Asks {
    script: VecDeque<(When, cycle::Request)>,
    pub refusals: Vec<(cycle::Request, Refusal)>,
}

impl Asks {
    pub fn one_cycle() -> Self {
        let asks = Asks { script: VecDeque::new(), refusals: Vec::new() };
        let ready = |state: &State| state.facts.robot == crate::cycle::Robot::Ready;
        asks.with(ready, cycle::Request::Reset)
            .with(|state| state.at == At::Idle, cycle::Request::Start { max_passes: 2, max_moves: 3 })
    }

    pub fn with(mut self, when: impl Fn(&State) -> bool + 'static, request: cycle::Request) -> Self {
        self.script.push_back((Box::new(when), request));
        self
    }
}

impl Requests for Asks {
    fn next(&mut self, state: &State) -> Result<Option<Request>, ThreadFault> {
        let what = match self.script.pop_front_if(|(when, _)| when(state)) {
            Some((_, request)) => Some(What::Table(request)),
            None => match state.at {
                At::Complete { .. } | At::Aborted { .. } => Some(What::Leave),
                At::Held(_) | At::Stopped if self.script.is_empty() => Some(What::Leave),
                _ => None,
            },
        };
        Ok(what.map(|what| Request::new(what, Who::by(Front::Command))))
    }

    fn refused(&mut self, request: cycle::Request, refusal: Refusal) {
        self.refusals.push((request, refusal));
    }
}
