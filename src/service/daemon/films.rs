//! The evaluation of a film, and a cache of evaluated films for simulations of many cycles: equal pictures at equal
//! times give equal results.
//!
//! Without the cache, each picture is evaluated when it arrives. With the cache, the pictures are only stored when they
//! arrive; after the last picture, the film is evaluated, or its result is read from the cache. The conditions for
//! accepting a picture are checked when it arrives; if they fail, the film is evaluated from this picture on. With the
//! thesis's method, a different fault may then be reported at the end.

use super::answers::figure;
use super::ports::Note;
use super::setup::CycleSetup;
use crate::stages::film::{self, FilmCounts, PictureOutcome};
use panelprep_base::geometry::{Base, ColorPicture, Mask, Panel, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::Film;
use panelprep_cell::panel::GridId;
use panelprep_vision::inspect::{InspectError, Inspection};
use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum number of films in the cache, each of which contains a time for every pixel. Further films are always
/// evaluated.
const MAX_FILMS: usize = 1_000;
/// Maximum number of pictures of a film in the cache; the pictures of a longer film are evaluated when they arrive.
const MAX_PICTURES: usize = 1_000;

/// The result of a complete film.
#[derive(Debug, Clone)]
pub(super) struct JudgedFilm {
    pub film: Film,
    pub inspection: Arc<Inspection>,
    /// Its last picture.
    pub last: Option<Arc<ColorPicture>>,
    /// The notes to be recorded.
    pub notes: Vec<Note>,
}

/// A cache of evaluated films. Clones share the same cache; it is valid for the cycles of one setup.
#[derive(Debug, Clone)]
pub(super) struct FilmMemory {
    known: Arc<Mutex<MemoryEntries>>,
    /// Converts a note to the form in which it is stored in the cache.
    keeps: fn(Note) -> Note,
}

#[derive(Debug, Default)]
struct MemoryEntries {
    /// The panel data, as text, with which a film was begun without an error.
    places: BTreeSet<String>,
    films: BTreeMap<String, JudgedFilm>,
}

/// A picture of the film with its time, s, and its phase.
type Shot = (Arc<ColorPicture>, f64, Phase);

/// The data of the panel that a film shows.
#[derive(Debug, Clone)]
pub(super) struct FilmedPanel {
    /// The panel's pose.
    pub place: Rigid<Base, Panel>,
    /// The taught pixels that were sanded after the dry picture was captured.
    pub sanded: Option<Arc<Mask>>,
}

/// A film in progress.
#[derive(Debug)]
pub(super) enum FilmWatch {
    /// Each picture is evaluated when it arrives.
    AtOnce(Box<film::FilmRun>),
    /// All pictures are evaluated after the last one has arrived.
    AtTheEnd { memory: FilmMemory, shots: Vec<Shot>, begins_s: Option<f64> },
}

impl FilmWatch {
    /// Begins a film of the panel at this pose, with its dry picture.
    ///
    /// # Errors
    /// If the region is not in the picture, or the picture does not have the size of the camera's pictures.
    pub fn begin_film(
        cycle: &CycleSetup,
        panel: &FilmedPanel,
        (dry, dry_s): (&Arc<ColorPicture>, f64),
        memory: Option<&FilmMemory>,
    ) -> Result<Self, InspectError> {
        let is_known = format!("{} {} {}", panel.inputs(), dry.width, dry.height);
        if let Some(memory) = memory.filter(|memory| memory.lock().places.contains(&is_known)) {
            let shots = vec![(dry.clone(), dry_s, Phase::Dry)];
            return Ok(FilmWatch::AtTheEnd { memory: memory.clone(), shots, begins_s: None });
        }
        let mut filming = film::FilmRun::begin_test(&film_setup(cycle, panel), cycle.film_demands().observation_s)?;
        filming.push(dry, dry_s, Phase::Dry)?;
        if let Some(memory) = memory {
            memory.lock().places.insert(is_known);
        }
        Ok(FilmWatch::AtOnce(Box::new(filming)))
    }

    /// Records the time at which the camera begins to film.
    pub fn set_start(&mut self, time_s: f64) {
        match self {
            FilmWatch::AtOnce(filming) => filming.set_start(time_s),
            FilmWatch::AtTheEnd { begins_s, .. } => *begins_s = Some(time_s),
        }
    }

    /// Adds the next wet picture.
    ///
    /// # Errors
    /// If the picture does not have the size of the camera's pictures, or its time is before that of the last picture.
    pub fn push(
        &mut self,
        (cycle, panel): (&CycleSetup, &FilmedPanel),
        picture: &Arc<ColorPicture>,
        time_s: f64,
    ) -> Result<PictureOutcome, InspectError> {
        if let FilmWatch::AtTheEnd { shots, begins_s, .. } = self {
            let follows = shots.last().is_some_and(|(last, last_s, _)| {
                (last.width, last.height) == (picture.width, picture.height) && time_s > *last_s
            });
            if follows && time_s.is_finite() && shots.len() < MAX_PICTURES {
                shots.push((picture.clone(), time_s, Phase::Wet));
                return Ok(PictureOutcome { since_wet_s: None, newly_broken_grids: None });
            }
            *self = FilmWatch::AtOnce(Box::new(evaluate_pictures((cycle, panel), shots, *begins_s)?));
        }
        match self {
            FilmWatch::AtOnce(filming) => filming.push(picture, time_s, Phase::Wet),
            FilmWatch::AtTheEnd { .. } => Ok(PictureOutcome { since_wet_s: None, newly_broken_grids: None }),
        }
    }

    /// Returns the newest picture, the pixels that broke so far and the grids that failed so far.
    pub fn current_breaks(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)> {
        match self {
            FilmWatch::AtOnce(filming) => filming.current_breaks(),
            FilmWatch::AtTheEnd { .. } => None,
        }
    }

    /// Evaluates the film: computes the verdict.
    ///
    /// # Errors
    /// If the film has no picture of the wet panel.
    pub fn finish(
        self,
        (cycle, panel): (&CycleSetup, &FilmedPanel),
        pass: u8,
        counted: FilmCounts,
    ) -> Result<JudgedFilm, InspectError> {
        let (memory, shots, begins_s) = match self {
            FilmWatch::AtOnce(filming) => return judge_film((cycle, panel), *filming, pass, counted),
            FilmWatch::AtTheEnd { memory, shots, begins_s } => (memory, shots, begins_s),
        };
        let inputs = format!("{} {pass} {:?} {}", panel.inputs(), counted.dropped, inputs(&shots, begins_s));
        let last = shots.last().map(|(picture, ..)| picture.clone());
        if let Some(known) = memory.lock().films.get(&inputs) {
            return Ok(JudgedFilm { last, ..known.clone() });
        }
        let filming = evaluate_pictures((cycle, panel), &shots, begins_s)?;
        let judged = judge_film((cycle, panel), filming, pass, counted)?;
        memory.store_judged(inputs, &judged);
        Ok(judged)
    }
}

impl FilmMemory {
    /// Creates an empty cache; `keeps` converts each note to the form in which it is stored.
    pub fn new(keeps: fn(Note) -> Note) -> Self {
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

impl FilmedPanel {
    /// Returns, as text, the data of the panel on which the result of a film depends.
    fn inputs(&self) -> String {
        format!("{:?} {:x}", self.place, mask_hash(self.sanded.as_deref()))
    }
}

/// Returns, as text, the other data on which the result of a film depends: its pictures, and their times after the
/// first wet picture.
fn inputs(shots: &[Shot], begins_s: Option<f64>) -> String {
    let first_s = shots.iter().find(|(.., phase)| *phase == Phase::Wet).map_or(0.0, |(_, time_s, _)| *time_s);
    let one = |(picture, time_s, phase): &Shot| {
        let since_s = if *phase == Phase::Wet { time_s - first_s } else { 0.0 };
        format!(" {phase:?} {since_s:?} {:x}", picture_hash(picture))
    };
    let late_s = begins_s.map(|begins_s| first_s - begins_s);
    format!("{late_s:?}{}", shots.iter().map(one).collect::<String>())
}

/// Returns a hash of a mask of the taught pixels; also if there is no mask.
pub(super) fn mask_hash(mask: Option<&Mask>) -> u64 {
    let mut hasher = DefaultHasher::new();
    mask.map(|mask| &mask.inside).hash(&mut hasher);
    hasher.finish()
}

/// Returns a hash of a picture. It identifies pictures within one process and is not secure against forged pictures.
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
) -> Result<film::FilmRun, InspectError> {
    let mut filming = film::FilmRun::begin_test(&film_setup(cycle, panel), cycle.film_demands().observation_s)?;
    for (picture, time_s, phase) in shots {
        filming.push(picture, *time_s, *phase)?;
        if let (Phase::Dry, Some(begins_s)) = (phase, begins_s) {
            filming.set_start(begins_s);
        }
    }
    Ok(filming)
}

fn judge_film(
    (cycle, panel): (&CycleSetup, &FilmedPanel),
    filming: film::FilmRun,
    pass: u8,
    counted: FilmCounts,
) -> Result<JudgedFilm, InspectError> {
    let filmed = filming.finish()?;
    let setup = film_setup(cycle, panel);
    let mut notes = Vec::new();
    if let Some(last) = &filmed.last {
        notes.push(Note::Picture("film".to_owned(), (**last).clone()));
        notes.extend(filmed.draw_film(&setup).into_iter().map(|drawing| Note::Figure(figure(drawing, last))));
    }
    notes.push(Note::Finding(filmed.finding(&setup, pass, counted)));
    let film = match filmed.inspection.judgement.verdict {
        Verdict::Pass => Film::Whole,
        Verdict::Fail => Film::Broken,
        _ => Film::Invalid,
    };
    Ok(JudgedFilm { film, inspection: filmed.inspection, last: filmed.last, notes })
}

/// Returns the parameters for evaluating a film of the panel at this pose.
fn film_setup<'a>(cycle: &'a CycleSetup, panel: &'a FilmedPanel) -> film::FilmSetup<'a> {
    film::FilmSetup {
        panel: &cycle.panel,
        camera: &cycle.calibrations.scanner,
        camera_from_panel: cycle.calibrations.base_from_camera.inverse() * panel.place,
        sanded: panel.sanded.as_deref(),
        demands: cycle.film_demands(),
        recipe: &cycle.recipe,
    }
}
