//! Results of earlier work, for simulations of many cycles: the stages are pure functions, so equal inputs give equal
//! results.
//!
//! The content of a camera picture is known only after the camera has taken it, and this takes time. So a simulation of
//! the cameras identifies each visible scene by a number. The other inputs of a piece of work are compared by content,
//! except inputs that follow from others.
//!
//! Films are remembered by their pictures: equal pictures at equal times give equal results. The pictures are only stored
//! as they arrive. After the last one, the film is evaluated, or its result is read from the memory. The conditions for
//! accepting a picture are checked as the picture arrives; if they fail, the film is evaluated from there on. With the
//! thesis's method, a different fault may be reported at the end instead.

use super::abrasion::AbrasionWork;
use super::computing::{Computing, PerformWork, WorkInput, WorkResult, Worker};
use super::films::{self, DryPicture, FilmEvaluation, FilmedPanel, JudgedFilm, film_setup};
use super::perception::Perception;
use super::ports::{CameraPort, Note};
use crate::setup::CycleSetup;
use crate::stages::film::{FilmCounts, FilmRun, PictureOutcome};
use panelprep_base::geometry::{ColorPicture, Mask};
use panelprep_base::phase::Phase;
use panelprep_cell::cycle::Action;
use panelprep_cell::panel::GridId;
use panelprep_toolpath::removal::map::RemovalMap;
use panelprep_vision::inspect::InspectError;
use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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
fn inputs(work: &WorkInput, scene_key: &mut SceneKey) -> Option<String> {
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
            format!("{act:?} {pass} {scene} {tip:?} {worn_mm2} {}", pose_inputs(&work.perception))
        }
        Action::Verify { .. } => format!("{act:?} {pass} {scene} {tip:?} {}", pose_inputs(&work.perception)),
        _ => format!(
            "{act:?} {pass} {scene} {} {}",
            perception_inputs(&work.perception),
            abrasion_inputs(&work.abrasion)
        ),
    })
}

impl<'p> Computing<'p> {
    /// Creates an executor that computes when the loop accepts a result, and does not compute a remembered result again.
    pub fn remembering(
        cameras: Box<dyn CameraPort + Send + 'p>,
        (memory, scene_key): (Memory, SceneKey),
        lock_step: bool,
    ) -> Self {
        let films = memory.films.clone();
        let begin =
            move |cycle: &CycleSetup, panel: &FilmedPanel, dry: DryPicture<'_>| films.begin(cycle, panel, dry);
        let mut worker = Worker::new(cameras, Box::new(Vec::new), None);
        worker.begin_film = Box::new(begin);
        Computing::with_worker(Box::new(RememberingWorker { worker, memory, scene_key }), lock_step)
    }
}

/// A worker that does only work whose result is not remembered.
struct RememberingWorker<'p> {
    worker: Worker<'p>,
    memory: Memory,
    scene_key: SceneKey,
}

impl PerformWork for RememberingWorker<'_> {
    fn perform(&mut self, work: WorkInput) -> WorkResult {
        let Some(inputs) = inputs(&work, &mut self.scene_key) else { return self.worker.perform(work) };
        if let Some(worked) = self.memory.cached_result(&inputs, &work) {
            return worked;
        }
        let worked = self.worker.perform(work);
        self.memory.store_result(inputs, &worked);
        worked
    }
}

impl Memory {
    /// Creates an empty memory. `keeps` returns the part of a note that is remembered: a caller that stores smaller
    /// pictures need not remember larger ones.
    pub fn new(keeps: fn(Note) -> Note) -> Self {
        Memory { results: Arc::default(), keeps, films: FilmMemory::new(keeps) }
    }

    /// Returns the remembered result for these inputs, adapted to this piece of work.
    fn cached_result(&self, inputs: &str, work: &WorkInput) -> Option<WorkResult> {
        let results = self.results.lock().unwrap_or_else(PoisonError::into_inner);
        let worked = results.get(inputs)?;
        let artifacts = worked.artifacts.clone().map(|(mut perception, abrasion)| {
            // The data from earlier films are not a result of this work.
            copy_films(&mut perception, &work.perception, work.action == Action::Locate);
            (perception, abrasion_after(work.action, &work.abrasion, abrasion))
        });
        let (found, notes) = (worked.outcome.as_ref().ok()?.clone(), worked.notes.clone());
        Some(WorkResult { id: work.id, outcome: Ok(found), artifacts, notes, is_of_film: false })
    }

    /// Remembers a result, unless it is an error.
    fn store_result(&self, inputs: String, worked: &WorkResult) {
        let Ok(found) = &worked.outcome else { return };
        let mut results = self.results.lock().unwrap_or_else(PoisonError::into_inner);
        if results.len() >= MAX_RESULTS {
            return;
        }
        let artifacts = worked.artifacts.clone().map(|(mut perception, abrasion)| {
            copy_films(&mut perception, &Perception::default(), true);
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
        // The same work in an earlier cycle used the surface of the same scan.
        _ => AbrasionWork {
            taught: before.taught.clone().or(then.taught),
            fit: then.fit.or(before.fit.clone()),
            ..before.clone()
        },
    }
}

/// Returns the data of the panel's pose on which a later phase's result depends, as text. The obstacles are not
/// included, since they follow from the scan by which the panel was located.
fn pose_inputs(perception: &Perception) -> String {
    let Perception { located, located_mm, place, corners, .. } = perception;
    format!("{located:?} {located_mm:?} {place:?} {corners:?}")
}

/// Returns the data of `pose_inputs` and the result of the film.
fn perception_inputs(perception: &Perception) -> String {
    let inspections = &perception.inspections;
    let failed: Vec<_> = inspections
        .last()
        .map_or(vec![], |film| film.grids.iter().filter(|grid| grid.failed).map(|grid| grid.id).collect());
    // Areas around breaks depend on the pixels that broke, and not only on the failed grids.
    let broken = inspections.last().map(|film| film.mask());
    format!("{} {failed:?} {:x}", pose_inputs(perception), mask_hash(broken.as_ref()))
}

/// Copies the films of another perception; with `without_dry`, as for a new localization, without its dry picture.
fn copy_films(perception: &mut Perception, other: &Perception, without_dry: bool) {
    perception.dry = if without_dry { None } else { other.dry.clone() };
    (perception.inspections, perception.film_picture) = (other.inspections.clone(), other.film_picture.clone());
}

/// Returns the data on which a later phase's result depends, as text. The surface follows from the taught data.
fn abrasion_inputs(work: &AbrasionWork) -> String {
    let AbrasionWork { plan, touched, done, most_passes, worn_mm2, earlier, removed, sanded, is_air, .. } = work;
    let removed_mm3 = removed.as_ref().map(RemovalMap::volume_mm3);
    let plan = plan.as_ref().map(|(number, _)| number);
    let sanded = mask_hash(sanded.as_deref());
    format!(
        "{plan:?} {touched:?} {done:?} {most_passes} {worn_mm2} {earlier:?} {removed_mm3:?} {sanded:x} {is_air}"
    )
}

/// Maximum number of remembered films: each contains a time for every pixel. Any further film is always evaluated.
const MAX_FILMS: usize = 1_000;
/// Maximum number of pictures of a remembered film; a longer film is evaluated as its pictures arrive.
const MAX_PICTURES: usize = 1_000;

/// The memory of films that were watched before. Clones share the same memory; it is valid for cycles of one setup.
#[derive(Debug, Clone)]
struct FilmMemory {
    known: Arc<Mutex<MemoryEntries>>,
    /// Converts a note to the form in which it is remembered.
    keeps: fn(Note) -> Note,
}

#[derive(Debug, Default)]
struct MemoryEntries {
    /// The panel data with which a film was begun without an error.
    places: BTreeSet<String>,
    films: BTreeMap<String, JudgedFilm>,
}

/// A picture, its time, s, and its phase.
type Shot = (Arc<ColorPicture>, f64, Phase);

/// A film whose pictures are evaluated when the last one has arrived, if their result is not remembered.
#[derive(Debug)]
struct RememberedFilm {
    memory: FilmMemory,
    shots: Vec<Shot>,
    begins_s: Option<f64>,
    /// The evaluation of a film with a picture that a remembered film cannot have.
    evaluated: Option<Box<FilmRun>>,
}

impl FilmEvaluation for RememberedFilm {
    fn set_start(&mut self, time_s: f64) {
        self.begins_s = Some(time_s);
    }

    fn push(
        &mut self,
        of: (&CycleSetup, &FilmedPanel),
        picture: &Arc<ColorPicture>,
        time_s: f64,
    ) -> Result<PictureOutcome, InspectError> {
        if let Some(film) = &mut self.evaluated {
            return FilmRun::push(film, picture, time_s, Phase::Wet);
        }
        let follows = self.shots.last().is_some_and(|(last, last_s, _)| {
            (last.width, last.height) == (picture.width, picture.height) && time_s > *last_s
        });
        if follows && time_s.is_finite() && self.shots.len() < MAX_PICTURES {
            self.shots.push((picture.clone(), time_s, Phase::Wet));
            return Ok(PictureOutcome { since_wet_s: None, newly_broken_grids: None });
        }
        let film = self.evaluated.insert(Box::new(evaluate_pictures(of, &self.shots, self.begins_s)?));
        FilmRun::push(film, picture, time_s, Phase::Wet)
    }

    fn current_breaks(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)> {
        self.evaluated.as_ref().and_then(|film| FilmRun::current_breaks(film))
    }

    fn finish(
        self: Box<Self>,
        (cycle, panel): (&CycleSetup, &FilmedPanel),
        pass: u8,
        counted: FilmCounts,
    ) -> Result<JudgedFilm, InspectError> {
        let RememberedFilm { memory, shots, begins_s, evaluated } = *self;
        if let Some(film) = evaluated {
            return FilmEvaluation::finish(film, (cycle, panel), pass, counted);
        }
        let inputs =
            format!("{} {pass} {:?} {}", panel_inputs(panel), counted.dropped, shots_inputs(&shots, begins_s));
        let last = shots.last().map(|(picture, ..)| picture.clone());
        if let Some(known) = memory.lock().films.get(&inputs) {
            return Ok(JudgedFilm { last, ..known.clone() });
        }
        let film = evaluate_pictures((cycle, panel), &shots, begins_s)?;
        let judged = FilmEvaluation::finish(Box::new(film), (cycle, panel), pass, counted)?;
        memory.store_judged(inputs, &judged);
        Ok(judged)
    }
}

impl FilmMemory {
    /// Begins a film; the first film of a panel is evaluated as its pictures arrive, which shows that it can begin.
    fn begin(
        &self,
        cycle: &CycleSetup,
        panel: &FilmedPanel,
        dry: DryPicture<'_>,
    ) -> Result<Box<dyn FilmEvaluation>, InspectError> {
        let is_known = format!("{} {} {}", panel_inputs(panel), dry.picture.width, dry.picture.height);
        if self.lock().places.contains(&is_known) {
            let shots = vec![(dry.picture.clone(), dry.time_s, Phase::Dry)];
            return Ok(Box::new(RememberedFilm { memory: self.clone(), shots, begins_s: None, evaluated: None }));
        }
        let film = films::begin_film(cycle, panel, dry)?;
        self.lock().places.insert(is_known);
        Ok(film)
    }

    /// Creates an empty memory; `keeps` converts each note to the form in which it is remembered.
    fn new(keeps: fn(Note) -> Note) -> Self {
        FilmMemory { known: Arc::default(), keeps }
    }

    fn lock(&self) -> MutexGuard<'_, MemoryEntries> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn store_judged(&self, inputs: String, judged: &JudgedFilm) {
        let mut known = self.lock();
        if known.films.len() < MAX_FILMS {
            let notes = judged.notes.iter().cloned().map(self.keeps).collect();
            known.films.insert(inputs, JudgedFilm { last: None, notes, ..judged.clone() });
        }
    }
}

/// Returns the panel's data on which a film's result depends, as text.
fn panel_inputs(panel: &FilmedPanel) -> String {
    format!("{:?} {:x}", panel.place, mask_hash(panel.sanded.as_deref()))
}

/// Returns the other data on which a film's result depends, as text: its pictures, and their times after the first wet
/// one.
fn shots_inputs(shots: &[Shot], begins_s: Option<f64>) -> String {
    let first_s = shots.iter().find(|(.., phase)| *phase == Phase::Wet).map_or(0.0, |(_, time_s, _)| *time_s);
    let one = |(picture, time_s, phase): &Shot| {
        let since_s = if *phase == Phase::Wet { time_s - first_s } else { 0.0 };
        format!(" {phase:?} {since_s:?} {:x}", picture_hash(picture))
    };
    let late_s = begins_s.map(|begins_s| first_s - begins_s);
    format!("{late_s:?}{}", shots.iter().map(one).collect::<String>())
}

/// Returns a hash of a mask of the taught pixels, or of no mask.
fn mask_hash(mask: Option<&Mask>) -> u64 {
    let mut hasher = DefaultHasher::new();
    mask.map(|mask| &mask.inside).hash(&mut hasher);
    hasher.finish()
}

/// Returns a hash of a picture. It identifies pictures within one process, in which no forged pictures occur.
fn picture_hash(picture: &ColorPicture) -> u64 {
    let mut hasher = DefaultHasher::new();
    (picture.width, picture.height, picture.rgb.as_flattened()).hash(&mut hasher);
    hasher.finish()
}

/// Evaluates the film with these pictures.
fn evaluate_pictures(
    (cycle, panel): (&CycleSetup, &FilmedPanel),
    shots: &[Shot],
    begins_s: Option<f64>,
) -> Result<FilmRun, InspectError> {
    let mut filming = FilmRun::begin_test(&film_setup(cycle, panel), cycle.film_demands().observation_s)?;
    for (picture, time_s, phase) in shots {
        filming.push(picture, *time_s, *phase)?;
        if let (Phase::Dry, Some(begins_s)) = (phase, begins_s) {
            filming.set_start(begins_s);
        }
    }
    Ok(filming)
}
