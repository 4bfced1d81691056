//! Somebody who asks by a script.

use super::super::super::*;
use crate::cycle::{At, Refusal, Request, State};
use std::collections::VecDeque;

type When = Box<dyn Fn(&State) -> bool>;

/// Somebody who asks each thing once, in order, when its time has come, and leaves where nothing more can happen.
pub struct Asks {
    script: VecDeque<(When, Request)>,
    pub refusals: Vec<(Request, Refusal)>,
}

impl Asks {
    pub fn one_cycle() -> Self {
        let asks = Asks { script: VecDeque::new(), refusals: Vec::new() };
        let ready = |state: &State| state.facts.robot == crate::cycle::Robot::Ready;
        asks.with(ready, Request::Reset)
            .with(|state| state.at == At::Idle, Request::Start { max_passes: 2, max_moves: 3 })
    }

    pub fn with(mut self, when: impl Fn(&State) -> bool + 'static, request: Request) -> Self {
        self.script.push_back((Box::new(when), request));
        self
    }
}

impl Requests for Asks {
    fn next(&mut self, state: &State) -> Ask {
        if let Some((_, request)) = self.script.pop_front_if(|(when, _)| when(state)) {
            return Ask::For(request);
        }
        match state.at {
            At::Complete { .. } | At::Aborted { .. } => Ask::Leave,
            At::Held(_) | At::Stopped if self.script.is_empty() => Ask::Leave,
            _ => Ask::Nothing,
        }
    }

    fn refused(&mut self, request: Request, refusal: Refusal) {
        self.refusals.push((request, refusal));
    }
}
