//! A step during its computation: the state, the effects so far, and the next action towards an aim.

use super::interlocks::{Row, Rule, Rules, action_needs};
use super::{
    Action, At, Deadline, Due, Effect, Facts, Id, Intent, Outcome, Phase, Refusal, Request, State, Trouble,
};
use panelprep_base::verdict::Verdict;

/// The aim of a state.
pub(super) enum Goal {
    /// To do nothing, or only to wait for time to pass.
    Rest,
    /// To perform this action, once its needs are satisfied.
    Do(Action),
    /// To perform this action at once.
    Now(Action),
    /// To enter the next state, once these needs are satisfied.
    Reach(&'static [Row], At),
}

/// A step in progress.
pub(super) struct TransitionStep {
    pub rules: Rules,
    pub state: State,
    pub effects: Vec<Effect>,
}

impl TransitionStep {
    /// Concludes the cycle with its result; the cycle's localization is void.
    pub fn conclude(&mut self, verdict: Verdict) {
        self.state.facts.token = None;
        if self.state.job.running {
            // A cycle has exactly one verdict: later transitions of the same cycle conclude nothing.
            self.state.job.running = false;
            self.effects.push(Effect::Conclude { verdict });
        }
    }

    /// Closes an open motion: the robot is at standstill.
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

    /// Arms a deadline that does not belong to an action.
    pub fn arm(&mut self, deadline: Deadline) -> Id {
        let id = self.next_id();
        self.effects.push(Effect::Arm { id, deadline });
        id
    }

    /// Performs the next action, unless one is in progress.
    pub fn perform_next_action(&mut self) {
        // One action at a time: an interlock that is proven now could otherwise be undone by an action in parallel.
        while self.state.due.is_none() {
            if self.lacks_override() {
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

    /// Returns whether the cycle touches the panel, or is about to, with another override than the one for which
    /// contact is planned. Neither time nor an action can correct this: a person must.
    pub fn lacks_override(&self) -> bool {
        let touches = self.state.at == At::Execute(Phase::Abrade) && !self.is_air();
        touches && !self.state.facts.full_override && self.rules.is_active(Rule::FullOverride)
    }

    /// Performs the first action that the given action still needs, or the given action itself if all its needs are
    /// satisfied. If it only has to wait for time to pass, nothing is performed yet.
    fn perform_required_action(&mut self, mut act: Action) {
        loop {
            match self.first_unmet_need(&action_needs(act)) {
                // An action that satisfies a need has needs itself (the tool starts only with extraction and drained
                // water), so the search continues until an action may begin.
                Some(Some(before)) => act = before,
                Some(None) => return,
                None => return self.perform(act),
            }
        }
    }

    /// Returns the action that satisfies the first need that is not satisfied; `Some(None)` if only time or a person
    /// can satisfy it, `None` if all needs are satisfied.
    fn first_unmet_need(&self, rows: &[Row]) -> Option<Option<Action>> {
        let missing = |(rule, need): &&Row| self.rules.is_active(*rule) && !need.is_satisfied(&self.state.facts);
        rows.iter().find(missing).map(|(_, need)| need.satisfying_action(&self.state))
    }

    fn perform(&mut self, act: Action) {
        let id = self.next_id();
        // From here on the output may have either state; if the answer never comes, no interlock may rely on the old
        // one.
        if self.rules.is_active(Rule::AskedIsUnknown) {
            self.state.facts.mark_unknown(act);
        }
        if let Action::Move(motion) = act {
            self.state.intent = Some(Intent { id, motion, done: 0 });
            // The intent is committed before the motion is sent: after a power cut, a contact that took place must be
            // in the store.
            if self.rules.is_active(Rule::IntentFirst) {
                self.effects.push(Effect::OpenIntent(motion));
            }
        }
        // Armed before the action is performed, so that an action that never returns is still detected as late.
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

    /// Returns the facts of the cell, so that they can be changed.
    pub fn facts(&mut self) -> &mut Facts {
        &mut self.state.facts
    }
}
