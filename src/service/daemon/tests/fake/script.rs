//! The result of a cycle of the scripted cell.

use super::super::super::*;
use panelprep_base::geometry::{Base, ColorPicture, Flange, Rigid};
use panelprep_base::phase::Phase;
use panelprep_cell::cycle::{self, Event, Motion, Outcome, Path, Refusal};
use panelprep_cell::record::{Budget, Clock, ContactPath, Kind, RequestRecord};
use panelprep_sim::CellTruth;
use std::sync::Arc;

/// The result of a run.
pub struct Story {
    pub outcome: LoopOutcome,
    pub truth: CellTruth,
    pub findings: Vec<Finding>,
    pub figures: Vec<String>,
    pub pictures: Vec<(String, ColorPicture, Rigid<Base, Flange>)>,
    pub frames: Vec<(Arc<ColorPicture>, f64, Phase)>,
    /// The times at which the films began, s.
    pub films_began_s: Vec<f64>,
    pub budget: Budget,
    pub intents: Vec<(Motion, Option<(Outcome, u32)>)>,
    pub events: Vec<Event>,
    pub refusals: Vec<(cycle::Request, Refusal)>,
    pub contact_points: usize,
    pub lines: usize,
    /// For each line with its own feed: the feed, m/s, and the rounding, mm.
    pub feeds: Vec<(f64, f64)>,
    pub worn_mm2: f64,
    pub wears: Vec<(f64, bool)>,
    pub contacts: Vec<(ContactPath, Vec<u32>)>,
    /// Number of waypoints that were executed before the record permitted them.
    pub beyond: u32,
    pub asked: Vec<RequestRecord>,
    pub clocks: Vec<Clock>,
    pub moved_without_intent: usize,
    /// How far each point of contact lies in front of the true panel, mm.
    pub contact_off_mm: Vec<f64>,
    /// Each base that was set, in order.
    pub bases: Vec<panelprep_base::geometry::KukaPose>,
    /// The times at which output 6 was set, with its values, ms, and the time at which the arm first moved.
    pub warning_ms: (Vec<(u64, bool)>, Option<u64>),
}

impl Story {
    /// Returns the stages that recorded a finding.
    pub fn stages(&self) -> Vec<Kind> {
        self.findings.iter().map(|finding| finding.kind).collect()
    }

    /// Returns the closed motions along this path.
    pub fn motions(&self, path: Path) -> Vec<(Motion, Outcome, u32)> {
        let closed = self.intents.iter().filter(|(motion, _)| motion.path == path);
        closed.filter_map(|(motion, end)| end.map(|(outcome, done)| (*motion, outcome, done))).collect()
    }
}

impl std::fmt::Display for Story {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{:?} {:?}", self.outcome.state.at, self.refusals)?;
        for event in self
            .events
            .iter()
            .filter(|e| !matches!(e, Event::Reported(panelprep_cell::cycle::Report::Progress { .. })))
        {
            writeln!(f, "{event:?}")?;
        }
        for finding in &self.findings {
            writeln!(f, "{:?} {:?} {:?}", finding.kind, finding.judgement, finding.checks)?;
        }
        Ok(())
    }
}
