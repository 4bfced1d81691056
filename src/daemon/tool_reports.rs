//! The compliant tool in the loop: it receives the command that the arm's position requires, and its reports may end a
//! contact path.
//!
//! In each iteration of the loop the tool's reports are read and compared with the state expected at the arm's
//! position. A deviation is recorded as a finding, the tool is held back, and the state table ends the path: tool off
//! and retract by the robot's own program.

use super::error::DaemonError;
use super::pending_action::{Condition, PendingAction};
use super::ports::{LoopEvent, RecordError};
use super::running::Running;
use crate::cycle::{Action, Answer, Event, Id, Motion, Path, Report, Trouble};
use crate::eki::Time;
use crate::force::{Press, downwards};
use crate::geometry::{Base, Tool};
use crate::path::routes::waypoints;
use crate::record::Kind;
use crate::verdict::Reason;

impl Running<'_> {
    /// Reads the tool's reports and sends it the command that is due; returns true if an event results.
    pub(super) fn attend_tool(&mut self, now: Time) -> Result<bool, DaemonError> {
        let cell = self.cell.clone();
        let Some(tool) = &cell.tool else { return Ok(false) };
        let lost = self.pressing.on_news(self.ports.tool.news(), now);
        let (under_way, downwards) = (self.contact_reached(), self.tool_downwards());
        if let Some(press) = self.pressing.wanted(tool, (under_way, downwards), now) {
            self.ports.tool.press(press);
        }
        if under_way.is_none() {
            if let Some(lost) = lost {
                tracing::warn!("{}", lost.message);
                self.ports.requests.publish(LoopEvent::Noted(vec![lost]));
            }
            return Ok(false);
        }
        if let Some(contact_n) = self.pressing.contact_n(tool, downwards) {
            self.trace.measured(contact_n);
        }
        let Some(why) = lost.or_else(|| self.pressing.ends(tool, downwards, now)) else { return Ok(false) };
        self.pressing.is_over();
        self.ports.tool.press(Press::held_back(tool.min_force_n));
        self.note(Kind::Tool, vec![why])?;
        self.events.push_back(Event::Reported(Report::Trouble(Trouble::Force)));
        Ok(true)
    }

    /// Returns the number of waypoints of a contact path that the arm has reached; `None` if no contact path is
    /// under way.
    fn contact_reached(&self) -> Option<usize> {
        let is_contact = |pending: &PendingAction| match (pending.act, &pending.waits) {
            (Action::Move(motion), Condition::PathEnd) => motion.path == Path::Contact,
            _ => false,
        };
        let sent = self.sent.filter(|_| self.pending.as_ref().is_some_and(is_contact))?;
        Some(sent.waypoints(self.robot_state?.done) as usize)
    }

    /// Returns the downward component of the tool's direction, −1…1.
    fn tool_downwards(&self) -> f64 {
        let base_from_tool = self
            .robot_state
            .map(|state| state.active_base.to_rigid::<Base, Base>() * state.base_from_tcp.to_rigid::<Base, Tool>());
        base_from_tool.map_or(0.0, |base_from_tool| downwards(&base_from_tool))
    }

    /// Starts the set-points of a contact path.
    pub(super) fn begin_pressing(&mut self, motion: Motion) {
        let (cell, Some(cycle)) = (self.cell.clone(), self.cycle.clone()) else { return };
        let Some(tool) = &cell.tool else { return };
        if let (Path::Contact, Some(plan)) = (motion.path, self.abrasion.plan(motion.plan)) {
            let on_panel = waypoints(plan).iter().map(|waypoint| waypoint.contact).collect();
            self.pressing.begin(on_panel, cycle.recipe.path(), tool);
        }
    }

    /// Returns whether the tool's state permits the arm to move towards the panel; if not, the act fails and the
    /// reason is recorded.
    pub(super) fn tool_lets_go(&mut self, id: Id, path: Path) -> Result<bool, RecordError> {
        let cell = self.cell.clone();
        let Some(tool) = cell.tool.as_ref().filter(|_| matches!(path, Path::Approach | Path::Contact)) else {
            return Ok(true);
        };
        let now = self.ports.robot_now();
        let Some(why) = self.pressing.refuses(tool, now) else { return Ok(true) };
        self.note(Kind::Tool, vec![why])?;
        self.answer(id, Answer::Failed(Trouble::Force));
        Ok(false)
    }

    /// Returns what the self-test finds wrong with the tool.
    pub(super) fn tool_unfit(&mut self) -> Option<(Trouble, Reason)> {
        let (cell, now) = (self.cell.clone(), self.ports.robot_now());
        self.pressing.refuses(cell.tool.as_ref()?, now).map(|why| (Trouble::Force, why))
    }
}
