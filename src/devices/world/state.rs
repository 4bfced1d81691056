//! The state of the simulated world that changes, and its connection to the controller's outputs and inputs.
//!
//! A device follows its output with a delay: a lamp needs time, a disc spins up, a valve closes. The water on the panel
//! is expressed as the film's own time. This time begins with a dry panel; the panel is sprayed from [`SPRAY_FROM_S`]
//! on, and the film is observed from [`WET_FROM_S`] on. If the panel is sprayed for less than the time in between, the
//! front of the water does not advance any further. If it is sprayed for longer, the film's time starts when the water
//! is switched off.
//!
//! A simulated production line brings parts, requests cycles, and removes finished parts. It uses only the controller's
//! signals.
//!
//! | Signal of the controller | Action of the line |
//! |---|---|
//! | ready on | brings the next part, then requests a cycle |
//! | ready off | withdraws its request |
//! | cycle done on | removes the part |
//! | fault on during its request | withdraws its request, and makes no further one |

use panelprep_cell::cell::{InputsOutputs, LINE_INPUTS, LineSignal, Output};
use panelprep_sim::{Film, SPRAY_FROM_S, Sanding, WET_FROM_S};
use std::sync::Arc;

/// Time between the signal and the moment at which the part is brought or removed, ms.
const PART_TRANSPORT_MS: u64 = 1_000;
/// Delay between the arrival of the part and the start request, and delay with which the request ends, ms.
const LINE_RESPONSE_MS: u64 = 500;

/// An action that violates the process rules, as the simulated world detects it; for tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Violation {
    /// A 3D scan was captured while the arm was not parked, or moved.
    ArmInView,
    /// A picture of the flange camera was captured while the arm moved.
    ArmMoves,
    /// A 3D scan was captured with the process light on.
    LightDuring3d,
    /// The water was on while the lens shutter was not closed.
    SprayOnLens,
    /// The water was on while the tool ran, or the tool was switched on while the water was on.
    WaterWhileToolRuns,
    /// The tool was switched on without the air flow of the extraction.
    ToolWithoutDustExtraction,
}

/// The area of the current part that the disc has sanded.
#[derive(Debug, Clone, Default)]
pub(super) struct SandedArea {
    /// The positions of the disc, grouped by sanding passes; each wetting ends a pass.
    pub sanding: Arc<Sanding>,
    /// The number of sanding passes.
    pub passes: u64,
    /// The time up to which the trace of the robot is included, ms.
    pub until_ms: u64,
}

/// The state of the simulated world.
pub(super) struct WorldState {
    pub signals: Vec<Signal>,
    /// The number of the input that is on while the tool is stopped, if the cell file names one.
    pub tool_stands: Option<u16>,
    pub wetting: Option<LastWetting>,
    /// The time at which the last evaluated wetting began, and for each spot whether its grease was removed by then.
    pub removed_grease: (Option<u64>, Vec<bool>),
    pub sanded: SandedArea,
    /// The last computed film, with the removed spots and the number of sanding passes for which it was computed.
    pub film: Option<((Vec<bool>, u64), Arc<Film>)>,
    /// Each recorded wetting of the current part: the time at which the water was switched on, its film, and the film's
    /// time in the last picture, s.
    pub watched_films: Vec<(u64, Arc<Film>, f64)>,
    pub shots: u64,
    pub disc_diameter_mm: f64,
    pub violations: Vec<(u64, Violation)>,
    pub line: Option<SimulatedLine>,
    /// The time at which the part was brought, on the controller's clock, ms.
    pub part_since_ms: u64,
}

impl WorldState {
    /// Creates the initial state of a world with these signals and this number of spots.
    pub fn new(signals: Vec<Signal>, spots: usize) -> Self {
        WorldState {
            signals,
            tool_stands: None,
            wetting: None,
            removed_grease: (None, vec![false; spots]),
            sanded: SandedArea::default(),
            film: None,
            watched_films: Vec::new(),
            shots: 0,
            disc_diameter_mm: 0.0,
            violations: Vec::new(),
            line: None,
            part_since_ms: 0,
        }
    }

    pub fn signal(&self, output: Output) -> &Signal {
        &self.signals[output_index(output)]
    }

    /// Replaces the part by a dry one with the same greasy spots. The films of the previous part are dropped, so that
    /// the memory does not grow when a line brings parts for days.
    fn bring_part(&mut self, now_ms: u64) {
        (self.part_since_ms, self.wetting) = (now_ms, None);
        self.watched_films.clear();
        self.removed_grease = (None, vec![false; self.removed_grease.1.len()]);
        self.sanded = SandedArea { until_ms: now_ms, ..SandedArea::default() };
    }

    /// Processes the change of an output of the controller.
    pub fn process_output(&mut self, number: u16, value: bool, time_ms: u64) {
        if self.line.as_mut().is_some_and(|line| line.process_output(number, value, time_ms)) {
            self.bring_part(time_ms);
        }
        let Some(signal) = self.signals.iter_mut().find(|signal| signal.number == number) else { return };
        signal.switch(value, time_ms);
        let output = signal.output;
        let runs = |output| self.signal(output).is_running(time_ms);
        let mut wrong = Vec::new();
        match (output, value) {
            (Output::Spray, true) => {
                wrong.extend(runs(Output::Tool).then_some(Violation::WaterWhileToolRuns));
                wrong.extend((!runs(Output::LensShutter)).then_some(Violation::SprayOnLens));
                self.wetting = Some(LastWetting { on_ms: time_ms, off_ms: None });
            }
            (Output::Spray, false) => {
                if let Some(wetting) = &mut self.wetting {
                    wetting.off_ms = Some(time_ms);
                }
            }
            (Output::Tool, true) => {
                wrong.extend(runs(Output::Spray).then_some(Violation::WaterWhileToolRuns));
                wrong.extend((!runs(Output::Extraction)).then_some(Violation::ToolWithoutDustExtraction));
            }
            _ => {}
        }
        self.violations.extend(wrong.into_iter().map(|violation| (time_ms, violation)));
    }

    /// Returns the value of an input of the controller; `None` if nothing is connected to it.
    pub fn input(&self, number: u16, time_ms: u64) -> Option<bool> {
        if let Some(set) = self.line.as_ref().and_then(|line| line.input_state(number, time_ms)) {
            return Some(set);
        }
        if self.tool_stands == Some(number) {
            return Some(!self.signal(Output::Tool).is_feedback_on(time_ms));
        }
        self.signals.iter().find(|signal| signal.feedback == number).map(|signal| signal.is_feedback_on(time_ms))
    }
}

/// Returns the index of an output in the list of all outputs.
fn output_index(output: Output) -> usize {
    Output::ALL.iter().position(|other| *other == output).unwrap_or_default()
}

/// The delays with which a device follows its output, ms.
struct DeviceDelays {
    on_ms: u64,
    off_ms: u64,
}

fn delays(output: Output) -> DeviceDelays {
    let (on_ms, off_ms) = match output {
        Output::Light => (300, 0),
        Output::Spray => (0, 200), // the valve closes slower than it opens
        Output::LensShutter => (250, 250),
        Output::Extraction => (800, 500),
        Output::Tool => (1_000, 600),
    };
    DeviceDelays { on_ms, off_ms }
}

/// An output with its device and the feedback input.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signal {
    pub output: Output,
    /// The number n of the output `$OUT[n]`.
    pub number: u16,
    /// The number n of the feedback input `$IN[n]`.
    pub feedback: u16,
    /// The output's value.
    pub on: bool,
    /// The time of the last change of the output, ms.
    since_ms: u64,
    /// Whether the device was running when the output last changed.
    was_running: bool,
}

impl Signal {
    pub fn new(output: Output, number: u16, feedback: u16) -> Self {
        Signal { output, number, feedback, on: false, since_ms: 0, was_running: false }
    }

    /// The output changes.
    pub fn switch(&mut self, on: bool, now_ms: u64) {
        self.was_running = self.is_running(now_ms);
        (self.on, self.since_ms) = (on, now_ms);
    }

    /// Returns whether the device runs.
    pub fn is_running(&self, now_ms: u64) -> bool {
        let DeviceDelays { on_ms, off_ms } = delays(self.output);
        let follows = now_ms >= self.since_ms + if self.on { on_ms } else { off_ms };
        if follows { self.on } else { self.was_running }
    }

    /// Returns the value of the feedback: for the spray whether it is off, for all other devices whether they run.
    pub fn is_feedback_on(&self, now_ms: u64) -> bool {
        self.is_running(now_ms) != (self.output == Output::Spray)
    }

    /// Returns the fraction of the device's start-up that is completed, 0 to 1, linear in time. When the device is
    /// switched off, the value is 0 immediately.
    pub fn share(&self, now_ms: u64) -> f64 {
        let since_ms = now_ms.saturating_sub(self.since_ms) as f64;
        let on_ms = delays(self.output).on_ms.max(1) as f64;
        if !self.on {
            0.0
        } else if self.was_running {
            1.0
        } else {
            (since_ms / on_ms).min(1.0)
        }
    }
}

/// The last period in which the water was on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LastWetting {
    pub on_ms: u64,
    pub off_ms: Option<u64>,
}

/// Calculates the film's own time at this time of the cell, s. Before the first wetting it also advances, so that no
/// two pictures have the same noise.
pub(super) fn film_s(last: Option<LastWetting>, now_ms: u64) -> f64 {
    let Some(LastWetting { on_ms, off_ms }) = last else { return -seconds(now_ms) };
    let reached_s = SPRAY_FROM_S + seconds(off_ms.unwrap_or(now_ms).saturating_sub(on_ms));
    match off_ms {
        Some(off_ms) if reached_s >= WET_FROM_S => WET_FROM_S + seconds(now_ms.saturating_sub(off_ms)),
        _ => reached_s.min(WET_FROM_S),
    }
}

pub(super) fn seconds(ms: u64) -> f64 {
    ms as f64 / 1_000.0
}

/// The value of a signal of the line, and the time at which it changes.
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

/// The simulated production line at the cell.
#[derive(Debug, Clone)]
pub(super) struct SimulatedLine {
    part_present: (u16, SignalChange),
    start_request: (u16, SignalChange),
    ready: u16,
    cycle_done: u16,
    fault: u16,
    /// Number of parts that were not brought yet.
    parts: u32,
}

impl SimulatedLine {
    /// Creates a line that brings this number of parts; `None` if the cell file does not name the line's signals.
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

    /// Processes the change of an output of the controller; returns whether the line brings another part.
    pub fn process_output(&mut self, number: u16, on: bool, now_ms: u64) -> bool {
        let (part_present, start_request) = (&mut self.part_present.1, &mut self.start_request.1);
        if number == self.ready && on && self.parts > 0 {
            self.parts -= 1;
            part_present.change(true, now_ms, PART_TRANSPORT_MS);
            start_request.change(true, now_ms, PART_TRANSPORT_MS + LINE_RESPONSE_MS);
            return true;
        }
        if number == self.ready && !on {
            start_request.change(false, now_ms, LINE_RESPONSE_MS);
        } else if number == self.cycle_done && on {
            part_present.change(false, now_ms, PART_TRANSPORT_MS);
        } else if number == self.fault && on && start_request.is_on_at(now_ms) {
            self.parts = 0;
        }
        false
    }

    /// Returns the value of an input of the controller that the line sets; `None` for other inputs.
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

    #[test]
    fn a_device_that_is_switched_off_early_never_runs() {
        let mut tool = Signal::new(Output::Tool, 5, 4);
        tool.switch(true, 100);
        assert!(!tool.is_feedback_on(1_099));
        tool.switch(false, 600);
        assert!((600..3_000).all(|now_ms| !tool.is_feedback_on(now_ms)));
        tool.switch(true, 3_000);
        assert!(!tool.is_feedback_on(3_999) && tool.is_feedback_on(4_000));
        tool.switch(false, 5_000);
        assert!(tool.is_feedback_on(5_599) && !tool.is_feedback_on(5_600), "it runs down");
    }

    #[test]
    fn the_spray_reports_that_it_is_off() {
        let mut spray = Signal::new(Output::Spray, 2, 1);
        assert!(spray.is_feedback_on(0));
        spray.switch(true, 10);
        assert!(!spray.is_feedback_on(10));
        spray.switch(false, 5_000);
        assert!(!spray.is_feedback_on(5_199) && spray.is_feedback_on(5_200));
    }

    /// Expected values, calculated by hand: three seconds of water advance the film's time from 1 s to 4 s.
    #[test]
    fn three_seconds_of_water_make_a_film() {
        let sprayed = |off_ms| Some(LastWetting { on_ms: 10_000, off_ms });
        assert!(film_s(None, 20_000) < SPRAY_FROM_S);
        assert_eq!(film_s(sprayed(None), 10_000), 1.0);
        assert_eq!(film_s(sprayed(None), 12_000), 3.0);
        assert_eq!(film_s(sprayed(None), 19_000), 4.0, "new as long as water comes");
        assert_eq!(film_s(sprayed(Some(15_000)), 15_000), 4.0);
        assert_eq!(film_s(sprayed(Some(15_000)), 45_000), 34.0);
        assert_eq!(film_s(sprayed(Some(12_000)), 45_000), 3.0, "half-way down and no further");
    }

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

    /// One part is brought, its cycle is requested, and the part is removed. There is no second part.
    #[test]
    fn a_part_is_brought_requested_and_removed() {
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
    fn a_fault_ends_the_requests_of_the_line() {
        let mut line = line(5);
        line.process_output(45, true, 0);
        assert!(line.process_output(40, true, 10), "a fault before it asks is none of its own");
        line.process_output(40, false, 3_000);
        line.process_output(45, true, 3_000);
        assert!(!line.process_output(40, true, 5_000));
        assert_eq!(input_state(&line, 9_000), [true, false]);
    }
}
