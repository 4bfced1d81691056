//! The goal of each state, and the transition after the answer to an action.

use super::interlocks::{
    CLEARING_CONDITIONS, COMPLETING_CONDITIONS, LEAVE_CONDITIONS, LEAVE_MOTION_CONDITIONS, LEAVE_TOOL_CONDITIONS,
    Need, RESETTING_CONDITIONS, STARTING_CONDITIONS, UNHOLDING_CONDITIONS, UNHOLDING_LOCATED_CONDITIONS,
};
use super::turn::{Goal, TransitionStep};
use super::{
    Action, Answer, At, Cause, Deadline, Epoch, Extraction, Film, Grade, Hold, Lens, Light, Motion, Outcome, Path,
    Phase, Refusal, Request, Robot, Switch, Tool, Trouble, Water, Why,
};
use panelprep_base::verdict::Verdict;

impl TransitionStep {
    /// Returns the goal of the present state.
    pub fn current_goal(&self) -> Goal {
        let state = &self.state;
        match state.at {
            At::Stopped | At::Idle | At::Held(_) | At::Complete { .. } | At::Aborted { .. } => Goal::Rest,
            At::Resetting => Goal::Reach(&RESETTING_CONDITIONS, At::Idle),
            At::Starting => Goal::Reach(&STARTING_CONDITIONS, At::Execute(Phase::Locate)),
            At::Holding(hold) => Goal::Reach(self.needs_on_leave(), At::Held(hold)),
            At::Unholding { resume, verify } => Goal::Reach(
                if verify { &UNHOLDING_LOCATED_CONDITIONS } else { &UNHOLDING_CONDITIONS },
                At::Execute(resume),
            ),
            At::Completing { verdict } => Goal::Reach(&COMPLETING_CONDITIONS, At::Complete { verdict }),
            At::Stopping { .. } => Goal::Reach(self.needs_on_leave(), At::Stopped),
            // An abort has no conditions, so that it never waits.
            At::Aborting { .. } => Goal::Now(Action::EndEpoch { epoch: state.epoch }),
            At::Clearing { .. } => Goal::Reach(&CLEARING_CONDITIONS, At::Stopped),
            At::Execute(phase) => match (phase, state.facts.water) {
                (Phase::Wet, Water::Spraying { .. }) | (Phase::Rinse, Water::Rinsing { .. }) => Goal::Rest,
                // The rinse may have its own valve. Then the water of the rinse would be taken as proof of the spray,
                // although the spray valve may not have opened.
                (Phase::Wet, Water::Rinsing { .. }) => Goal::Do(Action::Switch(Switch::WaterOff)),
                (Phase::Wet, _) => Goal::Do(Action::Switch(Switch::Spray)),
                (Phase::Rinse, _) => Goal::Do(Action::Switch(Switch::Rinse)),
                (Phase::Locate, _) => Goal::Do(Action::Locate),
                (Phase::Refine { moves }, _) => Goal::Do(Action::Refine { view: moves }),
                (Phase::Dry, _) => Goal::Do(Action::DryPicture),
                (Phase::Inspect, _) => Goal::Do(Action::Film),
                (Phase::Plan, _) => Goal::Do(Action::Plan { pass: state.job.pass }),
                (Phase::Verify, _) => Goal::Do(Action::Verify { view: state.job.verified }),
                (Phase::Abrade, _) => {
                    Goal::Do(Action::Move(state.motion(if self.is_air() { Path::Air } else { Path::Contact })))
                }
                (Phase::Retract, _) => Goal::Do(Action::Move(state.motion(Path::Retract))),
                (Phase::Assess { .. }, _) => Goal::Do(Action::Assess),
            },
        }
    }

    /// Returns the needs that a hold or a stop must satisfy now. Water may be commanded to run while the arm moves,
    /// contrary to what was proven.
    fn needs_on_leave(&self) -> &'static [Need] {
        let is_moving = self.state.intent.is_some() && self.state.facts.epoch != Epoch::Closed;
        match (is_moving, self.state.facts.epoch, self.state.facts.tool) {
            // The end of the epoch makes the controller brake the arm and switch tool and water off, which is faster
            // than single commands.
            (true, ..) => &LEAVE_MOTION_CONDITIONS,
            (false, Epoch::Closed, Tool::Unknown) => &LEAVE_TOOL_CONDITIONS,
            _ => &LEAVE_CONDITIONS,
        }
    }

    /// Updates the facts after the answer to an action, and determines the next state.
    pub fn on_answer(&mut self, act: Action, answer: Answer) {
        use Answer as R;
        match (act, answer) {
            (Action::EndEpoch { .. }, R::Standstill { done }) => self.epoch_ended(done),
            // This arm must precede the general arm for a fault, which would start the abort again and again.
            (Action::EndEpoch { .. }, _) if matches!(self.state.at, At::Aborting { .. }) => self.abort_failed(),
            (_, R::Failed(trouble)) => self.leave_for_trouble(trouble),
            (Action::CheckStandstill, R::Standstill { done }) => {
                self.close_intent(Outcome::Cleared, done);
                // Only Clear and Reset query the robot: a person has checked the cell, and the pad does not touch the
                // panel.
                (self.facts().standing, self.facts().touching) = (true, false);
            }
            (Action::SelfTest, R::Done) => self.facts().tested = true,
            // A new epoch needs a higher number. With the same number, delayed commands of the ended epoch could be
            // executed.
            (Action::OpenEpoch { above }, R::Epoch(epoch)) if epoch > above => {
                self.state.epoch = epoch;
                // A new epoch starts without base and tool frames.
                (self.facts().epoch, self.facts().frames) = (Epoch::Open, None);
            }
            (Action::SetFrames(frames), R::Done) => self.facts().frames = Some(frames),
            (Action::Switch(switch), R::Done) => self.on_switched(switch),
            (Action::Move(motion), R::Standstill { done }) => self.on_standstill(motion, done),
            (Action::Locate, R::Graded(grade)) => self.on_grade(grade, Phase::Refine { moves: 0 }),
            (Action::Refine { .. }, R::Graded(grade)) => self.on_refinement(grade),
            (Action::Refine { view }, R::LookOn) => {
                self.state.at = if self.is_last_corner(view) {
                    At::Completing { verdict: Verdict::Reject }
                } else {
                    At::Execute(Phase::Refine { moves: view.saturating_add(1) })
                };
            }
            (Action::DryPicture, R::Done) => self.state.at = At::Execute(self.state.job.after_dry),
            (Action::Film, R::Filmed(film)) => self.on_film(film),
            (Action::Plan { .. }, R::Planned { plan, waypoints }) => {
                (self.state.job.plan, self.state.job.waypoints) = (plan, waypoints);
                self.state.at = match (waypoints, self.is_air()) {
                    // The purpose of an air-run is to show the path. Without a path, it is rejected.
                    (0, true) => At::Completing { verdict: Verdict::Reject },
                    (0, false) => At::Execute(Phase::Rinse),
                    // Immediately before each contact the corners are verified.
                    _ => At::Execute(Phase::Verify),
                };
            }
            (Action::Plan { .. }, R::PlannedForReview { plan, waypoints }) => {
                (self.state.job.plan, self.state.job.waypoints) = (plan, waypoints);
                self.on_grade(Grade::Review, Phase::Verify);
            }
            (Action::Plan { .. }, R::Graded(Grade::Reject)) => self.on_grade(Grade::Reject, Phase::Verify),
            (Action::Assess, R::Graded(grade)) => self.on_assessment(grade),
            (Action::Verify { view }, R::LookOn) if self.is_last_corner(view) => {
                self.on_verification(Grade::Reject)
            }
            (Action::Verify { view }, R::LookOn) => self.state.job.verified = view.saturating_add(1),
            (Action::Verify { .. }, R::Graded(grade)) => self.on_verification(grade),
            _ => self.leave_for_trouble(Trouble::Unexpected),
        }
    }

    fn on_switched(&mut self, switch: Switch) {
        match switch {
            Switch::ToolOn => self.facts().tool = Tool::Running,
            Switch::ToolOff => (self.facts().tool, self.facts().tool_may_run) = (Tool::Off, false),
            Switch::Rinse => self.facts().water = Water::Rinsing { until: self.arm(Deadline::Rinse) },
            Switch::Spray => self.facts().water = Water::Spraying { until: self.arm(Deadline::Spray) },
            Switch::WaterOff => self.mark_water_off(),
            Switch::LightOn => self.facts().light = Light::Settling { until: self.arm(Deadline::Settle) },
            Switch::LightOff => self.facts().light = Light::Off,
            Switch::LensClear => self.facts().lens = Lens::Clear,
            Switch::LensGuard => self.facts().lens = Lens::Guarded,
            Switch::ExtractionOn => self.facts().extraction = Extraction::Flowing,
            Switch::ExtractionOff => self.facts().extraction = Extraction::Off,
        }
    }

    /// Marks the water as off: it drains from now on.
    fn mark_water_off(&mut self) {
        self.facts().water_may_run = false;
        // The panel is still wet after the valve has closed: the tool may start only after the water has drained.
        self.facts().water = Water::Draining { until: self.arm(Deadline::Drain) };
    }

    /// Returns whether this corner pose is the last one.
    fn is_last_corner(&self, view: u8) -> bool {
        view >= self.state.job.max_moves
    }

    pub fn is_air(&self) -> bool {
        self.state.job.air
    }

    /// Handles the robot's standstill at the end of a motion, or before its end.
    fn on_standstill(&mut self, motion: Motion, done: u32) {
        if done != motion.waypoints {
            // Standstill alone is not a completion: a path that ended early leaves places unsanded, which would count
            // as treated.
            return self.leave_for_trouble(Trouble::Short);
        }
        self.close_intent(Outcome::Done, done);
        self.facts().arm = Some(motion.path);
        if motion.path == Path::Contact {
            self.facts().touching = false;
        }
        match (self.state.at, motion.path) {
            (At::Execute(Phase::Abrade), Path::Contact | Path::Air) => self.state.at = At::Execute(Phase::Retract),
            (At::Execute(Phase::Retract), Path::Retract) if self.is_air() => {
                self.state.at = At::Completing { verdict: Verdict::Pass };
            }
            (At::Execute(Phase::Retract), Path::Retract) => {
                // Before anything else the executed path is graded.
                self.state.at = At::Execute(Phase::Assess { left: false });
            }
            _ => {}
        }
    }

    /// Handles the answer to the abort frame: the robot is at standstill, tool and water are off, and no command of the
    /// epoch remains.
    fn epoch_ended(&mut self, done: u32) {
        // The reported number of executed waypoints must never decrease.
        let done = self.state.intent.map_or(done, |intent| done.max(intent.done));
        let (outcome, aborted) = match self.state.at {
            At::Holding(_) => (Outcome::Held, None),
            At::Aborting { cause } => (Outcome::Aborted, Some(cause)),
            _ => (Outcome::Stopped, None),
        };
        // Evaluate this before the facts change: a new drain time is needed only if the water may have run.
        let ran = !self.facts().water_off();
        let facts = self.facts();
        facts.end_epoch(Epoch::Closed);
        (facts.tool, facts.tool_may_run) = (Tool::Off, false);
        // If the drives are off, the controller cannot retract the tool: a person jogs the arm away from the panel and
        // confirms this with Clear.
        facts.touching &= facts.robot != Robot::Ready;
        if ran {
            self.mark_water_off();
        }
        self.close_intent(outcome, done);
        if let Some(cause) = aborted {
            self.aborted(cause);
        }
    }

    /// Handles an abort frame that could not be sent or was not answered: only the controller itself can still stop the
    /// arm. Facts that are not confirmed stay unknown and are reported.
    fn abort_failed(&mut self) {
        if let At::Aborting { cause } = self.state.at {
            self.aborted(cause);
        }
    }

    /// Determines the state after a grade: the next phase, a hold for review, or the end of the cycle.
    fn on_grade(&mut self, grade: Grade, next: Phase) {
        self.on_grade_in_phase(grade, (next, next));
    }

    /// As `on_grade`, but a hold for review resumes in the phase `held` instead of the phase `next`.
    fn on_grade_in_phase(&mut self, grade: Grade, (next, held): (Phase, Phase)) {
        self.state.at = match grade {
            Grade::Review => {
                // A review may last arbitrarily long.
                self.facts().token = None;
                At::Holding(Hold { why: Why::Review, resume: held })
            }
            Grade::Reject => At::Completing { verdict: Verdict::Reject },
            Grade::Accept => At::Execute(next),
        };
    }

    fn on_assessment(&mut self, grade: Grade) {
        match self.state.at {
            At::Execute(phase @ Phase::Assess { .. }) => {
                self.on_grade_in_phase(grade, (phase.phase_after_accept(), phase))
            }
            _ => self.abort(Cause::Trouble(Trouble::Unexpected)),
        }
    }

    fn on_refinement(&mut self, grade: Grade) {
        if grade == Grade::Accept {
            self.facts().token = Some(self.arm(Deadline::Token));
        }
        // After the first water no place looks dry any more, so the picture with which the film is compared comes
        // first.
        self.on_grade(grade, if self.is_air() { Phase::Plan } else { Phase::Dry });
    }

    fn on_verification(&mut self, grade: Grade) {
        self.state.job.verified = 0;
        match (grade, self.state.at) {
            (Grade::Accept, at) => {
                self.facts().token = Some(self.arm(Deadline::Token));
                if at == At::Execute(Phase::Verify) {
                    self.state.at = At::Execute(Phase::Abrade);
                }
            }
            (_, At::Execute(phase) | At::Unholding { resume: phase, .. }) => self.hold(Why::NotVerified, phase),
            _ => self.abort(Cause::Trouble(Trouble::Unexpected)),
        }
    }

    /// Determines the state after the rinse: the film, or a hold in which the panel is dried for a new dry picture.
    pub fn after_rinse(&mut self) {
        if self.state.job.dries {
            self.hold(Why::Drying, Phase::Wet);
        } else {
            self.state.at = At::Execute(Phase::Wet);
        }
    }

    fn on_film(&mut self, film: Film) {
        let passes_left = self.state.job.pass < self.state.job.max_passes;
        self.state.at = match film {
            Film::Whole => At::Completing { verdict: Verdict::Pass },
            Film::Invalid => At::Completing { verdict: Verdict::Invalid },
            Film::Broken if passes_left => {
                self.state.job.pass = self.state.job.pass.saturating_add(1);
                At::Execute(Phase::Plan)
            }
            Film::Broken => At::Completing { verdict: Verdict::Fail },
        };
    }

    /// Handles a localization that has become too old. Contact ends; in all other phases, Verify renews the
    /// localization when it is needed.
    pub fn on_token_expired(&mut self) {
        self.facts().token = None;
        let in_contact = self.state.intent.is_some_and(|intent| intent.motion.path == Path::Contact);
        if let (At::Execute(phase), true) = (self.state.at, in_contact) {
            self.hold(Why::TokenOver, phase);
        }
    }

    /// Interrupts the work in progress; the interrupted action is not resumed.
    pub fn hold(&mut self, why: Why, phase: Phase) {
        self.state.due = None;
        self.state.job.verified = 0;
        self.facts().token = None;
        let in_contact = self.state.intent.is_some_and(|intent| intent.motion.path == Path::Contact);
        let resume = match phase {
            // A part of the path was sanded: it is graded by what was executed, and only the rest is planned again.
            Phase::Abrade if in_contact => Phase::Assess { left: true },
            // During a hold a person may have moved the panel, and a refinement starts from the scan.
            Phase::Locate | Phase::Refine { .. } => Phase::Locate,
            Phase::Dry => Phase::Dry,
            // An interrupted film has partly dried or drained. A film can be evaluated only as a whole, so it is
            // sprayed again.
            Phase::Wet | Phase::Inspect => Phase::Wet,
            // The path was planned for a pose of the panel that the next Verify may correct.
            Phase::Plan | Phase::Verify | Phase::Abrade => Phase::Plan,
            Phase::Retract | Phase::Rinse if self.is_air() => Phase::Plan,
            Phase::Retract => Phase::Assess { left: false },
            Phase::Assess { .. } | Phase::Rinse => phase,
        };
        self.state.at = At::Holding(Hold { why, resume });
    }

    /// Resumes the cycle through Verify or, if the panel was dried, through a new localization.
    pub fn start_unhold(&mut self, hold: Hold, dried: bool) {
        if hold.is_for_contact() {
            self.refuse(Request::Unhold { dried }, Refusal::Review);
        // A dried panel can be scanned again; a wet one reflects the pattern away, so that points are missing.
        } else if dried {
            match hold.resume {
                Phase::Wet | Phase::Plan | Phase::Rinse | Phase::Assess { .. } => {
                    self.state.job.after_dry = hold.resume;
                }
                // If a review interrupted Verify, the path is planned again.
                Phase::Verify => self.state.job.after_dry = Phase::Plan,
                _ => {}
            }
            self.state.at = At::Unholding { resume: Phase::Locate, verify: false };
        } else if hold.why == Why::Review {
            self.refuse(Request::Unhold { dried }, Refusal::Review);
        } else if hold.why == Why::Drying {
            self.refuse(Request::Unhold { dried }, Refusal::Undried);
        } else {
            let verify = !matches!(hold.resume, Phase::Locate | Phase::Refine { .. });
            self.state.at = At::Unholding { resume: hold.resume, verify };
        }
    }
}
