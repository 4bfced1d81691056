//! Reports of the robot and of its compliant tool. A report of the robot becomes an event of the state table, the
//! answer to the pending action, or both.
//!
//! In each iteration of the loop, the tool receives the command for the present position of the arm, and its reports
//! are compared with the state that is expected at this position. A deviation is recorded as a finding, the tool is
//! retracted, and the state table ends the contact path: the robot's own program switches the tool off and retracts the
//! arm.

use super::answers::reason;
use super::error::DaemonError;
use super::ports::{LoopEvent, RecordError};
use super::running::{Condition, LoopMemory, PendingAction, SentPath};
use crate::setup::{FeedbackContradiction, contrary_reason, unproven_reason};
use crate::stages::abrade::deviation_limit_mm;
use panelprep_base::geometry::{Base, Panel, Rigid, Tool};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle;
use panelprep_cell::cycle::{Action, Answer, At, Deadline, Event, Id, Motion, Path, Report, Trouble};
use panelprep_cell::force::{ForceSetPoint, down_cosine};
use panelprep_cell::record::Kind;
use panelprep_kuka::eki;
use panelprep_kuka::eki::{CONTACT_OVERRIDE_PERCENT, Mode, Refusal, StopCause, Time};
use panelprep_toolpath::path::routes::waypoints;
use panelprep_toolpath::path::trace::{PoseReport, path_deviation_mm};

/// Ratio of the deviation that aborts a contact path immediately to the deviation that requires a review.
const ABORT_DEVIATION_RATIO: f64 = 4.0;

impl LoopMemory<'_> {
    /// Converts a report to events of the state table and to the answer of the pending action.
    pub(super) fn on_report(&mut self, report: eki::Report) -> Result<(), DaemonError> {
        use eki::Report as R;
        match report {
            R::Connected { state } | R::State(state) => self.handle_state(&state)?,
            R::Rebooted { state } => {
                (self.full_override, self.axes_at_path_end) = (None, None);
                self.on_robot_condition(cycle::Robot::Restarted);
                self.handle_state(&state)?;
            }
            R::LinkLost { why } => {
                (self.robot_state, self.full_override, self.axes_at_path_end) = (None, None, None);
                self.on_robot_condition(cycle::Robot::LinkLost);
                self.record_problem(Kind::Robot, vec![reason("link_lost", &why)])?;
            }
            R::EpochOpened { epoch } => {
                self.answer_pending_if(|act| matches!(act, Action::OpenEpoch { .. }), Answer::Epoch(epoch.0))
            }
            R::EpochNotOpened { .. } => {
                self.answer_pending_if(
                    |act| matches!(act, Action::OpenEpoch { .. }),
                    Answer::Failed(Trouble::Protocol),
                );
            }
            R::Progress { done } => self.on_executed(done)?,
            // The end of a path is handled when a state reports that the robot is stationary at the end.
            R::PathDone { .. } => {}
            R::Standstill { done } => self.on_standstill(done),
            R::Refused { refusal, id } => {
                let words = Reason::new("refused", format!("the controller refused command {id}: {refusal}"));
                let trouble = if refusal == Refusal::Override { Trouble::Override } else { Trouble::Refused };
                self.on_epoch_over(trouble, words)?;
            }
            R::EchoMismatch(mismatch) => self.on_epoch_over(Trouble::Protocol, reason("echo", &*mismatch))?,
            R::Interrupted { cause: cause @ (StopCause::ByProgram | StopCause::Unattended) } => {
                self.on_epoch_over(Trouble::Starved, reason("interrupted", &cause))?;
            }
            R::Interrupted { cause: cause @ StopCause::Override } => {
                self.on_epoch_over(Trouble::Override, reason("interrupted", &cause))?;
            }
            // The cause is reported as a condition of the robot.
            R::Interrupted { .. } => self.events.push_back(Event::Reported(Report::EpochOver { trouble: None })),
            R::Slow { id, contact, waited } => {
                let waited_s = waited.as_secs_f64();
                let words = format!(
                    "the robot is slower than its plan: command {id} has taken {waited_s:.1} s; set the override \
                     to 100 %, and in T1 hold the start key"
                );
                if contact {
                    self.on_epoch_over(Trouble::Slow, Reason::new("slow", words))?;
                } else {
                    tracing::warn!("{words}");
                    self.ports.requests.publish(LoopEvent::Noted(vec![Reason::new("slow", words)]));
                    self.events.push_back(Event::Reported(Report::Trouble(Trouble::Slow)));
                }
            }
            R::SequenceError(error) => self.on_epoch_over(Trouble::Sequence, reason("sequence", &error))?,
            R::WatchdogExpired { channel, silence } => {
                let words = format!(
                    "no message was received on the {channel} for {} ms; check the cable and the \
                                     robot program",
                    silence.as_millis()
                );
                self.on_epoch_over(Trouble::Late, Reason::new("watchdog", words))?;
            }
        }
        Ok(())
    }

    fn handle_state(&mut self, state: &eki::State) -> Result<(), DaemonError> {
        self.robot_state = Some(*state);
        self.track_contact_path(state)?;
        // Handled after the motion: if a state reports both the end of a path and an open guard, the path has ended
        // first.
        self.on_robot_condition(condition(state, self.cell.programs_sum));
        let is_full = state.override_percent == CONTACT_OVERRIDE_PERCENT;
        // Only changes become events, because each event is a line of the journal and states arrive ten times a second.
        if self.full_override.replace(is_full) != Some(is_full) {
            self.events.push_back(Event::Reported(Report::FullOverride(is_full)));
        }
        self.watch_outputs(state)?;
        let facts = &self.state.facts;
        // While a cycle is running, the actions themselves prove that the outputs are off.
        let asks = self.state.at.is_at_rest() && (facts.tool_may_run || facts.water_may_run);
        if asks && self.cell.wiring.tool_is_off(state) && self.cell.wiring.water_is_off(state) {
            self.events.push_back(Event::Reported(Report::OutputsOff));
        }
        self.check_pending(state)
    }

    /// Compares the reported state with the proven states of the outputs.
    fn watch_outputs(&mut self, state: &eki::State) -> Result<(), DaemonError> {
        let contrary = self.feedback_contradiction.update(&self.cell.wiring, &self.state.facts, state);
        let Some(switch) = contrary else { return Ok(()) };
        self.feedback_contradiction = FeedbackContradiction::default();
        let why = contrary_reason(switch, &self.cell.wiring, state);
        if self.state.at.is_at_rest() || matches!(self.state.at, At::Completing { .. }) {
            // While the cell is idle, the displayed reason must remain the reason of this state. If a cycle already has
            // its result, the contradiction has no effect on the result.
            tracing::warn!("{}", why.message);
        } else {
            self.record_problem(Kind::Robot, vec![why])?;
        }
        self.events.push_back(Event::Reported(Report::Contrary(switch)));
        Ok(())
    }

    /// Records which feedback was missing when the deadline of a switching action passed.
    pub(super) fn record_unproven_switch(&mut self, over: Report) -> Result<(), DaemonError> {
        let Report::Deadline { id: over, which: Deadline::Answer } = over else { return Ok(()) };
        let switch = self.pending_action.as_ref().filter(|pending| pending.id == over).map(|pending| pending.act);
        let (Some(Action::Switch(switch)), Some(state)) = (switch, self.robot_state) else { return Ok(()) };
        match unproven_reason(switch, &self.cell.wiring, &state) {
            Some(why) => Ok(self.record_problem(Kind::Robot, vec![why])?),
            None => Ok(()),
        }
    }

    fn on_robot_condition(&mut self, condition: cycle::Robot) {
        if condition != self.condition {
            self.condition = condition;
            self.events.push_back(Event::Reported(Report::Robot(condition)));
        }
    }

    fn answer_pending_if(&mut self, fits: impl Fn(Action) -> bool, answer: Answer) {
        let id: Option<Id> =
            self.pending_action.as_ref().filter(|pending| fits(pending.act)).map(|pending| pending.id);
        if let Some(id) = id {
            self.answer_action(id, answer);
        }
    }

    /// Records the reason for which the connection ended the epoch, and reports the end to the state table.
    fn on_epoch_over(&mut self, trouble: Trouble, words: Reason) -> Result<(), DaemonError> {
        self.record_problem(Kind::Robot, vec![words])?;
        self.events.push_back(Event::Reported(Report::EpochOver { trouble: Some(trouble) }));
        Ok(())
    }

    /// Adds the measured position of the tool on a contact path to the trace, and aborts the path if the position is
    /// too far from the plan.
    fn track_contact_path(&mut self, state: &eki::State) -> Result<(), DaemonError> {
        let contact = |pending: &PendingAction| match (pending.act, &pending.waits) {
            (Action::Move(motion), Condition::PathEnd) => motion.path == Path::Contact,
            _ => false,
        };
        let Some(sent) = self.sent_path.filter(|_| self.pending_action.as_ref().is_some_and(contact)) else {
            return Ok(());
        };
        let done = sent.waypoints(state.done);
        self.trace.push(PoseReport { time_ms: state.time_ms, tip: state.base_from_tcp, done, force_n: None });
        let Some((off_mm, allowed_mm)) = self.path_deviation_mm(sent, done, state) else { return Ok(()) };
        let [off, allowed] = distinguishable_texts(off_mm, allowed_mm, 2);
        let message = format!(
            "during contact the measured TCP is {off} mm off the planned path (limit {allowed} mm): an axis slips, \
             or an object pushes the arm; the cycle is aborted"
        );
        self.record_problem(Kind::Robot, vec![Reason::new("deviation", message)])?;
        self.events.push_back(Event::Reported(Report::Trouble(Trouble::Deviation)));
        Ok(())
    }

    /// Returns the measured distance of the TCP from the planned path, and the limit, mm, if the distance exceeds the
    /// limit. Smaller deviations are evaluated at the end of the path.
    fn path_deviation_mm(&self, sent: SentPath, done: u32, state: &eki::State) -> Option<(f64, f64)> {
        let cycle = self.cycle_setup()?;
        let allowed_mm = ABORT_DEVIATION_RATIO * deviation_limit_mm(cycle.recipe.path());
        let tip: Rigid<Panel, Tool> = state.base_from_tcp.to_rigid();
        let off_mm = self
            .abrasion
            .plan(sent.motion.plan)
            .map_or(f64::INFINITY, |plan| path_deviation_mm(&waypoints(plan), done, tip.origin()));
        (off_mm.is_nan() || off_mm > allowed_mm).then_some((off_mm, allowed_mm))
    }
}

fn condition(state: &eki::State, programs_sum: Option<i32>) -> cycle::Robot {
    use cycle::Robot;
    match state {
        _ if state.emergency_stop => Robot::EmergencyStop,
        _ if !state.guard_closed => Robot::GuardOpen,
        _ if programs_sum.is_some_and(|accepted| accepted != state.programs_checksum) => Robot::OtherPrograms,
        _ if matches!(state.mode, Mode::T1 | Mode::T2) => Robot::NotAutomatic,
        _ if !(state.drives_on && state.motion_possible) => Robot::DrivesOff,
        _ => Robot::Ready,
    }
}

impl LoopMemory<'_> {
    /// Reads the reports of the tool, and sends it the next command; returns true if this causes an event.
    pub(super) fn update_tool(&mut self, now: Time) -> Result<bool, DaemonError> {
        let cell = self.cell.clone();
        let Some(tool) = &cell.tool else { return Ok(false) };
        let lost = self.press_state.on_report(self.ports.tool.next_report(), now);
        let (under_way, downwards) = (self.contact_reached(), self.tool_downwards());
        if let Some(press) = self.press_state.next_command(tool, (under_way, downwards), now) {
            self.ports.tool.set_force(press);
        }
        if under_way.is_none() {
            if let Some(lost) = lost {
                tracing::warn!("{}", lost.message);
                self.ports.requests.publish(LoopEvent::Noted(vec![lost]));
            }
            return Ok(false);
        }
        if let Some(contact_n) = self.press_state.contact_n(tool, downwards) {
            self.trace.add_force(contact_n);
        }
        let Some(why) = lost.or_else(|| self.press_state.end_reason(tool, downwards, now)) else {
            return Ok(false);
        };
        self.press_state.end_contact();
        self.ports.tool.set_force(ForceSetPoint::retracted(tool.min_force_n));
        self.record_problem(Kind::Tool, vec![why])?;
        self.events.push_back(Event::Reported(Report::Trouble(Trouble::Force)));
        Ok(true)
    }

    /// Returns the number of waypoints of the contact path that the arm has reached; `None` if no contact path is in
    /// progress.
    fn contact_reached(&self) -> Option<usize> {
        let is_contact = |pending: &PendingAction| match (pending.act, &pending.waits) {
            (Action::Move(motion), Condition::PathEnd) => motion.path == Path::Contact,
            _ => false,
        };
        let sent = self.sent_path.filter(|_| self.pending_action.as_ref().is_some_and(is_contact))?;
        Some(sent.waypoints(self.robot_state?.done) as usize)
    }

    /// Returns the vertical component of the tool's direction, −1 to 1; positive downwards.
    fn tool_downwards(&self) -> f64 {
        let base_from_tool = self
            .robot_state
            .map(|state| state.active_base.to_rigid::<Base, Base>() * state.base_from_tcp.to_rigid::<Base, Tool>());
        base_from_tool.map_or(0.0, |base_from_tool| down_cosine(&base_from_tool))
    }

    /// Begins to send the force set-points of a contact path.
    pub(super) fn begin_pressing(&mut self, motion: Motion) {
        let (cell, Some(cycle)) = (self.cell.clone(), self.cycle.clone()) else { return };
        let Some(tool) = &cell.tool else { return };
        if let (Path::Contact, Some(plan)) = (motion.path, self.abrasion.plan(motion.plan)) {
            let on_panel = waypoints(plan).iter().map(|waypoint| waypoint.contact).collect();
            self.press_state.begin_contact(on_panel, cycle.recipe.path(), tool);
        }
    }

    /// Returns whether the state of the tool permits the arm to move towards the panel; if not, the action fails and
    /// the reason is recorded.
    pub(super) fn tool_permits_motion(&mut self, id: Id, path: Path) -> Result<bool, RecordError> {
        let cell = self.cell.clone();
        let Some(tool) = cell.tool.as_ref().filter(|_| matches!(path, Path::Approach | Path::Contact)) else {
            return Ok(true);
        };
        let now = self.ports.robot_now();
        let Some(why) = self.press_state.motion_refusal(tool, now) else { return Ok(true) };
        self.record_problem(Kind::Tool, vec![why])?;
        self.answer_action(id, Answer::Failed(Trouble::Force));
        Ok(false)
    }

    /// Returns the problem of the tool that the self-test finds.
    pub(super) fn tool_problem(&mut self) -> Option<(Trouble, Reason)> {
        let (cell, now) = (self.cell.clone(), self.ports.robot_now());
        self.press_state.motion_refusal(cell.tool.as_ref()?, now).map(|why| (Trouble::Force, why))
    }
}
