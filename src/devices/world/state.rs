//! The changing state of the simulated world, and its connection to the controller's outputs and inputs.

use super::line::SimulatedLine;
use super::signal::Signal;
use super::water::LastWetting;
use panelprep_cell::cell::Output;
use panelprep_sim::{Film, Sanding};
use std::sync::Arc;

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
