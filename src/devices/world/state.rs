//! The changing state of the simulated world, and its connection to the controller's outputs and inputs.
//!
//! An output acts in the world with a delay: a lamp needs time, a disc spins up, a valve closes. The water on the
//! panel is expressed as a time of the film. The film's own time begins dry; the film is sprayed from [`SPRAY_FROM_S`]
//! and watched from [`WET_FROM_S`] on. If it is sprayed for less than the time in between, the front of the water
//! stays where it is. Longer spraying keeps the film new until the water is off.
//!
//! A simulated line brings parts, requests cycles, and removes finished parts, only by the controller's signals.
//!
//! | It reads | It does |
//! |---|---|
//! | ready on | brings the next part, then requests a cycle |
//! | ready off | withdraws its request |
//! | cycle done on | removes the part |
//! | fault on during its request | withdraws its request, and makes no further one |

use panelprep_cell::cell::{InputsOutputs, LINE_INPUTS, LineSignal, Output};
use panelprep_sim::{Film, SPRAY_FROM_S, Sanding, WET_FROM_S};
use std::sync::Arc;

/// Time between the signal and the moment at which a part is brought in or taken out.
const PART_TRANSPORT_MS: u64 = 1_000;
/// Delay from the part to the start request, and delay with which the request ends, ms.
const LINE_RESPONSE_MS: u64 = 500;

/// An action that violates the process rules, as seen by the world. For tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Violation {
    /// A 3D shot with the arm not parked, or moving.
    ArmInView,
    /// A picture of the flange camera while the arm moved.
    ArmMoves,
    /// A 3D shot with the process light on.
    LightDuring3d,
    /// Water while the lens was not shut.
    SprayOnLens,
    /// Water while the tool ran, or the tool switched on while water came.
    WaterWhileToolRuns,
    /// The tool switched on without the extraction's flow.
    ToolWithoutDustExtraction,
}

/// The area of this part that the disc has sanded.
#[derive(Debug, Clone, Default)]
pub(super) struct SandedArea {
    /// The disc's positions, grouped in passes: one pass for each wetting that followed.
    pub sanding: Arc<Sanding>,
    /// The number of passes.
    pub passes: u64,
    /// The time up to which the robot's trace is included, ms.
    pub until_ms: u64,
}

/// The state of the simulated world.
pub(super) struct WorldState {
    pub signals: Vec<Signal>,
    /// The input that is on while the tool is stopped, if the cell names one.
    pub tool_stands: Option<u16>,
    pub wetting: Option<LastWetting>,
    /// The time at which the last evaluated wetting began, and which spots were no longer greasy then.
    pub removed_grease: (Option<u64>, Vec<bool>),
    pub sanded: SandedArea,
    /// The last film, with the spots that were no longer greasy and the number of passes for which it was computed.
    pub film: Option<((Vec<bool>, u64), Arc<Film>)>,
    /// Each watched wetting of this part: the time at which its water came on, its film, and the film's time in the
    /// last picture, s.
    pub watched_films: Vec<(u64, Arc<Film>, f64)>,
    pub shots: u64,
    pub disc_diameter_mm: f64,
    pub violations: Vec<(u64, Violation)>,
    pub line: Option<SimulatedLine>,
    /// Time at which the part was brought in, by the controller's time, ms.
    pub part_since_ms: u64,
}

impl WorldState {
    /// Creates the state in which nothing was done yet.
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

    /// Replaces the part by one that is dry and as greasy as the first. The films of the previous part are released,
    /// so that memory does not grow when a line brings parts for days.
    fn bring_part(&mut self, now_ms: u64) {
        (self.part_since_ms, self.wetting) = (now_ms, None);
        self.watched_films.clear();
        self.removed_grease = (None, vec![false; self.removed_grease.1.len()]);
        self.sanded = SandedArea { until_ms: now_ms, ..SandedArea::default() };
    }

    /// Processes a changed output of the controller.
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

    /// Returns an input of the controller, if something is wired to it.
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

/// Returns the position of an output among all outputs.
fn output_index(output: Output) -> usize {
    Output::ALL.iter().position(|other| *other == output).unwrap_or_default()
}

/// Delay until the device at an output follows, ms.
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

/// An output and the feedback that follows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signal {
    pub output: Output,
    /// Number n of the output `$OUT[n]`.
    pub number: u16,
    /// Number n of `$IN[n]` of its feedback.
    pub feedback: u16,
    /// The output's value.
    pub on: bool,
    /// Time of the last change, ms.
    since_ms: u64,
    /// Whether the driven device was running when the output last changed.
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

    /// Returns whether the driven device runs.
    pub fn is_running(&self, now_ms: u64) -> bool {
        let DeviceDelays { on_ms, off_ms } = delays(self.output);
        let follows = now_ms >= self.since_ms + if self.on { on_ms } else { off_ms };
        if follows { self.on } else { self.was_running }
    }

    /// Returns the feedback: for the spray whether it is off, for everything else whether it runs.
    pub fn is_feedback_on(&self, now_ms: u64) -> bool {
        self.is_running(now_ms) != (self.output == Output::Spray)
    }

    /// Returns the start-up progress of the driven device, 0…1, linear in time; when the device is switched off, the
    /// value is 0 at once.
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

/// The last time that the water was on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LastWetting {
    pub on_ms: u64,
    pub off_ms: Option<u64>,
}

/// Calculates the film's time at this time of the cell, s. Before the first wetting it also advances, so that no two
/// pictures have the same noise.
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

    /// Calculated by hand: the spray is watched from 1 s to 4 s of the film's time.
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

    /// One part is brought in, its cycle is requested, and it is removed; there is no second part.
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
