//! Perception of the panel: its pose, and the result of the film. The pictures and results are recorded here.
//!
//! The pose of the panel is corrected by the pictures of all corners together. Before contact, the corner pictures show
//! whether the corners are still at their positions.

use super::answers::{MISSING, camera_fault_answer, figure, grade_judgement, reason, unusable_picture_answer};
use super::corners::CornerLoop;
use super::error::DaemonError;
use super::films::{BeginFilm, DryPicture, FilmEvaluation, FilmedPanel};
use super::ports::{CameraPort, Picture2d, Record};
use crate::setup::CycleSetup;
use crate::stages::corners::{CornerReference, Progress, Sighting};
use crate::stages::{ResultDrawing, film};
use crate::{report, stages};
use panelprep_base::geometry::{Base, ColorPicture, FlangeCamera, Mask, Panel, Rigid, median};
use panelprep_base::phase::Phase;
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Answer, Grade};
use panelprep_cell::panel::GridId;
use panelprep_cell::record::{Budget, Kind};
use panelprep_toolpath::path::approach::Approach;
use panelprep_toolpath::path::reach::Obstacles;
use panelprep_toolpath::surface;
use panelprep_toolpath::surface::{FormErrors, TodaysScan};
use panelprep_vision::inspect::Inspection;
use panelprep_vision::locate;
use std::sync::Arc;
use std::time::Instant;

/// The pose of the panel and the results of its films.
#[derive(Debug, Default, Clone)]
pub(super) struct Perception {
    /// The panel's pose from the 3D scan.
    pub(super) located: Option<Rigid<Base, Panel>>,
    /// The uncertainty of the pose from the 3D scan, 95 %, mm.
    pub(super) located_mm: Option<f64>,
    /// The panel's pose after the correction by the corners.
    pub(super) place: Option<Rigid<Base, Panel>>,
    /// The taught corners that are viewed, and the results of their pictures.
    pub corners: CornerLoop,
    /// Obstacles for the arm: the panel at its located pose, and all other points of the scan.
    obstacles: Option<Arc<Obstacles>>,
    /// The points of the panel's region in the scan by which the panel was located, with their errors.
    todays_scan: Arc<TodaysScan>,
    pub(super) dry: Option<(Arc<ColorPicture>, f64)>,
    /// The films of this cycle, in order.
    pub inspections: Vec<Arc<Inspection>>,
    /// The last picture of the last film.
    pub film_picture: Option<Arc<ColorPicture>>,
}

/// A film in progress.
#[derive(Debug)]
pub(super) struct FilmInProgress {
    filming: Box<dyn FilmEvaluation>,
    /// The panel in this film.
    pub panel: FilmedPanel,
    /// The time of the film's first picture on the camera's clock, s.
    first_s: Option<f64>,
    /// Time from the film's first picture to its last picture so far, s.
    pub seen_s: f64,
    /// For each picture, the time from its decoding to its result, ms.
    elapsed_ms: Vec<f64>,
}

impl FilmInProgress {
    /// Returns the newest picture, the pixels that broke so far and the grids that failed so far.
    pub fn current_breaks(&self) -> Option<(Arc<ColorPicture>, Mask, Vec<GridId>)> {
        self.filming.current_breaks()
    }
}

impl Perception {
    /// Returns the best known pose of the panel.
    pub fn panel_pose(&self) -> Option<Rigid<Base, Panel>> {
        self.place
    }

    /// Discards the pictures after a cycle, because they are recorded; the pose of the panel remains.
    pub fn forget_pictures(&mut self) {
        (self.dry, self.film_picture) = (None, None);
        self.inspections.clear();
    }

    /// Returns the pose from which the flange camera should see the corner as it was taught (Eq. 3.22).
    pub fn corner_pose(&self, cycle: &CycleSetup) -> Option<Rigid<Base, FlangeCamera>> {
        Some(self.place? * cycle.corners.get(self.corners.aimed_corner())?.teaching_data.panel_from_camera)
    }

    /// Returns the pose of the panel in the arm's base, with the corners by which it was corrected.
    pub fn approach(&self) -> Option<Approach<'_>> {
        let (corners, obstacles) = (self.corners.correction_corners(), self.obstacles());
        self.place.map(|base_from_panel| Approach { base_from_panel, corners, obstacles })
    }

    /// Returns the obstacles that the arm must avoid on its way to a corner.
    pub fn obstacles(&self) -> Option<&Arc<Obstacles>> {
        self.obstacles.as_ref()
    }

    /// Returns the points of the panel's region in the scan by which the panel was located.
    pub fn todays_scan(&self) -> &Arc<TodaysScan> {
        &self.todays_scan
    }

    /// Adds the results of a film that was evaluated separately.
    pub fn add_film(&mut self, film: Perception) {
        self.inspections.extend(film.inspections);
        if film.film_picture.is_some() {
            self.film_picture = film.film_picture;
        }
    }

    /// Captures a 3D scan and locates the panel in it. The film results of the panel's grids remain.
    pub fn locate(
        &mut self,
        cycle: &CycleSetup,
        eyes: &mut dyn CameraPort,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        // Deleted before the scan: if the camera fails, no action may use the pose from the former scan.
        (self.located, self.located_mm, self.place, self.obstacles) = (None, None, None, None);
        (self.dry, self.corners, self.todays_scan) = (None, CornerLoop::default(), Arc::default());
        let errors = &cycle.calibrations.scan_errors;
        // The model of the taught panel is prepared while the camera scans.
        let scan = std::thread::scope(|threads| {
            threads.spawn(|| cycle.taught_model());
            eyes.scan()
        });
        let scan = match scan {
            Ok(scan) => scan,
            Err(error) => return camera_fault_answer(Kind::Locate, 0, &error, record),
        };
        let picture = scan.picture();
        record.picture("scan", &picture)?;
        let begun = Instant::now();
        let scan = errors.correct_scan(scan);
        let (camera, base_from_camera) = (&cycle.calibrations.scanner, cycle.calibrations.base_from_camera);
        let view = locate::ScanView { scan: &scan, camera, base_from_camera, range: errors.range };
        let located = stages::locate::locate((&cycle.panel, cycle.taught_model()), view, &cycle.recipe);
        let obstacles = located.obstacles().map(Arc::new);
        let elapsed_ms = elapsed_ms(begun);
        let nowhere = || ResultDrawing {
            name: "located".to_owned(),
            caption: "Picture of the scan in which no panel was found".to_owned(),
            picture: Ok(picture.clone()),
        };
        record.figure(&figure(located.draw_placement(&picture).unwrap_or_else(nowhere), &picture))?;
        for drawing in located.draw_reasons(&picture) {
            record.figure(&figure(drawing, &picture))?;
        }
        let found = located.finding(elapsed_ms);
        record.finding(&found)?;
        let place = located.fit.as_ref().map(|fit| fit.base_from_panel);
        let located_mm = located.fit.as_ref().map(|fit| fit.uncertainty_mm);
        record.budget(&Budget {
            hand_eye_mm: cycle.calibrations.hand_eye_mm,
            robot_mm: cycle.calibrations.robot_mm,
            locate_mm: located_mm,
            stated_mm: cycle.cell.limits.tool_error_mm(),
            ..Budget::default()
        })?;
        if let Some(place) = place {
            let panel_from_camera = place.inverse() * base_from_camera;
            let scan_mm = errors.range.point_mm();
            self.todays_scan = Arc::new(TodaysScan {
                points: surface::todays_points(&cycle.panel, &scan, &panel_from_camera),
                errors: located
                    .fit
                    .as_ref()
                    .map(|fit| FormErrors { scan_mm, pose: fit.pose_uncertainty(base_from_camera) }),
            });
            record.show_scan(&scan, &panel_from_camera);
        }
        (self.located, self.place, self.located_mm, self.obstacles) = (place, place, located_mm, obstacles);
        Ok(Answer::Graded(grade_judgement(&found.judgement)))
    }

    /// Captures the picture of the dry panel.
    pub fn dry_picture(
        &mut self,
        eyes: &mut dyn CameraPort,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        match eyes.picture() {
            Ok(Picture2d { picture, time_s }) => {
                record.picture("dry", &picture)?;
                self.dry = Some((Arc::new(picture), time_s));
                Ok(Answer::Done)
            }
            Err(error) => camera_fault_answer(Kind::Inspect, 0, &error, record),
        }
    }

    /// Begins the film on the camera and its evaluation. `sanded` are the taught pixels that were sanded after the dry
    /// picture was captured.
    pub fn film(
        &self,
        cycle: &CycleSetup,
        (pass, sanded): (u8, Option<Arc<Mask>>),
        (eyes, begin_film): (&mut dyn CameraPort, &BeginFilm),
        record: &mut dyn Record,
    ) -> Result<Result<FilmInProgress, Answer>, DaemonError> {
        let (Some(place), Some((dry, dry_s))) = (self.place, &self.dry) else { return Ok(Err(MISSING)) };
        let panel = FilmedPanel { place, sanded };
        match begin_film(cycle, &panel, DryPicture { picture: dry, time_s: *dry_s }) {
            Ok(filming) => {
                let mut filming =
                    FilmInProgress { filming, panel, first_s: None, seen_s: 0.0, elapsed_ms: Vec::new() };
                record.frame(dry, *dry_s, Phase::Dry)?;
                match eyes.begin_film(cycle.film_demands().frames_per_second) {
                    Ok(began_s) => {
                        filming.filming.set_start(began_s);
                        Ok(Ok(filming))
                    }
                    Err(error) => camera_fault_answer(Kind::Inspect, pass, &error, record).map(Err),
                }
            }
            Err(error) => unusable_picture_answer(Kind::Inspect, pass, reason("film", &error), record).map(Err),
        }
    }

    /// Fetches the next picture of the film if one is available. After the last picture, computes the result of the
    /// film. Times are those of the camera's clock.
    pub fn evaluate_next_picture(
        &mut self,
        cycle: &CycleSetup,
        filming: FilmInProgress,
        pass: u8,
        eyes: &mut dyn CameraPort,
        record: &mut dyn Record,
    ) -> Result<Result<FilmInProgress, Answer>, DaemonError> {
        let mut filming = filming;
        let (picture, time_s) = match eyes.next_film_picture() {
            Ok(Some(Picture2d { picture, time_s })) => (Arc::new(picture), time_s),
            Ok(None) => return Ok(Ok(filming)),
            Err(error) => return camera_fault_answer(Kind::Inspect, pass, &error, record).map(Err),
        };
        // Recorded before the evaluation, so that a film that ends with an error can be evaluated again from the
        // record.
        record.frame(&picture, time_s, Phase::Wet)?;
        let begun = Instant::now();
        let added = match filming.filming.push((cycle, &filming.panel), &picture, time_s) {
            Ok(added) => added,
            Err(error) => {
                #[expect(
                    clippy::let_underscore_must_use,
                    reason = "the film is ended early: no further picture is requested"
                )]
                let _ = eyes.end_film();
                return unusable_picture_answer(Kind::Inspect, pass, reason("film", &error), record).map(Err);
            }
        };
        filming.elapsed_ms.push(elapsed_ms(begun));
        if let Some(grids) = added.newly_broken_grids {
            tracing::info!(since_wet_s = added.since_wet_s, "the water film broke on {grids}");
        }
        let since_s = time_s - *filming.first_s.get_or_insert(time_s);
        filming.seen_s = since_s;
        if since_s < cycle.film_demands().filmed_s() {
            return Ok(Ok(filming));
        }
        // If the camera is lost at the end of the film, all required pictures have already been delivered.
        let dropped = eyes
            .end_film()
            .inspect_err(|error| tracing::warn!("cannot end the recording of the film: {error}"))
            .ok();
        self.finish(cycle, (filming, dropped), pass, record).map(Err)
    }

    fn finish(
        &mut self,
        cycle: &CycleSetup,
        (mut filming, dropped): (FilmInProgress, Option<u64>),
        pass: u8,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let counted = film::FilmCounts { ms_per_picture: median(&mut filming.elapsed_ms), dropped };
        let judged = match filming.filming.finish((cycle, &filming.panel), pass, counted) {
            Ok(judged) => judged,
            Err(error) => return unusable_picture_answer(Kind::Inspect, pass, reason("film", &error), record),
        };
        judged.notes.into_iter().try_for_each(|note| record.record_note(note))?;
        self.inspections.push(judged.inspection);
        self.film_picture = judged.last;
        Ok(Answer::Filmed(judged.film))
    }
}

impl Perception {
    /// Captures a corner picture from `base_from_camera`, and corrects the panel's pose by all corner pictures. `moves`
    /// is the number of earlier moves.
    pub fn refine(
        &mut self,
        cycle: &CycleSetup,
        (moves, base_from_camera): (u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn CameraPort,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let (Some(located), Some(place)) = (self.located, self.place) else { return Ok(MISSING) };
        let picture = match eyes.corner_picture() {
            Ok(picture) => picture,
            Err(error) => return camera_fault_answer(Kind::Refine, 0, &error, record),
        };
        record.picture(&format!("corner{moves}"), &picture)?;
        let claims_mm = self.located_mm.zip(cycle.calibrations.hand_eye_mm).map(<[f64; 2]>::from);
        let looked = self.find_corner((cycle, moves), &picture, (place, base_from_camera)).and_then(|sighting| {
            let progress = Progress { moves: usize::from(moves), is_missing: self.corners.is_missing(cycle) };
            let claims = (claims_mm, Some(progress));
            let correction =
                taught(cycle).refine(located, &self.corners.sightings, claims).map_err(not_in_view_reason)?;
            Ok((sighting, correction))
        });
        let (sighting, correction) = match looked {
            Ok(seen) => seen,
            Err(reason) => return self.record_unseen_corner((Kind::Refine, 0), (reason, &picture), record),
        };
        let corrected = correction.refined.base_from_panel;
        for (place, title) in [
            (place, ("corner_before", "before the correction")),
            (corrected, ("corner_after", "after the correction")),
        ] {
            if let Some(drawing) = taught(cycle).draw_corner((&sighting, &picture), place, title) {
                record.figure(&figure(drawing, &picture))?;
            }
        }
        let found = correction.finding(&self.corners.describe_excluded());
        let grade = grade_judgement(&found.judgement);
        record.finding(&found)?;
        self.place = Some(corrected);
        // A corner whose picture was rejected is not viewed again from a shorter distance.
        if correction.is_another_view_useful && grade != Grade::Reject {
            return Ok(Answer::LookOn);
        }
        self.corners.hold();
        Ok(Answer::Graded(grade))
    }

    /// Captures the corners again, wet or dry, and checks whether they are at the positions that the localization
    /// predicts.
    pub fn verify(
        &mut self,
        cycle: &CycleSetup,
        (pass, view, base_from_camera): (u8, u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn CameraPort,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let Some(place) = self.place else { return Ok(MISSING) };
        let picture = match eyes.corner_picture() {
            Ok(picture) => picture,
            Err(error) => return camera_fault_answer(Kind::Verify, pass, &error, record),
        };
        record.picture(&format!("verify{view}"), &picture)?;
        let looked = self.find_corner((cycle, view), &picture, (place, base_from_camera)).and_then(|sighting| {
            let (corners, unseen) = (&self.corners.sightings, self.corners.missing_corner_reason());
            Ok((sighting, taught(cycle).verify(place, corners, unseen).map_err(not_in_view_reason)?))
        });
        let (sighting, verification) = match looked {
            Ok(seen) => seen,
            Err(reason) => return self.record_unseen_corner((Kind::Verify, pass), (reason, &picture), record),
        };
        if let Some(drawing) = taught(cycle).draw_corner((&sighting, &picture), place, ("verify", "before contact"))
        {
            record.figure(&figure(drawing, &picture))?;
        }
        let grade = grade_judgement(&verification.judgement);
        let goes_on = grade == Grade::Accept && self.corners.is_missing(cycle);
        // If further views follow, some corners may not have been seen yet.
        let needed = (!goes_on).then_some(self.corners.correction_corners().len());
        record.finding(&verification.finding(pass, needed))?;
        Ok(if goes_on { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// Searches the corner to which the camera was sent in the picture of a view; `place` is the pose from which the
    /// corner's position is predicted.
    fn find_corner(
        &mut self,
        (cycle, view): (&CycleSetup, u8),
        picture: &ColorPicture,
        place: (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, Reason> {
        let index = self.corners.aimed_corner();
        let no_corner = || {
            Reason::new(
                "no_corner",
                "no corner of this panel was taught; teach a corner with \
                                                     --corner and --flange",
            )
        };
        let corner = (index, cycle.corners.get(index).ok_or_else(no_corner)?);
        let found = taught(cycle).find(corner, picture, place).map_err(|error| reason("no_corner", &error))?;
        self.corners.record_sighting(view, found);
        Ok(found)
    }

    /// Records a picture in which no corner was found, without a drawing.
    fn record_unseen_corner(
        &self,
        (kind, pass): (Kind, u8),
        (reason, picture): (Reason, &ColorPicture),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let which = self.corners.aimed_corner() + 1;
        let caption = format!("The flange camera's picture in which corner {which} was not found");
        let bare = ResultDrawing { name: "no_corner".to_owned(), caption, picture: Ok(picture.clone()) };
        record.figure(&figure(bare, picture))?;
        unusable_picture_answer(kind, pass, reason, record)
    }
}

/// Returns the view of the 3D camera with the panel at its located pose.
pub(super) fn view<'a>(
    cycle: &'a CycleSetup,
    picture: &'a ColorPicture,
    place: Rigid<Base, Panel>,
) -> report::PanelOverlay<'a> {
    let camera_from_panel = cycle.calibrations.base_from_camera.inverse() * place;
    report::PanelOverlay { picture, camera: &cycle.calibrations.scanner, camera_from_panel }
}

fn elapsed_ms(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

fn taught<'a>(cycle: &'a CycleSetup) -> CornerReference<'a> {
    CornerReference {
        corners: &cycle.corners,
        camera: &cycle.calibrations.flange_camera,
        lens: &cycle.lens,
        limits: cycle.recipe.corner(),
    }
}

fn not_in_view_reason(error: impl std::error::Error) -> Reason {
    reason("not_in_view", &error)
}
