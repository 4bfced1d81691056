//! Decides when the line makes a request: by a rising edge that is preceded by an observed low state, never by a
//! level.

use super::signals::{CellStatus, LineInputs, LineSignals, line_signals};
use crate::cell::LineSignal;

/// This many consecutive observations must be equal before they count: a bouncing contact makes no request.
const MIN_EQUAL_OBSERVATIONS: u8 = 2;

/// A request to the cell for the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineRequest {
    /// Requests a cycle, with the recipe and the part of the cell's file.
    Start,
    /// Requests a reset: the part was removed after a cycle.
    Reset,
}

/// One observation of the line and the cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineObservation {
    /// The line's inputs; `None` if nothing is received from the controller.
    pub inputs: Option<LineInputs>,
    /// The state of the cell; `None` if its loop does not answer.
    pub cell: Option<CellStatus>,
}

/// The observations of the line so far.
///
/// A start is requested after two events in this order, without an interruption of the link. First the cell is idle
/// and the request low; then the request becomes high while the part is present and the cell is still idle. A request
/// that was high when the program began, when the link came back, or when the cell became idle has no effect until it
/// has been low.
#[derive(Debug, Clone, Default)]
pub struct Handshake {
    /// Whether the request was low while the cell was idle.
    is_armed: bool,
    /// Whether the part was seen in the cell after its cycle.
    saw_part: bool,
    /// The last request, if it was refused and the line or a person has not reacted yet.
    refused: Option<LineRequest>,
    /// The last observation, and the number of equal consecutive ones.
    steady: Option<(LineObservation, u8)>,
}

impl Handshake {
    /// Evaluates one observation and returns the request that is to be made.
    pub fn evaluate(&mut self, look: LineObservation) -> Option<LineRequest> {
        let count = match &self.steady {
            Some((before, count)) if *before == look => count.saturating_add(1),
            _ => 1,
        };
        self.steady = Some((look.clone(), count));
        let (Some(inputs), Some(cell)) = (look.inputs, look.cell) else {
            // After a break of the link it is not known what happened meanwhile.
            (self.is_armed, self.saw_part) = (false, false);
            return None;
        };
        // The cell's own state does not bounce: observations in another state become invalid at once.
        self.is_armed &= cell.state == "idle";
        self.saw_part &= cell.state == "complete";
        match cell.state.as_str() {
            _ if count < MIN_EQUAL_OBSERVATIONS => None,
            "idle" => self.on_idle(inputs),
            "complete" => self.complete(inputs),
            _ => None,
        }
    }

    /// Records that this request was refused. The line receives a fault: after a start until its request is low,
    /// after a reset until a person has reset the cell. The reason for the latter: the part is gone, and no further
    /// request comes.
    pub fn refused(&mut self, request: LineRequest) {
        self.refused = Some(request);
    }

    /// The signals that the line receives now.
    pub fn output_signals(&mut self, look: &LineObservation) -> LineSignals {
        let is_over = match self.refused {
            Some(LineRequest::Start) => look.inputs.is_some_and(|inputs| !inputs.start_request),
            Some(LineRequest::Reset) => look.cell.as_ref().is_some_and(|cell| cell.state != "complete"),
            None => true,
        };
        if !is_over {
            return LineSignals::from_signals(&[LineSignal::Fault]);
        }
        self.refused = None;
        line_signals(look.cell.as_ref())
    }

    fn on_idle(&mut self, inputs: LineInputs) -> Option<LineRequest> {
        if !inputs.start_request {
            self.is_armed = true;
            return None;
        }
        // One edge makes one request, whether it is accepted or not: without a part nothing begins, not even when
        // one comes later.
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
