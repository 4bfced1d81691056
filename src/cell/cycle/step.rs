//! One step of the state table: how an event changes the state. Also the state after a restart of the program, and the
//! recovery at its start, which computes the state from the journal of the last process, no matter how that process
//! ended.

#[cfg(test)]
use super::interlocks::Need;
use super::turn::TransitionStep;
use super::{
    Action, Answer, At, Cause, Deadline, Effect, Epoch, Event, Hold, Id, Job, Light, Phase, Refusal, Report,
    Request, Robot, State, Trouble, Water, Why,
};
use panelprep_base::verdict::Verdict;

/// Returns the next state, and the effects to perform in this order before the next event.
pub fn step(state: State, event: Event) -> (State, Vec<Effect>) {
    TransitionStep::new(state).process_event(event)
}

/// Returns the same without this need in any row.
#[cfg(test)]
pub(super) fn step_without(dropped: Option<Need>, state: State, event: Event) -> (State, Vec<Effect>) {
    TransitionStep { dropped, ..TransitionStep::new(state) }.process_event(event)
}

impl TransitionStep {
    fn process_event(mut self, event: Event) -> (State, Vec<Effect>) {
        let before = self.state.at;
        match event {
            Event::Asked(request) => self.on_request(request),
            Event::Reported(report) => self.on_report(report),
        }
        self.perform_next_action();
        // A person's decision refers to the state that was displayed. The step number prevents that a click on an
        // outdated page is applied to a newer state.
        if self.state.at != before {
            self.state.step += 1;
        }
        (self.state, self.effects)
    }

    fn on_request(&mut self, request: Request) {
        use Request as Q;
        let robot = self.state.facts.robot;
        let ready = robot == Robot::Ready;
        match (self.state.at, request) {
            // A request that may lead to a motion is accepted only if the robot is ready.
            (At::Stopped | At::Complete { .. }, Q::Reset) if ready => {
                // The standstill and the self-test of the last cycle do not prove the present state, so both are
                // repeated.
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
            // The person has checked the result at the panel: the next phase needs no Verify.
            (At::Held(Hold { why: Why::Review, resume }), Q::Accept) if ready => {
                self.state.at = At::Unholding { resume: resume.phase_after_accept(), verify: false };
            }
            (At::Aborted { cause }, Q::Clear) if ready => {
                // A person may have jogged the arm since the abort, so the robot must report its standstill again.
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
            // These states already lead to rest. An abort is still possible in Stopping and Clearing, because it takes
            // effect immediately.
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
                if self.has_wrong_override() {
                    self.leave_for_trouble(Trouble::Override);
                }
            }
            Report::Trouble(trouble) => self.on_unexpected_trouble(trouble),
            Report::Contrary(switch) => {
                // What the output or feedback contradicts is not proven any more.
                self.state.facts.invalidate_switch(switch);
                self.on_unexpected_trouble(Trouble::Feedback);
            }
            Report::StoreChanged => self.on_store_changed(Cause::StoreChanged),
            Report::StoreRestored => self.on_store_changed(Cause::StoreRestored),
            Report::EpochOver { trouble } => self.on_epoch_over(trouble),
            Report::OutputsOff => {
                // After a lost link, the tool and the water may still run, until evidence shows that they are off. Here
                // both feedbacks show it.
                (self.state.facts.tool_may_run, self.state.facts.water_may_run) = (false, false);
            }
            Report::Progress { id, done } => self.on_progress(id, done),
            Report::Answered { id, answer } => {
                // An answer counts only for the action whose id it contains.
                let Some(due) = is_due(id) else { return self.discard_report() };
                self.state.due = None;
                self.on_answer(due.act, answer);
            }
            Report::Deadline { id, which: Deadline::Answer } => {
                let Some(due) = is_due(id) else { return self.discard_report() };
                self.state.due = None;
                // If the answer arrives later, it is dropped, because its id is no longer that of the action in
                // progress.
                self.on_answer(due.act, Answer::Failed(Trouble::Late));
            }
            Report::Deadline { id, which } => self.elapsed(id, which),
        }
    }

    /// Handles the end of a deadline, if the deadline is still active.
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
            (Deadline::Stop, At::Stopping { until }) if until == id => {
                self.abort(Cause::StopTimedOut);
            }
            _ => self.discard_report(),
        }
    }

    /// Handles a change of the robot's condition. If the robot is no longer ready, the work ends.
    fn condition(&mut self, robot: Robot) {
        self.state.facts.robot = robot;
        if robot == Robot::Ready {
            return;
        }
        // A robot that is not ready voids the localization, and the knowledge of arm and outputs.
        self.state.facts.forget();
        // No controller answers in these two conditions; in all others the controller still answers an abort.
        let gone = matches!(robot, Robot::LinkLost | Robot::Restarted);
        match self.state.at {
            At::Stopped | At::Aborted { .. } => {}
            // The arm does not move in these states, so no abort is needed; but Start needs a new Reset with its
            // self-test. Only an emergency stop, which a person has pressed for a reason, must be cleared.
            At::Idle | At::Complete { .. } if robot != Robot::EmergencyStop => self.state.at = At::Stopped,
            // The cycle stays held: the arm does not move, and a person may open the guard to dry the panel or to
            // correct a fault.
            At::Held(_) if !matches!(robot, Robot::EmergencyStop | Robot::Restarted) => {}
            // Without a controller, the abort frame is never answered. The motion stays open until the robot's
            // standstill has been queried.
            At::Aborting { cause } => {
                let cause = cause.merged_with_robot(robot);
                self.state.at = At::Aborting { cause };
                if gone {
                    self.aborted(cause);
                }
            }
            At::Clearing { .. } => self.aborted(Cause::Robot(robot)),
            _ => self.abort(Cause::Robot(robot)),
        }
    }

    fn on_progress(&mut self, id: Id, done: u32) {
        let Some(due) = self.state.due.filter(|due| due.id == id) else { return self.discard_report() };
        match (&mut self.state.intent, due.act) {
            (Some(intent), Action::Move(motion)) => {
                // If the count decreases or exceeds the path, it belongs to another motion, or the message was
                // corrupted.
                let in_order = intent.done <= done && done <= motion.waypoints;
                intent.done = done;
                if !in_order {
                    self.leave_for_trouble(Trouble::Sequence);
                }
            }
            _ => self.leave_for_trouble(Trouble::Unexpected),
        }
    }

    /// Handles a fault that is not the answer to an action. It is relevant only while work is in progress.
    fn on_unexpected_trouble(&mut self, trouble: Trouble) {
        match self.state.at {
            at if at.is_at_rest() => self.discard_report(),
            At::Aborting { .. } => self.discard_report(),
            // These states already lead to rest; a hold would only delay them.
            At::Resetting | At::Clearing { .. } | At::Completing { .. } | At::Stopping { .. } | At::Holding(_)
                if trouble.allows_continuation() =>
            {
                self.discard_report();
            }
            // A robot that is behind its plan can do harm only while the pad is in contact with the panel.
            _ if trouble == Trouble::Slow && !self.state.facts.touching => self.discard_report(),
            _ => self.leave_for_trouble(trouble),
        }
    }

    /// Handles an epoch that the link has ended on its own. In every state the epoch is no longer open, and the work in
    /// this epoch ends.
    fn on_epoch_over(&mut self, trouble: Option<Trouble>) {
        self.state.facts.end_epoch(Epoch::Changing);
        let Some(trouble) = trouble else { return };
        let ends = self.state.due.is_some_and(|due| matches!(due.act, Action::EndEpoch { .. }));
        match self.state.at {
            at if at.is_at_rest() => {}
            At::Aborting { .. } => {}
            // The state is already ending the epoch.
            At::Stopping { .. } | At::Holding(_) if ends && trouble.allows_continuation() => {}
            _ => self.leave_for_trouble(trouble),
        }
    }

    /// Ends the work in progress by a hold or an abort, depending on the fault.
    pub fn leave_for_trouble(&mut self, trouble: Trouble) {
        self.state.due = None;
        match self.state.at {
            At::Resetting => {
                self.state.at = At::Stopped;
                // The arm has not moved yet: the operator is shown the reason and may request Reset again, without a
                // Clear.
                self.refuse(Request::Reset, Refusal::Failed(trouble));
            }
            At::Clearing { cause } => self.aborted(cause),
            At::Execute(phase) | At::Unholding { resume: phase, .. } if trouble.allows_continuation() => {
                self.hold(Why::Trouble(trouble), phase);
            }
            // The panel is not located yet, so the cycle must be resumed from its first phase.
            At::Starting if trouble.allows_continuation() => self.hold(Why::Trouble(trouble), Phase::Locate),
            _ => self.abort(Cause::Trouble(trouble)),
        }
    }

    /// Aborts: the abort frame is sent immediately, during any action.
    pub fn abort(&mut self, cause: Cause) {
        // A late answer must not continue the work, and the localization is no longer valid, because the panel may have
        // been moved.
        (self.state.due, self.state.facts.token) = (None, None);
        self.state.at = At::Aborting { cause };
    }

    /// Ends an abort, whether or not the controller has confirmed the abort frame. The cycle is concluded only now,
    /// because the robot's reports until standstill belong to the cycle.
    pub fn aborted(&mut self, cause: Cause) {
        self.conclude(Verdict::Aborted);
        self.state.due = None;
        self.state.at = At::Aborted { cause };
    }

    fn stop(&mut self) {
        // A stop does not accept a result that needs review: the verdict is review.
        let review = matches!(self.state.at, At::Held(Hold { why: Why::Review, .. }));
        self.conclude(if review { Verdict::Review } else { Verdict::Aborted });
        self.state.due = None;
        // The cell is already at rest, with the water off and the epoch ended. The robot is not ready and accepts no
        // command; Reset checks everything again.
        if matches!(self.state.at, At::Held(_)) && self.state.facts.robot != Robot::Ready {
            self.state.at = At::Stopped;
            return;
        }
        // A stop waits for standstill and until the water is off. If a valve does not close, the deadline causes an
        // abort.
        let until = self.arm(Deadline::Stop);
        self.state.at = At::Stopping { until };
    }

    /// Handles a changed or restored store, which is reported at the start, before any motion. A person must check the
    /// store first, because the state may be wrong.
    fn on_store_changed(&mut self, cause: Cause) {
        match self.state.at {
            // The arm does not move, and no robot may be connected yet to which an abort could be sent.
            At::Stopped | At::Aborted { .. } => self.aborted(cause),
            _ => self.abort(cause),
        }
    }

    fn boot(&mut self) {
        self.conclude(Verdict::Aborted);
        self.state = state_after_restart(self.state);
    }
}

/// Returns the state after a restart of the program. No motion is resumed. The state is Aborted after an open motion,
/// after tool or water that was on, and after an abort that was not cleared; otherwise it is Stopped.
fn state_after_restart(before: State) -> State {
    let at = match (before.intent, before.at) {
        // A restart does not acknowledge an abort: a person must still clear it.
        (_, At::Aborting { cause, .. } | At::Aborted { cause } | At::Clearing { cause }) => At::Aborted { cause },
        // The process ended during a motion, possibly in contact, and no standstill was reported.
        (Some(_), _) => At::Aborted { cause: Cause::Interrupted },
        (None, _) if before.facts.tool_may_run || before.facts.water_may_run => {
            At::Aborted { cause: Cause::OutputsOn }
        }
        (None, _) => At::Stopped,
    };
    // The outputs were not monitored while no process ran, so only facts that restrict the cell stay valid.
    let facts = before.facts.facts_after_loss();
    State { at, facts, due: None, job: Job { running: false, ..before.job }, ..before }
}

/// Computes the state from the events of a journal, without performing their effects.
pub fn fold_journal(journal: impl IntoIterator<Item = Event>) -> State {
    journal.into_iter().fold(State::INITIAL, |state, event| step(state, event).0)
}

/// Returns the state at the start of a program whose store contains this journal: Aborted or Stopped.
///
/// The result is the same as that of the event [`Report::Boot`], which the control loop writes to the journal first.
/// Therefore a journal with several starts gives the same state.
pub fn recover(journal: impl IntoIterator<Item = Event>) -> State {
    step(fold_journal(journal), Event::Reported(Report::Boot)).0
}
