//! One step of the table: how an event changes the state; the state after a restart of the program; and the recovery
//! at program start, which folds the journal of the last process into a state, however that process ended.

use super::interlocks::{Rule, Rules};
use super::turn::TransitionStep;
use super::{
    Action, Answer, At, Cause, Deadline, Effect, Epoch, Event, Hold, Id, Job, Light, Phase, Refusal, Report,
    Request, Robot, State, Trouble, Water, Why,
};
use panelprep_base::verdict::Verdict;

/// Returns the next state and the effects to perform now, in order. All effects are performed before the next
/// event.
pub fn step(state: State, event: Event) -> (State, Vec<Effect>) {
    step_with(Rules::ALL, state, event)
}

pub(super) fn step_with(rules: Rules, state: State, event: Event) -> (State, Vec<Effect>) {
    let mut turn = TransitionStep { rules, state, effects: Vec::new() };
    match event {
        Event::Asked(request) => turn.on_request(request),
        Event::Reported(report) => turn.on_report(report),
    }
    turn.perform_next_action();
    // A person decides on the state that was shown: the number keeps a click on an old page from acting on a newer
    // state.
    if turn.state.at != state.at {
        turn.state.step += 1;
    }
    (turn.state, turn.effects)
}

impl TransitionStep {
    fn on_request(&mut self, request: Request) {
        use Request as Q;
        let robot = self.state.facts.robot;
        let ready = robot == Robot::Ready || !self.rules.is_active(Rule::RobotReady);
        match (self.state.at, request) {
            // A request that may lead to motion needs a robot that is ready.
            (At::Stopped | At::Complete { .. }, Q::Reset) if ready => {
                // What was true before the last cycle is not evidence for the next one: standstill and self-test are
                // proven again.
                (self.state.facts.standing, self.state.facts.tested) = (false, false);
                self.state.at = At::Resetting;
            }
            (At::Idle, Q::Start { max_passes, max_moves, dries }) if ready => {
                self.state.job = Job { running: true, max_passes, max_moves, dries, ..State::INITIAL.job };
                self.state.at = At::Starting;
            }
            (At::Idle, Q::AirRun { max_moves }) if ready => {
                self.state.job = Job { running: true, air: true, max_moves, ..State::INITIAL.job };
                self.state.at = At::Starting;
            }
            (At::Held(hold), Q::Unhold { dried }) if ready => self.start_unhold(hold, dried),
            // A person looked at the result and is at the panel: no Verify before the next phase.
            (At::Held(Hold { why: Why::Review, resume }), Q::Accept) if ready => {
                self.state.at = At::Unholding { resume: resume.phase_after_accept(), verify: false };
            }
            (At::Aborted { cause }, Q::Clear) if ready => {
                // Between the abort and this request a person may have jogged the arm; standstill must be reported
                // anew.
                self.state.facts.standing = false;
                self.state.at = At::Clearing { cause };
            }
            (At::Stopped | At::Complete { .. }, Q::Reset)
            | (At::Idle, Q::Start { .. } | Q::AirRun { .. })
            | (At::Held(_), Q::Unhold { .. })
            | (At::Held(Hold { why: Why::Review, .. }), Q::Accept)
            | (At::Aborted { .. }, Q::Clear)
                if !ready =>
            {
                self.refuse(request, Refusal::Robot(robot));
            }
            (At::Execute(phase) | At::Unholding { resume: phase, .. }, Q::Hold) => self.hold(Why::Asked, phase),
            // These states already lead to rest. An abort stays possible in Stopping and Clearing, since it is sent at
            // once.
            (At::Stopped | At::Stopping { .. } | At::Clearing { .. }, Q::Stop)
            | (At::Aborting { .. } | At::Aborted { .. }, Q::Stop | Q::Abort) => {
                self.refuse(request, Refusal::NotNow);
            }
            (_, Q::Stop) => self.stop(),
            (_, Q::Abort) => self.abort(Cause::Asked),
            (_, request) => self.refuse(request, Refusal::NotNow),
        }
    }

    fn on_report(&mut self, report: Report) {
        let due = self.state.due;
        let is_due = |id: Id| due.filter(|due| due.id == id);
        match report {
            Report::Boot => self.boot(),
            Report::Robot(robot) => self.condition(robot),
            Report::FullOverride(is_full) => {
                self.state.facts.full_override = is_full;
                if self.lacks_override() {
                    self.leave_for_trouble(Trouble::Override);
                }
            }
            Report::Trouble(trouble) => self.on_unexpected_trouble(trouble),
            Report::Contrary(switch) => {
                if self.rules.is_active(Rule::ContraryDoubts) {
                    self.state.facts.invalidate_switch(switch);
                }
                self.on_unexpected_trouble(Trouble::Feedback);
            }
            Report::StoreChanged => self.on_store_changed(Cause::StoreChanged),
            Report::StoreRestored => self.on_store_changed(Cause::StoreRestored),
            Report::EpochOver { trouble } => self.on_epoch_over(trouble),
            Report::OutputsOff => {
                // That tool or water may run stays set after a lost link, and only evidence clears it: here the
                // feedbacks of both.
                (self.state.facts.tool_may_run, self.state.facts.water_may_run) = (false, false);
            }
            Report::Progress { id, done } => self.on_progress(id, done),
            Report::Answered { id, answer } => {
                let due = if self.rules.is_active(Rule::AnswersMatch) { is_due(id) } else { due };
                let Some(due) = due else { return self.discard_report() };
                self.state.due = None;
                self.on_answer(due.act, answer);
            }
            Report::Deadline { id, which: Deadline::Answer } => {
                let Some(due) = is_due(id).filter(|_| self.rules.is_active(Rule::AnswerDeadline)) else {
                    return self.discard_report();
                };
                self.state.due = None;
                // A late answer is dropped afterwards, since its id is not due any more: the work must not continue by
                // it.
                self.on_answer(due.act, Answer::Failed(Trouble::Late));
            }
            Report::Deadline { id, which } => self.elapsed(id, which),
        }
    }

    /// Handles the end of a deadline, if the table still waits for it.
    fn elapsed(&mut self, id: Id, which: Deadline) {
        let facts = &mut self.state.facts;
        match (which, self.state.at) {
            (Deadline::Settle, _) if facts.light == (Light::Settling { until: id }) => facts.light = Light::Settled,
            (Deadline::Drain, _) if facts.water == (Water::Draining { until: id }) => facts.water = Water::Drained,
            (Deadline::Rinse, At::Execute(Phase::Rinse)) if facts.water == (Water::Rinsing { until: id }) => {
                self.after_rinse();
            }
            (Deadline::Spray, At::Execute(Phase::Wet)) if facts.water == (Water::Spraying { until: id }) => {
                self.state.at = At::Execute(Phase::Inspect);
            }
            (Deadline::Token, _) if facts.token == Some(id) => self.on_token_expired(),
            (Deadline::Stop, At::Stopping { until }) if until == id && self.rules.is_active(Rule::StopDeadline) => {
                self.abort(Cause::StopTimedOut);
            }
            _ => self.discard_report(),
        }
    }

    /// Handles a change of the robot's condition; a robot that is not ready ends the work.
    fn condition(&mut self, robot: Robot) {
        self.state.facts.robot = robot;
        if robot == Robot::Ready {
            return;
        }
        if self.rules.is_active(Rule::LossForgets) {
            self.state.facts.forget();
        }
        // No controller answers in these two conditions; in all others the controller still answers an abort.
        let gone = matches!(robot, Robot::LinkLost | Robot::Restarted);
        match self.state.at {
            At::Stopped | At::Aborted { .. } => {}
            // Nothing moves in these states, so there is nothing to abort; but Start needs a new Reset, which tests
            // again. An emergency stop is different: a person pressed it for a reason, and must clear it.
            At::Idle | At::Complete { .. } if robot != Robot::EmergencyStop => self.state.at = At::Stopped,
            // The hold continues: nothing moves, and a person may open the guard to dry the panel or to correct the
            // trouble.
            At::Held(_) if !matches!(robot, Robot::EmergencyStop | Robot::Restarted) => {}
            // If the robot is gone, nothing can answer the abort frame. The motion's intent stays open until the robot
            // has been asked.
            At::Aborting { cause } => {
                let cause = cause.merged_with_robot(robot);
                self.state.at = At::Aborting { cause };
                if gone {
                    self.aborted(cause);
                }
            }
            At::Clearing { .. } => self.aborted(Cause::Robot(robot)),
            _ if !self.rules.is_active(Rule::ConditionAborts) => {}
            _ => self.abort(Cause::Robot(robot)),
        }
    }

    fn on_progress(&mut self, id: Id, done: u32) {
        let Some(due) = self.state.due.filter(|due| due.id == id) else { return self.discard_report() };
        match (&mut self.state.intent, due.act) {
            (Some(intent), Action::Move(motion)) => {
                // A count that goes back or beyond the path belongs to another motion, or a message was changed on its
                // way.
                let in_order = intent.done <= done && done <= motion.waypoints;
                intent.done = done;
                if !in_order && self.rules.is_active(Rule::Sequence) {
                    self.leave_for_trouble(Trouble::Sequence);
                }
            }
            _ => self.leave_for_trouble(Trouble::Unexpected),
        }
    }

    /// Handles trouble that is not the answer of an action: it matters only while something is in progress.
    fn on_unexpected_trouble(&mut self, trouble: Trouble) {
        match self.state.at {
            at if at.is_at_rest() => self.discard_report(),
            At::Aborting { .. } => self.discard_report(),
            // These states bring the cell to rest by themselves. A hold on top of that would only delay it.
            At::Resetting | At::Clearing { .. } | At::Completing { .. } | At::Stopping { .. } | At::Holding(_)
                if trouble.allows_continuation() =>
            {
                self.discard_report();
            }
            // A robot that is late but responds does harm only while the pad touches the panel.
            _ if trouble == Trouble::Slow && !self.state.facts.touching => self.discard_report(),
            _ => self.leave_for_trouble(trouble),
        }
    }

    /// Handles an epoch that the link has ended without a command of the table. Whatever the cycle is doing, there
    /// is no open epoch any more, and the work in this epoch ends.
    fn on_epoch_over(&mut self, trouble: Option<Trouble>) {
        if self.rules.is_active(Rule::LinkEndsEpoch) {
            self.state.facts.end_epoch(Epoch::Changing);
        }
        let Some(trouble) = trouble else { return };
        let ends = self.state.due.is_some_and(|due| matches!(due.act, Action::EndEpoch { .. }));
        match self.state.at {
            at if at.is_at_rest() => {}
            At::Aborting { .. } => {}
            // The state is already bringing about the end of the epoch.
            At::Stopping { .. } | At::Holding(_) if ends && trouble.allows_continuation() => {}
            _ => self.leave_for_trouble(trouble),
        }
    }

    /// Leaves the work in progress as this trouble requires.
    pub fn leave_for_trouble(&mut self, trouble: Trouble) {
        if !self.rules.is_active(Rule::TroubleLeaves) {
            return;
        }
        self.state.due = None;
        match self.state.at {
            At::Resetting => {
                self.state.at = At::Stopped;
                // Nothing has moved yet: the operator gets the reason and may request Reset again, without an abort to
                // clear.
                self.refuse(Request::Reset, Refusal::Failed(trouble));
            }
            At::Clearing { cause } => self.aborted(cause),
            At::Execute(phase) | At::Unholding { resume: phase, .. } if trouble.allows_continuation() => {
                self.hold(Why::Trouble(trouble), phase);
            }
            // The panel was not located yet, so the cycle can only continue from its first phase.
            At::Starting if trouble.allows_continuation() => self.hold(Why::Trouble(trouble), Phase::Locate),
            _ => self.abort(Cause::Trouble(trouble)),
        }
    }

    /// Aborts at once: the abort frame is sent, whatever was in progress.
    pub fn abort(&mut self, cause: Cause) {
        // The answer of the action in progress must not continue the work, and after an abort the panel may have been
        // pushed.
        (self.state.due, self.state.facts.token) = (None, None);
        self.state.at = At::Aborting { cause };
        if !self.rules.is_active(Rule::AbortIsSent) {
            self.aborted(cause);
        }
    }

    /// Ends an abort, whether or not the controller confirmed it. The cycle is concluded here: the robot's reports
    /// until standstill belong to the cycle.
    pub fn aborted(&mut self, cause: Cause) {
        self.conclude(Verdict::Aborted);
        self.state.due = None;
        self.state.at = At::Aborted { cause };
    }

    fn stop(&mut self) {
        // A stop does not accept a result that waits for review: the verdict stays review.
        let review = matches!(self.state.at, At::Held(Hold { why: Why::Review, .. }));
        self.conclude(if review { Verdict::Review } else { Verdict::Aborted });
        self.state.due = None;
        // The cell is at rest already, with water shut and epoch ended; a robot that is not ready accepts no command.
        // Reset checks again.
        if matches!(self.state.at, At::Held(_)) && self.state.facts.robot != Robot::Ready {
            self.state.at = At::Stopped;
            return;
        }
        // A stop waits for standstill and for water off. If a valve hangs, the deadline turns it into an abort.
        let until = self.arm(Deadline::Stop);
        self.state.at = At::Stopping { until };
    }

    /// Handles a store that was changed or restored, reported at a start before anything moves: a person must check it
    /// first. The contents of the state may be wrong.
    fn on_store_changed(&mut self, cause: Cause) {
        match self.state.at {
            // Nothing moves here, and there may be no robot yet to which an abort could be sent.
            At::Stopped | At::Aborted { .. } => self.aborted(cause),
            _ => self.abort(cause),
        }
    }

    fn boot(&mut self) {
        self.conclude(Verdict::Aborted);
        if self.rules.is_active(Rule::BootRests) {
            self.state = state_after_restart(self.state);
        }
    }
}

/// Returns the state after a restart: no motion continues. An open motion, tool or water that was on, or an abort that
/// was not cleared leads to Aborted; everything else leads to Stopped.
fn state_after_restart(before: State) -> State {
    let at = match (before.intent, before.at) {
        // A restart is not an acknowledgement: what a person has not cleared stays to be cleared.
        (_, At::Aborting { cause, .. } | At::Aborted { cause } | At::Clearing { cause }) => At::Aborted { cause },
        // The arm was in motion, perhaps in contact, when the process ended, and nothing has reported its standstill.
        (Some(_), _) => At::Aborted { cause: Cause::Interrupted },
        (None, _) if before.facts.tool_may_run || before.facts.water_may_run => {
            At::Aborted { cause: Cause::OutputsOn }
        }
        (None, _) => At::Stopped,
    };
    // The outputs were not watched while no process ran; only facts that restrict the cell stay valid.
    let facts = before.facts.facts_after_loss();
    State { at, facts, due: None, job: Job { running: false, ..before.job }, ..before }
}

/// Returns the state to which a journal leads: the steps of the table are computed, but their effects are not
/// performed.
pub fn fold_journal(journal: impl IntoIterator<Item = Event>) -> State {
    journal.into_iter().fold(State::INITIAL, |state, event| step(state, event).0)
}

/// Returns the state in which a program starts with this journal in its store: Aborted, or Stopped.
///
/// It is the same as one step of [`Report::Boot`], which the loop journals before anything else, so that a journal of
/// many starts folds as one.
pub fn recover(journal: impl IntoIterator<Item = Event>) -> State {
    step(fold_journal(journal), Event::Reported(Report::Boot)).0
}
