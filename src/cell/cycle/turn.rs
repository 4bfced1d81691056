//! A transition while it is computed: the state, the effects so far, and the next action towards the goal of the state.

use super::interlocks::{Need, action_needs};
use super::{
    Action, At, Deadline, Due, Effect, Facts, Id, Intent, Outcome, Phase, Refusal, Request, State, Trouble,
};
use panelprep_base::verdict::Verdict;

/// The goal of a state.
pub(super) enum Goal {
    /// Do nothing, or wait.
    Rest,
    /// Perform this action as soon as its conditions are satisfied.
    Do(Action),
    /// Perform this action immediately.
    Now(Action),
    /// To enter the next state, once these needs are satisfied.
    Reach(&'static [Need], At),
}

/// A transition while it is computed.
pub(super) struct TransitionStep {
    /// A need that a test drops from all rows.
    #[cfg(test)]
    pub dropped: Option<Need>,
    pub state: State,
    pub effects: Vec<Effect>,
}

impl TransitionStep {
    /// Begins a transition from this state.
    pub fn new(state: State) -> Self {
        TransitionStep {
            #[cfg(test)]
            dropped: None,
            state,
            effects: Vec::new(),
        }
    }

    /// Concludes the cycle with its verdict. The localization is no longer valid.
    pub fn conclude(&mut self, verdict: Verdict) {
        self.state.facts.token = None;
        if self.state.job.running {
            // A cycle has exactly one verdict: later transitions do not conclude it again.
            self.state.job.running = false;
            self.effects.push(Effect::Conclude { verdict });
        }
    }

    /// Closes an open motion after the robot has reached standstill.
    pub fn close_intent(&mut self, outcome: Outcome, done: u32) {
        if let Some(Intent { motion, .. }) = self.state.intent.take() {
            self.effects.push(Effect::CloseIntent { motion, outcome, done });
        }
    }

    pub fn refuse(&mut self, request: Request, refusal: Refusal) {
        self.effects.push(Effect::Refuse { request, refusal });
    }

    pub fn discard_report(&mut self) {
        self.state.dropped += 1;
    }

    fn next_id(&mut self) -> Id {
        self.state.last_id = Id(self.state.last_id.0 + 1);
        self.state.last_id
    }

    /// Starts a deadline that does not belong to an action.
    pub fn arm(&mut self, deadline: Deadline) -> Id {
        let id = self.next_id();
        self.effects.push(Effect::Arm { id, deadline });
        id
    }

    /// Starts the next action, unless one is in progress.
    pub fn perform_next_action(&mut self) {
        // Only one action at a time: a parallel action could violate an interlock that was satisfied before.
        while self.state.due.is_none() {
            if self.has_wrong_override() {
                self.leave_for_trouble(Trouble::Override);
            }
            match self.current_goal() {
                Goal::Rest => return,
                Goal::Do(act) => return self.perform_required_action(act),
                Goal::Now(act) => return self.perform(act),
                Goal::Reach(rows, at) => match self.first_unmet_need(rows) {
                    Some(Some(act)) => return self.perform_required_action(act),
                    Some(None) => return,
                    None => self.enter_state(at),
                },
            }
        }
    }

    /// Returns whether the tool is in contact, or contact is the next action, at an override other than the one for
    /// which contact is planned. Only a person can correct this.
    pub fn has_wrong_override(&self) -> bool {
        let touches = self.state.at == At::Execute(Phase::Abrade) && !self.is_air();
        touches && !self.is_satisfied(Need::FullOverride)
    }

    /// Starts the first action that is needed for the given action, or the given action itself if all its conditions
    /// are satisfied. Starts nothing if the condition only needs time.
    fn perform_required_action(&mut self, mut act: Action) {
        loop {
            match self.first_unmet_need(&action_needs(act)) {
                // An action that satisfies a condition has conditions itself: the tool starts only with extraction and
                // after the water has drained. Therefore the search continues until an action may begin.
                Some(Some(before)) => act = before,
                Some(None) => return,
                None => return self.perform(act),
            }
        }
    }

    /// Returns the action that satisfies the first need that is not satisfied; `Some(None)` if only time or a person
    /// can satisfy it, `None` if all needs are satisfied.
    fn first_unmet_need(&self, rows: &[Need]) -> Option<Option<Action>> {
        rows.iter().find(|need| !self.is_satisfied(**need)).map(|need| need.satisfying_action(&self.state))
    }

    fn is_satisfied(&self, need: Need) -> bool {
        #[cfg(test)]
        if self.dropped == Some(need) {
            return true;
        }
        need.is_satisfied(&self.state.facts)
    }

    fn perform(&mut self, act: Action) {
        let id = self.next_id();
        // From here on the output may have either state; if the answer never comes, no interlock may rely on the old
        // one.
        self.state.facts.mark_unknown(act);
        if let Action::Move(motion) = act {
            self.state.intent = Some(Intent { id, motion, done: 0 });
            // The intent is committed before the motion is sent: after a power cut, a contact that took place must be
            // in the store.
            self.effects.push(Effect::OpenIntent(motion));
        }
        // The deadline starts before the action, so that an action without an answer is always detected.
        self.effects.push(Effect::Arm { id, deadline: Deadline::Answer });
        self.effects.push(Effect::Do { id, act });
        self.state.due = Some(Due { id, act });
    }

    fn enter_state(&mut self, at: At) {
        self.state.at = at;
        if let At::Complete { verdict } = at {
            self.conclude(verdict);
        }
    }

    /// Returns the facts of the cell for modification.
    pub fn facts(&mut self) -> &mut Facts {
        &mut self.state.facts
    }
}
