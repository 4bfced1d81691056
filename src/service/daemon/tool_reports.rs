//! The compliant tool in the loop: it receives the command that the arm's position requires, and its reports may end a
//! contact path.
//!
//! In each iteration of the loop the tool's reports are read and compared with the state expected at the arm's
//! position. A deviation is recorded as a finding, the tool is held back, and the state table ends the path: tool off
//! and retract by the robot's own program.

use super::error::DaemonError;
use super::pending_action::{Condition, PendingAction};
use super::ports::{LoopEvent, RecordError};
use super::running::LoopMemory;
use panelprep_base::geometry::{Base, Tool};
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Action, Answer, Event, Id, Motion, Path, Report, Trouble};
use panelprep_cell::force::{ForceSetPoint, down_cosine};
use panelprep_cell::record::Kind;
use panelprep_kuka::eki::Time;
use panelprep_toolpath::path::routes::waypoints;

impl LoopMemory<'_> {
    /// Reads the tool's reports and sends it the command that is due; returns true if an event results.
    pub(super) fn attend_tool(&mut self, now: Time) -> Result<bool, DaemonError> {
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
            self.trace.measured(contact_n);
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

    /// Returns the number of waypoints of a contact path that the arm has reached; `None` if no contact path is in
    /// progress.
    fn contact_reached(&self) -> Option<usize> {
        let is_contact = |pending: &PendingAction| match (pending.act, &pending.waits) {
            (Action::Move(motion), Condition::PathEnd) => motion.path == Path::Contact,
            _ => false,
        };
        let sent = self.sent_path.filter(|_| self.pending_action.as_ref().is_some_and(is_contact))?;
        Some(sent.waypoints(self.robot_state?.done) as usize)
    }

    /// Returns the downward component of the tool's direction, −1…1.
    fn tool_downwards(&self) -> f64 {
        let base_from_tool = self
            .robot_state
            .map(|state| state.active_base.to_rigid::<Base, Base>() * state.base_from_tcp.to_rigid::<Base, Tool>());
        base_from_tool.map_or(0.0, |base_from_tool| down_cosine(&base_from_tool))
    }

    /// Starts the set-points of a contact path.
    pub(super) fn begin_pressing(&mut self, motion: Motion) {
        let (cell, Some(cycle)) = (self.cell.clone(), self.cycle.clone()) else { return };
        let Some(tool) = &cell.tool else { return };
        if let (Path::Contact, Some(plan)) = (motion.path, self.abrasion.plan(motion.plan)) {
            let on_panel = waypoints(plan).iter().map(|waypoint| waypoint.contact).collect();
            self.press_state.begin_contact(on_panel, cycle.recipe.path(), tool);
        }
    }

    /// Returns whether the tool's state permits the arm to move towards the panel; if not, the action fails and the
    /// reason is recorded.
    pub(super) fn tool_lets_go(&mut self, id: Id, path: Path) -> Result<bool, RecordError> {
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

    /// Returns what the self-test finds wrong with the tool.
    pub(super) fn tool_unfit(&mut self) -> Option<(Trouble, Reason)> {
        let (cell, now) = (self.cell.clone(), self.ports.robot_now());
        self.press_state.motion_refusal(cell.tool.as_ref()?, now).map(|why| (Trouble::Force, why))
    }
}
