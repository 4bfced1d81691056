//! The line's signals, and which of them are on in each state of the cell.

use crate::cell::LineSignal;
use panelprep_base::verdict::Verdict;

/// The inputs that the line sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LineInputs {
    /// Whether a part lies in the cell.
    pub part_present: bool,
    /// The line requests a cycle.
    pub start_request: bool,
}

/// The state of the cell, for the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellStatus {
    /// The PackML name of the cell's state.
    pub state: String,
    /// Whether the cell waits for a person's decision on a result.
    pub is_review: bool,
    /// The verdict of the cell's last cycle.
    pub verdict: Option<Verdict>,
}

/// The signals that are on, as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LineSignals(pub u32);

impl LineSignals {
    /// Creates the state from these signals.
    pub fn from_signals(signals: &[LineSignal]) -> Self {
        LineSignals(signals.iter().fold(0, |bits, signal| bits | signal.bit()))
    }

    /// Returns whether this signal is on.
    pub fn is_on(self, signal: LineSignal) -> bool {
        self.0 & signal.bit() != 0
    }
}

/// Returns the signals to the line. If the loop does not answer, only the fault signal is on: a person is needed.
pub fn line_signals(cell: Option<&CellStatus>) -> LineSignals {
    use LineSignal::{CycleDone, Fail, Fault, Pass, Ready, Review};
    let Some(cell) = cell else { return LineSignals::from_signals(&[Fault]) };
    match (cell.state.as_str(), cell.verdict) {
        ("idle", _) => LineSignals::from_signals(&[Ready]),
        ("complete", Some(Verdict::Pass)) => LineSignals::from_signals(&[CycleDone, Pass]),
        ("complete", Some(_)) => LineSignals::from_signals(&[CycleDone, Fail]),
        // A line must not continue after a cycle without a verdict.
        ("complete", None) => LineSignals::from_signals(&[Fault]),
        ("held", _) if cell.is_review => LineSignals::from_signals(&[Review]),
        ("starting" | "execute" | "completing" | "resetting" | "unholding" | "holding" | "stopping", _) => {
            LineSignals(0)
        }
        // Stopped, held because of a problem, or aborted: a person must act.
        _ => LineSignals::from_signals(&[Fault]),
    }
}
