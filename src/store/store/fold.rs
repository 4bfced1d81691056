//! The state of motions and cycles according to the journal: its events, folded by the cycle's state machine.

use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{Effect, Event, Motion, Outcome, Report, State, step};
use panelprep_cell::record::CycleId;
use serde::{Deserialize, Serialize};

/// A motion with its outcome and its number of executed waypoints.
pub(super) type MotionEnd = (Motion, Outcome, u32);

/// The content of a journal about motions and cycles, as far as it was read.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JournalFold {
    pub(super) state: State,
    pub(super) closed: Option<MotionEnd>,
    pub(super) concluded: Option<(Option<CycleId>, Verdict)>,
    pub(super) cycle: Option<CycleId>,
}

impl JournalFold {
    pub const INITIAL: JournalFold =
        JournalFold { state: State::INITIAL, closed: None, concluded: None, cycle: None };

    pub fn step(&mut self, event: Event, cycle: Option<CycleId>) {
        let (state, effects) = step(self.state, event);
        self.state = state;
        self.cycle = cycle;
        for effect in effects {
            match effect {
                Effect::CloseIntent { motion, outcome, done } => self.closed = Some((motion, outcome, done)),
                Effect::Conclude { verdict } => self.concluded = Some((cycle, verdict)),
                _ => {}
            }
        }
    }

    /// The state at the end of the journal.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns the state after the next start of the program.
    pub fn after_restart(&self) -> State {
        step(self.state, Event::Reported(Report::Boot)).0
    }
}
