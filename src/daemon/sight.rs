//! What is seen of the panel: where it stands, and what the film did. The artifacts live here.

use super::figures::{self, Kept, Sighting};
use super::findings;
use super::ports::{Eyes, Record, SightError};
use super::{DaemonError, Job};
use crate::cycle::{Answer, Film, Grade, Trouble};
use crate::eki::Time;
use crate::geometry::{Base, ColorPicture, FlangeCamera, Panel, Point, Rigid};
use crate::inspect::{Inspection, Watch};
use crate::locate::refine::{self, CornerView, Refined};
use crate::locate::{self, corner, gate};
use crate::panel::TaughtCorner;
use crate::phase::Phase;
use crate::record::{Budget, Finding, Kind};
use crate::verdict::{Judgement, Reason, Verdict};
use std::sync::Arc;
use std::time::Instant;

/// Where the panel stands and what its film did.
#[derive(Debug, Default, Clone)]
pub(super) struct Sight {
    /// By the 3D scan.
    located: Option<Rigid<Base, Panel>>,
    /// How well that is known, 95 %, mm.
    located_mm: Option<f64>,
    /// By the corner too.
    place: Option<Rigid<Base, Panel>>,
    /// Which of the taught corners is looked at.
    corner: usize,
    dry: Option<(Arc<ColorPicture>, f64)>,
    /// The films of this cycle, in order.
    pub inspections: Vec<Arc<Inspection>>,
    /// The last picture of the last of them.
    pub film_picture: Option<Arc<ColorPicture>>,
}

/// A film that is being watched.
#[derive(Debug)]
pub(super) struct Filming {
    watch: Watch,
    place: Rigid<Base, Panel>,
    began: Time,
    frames: u32,
    last: Option<Arc<ColorPicture>>,
    opened: bool,
    kept: Kept,
    /// From a decoded picture to its result.
    elapsed_ms: Vec<f64>,
}

/// What cannot be computed without what an earlier act leaves.
const MISSING: Answer = Answer::Failed(Trouble::Unexpected);

impl Sight {
    /// Where the panel stands, as well as is known.
    pub fn place(&self) -> Option<Rigid<Base, Panel>> {
        self.place
    }

    /// Where the flange camera should stand to see the corner as it was taught (Eq. 3.22).
    pub fn corner_pose(&self, job: &Job<'_>) -> Option<Rigid<Base, FlangeCamera>> {
        Some(self.place? * job.corners.get(self.corner)?.teaching.panel_from_camera)
    }

    /// Chooses the taught corner that is looked at from now on.
    pub fn look_at_corner(&mut self, index: usize) {
        self.corner = index;
    }

    /// Adds what a film that was watched on its own left.
    pub fn take_film(&mut self, film: Sight) {
        self.inspections.extend(film.inspections);
        if film.film_picture.is_some() {
            self.film_picture = film.film_picture;
        }
    }

    /// A 3D shot, and the panel in it. What films said of the panel's grids stays.
    pub fn locate(
        &mut self,
        job: &Job<'_>,
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        (self.located, self.place, self.dry) = (None, None, None);
        let scan = match eyes.scan() {
            Ok(scan) => scan,
            Err(error) => return blind(Kind::Locate, 0, &error, record),
        };
        let picture = scan.picture();
        record.picture("scan", &picture)?;
        let begun = Instant::now();
        let settings = job.recipe.locate();
        let (camera, base_from_camera) = (&job.calibrations.scanner, job.calibrations.base_from_camera);
        let found = locate::locate(job.panel, &locate::View { scan: &scan, camera, base_from_camera }, settings);
        let judgement = match &found {
            Ok(fit) => gate::judge(fit, settings),
            Err(error) => gate::refusal(error),
        };
        let elapsed_ms = elapsed_ms(begun);
        let (grade, fit) = (grade(&judgement), found.ok());
        let place = fit.as_ref().map(|fit| fit.base_from_panel);
        let located_mm = fit.as_ref().map(|fit| fit.uncertainty_mm);
        record.figure(&figures::located(job, &picture, place))?;
        record.finding(&findings::located(fit.as_ref(), judgement, elapsed_ms, job))?;
        record.budget(&Budget {
            hand_eye_mm: job.calibrations.hand_eye_mm,
            robot_mm: job.calibrations.robot_mm,
            locate_mm: located_mm,
            stated_mm: job.limits.tool_error_mm(),
            ..Budget::default()
        })?;
        (self.located, self.place, self.located_mm) = (place, place, located_mm);
        Ok(Answer::Graded(grade))
    }

    /// A corner picture from `base_from_camera`, and what it says about the place. `moves` were made before.
    pub fn refine(
        &mut self,
        job: &Job<'_>,
        (moves, base_from_camera): (u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let (Some(located), Some(place)) = (self.located, self.place) else { return Ok(MISSING) };
        let picture = match eyes.corner_picture() {
            Ok(picture) => picture,
            Err(error) => return blind(Kind::Refine, 0, &error, record),
        };
        record.picture(&format!("corner{moves}"), &picture)?;
        let (whole, sighting) = match look((job, self.corner), &picture, located, (place, base_from_camera)) {
            Ok(seen) => seen,
            Err(reason) => return unseen(Kind::Refine, 0, reason, record),
        };
        let (limits, step_mm) = (job.recipe.corner(), place_step_mm(&whole, place, sighting.corner));
        let displaced = step_mm > limits.settled_mm();
        let mut judgement = refine::judge(&whole, limits);
        let claims = self.located_mm.zip(job.calibrations.hand_eye_mm);
        let found =
            claims.and_then(|(located_mm, hand_eye_mm)| refine::disagreement(&whole, &[located_mm, hand_eye_mm]));
        if let (Some(reason), Verdict::Accept) = (found, judgement.verdict) {
            judgement = Judgement::of(vec![], vec![reason]);
        }
        if displaced && usize::from(moves) >= limits.max_moves() && judgement.verdict == Verdict::Accept {
            judgement = Judgement::of(vec![not_settled(step_mm, job)], vec![]);
        }
        let grade = grade(&judgement);
        let before = figures::corner(job, &picture, (sighting, place), ("corner_before", "before the correction"));
        let after = (sighting, whole.base_from_panel);
        let after = figures::corner(job, &picture, after, ("corner_after", "after the correction"));
        for figure in before.iter().chain(&after) {
            record.figure(figure)?;
        }
        record.finding(&findings::refined(&whole, judgement, (moves, step_mm), job))?;
        self.place = Some(whole.base_from_panel);
        // What is rejected is not looked at again from nearer.
        Ok(if displaced && grade == Grade::Accept { Answer::Displaced } else { Answer::Graded(grade) })
    }

    /// The corner again, wet or dry: does it still stand where the localization puts it?
    pub fn verify(
        &mut self,
        job: &Job<'_>,
        (pass, base_from_camera): (u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let Some(place) = self.place else { return Ok(MISSING) };
        let picture = match eyes.corner_picture() {
            Ok(picture) => picture,
            Err(error) => return blind(Kind::Verify, pass, &error, record),
        };
        record.picture("verify", &picture)?;
        let (seen, sighting) = match look((job, self.corner), &picture, place, (place, base_from_camera)) {
            Ok(seen) => seen,
            Err(reason) => return unseen(Kind::Verify, pass, reason, record),
        };
        let (off_mm, allowed_mm) = (seen.shift_mm[0].hypot(seen.shift_mm[1]), job.recipe.corner().verify_mm());
        let message = || {
            format!(
                "the corner stands {off_mm:.2} mm from where the localization puts it, allowed are {allowed_mm:.2} mm, \
                 [corner] verify_mm; has the panel moved?"
            )
        };
        let reasons = if off_mm <= allowed_mm { vec![] } else { vec![Reason::new("moved", message())] };
        let judgement = Judgement::of(reasons, vec![]);
        let grade = grade(&judgement);
        if let Some(figure) = figures::corner(job, &picture, (sighting, place), ("verify", "before contact")) {
            record.figure(&figure)?;
        }
        record.finding(&findings::verified(&seen, judgement, pass, job))?;
        Ok(Answer::Graded(grade))
    }

    /// The picture of the dry panel.
    pub fn dry_picture(
        &mut self,
        now: Time,
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        match eyes.picture() {
            Ok(picture) => {
                record.picture("dry", &picture)?;
                self.dry = Some((Arc::new(picture), now.since_start().as_secs_f64()));
                Ok(Answer::Done)
            }
            Err(error) => blind(Kind::Inspect, 0, &error, record),
        }
    }

    /// Begins to watch.
    pub fn film(
        &self,
        job: &Job<'_>,
        (pass, now): (u8, Time),
        record: &mut dyn Record,
    ) -> Result<Result<Filming, Answer>, DaemonError> {
        let (Some(place), Some((dry, dry_s))) = (self.place, &self.dry) else { return Ok(Err(MISSING)) };
        let camera_from_panel = job.calibrations.base_from_camera.inverse() * place;
        let camera = &job.calibrations.scanner;
        let watch = Watch::new(job.panel, camera, camera_from_panel, job.recipe.inspect(), job.demands());
        let begun = watch.and_then(|mut watch| {
            watch.push(dry, *dry_s, Phase::Dry)?;
            let (kept, elapsed_ms) = (Kept::default(), Vec::new());
            Ok(Filming { watch, place, began: now, frames: 0, last: None, opened: false, kept, elapsed_ms })
        });
        match begun {
            Ok(filming) => {
                record.frame(dry, *dry_s, Phase::Dry)?;
                Ok(Ok(filming))
            }
            Err(error) => {
                let judgement = Judgement { verdict: Verdict::Invalid, reasons: vec![reason("film", &error)] };
                record.finding(&Finding::new(Kind::Inspect, pass, judgement))?;
                Ok(Err(Answer::Failed(Trouble::Picture)))
            }
        }
    }

    /// Takes the picture that is due; after the last one judges the film.
    pub fn watch(
        &mut self,
        job: &Job<'_>,
        filming: Filming,
        (pass, now): (u8, Time),
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Result<Filming, Answer>, DaemonError> {
        let mut filming = filming;
        let demands = job.demands();
        let since_s = now.since(filming.began).as_secs_f64();
        if since_s * demands.frames_per_second < f64::from(filming.frames) {
            return Ok(Ok(filming));
        }
        let picture = match eyes.picture() {
            Ok(picture) => Arc::new(picture),
            Err(error) => return blind(Kind::Inspect, pass, &error, record).map(Err),
        };
        filming.frames += 1;
        let now_s = now.since_start().as_secs_f64();
        record.frame(&picture, now_s, Phase::Wet)?;
        let begun = Instant::now();
        let step = match filming.watch.push(&picture, now_s, Phase::Wet) {
            Ok(step) => step,
            Err(error) => return unseen(Kind::Inspect, pass, reason("film", &error), record).map(Err),
        };
        filming.elapsed_ms.push(elapsed_ms(begun));
        filming.kept.see(job, filming.place, &picture, &step);
        if !filming.opened && !step.newly_failed.is_empty() {
            filming.opened = true;
            let grids: Vec<String> = step.newly_failed.iter().map(ToString::to_string).collect();
            tracing::info!(since_wet_s = step.since_wet_s, "the film broke on {}", grids.join(", "));
        }
        filming.last = Some(picture);
        if since_s < demands.filmed_s() {
            return Ok(Ok(filming));
        }
        self.finish(job, filming, pass, record).map(Err)
    }

    fn finish(
        &mut self,
        job: &Job<'_>,
        mut filming: Filming,
        pass: u8,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let inspection = match filming.watch.finish() {
            Ok(inspection) => inspection,
            Err(error) => return unseen(Kind::Inspect, pass, reason("film", &error), record),
        };
        if let Some(last) = &filming.last {
            record.picture("film", last)?;
            record.figure(&filming.kept.strip(&inspection, last))?;
            record.figure(&figures::inspected(job, &inspection, last, filming.place))?;
            record.figure(&figures::break_times(job, &inspection, last, filming.place))?;
        }
        let film = match inspection.judgement.verdict {
            Verdict::Pass => Film::Whole,
            Verdict::Fail => Film::Broken,
            _ => Film::Invalid,
        };
        record.finding(&findings::filmed(&inspection, pass, median(&mut filming.elapsed_ms), job))?;
        self.inspections.push(Arc::new(inspection));
        self.film_picture = filming.last;
        Ok(Answer::Filmed(film))
    }
}

fn elapsed_ms(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn not_settled(step_mm: f64, job: &Job<'_>) -> Reason {
    let limits = job.recipe.corner();
    let (settled_mm, moves) = (limits.settled_mm(), limits.max_moves());
    let message = format!(
        "after {moves} moves, [corner] max_moves, the corner still stands {step_mm:.2} mm from where it was looked for, \
         allowed are {settled_mm:.2} mm, settled_mm; is the hand-eye calibration good, does the panel move?"
    );
    Reason::new("not_settled", message)
}

/// What a corner picture says about a place: the correction of `place` by the corner as it is seen by a camera that
/// expects it at `expected`.
fn look(
    (job, index): (&Job<'_>, usize),
    picture: &ColorPicture,
    place: Rigid<Base, Panel>,
    (expected, base_from_camera): (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
) -> Result<(Refined, Sighting), Reason> {
    let camera = &job.calibrations.flange_camera;
    let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
    let taught: &TaughtCorner = job.corners.get(index).ok_or_else(no_corner)?;
    let depth_mm = (base_from_camera.inverse() * (expected * taught.point)).mm.z;
    let (settings, px_per_mm) = (job.recipe.corner(), camera.px_per_mm_at(depth_mm).0);
    let found = corner::find(&picture.to_gray(), settings, settings.which().of(index), px_per_mm)
        .map_err(|error| reason("no_corner", &error))?;
    let view = CornerView { taught, base_from_camera, found_px: found.corner_px };
    let refined = refine::refine(place, camera, &[view]).map_err(|error| reason("not_in_view", &error))?;
    Ok((refined, Sighting { base_from_camera, found_px: found.corner_px, corner: taught.point }))
}

/// How far the corner's new place is from the one that the camera was sent to, mm.
fn place_step_mm(whole: &Refined, before: Rigid<Base, Panel>, corner: Point<Panel>) -> f64 {
    whole.base_from_panel.distance_at_mm(before, corner)
}

/// A gate's word for the table.
pub(super) fn grade(judgement: &Judgement) -> Grade {
    match judgement.verdict {
        Verdict::Accept => Grade::Accept,
        Verdict::Review => Grade::Review,
        _ => Grade::Reject,
    }
}

pub(super) fn reason(code: &'static str, error: &dyn std::error::Error) -> Reason {
    Reason::new(code, error.to_string())
}

fn blind(kind: Kind, pass: u8, error: &SightError, record: &mut dyn Record) -> Result<Answer, DaemonError> {
    record.finding(&findings::rejected(kind, pass, reason("no_picture", error)))?;
    Ok(Answer::Failed(Trouble::Camera))
}

/// A picture that cannot be read: of a corner that is a rejection, of a film it says nothing.
fn unseen(kind: Kind, pass: u8, reason: Reason, record: &mut dyn Record) -> Result<Answer, DaemonError> {
    record.finding(&findings::rejected(kind, pass, reason))?;
    let of_film = kind == Kind::Inspect;
    Ok(if of_film { Answer::Failed(Trouble::Picture) } else { Answer::Graded(Grade::Reject) })
}
