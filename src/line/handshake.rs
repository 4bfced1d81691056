//! When the line asks for something: by an edge that was seen from its low side on, never by a level.

use super::signals::{CellStands, LineInputs, Told, told};
use crate::cell::LineSignal;

/// So many looks in a row must show the same before it counts: a bouncing contact asks for nothing.
const STEADY: u8 = 2;

/// What is asked of the cell for the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineRequest {
    /// A cycle, by the recipe and part of the cell's file.
    Start,
    /// A reset: the part was taken after a cycle.
    Reset,
}

/// One look at the line and the cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Look {
    /// The line's inputs; `None` where nothing is heard from the controller.
    pub inputs: Option<LineInputs>,
    /// How the cell stands; `None` where its loop does not answer.
    pub cell: Option<CellStands>,
}

/// What was seen of the line so far.
///
/// A start is asked for where, in this order and without a break of the link: the cell was idle and the request low, then the request
/// became high while the part was present and the cell still idle. A request that was high when the program began, when the link
/// came back, or when the cell became idle asks for nothing before it was low.
#[derive(Debug, Clone, Default)]
pub struct Handshake {
    /// The request was low while the cell was idle.
    is_armed: bool,
    /// The part of the cycle that is over was still there.
    saw_part: bool,
    /// What was asked for last was refused, and nobody has done anything about it yet.
    refused: Option<LineRequest>,
    /// The last looks that were the same, and how many.
    steady: Option<(Look, u8)>,
}

impl Handshake {
    /// One look; what is to be asked for.
    pub fn look(&mut self, look: Look) -> Option<LineRequest> {
        let count = match &self.steady {
            Some((before, count)) if *before == look => count.saturating_add(1),
            _ => 1,
        };
        self.steady = Some((look.clone(), count));
        let (Some(inputs), Some(cell)) = (look.inputs, look.cell) else {
            // What happened meanwhile nobody knows.
            (self.is_armed, self.saw_part) = (false, false);
            return None;
        };
        // The cell's own state does not bounce: what was seen in another one is over at once.
        self.is_armed &= cell.state == "idle";
        self.saw_part &= cell.state == "complete";
        match cell.state.as_str() {
            _ if count < STEADY => None,
            "idle" => self.idle(inputs),
            "complete" => self.complete(inputs),
            _ => None,
        }
    }

    /// This was refused. The line is told of a fault: after a start until its request is low, after a reset until a person has reset
    /// the cell, since the part is gone and nothing asks again.
    pub fn refused(&mut self, request: LineRequest) {
        self.refused = Some(request);
    }

    /// What the line is told now.
    pub fn told(&mut self, look: &Look) -> Told {
        let is_over = match self.refused {
            Some(LineRequest::Start) => look.inputs.is_some_and(|inputs| !inputs.start_request),
            Some(LineRequest::Reset) => look.cell.as_ref().is_some_and(|cell| cell.state != "complete"),
            None => true,
        };
        if !is_over {
            return Told::of(&[LineSignal::Fault]);
        }
        self.refused = None;
        told(look.cell.as_ref())
    }

    fn idle(&mut self, inputs: LineInputs) -> Option<LineRequest> {
        if !inputs.start_request {
            self.is_armed = true;
            return None;
        }
        // One edge asks once, whether it is taken or not: without a part nothing begins, not even when one comes later.
        let was_armed = std::mem::take(&mut self.is_armed);
        (was_armed && inputs.part_present).then_some(LineRequest::Start)
    }

    fn complete(&mut self, inputs: LineInputs) -> Option<LineRequest> {
        if inputs.part_present {
            self.saw_part = true;
            return None;
        }
        if !self.saw_part || inputs.start_request {
            return None;
        }
        self.saw_part = false;
        Some(LineRequest::Reset)
    }
}
