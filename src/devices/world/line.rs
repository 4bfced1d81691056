//! A simulated line: it brings parts, requests cycles, and removes finished parts, only by the controller's signals.
//!
//! | It reads | It does |
//! |---|---|
//! | ready on | brings the next part, then requests a cycle |
//! | ready off | withdraws its request |
//! | cycle done on | removes the part |
//! | fault on during its request | withdraws its request, and makes no further one |

use panelprep_cell::cell::{InputsOutputs, LINE_INPUTS, LineSignal};

/// Time between the signal and the moment at which a part is brought in or taken out.
const PART_TRANSPORT_MS: u64 = 1_000;
/// Delay between the part and the start request, and delay with which the request ends.
const ANSWERS_MS: u64 = 500;

/// A signal of the line, and the time at which it changes.
#[derive(Debug, Clone, Copy, Default)]
struct SignalChange {
    initial_value: bool,
    changed_value: bool,
    at_ms: u64,
}

impl SignalChange {
    fn is_on_at(&self, now_ms: u64) -> bool {
        if now_ms >= self.at_ms { self.changed_value } else { self.initial_value }
    }

    fn change(&mut self, then: bool, now_ms: u64, after_ms: u64) {
        *self =
            SignalChange { initial_value: self.is_on_at(now_ms), changed_value: then, at_ms: now_ms + after_ms };
    }
}

/// The simulated line next to the cell.
#[derive(Debug, Clone)]
pub(super) struct SimulatedLine {
    part_present: (u16, SignalChange),
    start_request: (u16, SignalChange),
    ready: u16,
    cycle_done: u16,
    fault: u16,
    /// Number of parts that are still to come.
    parts: u32,
}

impl SimulatedLine {
    /// Returns a line that brings this number of parts; `None` if the cell's file does not name its signals.
    pub fn new(io: &InputsOutputs, parts: u32) -> Option<Self> {
        let [part_present, start_request] = LINE_INPUTS.map(|name| io.feedbacks().get(name).copied());
        let output = |signal| io.line_output(signal);
        Some(SimulatedLine {
            part_present: (part_present?, SignalChange::default()),
            start_request: (start_request?, SignalChange::default()),
            ready: output(LineSignal::Ready)?,
            cycle_done: output(LineSignal::CycleDone)?,
            fault: output(LineSignal::Fault)?,
            parts,
        })
    }

    /// Processes a changed output of the controller; returns whether the line brings in another part.
    pub fn process_output(&mut self, number: u16, on: bool, now_ms: u64) -> bool {
        let (part_present, start_request) = (&mut self.part_present.1, &mut self.start_request.1);
        if number == self.ready && on && self.parts > 0 {
            self.parts -= 1;
            part_present.change(true, now_ms, PART_TRANSPORT_MS);
            start_request.change(true, now_ms, PART_TRANSPORT_MS + ANSWERS_MS);
            return true;
        }
        if number == self.ready && !on {
            start_request.change(false, now_ms, ANSWERS_MS);
        } else if number == self.cycle_done && on {
            part_present.change(false, now_ms, PART_TRANSPORT_MS);
        } else if number == self.fault && on && start_request.is_on_at(now_ms) {
            self.parts = 0;
        }
        false
    }

    /// Returns the state that the line sets, if this input of the controller belongs to the line.
    pub fn input_state(&self, number: u16, now_ms: u64) -> Option<bool> {
        [self.part_present, self.start_request]
            .iter()
            .find(|(own, _)| *own == number)
            .map(|(_, changes)| changes.is_on_at(now_ms))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(parts: u32) -> SimulatedLine {
        SimulatedLine {
            part_present: (30, SignalChange::default()),
            start_request: (31, SignalChange::default()),
            ready: 40,
            cycle_done: 41,
            fault: 45,
            parts,
        }
    }

    fn input_state(line: &SimulatedLine, now_ms: u64) -> [bool; 2] {
        [30, 31].map(|number| line.input_state(number, now_ms).expect("its own"))
    }

    /// One part is brought in, its cycle is requested, and it is removed; there is no second part.
    #[test]
    fn a_part_comes_is_asked_for_and_goes() {
        let mut line = line(1);
        assert!(line.process_output(40, true, 0));
        assert_eq!(
            [999, 1_000, 1_499, 1_500].map(|now_ms| input_state(&line, now_ms)),
            [[false, false], [true, false], [true, false], [true, true]]
        );
        assert!(!line.process_output(40, false, 2_000));
        assert_eq!([2_499, 2_500].map(|now_ms| input_state(&line, now_ms)), [[true, true], [true, false]]);
        line.process_output(41, true, 60_000);
        assert_eq!([60_999, 61_000].map(|now_ms| input_state(&line, now_ms)), [[true, false], [false, false]]);
        assert!(!line.process_output(40, true, 62_000), "there is no other part");
        assert_eq!(input_state(&line, 70_000), [false, false]);
        assert_eq!(line.input_state(1, 0), None);
    }

    #[test]
    fn a_refusal_ends_its_asking() {
        let mut line = line(5);
        line.process_output(45, true, 0);
        assert!(line.process_output(40, true, 10), "a fault before it asks is none of its own");
        line.process_output(40, false, 3_000);
        line.process_output(45, true, 3_000);
        assert!(!line.process_output(40, true, 5_000));
        assert_eq!(input_state(&line, 9_000), [true, false]);
    }
}
