//! The evaluation of a film picture by picture, and the notes of its result for the record.

use super::answers::figure;
use super::ports::Note;
use crate::setup::CycleSetup;
use crate::stages::film::{self, FilmCounts, FilmRun, PictureOutcome};
use panelprep_base::geometry::{Base, ColorPicture, Mask, Panel, Rigid};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::Film;
use panelprep_cell::panel::GridId;
use panelprep_vision::inspect::{InspectError, Inspection};
use std::fmt::Debug;
use std::sync::Arc;

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

/// The data of the panel that a film shows.
#[derive(Debug, Clone)]
pub(super) struct FilmedPanel {
    /// The panel's pose.
    pub place: Rigid<Base, Panel>,
    /// The taught pixels that were sanded after the dry picture was captured.
    pub sanded: Option<Arc<Mask>>,
}

/// The dry picture of a film, and its time by the camera's clock, s.
#[derive(Debug, Clone, Copy)]
pub(super) struct DryPicture<'p> {
    pub picture: &'p Arc<ColorPicture>,
    pub time_s: f64,
}

/// Begins the evaluation of a film of the panel at this pose, with its dry picture. Fails if the region is not in the
/// picture, or the picture does not have the camera's size.
pub(super) type BeginFilm =
    dyn Fn(&CycleSetup, &FilmedPanel, DryPicture<'_>) -> Result<Box<dyn FilmEvaluation>, InspectError> + Send;

/// The evaluation of a film in progress.
pub(super) trait FilmEvaluation: Debug + Send {
    /// Records the time at which the camera begins to film.
    fn set_start(&mut self, time_s: f64);

    /// Adds the next wet picture.
    ///
    /// # Errors
    /// If its size is not the camera's, or its time is before that of the last picture.
    fn push(
        &mut self,
        of: (&CycleSetup, &FilmedPanel),
        picture: &Arc<ColorPicture>,
        time_s: f64,
    ) -> Result<PictureOutcome, InspectError>;

    /// Returns the newest picture, the pixels that broke so far and the grids that failed so far.
    fn current_breaks(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)>;

    /// Evaluates the film: computes the verdict.
    ///
    /// # Errors
    /// If it has no picture of the wet panel.
    fn finish(
        self: Box<Self>,
        of: (&CycleSetup, &FilmedPanel),
        pass: u8,
        counted: FilmCounts,
    ) -> Result<JudgedFilm, InspectError>;
}

impl FilmEvaluation for FilmRun {
    fn set_start(&mut self, time_s: f64) {
        FilmRun::set_start(self, time_s);
    }

    fn push(
        &mut self,
        _: (&CycleSetup, &FilmedPanel),
        picture: &Arc<ColorPicture>,
        time_s: f64,
    ) -> Result<PictureOutcome, InspectError> {
        FilmRun::push(self, picture, time_s, Phase::Wet)
    }

    fn current_breaks(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)> {
        FilmRun::current_breaks(self)
    }

    fn finish(
        self: Box<Self>,
        of: (&CycleSetup, &FilmedPanel),
        pass: u8,
        counted: FilmCounts,
    ) -> Result<JudgedFilm, InspectError> {
        judge_film(of, *self, pass, counted)
    }
}

/// Begins a film whose pictures are evaluated as they arrive; see [`BeginFilm`].
pub(super) fn begin_film(
    cycle: &CycleSetup,
    panel: &FilmedPanel,
    dry: DryPicture<'_>,
) -> Result<Box<dyn FilmEvaluation>, InspectError> {
    let mut film = FilmRun::begin_test(&film_setup(cycle, panel), cycle.film_demands().observation_s)?;
    film.push(dry.picture, dry.time_s, Phase::Dry)?;
    Ok(Box::new(film))
}

fn judge_film(
    (cycle, panel): (&CycleSetup, &FilmedPanel),
    filming: FilmRun,
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
pub(super) fn film_setup<'a>(cycle: &'a CycleSetup, panel: &'a FilmedPanel) -> film::FilmSetup<'a> {
    film::FilmSetup {
        panel: &cycle.panel,
        camera: &cycle.calibrations.scanner,
        camera_from_panel: cycle.calibrations.base_from_camera.inverse() * panel.place,
        sanded: panel.sanded.as_deref(),
        demands: cycle.film_demands(),
        recipe: &cycle.recipe,
    }
}
