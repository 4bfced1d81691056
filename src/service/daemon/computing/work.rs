//! A piece of work, and its result.

use crate::daemon::abrasion::AbrasionWork;
use crate::daemon::error::DaemonError;
use crate::daemon::perception::Perception;
use crate::daemon::ports::Note;
use crate::daemon::setup::CycleSetup;
use panelprep_base::geometry::KukaPose;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Action, Answer, Id, Trouble};
use std::sync::Arc;

/// The data that an action needs.
#[derive(Debug)]
pub(in crate::daemon) struct WorkInput {
    /// Id of the action.
    pub id: Id,
    pub action: Action,
    /// Whether this is the next step of the film in progress; such a step needs no other data.
    pub is_next_picture: bool,
    pub perception: Perception,
    pub abrasion: AbrasionWork,
    /// The pose of the active tool in the active base, as far as it is known.
    pub tip: Option<KukaPose>,
    pub pass: u8,
    /// The setup of the cycle; `None` before the first cycle.
    pub setup: Option<Arc<CycleSetup>>,
}

impl WorkInput {
    /// Creates the next step of the film that this action watches.
    pub fn next_picture_step(id: Id, act: Action, pass: u8, setup: Option<Arc<CycleSetup>>) -> Self {
        let (perception, abrasion) = Default::default();
        WorkInput { id, action: act, is_next_picture: true, perception, abrasion, tip: None, pass, setup }
    }
}

/// The result of the work.
#[derive(Debug)]
pub(in crate::daemon) struct WorkResult {
    pub id: Id,
    pub outcome: Result<WorkOutcome, DaemonError>,
    /// The artifacts after the work; `None` if the work was lost.
    pub artifacts: Option<(Perception, AbrasionWork)>,
    pub notes: Vec<Note>,
    /// Whether this is the result of a step of a film.
    pub(super) is_of_film: bool,
}

impl WorkResult {
    pub(super) fn is_last(&self) -> bool {
        !matches!(self.outcome, Ok(WorkOutcome::Watching { .. }))
    }
}

/// The result of a piece of work.
#[derive(Debug, Clone)]
pub(in crate::daemon) enum WorkOutcome {
    /// Answer for the action.
    Answer(Answer),
    /// The film continues; this is the duration of the part seen so far, s.
    Watching { seen_s: f64 },
    /// The problems that a self-test found.
    Wrong(Vec<(Trouble, Reason)>),
}

/// Checks the calibrations; returns a message for each one that cannot be read.
pub type CalibrationCheck = Box<dyn FnMut() -> Vec<Reason> + Send>;
