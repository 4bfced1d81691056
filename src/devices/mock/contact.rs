//! Whether the sanding tool is on the panel, as the programs derive it from the commands, and the retract from the
//! panel.
//!
//! The tool is in contact from the start of a move to a contact point until an air point is reached: landing and
//! leaving count.

use super::corner::Pose;
use super::moves::{Lin, Move};
use panelprep_base::geometry::{Flange, Rigid, Tool, Vector};

/// Length of a retract along the tool's −Z, mm.
const RETRACT_MM: f64 = 50.0;
const RETRACT_MM_S: f64 = 200.0;
const RETRACT_MM_S2: f64 = 2000.0;

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ContactState {
    /// The last point that was reached is a point in contact.
    was_last_point_in_contact: bool,
    /// The tool that is in contact.
    tool: Option<Rigid<Flange, Tool>>,
    retract: RetractState,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum RetractState {
    #[default]
    No,
    /// Begins as soon as the arm has stopped.
    Due,
    Runs,
}

impl ContactState {
    /// Returns whether the tool is in contact, or moves towards contact.
    pub(super) fn touches(&self, front: Option<&Move>) -> bool {
        self.was_last_point_in_contact || front.is_some_and(Move::contact)
    }

    /// Returns whether both ends of the present segment are in contact.
    pub(super) fn is_in_contact(&self, front: Option<&Move>) -> bool {
        self.was_last_point_in_contact && front.is_none_or(Move::contact)
    }

    /// Returns the tool that is in contact.
    pub(super) fn tool(&self) -> Option<Rigid<Flange, Tool>> {
        self.tool
    }

    /// Records that this move is being executed.
    pub(super) fn heads_for(&mut self, front: Option<&Move>) {
        if let Some(Move::Lin(lin)) = front
            && lin.contact
        {
            self.tool = Some(lin.flange_from_tool);
        }
    }

    /// Records that the end of this move was reached or passed.
    pub(super) fn on_point_reached(&mut self, step: &Move) {
        self.was_last_point_in_contact = step.contact();
        if step.key().is_none() {
            self.retract = RetractState::No;
        }
    }

    /// Stops: the tool retracts from the panel as soon as the arm has stopped, if this is allowed.
    pub(super) fn stop(&mut self, front: Option<&Move>, may_retract: bool) {
        self.was_last_point_in_contact = self.touches(front);
        self.retract =
            if may_retract && self.was_last_point_in_contact { RetractState::Due } else { RetractState::No };
    }

    /// Resets the contact for a new epoch: a person jogs a tool off the panel if an e-stop left it there. A retract
    /// continues.
    pub(super) fn forget(&mut self) {
        if !self.is_retract_due() {
            *self = ContactState::default();
        }
    }

    /// Abandons the retract, because it cannot be executed.
    pub(super) fn abandon_retract(&mut self) {
        self.retract = RetractState::No;
    }

    pub(super) fn is_retract_due(&self) -> bool {
        self.retract != RetractState::No
    }

    pub(super) fn is_retracting(&self) -> bool {
        self.retract == RetractState::Runs
    }

    /// Returns the retract that is due, from the tool's present position.
    pub(super) fn take_retract(&mut self, tool_at: impl Fn(&Rigid<Flange, Tool>) -> Pose) -> Option<Move> {
        if self.retract != RetractState::Due {
            return None;
        }
        let Some(flange_from_tool) = self.tool else {
            self.retract = RetractState::No;
            return None;
        };
        self.retract = RetractState::Runs;
        let from = tool_at(&flange_from_tool);
        let away = from * Vector::<Tool>::new(nalgebra::Vector3::z() * -RETRACT_MM);
        Some(Move::Lin(Lin {
            key: None,
            target: from.followed_by_displacement(away),
            flange_from_tool,
            blend_mm: 0.0,
            contact: false,
            switched_output: None,
            remaining_points: 0,
            speed_mm_s: RETRACT_MM_S,
            acceleration_mm_s2: RETRACT_MM_S2,
        }))
    }
}
