//! A piece of work with its input and its result, and the worker that does it. The worker has the cameras and the film
//! in progress, and calls the phases.

use crate::daemon::abrasion::AbrasionWork;
use crate::daemon::answers::MISSING;
use crate::daemon::error::DaemonError;
use crate::daemon::films::{self, BeginFilm};
use crate::daemon::live_view::{LiveFilm, LiveFrame, LiveView};
use crate::daemon::perception::{FilmInProgress, Perception};
use crate::daemon::ports::{CameraPort, Note, PictureStore, Record, RecordError, StoredPicture};
use crate::setup::CycleSetup;
use panelprep_base::geometry::{Camera, Frame, KukaPose, OrganizedCloud, Panel, Rigid};
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Action, Answer, Grade, Id, Trouble};
use panelprep_cell::files::ClipEntry;
use panelprep_cell::recipe::SandedReference;
use panelprep_cell::record::{KeptFile, Picture};
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
    /// The pose of the active tool in the active base, if it is known.
    pub tip: Option<KukaPose>,
    pub pass: u8,
    /// The setup of the cycle; `None` before the first cycle.
    pub setup: Option<Arc<CycleSetup>>,
}

impl WorkInput {
    /// Creates the next step of the film that belongs to this action.
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
    /// The artifacts after the work; `None` if the work failed with its thread.
    pub artifacts: Option<(Perception, AbrasionWork)>,
    pub notes: Vec<Note>,
    /// Whether this is the result of one step of a film.
    pub is_of_film: bool,
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
    /// The film continues; `seen_s` is its duration so far, s.
    Watching { seen_s: f64 },
    /// The problems that a self-test found.
    Wrong(Vec<(Trouble, Reason)>),
}

/// Checks the calibrations; returns a message for each one that cannot be read.
pub type CalibrationCheck = Box<dyn FnMut() -> Vec<Reason> + Send>;

/// A list of notes in place of a record. The worker compresses and writes pictures at once on its own thread: on the
/// loop's thread, this would exceed the loop's deadlines and its watchdog time.
struct NoteBuffer<'k> {
    notes: Vec<Note>,
    keep: Option<&'k mut PictureStore>,
    view: &'k LiveView,
    cycle: Option<&'k Arc<CycleSetup>>,
}

impl Record for NoteBuffer<'_> {
    fn record_note(&mut self, note: Note) -> Result<(), RecordError> {
        self.show(&note);
        let Some(keep) = &mut self.keep else {
            self.notes.push(note);
            return Ok(());
        };
        let kept = match note {
            Note::Picture(name, picture) => {
                keep(&picture)?.map(|hash| StoredPicture::Shot(KeptFile { name, hash }))
            }
            Note::Frame(picture, time_s, phase) => {
                keep(&picture)?.map(|file| StoredPicture::Frame(ClipEntry { file, time_s, phase }))
            }
            Note::Figure(figure) => {
                let (name, caption) = (figure.name, figure.caption);
                keep(&figure.picture)?.map(|hash| StoredPicture::Figure(Picture { name, caption, hash }))
            }
            note @ (Note::Finding(_) | Note::Kept(_) | Note::Budget(_)) => {
                self.notes.push(note);
                None
            }
        };
        self.notes.extend(kept.map(Note::Kept));
        Ok(())
    }

    fn show_scan(&mut self, scan: &OrganizedCloud<Camera>, panel_from_camera: &Rigid<Panel, Camera>) {
        if let Some(cycle) = self.cycle {
            self.view.scene().show_scan(cycle, scan, panel_from_camera);
        }
    }
}

impl NoteBuffer<'_> {
    /// Shows viewers a picture of a camera, or a drawing on it.
    fn show(&self, note: &Note) {
        let (name, picture) = match note {
            Note::Picture(name, picture) => (name, picture),
            Note::Figure(figure) => (&figure.name, &figure.picture),
            _ => return,
        };
        self.view.offer_picture(|| {
            Some(LiveFrame { name: name.clone(), picture: Arc::new(picture.clone()), film: None })
        });
    }
}

/// The worker of an executor.
pub(in crate::daemon) trait PerformWork {
    /// Does one piece of work.
    fn perform(&mut self, work: WorkInput) -> WorkResult;
}

/// Does the work; owns the cameras and the film in progress.
pub(in crate::daemon) struct Worker<'p> {
    cameras: Box<dyn CameraPort + Send + 'p>,
    /// Checks whether the calibrations can be read, for a self-test.
    readable: CalibrationCheck,
    keep: Option<PictureStore>,
    filming: Option<FilmInProgress>,
    pub begin_film: Box<BeginFilm>,
    /// The live view for viewers.
    view: LiveView,
}

impl<'p> Worker<'p> {
    /// Creates the worker. With a picture store it stores pictures at once; without one, the record stores them.
    pub fn new(
        cameras: Box<dyn CameraPort + Send + 'p>,
        readable: CalibrationCheck,
        keep: Option<PictureStore>,
    ) -> Self {
        let begin_film = Box::new(films::begin_film);
        Worker { cameras, readable, keep, filming: None, begin_film, view: LiveView::default() }
    }

    /// Returns the worker with a live view for viewers.
    pub fn with_live_view(self, view: LiveView) -> Self {
        Worker { view, ..self }
    }
}

impl PerformWork for Worker<'_> {
    fn perform(&mut self, mut work: WorkInput) -> WorkResult {
        let mut keep = self.keep.take();
        let view = self.view.clone();
        let setup = work.setup.take();
        let mut notes = NoteBuffer { notes: Vec::new(), keep: keep.as_mut(), view: &view, cycle: setup.as_ref() };
        let found = match (work.action, setup.as_deref()) {
            (Action::SelfTest, _) => Ok(WorkOutcome::Wrong(self.run_self_test())),
            (_, Some(cycle)) => self.phase(&mut work, cycle, &mut notes),
            (_, None) => Ok(WorkOutcome::Answer(MISSING)),
        };
        let notes = notes.notes;
        self.keep = keep;
        if let (Some(filming), Some(setup), true) = (&self.filming, &setup, work.is_next_picture) {
            view.offer_picture(|| live_frame(filming, setup));
        }
        if let (Ok(WorkOutcome::Answer(answer)), Some(setup)) = (&found, &setup) {
            show_plan(&view, setup, &work, *answer);
        }
        let is_of_film = work.action == Action::Film;
        WorkResult {
            id: work.id,
            outcome: found,
            artifacts: Some((work.perception, work.abrasion)),
            notes,
            is_of_film,
        }
    }
}

impl Worker<'_> {
    fn phase(
        &mut self,
        work: &mut WorkInput,
        cycle: &CycleSetup,
        notes: &mut NoteBuffer<'_>,
    ) -> Result<WorkOutcome, DaemonError> {
        let (pass, cameras) = (work.pass, &mut *self.cameras);
        let answer = match work.action {
            Action::Film => return self.film(work, cycle, notes),
            Action::Locate => work.perception.locate(cycle, cameras, notes)?,
            Action::DryPicture => {
                let answer = work.perception.dry_picture(cameras, notes)?;
                if answer == Answer::Done && cycle.recipe.inspect().reference() == SandedReference::Dry {
                    work.abrasion.note_dry_picture();
                }
                answer
            }
            Action::Plan { pass } => work.abrasion.plan_failed_grids(cycle, (pass, &work.perception), notes)?,
            Action::Refine { view } => match work.tip() {
                Some(tip) => {
                    let answer = work.perception.refine(cycle, (view, tip), cameras, notes)?;
                    work.survey_if_refined(cycle, answer, notes)?
                }
                None => MISSING,
            },
            Action::Verify { view } => match work.tip() {
                Some(tip) => work.perception.verify(cycle, (pass, view, tip), cameras, notes)?,
                None => MISSING,
            },
            _ => MISSING,
        };
        Ok(WorkOutcome::Answer(answer))
    }

    /// Begins the film, or evaluates the film's next picture.
    fn film(
        &mut self,
        work: &mut WorkInput,
        cycle: &CycleSetup,
        notes: &mut NoteBuffer<'_>,
    ) -> Result<WorkOutcome, DaemonError> {
        let cameras: &mut dyn CameraPort = &mut *self.cameras;
        let watched = match (work.is_next_picture, self.filming.take()) {
            (true, Some(filming)) => {
                work.perception.evaluate_next_picture(cycle, filming, work.pass, cameras, notes)?
            }
            (true, None) => Err(MISSING),
            // The film only continues: this step produces no new artifacts.
            (false, _) => {
                let eyes = (cameras, &*self.begin_film);
                let sanded = work.abrasion.sanded_pixels();
                std::mem::take(&mut work.perception).film(cycle, (work.pass, sanded), eyes, notes)?
            }
        };
        Ok(match watched {
            Ok(filming) => WorkOutcome::Watching { seen_s: self.filming.insert(filming).seen_s },
            Err(answer) => WorkOutcome::Answer(answer),
        })
    }

    fn run_self_test(&mut self) -> Vec<(Trouble, Reason)> {
        let faults = self.cameras.check_cameras().into_iter();
        let faults = faults.map(|fault| (Trouble::Camera, Reason::new("camera", fault.to_string())));
        let unreadable = (self.readable)().into_iter().map(|reason| (Trouble::Computing, reason));
        faults.chain(unreadable).collect()
    }
}

/// Shows the planned path to viewers.
fn show_plan(view: &LiveView, setup: &Arc<CycleSetup>, work: &WorkInput, answer: Answer) {
    let (Answer::Planned { plan, .. } | Answer::PlannedForReview { plan, .. }) = answer else { return };
    if let Some(path) = work.abrasion.plan(plan) {
        view.scene().show_plan(setup, (plan, work.pass), path);
    }
}

/// Returns the newest picture of a film, with the water breaks so far, for viewers.
fn live_frame(filming: &FilmInProgress, setup: &Arc<CycleSetup>) -> Option<LiveFrame> {
    let (picture, broken, failed) = filming.current_breaks()?;
    let film = LiveFilm {
        film_time_s: filming.seen_s,
        broken_so_far: broken,
        failed_so_far: failed,
        setup: setup.clone(),
        place: filming.panel.place,
    };
    Some(LiveFrame { name: "film".to_owned(), picture, film: Some(film) })
}

impl WorkInput {
    /// If the corner confirms the panel's pose, checks before the panel is wetted whether the arm reaches the panel.
    fn survey_if_refined(
        &mut self,
        cycle: &CycleSetup,
        answer: Answer,
        notes: &mut NoteBuffer<'_>,
    ) -> Result<Answer, DaemonError> {
        match (answer, self.perception.approach()) {
            (Answer::Graded(grade @ (Grade::Accept | Grade::Review)), Some(panel)) => {
                self.abrasion.survey_region(cycle, (self.pass, grade, &panel), self.perception.todays_scan(), notes)
            }
            (answer, _) => Ok(answer),
        }
    }

    /// Returns the pose of the flange camera. The pose is valid only while the flange camera is the active tool and the
    /// base is the robot's own.
    fn tip<To: Frame, From: Frame>(&self) -> Option<Rigid<To, From>> {
        self.tip.map(|pose| pose.to_rigid())
    }
}
