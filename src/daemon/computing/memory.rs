//! Results of work that was done before, for simulations of many cycles: the stages are pure, so that equal inputs give equal results.
//!
//! What the cameras would show cannot be known before they are asked, which takes their time. So whoever simulates them names it:
//! a number for each thing that can be seen. The rest of a piece of work's inputs is compared by content, except what follows from
//! the rest. Films are never remembered: each picture of them has its own time.

use super::work::{Work, Worked};
use crate::cycle::Act;
use crate::daemon::ports::Note;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Results that are remembered, at most: each has its pictures. What is new after that is computed each time.
const MOST: usize = 500;

/// Names what the cameras would show for this act now; none where the result is not to be remembered.
pub type SceneKey = Box<dyn FnMut(Act) -> Option<u64> + Send>;

/// Results of work that was done before. Clones are the same memory; it serves cycles of one setup.
#[derive(Debug, Clone, Default)]
pub struct Memory(Arc<Mutex<BTreeMap<String, (Worked, Vec<Note>)>>>);

/// What a piece of work depends on, as text; none for what is not remembered.
pub(super) fn inputs(work: &Work, scene_key: &mut SceneKey) -> Option<String> {
    if !matches!(work.act, Act::Locate | Act::Refine { .. } | Act::Verify { .. } | Act::Plan { .. }) {
        return None;
    }
    let scene = scene_key(work.act)?;
    let (act, pass, tip) = (work.act, work.pass, work.tip);
    Some(format!("{act:?} {pass} {scene} {tip:?} {} {}", work.perception.inputs(), work.abrasion.inputs()))
}

impl Memory {
    /// The result of such work for this piece of it.
    pub(super) fn recall(&self, inputs: &str, work: &Work) -> Option<Worked> {
        let memory = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (worked, notes) = memory.get(inputs)?;
        let artifacts = worked.artifacts.clone().map(|(mut perception, abrasion)| {
            // What films left is none of this work's results.
            perception.keep_films_of(&work.perception, work.act == Act::Locate);
            (perception, abrasion)
        });
        let found = worked.found.as_ref().ok()?.clone();
        Some(Worked { id: work.id, found: Ok(found), artifacts, notes: notes.clone(), is_of_film: false })
    }

    /// Remembers a result that is one.
    pub(super) fn remember(&self, inputs: String, worked: &Worked) {
        let Ok(found) = &worked.found else { return };
        let (id, found, artifacts) = (worked.id, Ok(found.clone()), worked.artifacts.clone());
        let kept = Worked { id, found, artifacts, notes: vec![], is_of_film: false };
        let mut memory = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if memory.len() < MOST {
            memory.insert(inputs, (kept, worked.notes.clone()));
        }
    }
}
