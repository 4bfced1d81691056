//! Results of earlier work, for simulations of many cycles: the stages are pure functions, so equal inputs give equal
//! results.
//!
//! The content of a camera picture is known only after the camera has taken it, and this takes time. So a simulation of
//! the cameras identifies each visible scene by a number. The other inputs of a piece of work are compared by content,
//! except inputs that follow from others. Films are remembered by their pictures (see `films`).

use super::worker::{WorkInput, WorkResult};
use crate::daemon::abrasion::AbrasionWork;
use crate::daemon::films::FilmMemory;
use crate::daemon::perception::Perception;
use crate::daemon::ports::Note;
use panelprep_cell::cycle::Action;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Largest number of remembered results, each with its notes. Further results are computed each time.
const MAX_RESULTS: usize = 4_000;

/// Returns the number of the scene that the cameras would show for this action now; `None` if the result must not be
/// remembered.
pub type SceneKey = Box<dyn FnMut(Action) -> Option<u64> + Send>;

/// Results of earlier work. All clones share the same memory; it is valid for cycles of one setup.
#[derive(Debug, Clone)]
pub struct Memory {
    results: Arc<Mutex<BTreeMap<String, WorkResult>>>,
    /// Reduces a note to the part that is remembered.
    keeps: fn(Note) -> Note,
    films: FilmMemory,
}

/// Returns the inputs of a piece of work as text; `None` if its result is not remembered. The text contains the action
/// and the data that the action's phase reads.
pub(super) fn inputs(work: &WorkInput, scene_key: &mut SceneKey) -> Option<String> {
    if !matches!(work.action, Action::Locate | Action::Refine { .. } | Action::Verify { .. } | Action::Plan { .. })
    {
        return None;
    }
    let scene = scene_key(work.action)?;
    let (act, pass, tip) = (work.action, work.pass, work.tip);
    Some(match act {
        Action::Locate => format!("{act:?} {scene}"),
        // The reach check that follows the refinement of a corner depends on the wear of the disc.
        Action::Refine { .. } => {
            let worn_mm2 = work.abrasion.worn_mm2;
            format!("{act:?} {pass} {scene} {tip:?} {worn_mm2} {}", work.perception.pose_inputs())
        }
        Action::Verify { .. } => format!("{act:?} {pass} {scene} {tip:?} {}", work.perception.pose_inputs()),
        _ => format!("{act:?} {pass} {scene} {} {}", work.perception.inputs(), work.abrasion.inputs()),
    })
}

impl Memory {
    /// Creates an empty memory. `keeps` returns the part of a note that is remembered: a caller that stores smaller
    /// pictures need not remember larger ones.
    pub fn new(keeps: fn(Note) -> Note) -> Self {
        Memory { results: Arc::default(), keeps, films: FilmMemory::new(keeps) }
    }

    pub(super) fn films(&self) -> FilmMemory {
        self.films.clone()
    }

    /// Returns the remembered result for these inputs, adapted to this piece of work.
    pub(super) fn cached_result(&self, inputs: &str, work: &WorkInput) -> Option<WorkResult> {
        let results = self.results.lock().unwrap_or_else(PoisonError::into_inner);
        let worked = results.get(inputs)?;
        let artifacts = worked.artifacts.clone().map(|(mut perception, abrasion)| {
            // The data from earlier films are not a result of this work.
            perception.copy_films(&work.perception, work.action == Action::Locate);
            (perception, abrasion_after(work.action, &work.abrasion, abrasion))
        });
        let (found, notes) = (worked.outcome.as_ref().ok()?.clone(), worked.notes.clone());
        Some(WorkResult { id: work.id, outcome: Ok(found), artifacts, notes, is_of_film: false })
    }

    /// Remembers a result, unless it is an error.
    pub(super) fn store_result(&self, inputs: String, worked: &WorkResult) {
        let Ok(found) = &worked.outcome else { return };
        let mut results = self.results.lock().unwrap_or_else(PoisonError::into_inner);
        if results.len() >= MAX_RESULTS {
            return;
        }
        let artifacts = worked.artifacts.clone().map(|(mut perception, abrasion)| {
            perception.copy_films(&Perception::default(), true);
            (perception, abrasion)
        });
        let notes = worked.notes.iter().cloned().map(self.keeps).collect();
        let (id, found) = (worked.id, Ok(found.clone()));
        results.insert(inputs, WorkResult { id, outcome: found, artifacts, notes, is_of_film: false });
    }
}

/// Returns the abrasion data after a remembered action: only planning changes them, except the surface, which follows
/// from the taught data.
fn abrasion_after(act: Action, before: &AbrasionWork, then: AbrasionWork) -> AbrasionWork {
    match act {
        Action::Plan { .. } => then,
        _ => before.clone().with_surface_of(then),
    }
}
