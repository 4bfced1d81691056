//! What is seen of the panel: where it stands, and what the film did. The artifacts live here.

use super::ports::{Eyes, Finding, Record, RecordError, SightError};
use super::{DaemonError, Job};
use crate::cycle::{Answer, Film, Grade, Trouble};
use crate::eki::Time;
use crate::geometry::{Base, ColorPicture, FlangeCamera, KukaPose, Panel, Rigid};
use crate::inspect::{Inspection, Watch};
use crate::locate::refine::{self, CornerView, Refined};
use crate::locate::{self, corner, gate};
use crate::panel::TaughtCorner;
use crate::phase::Phase;
use crate::verdict::{Judgement, Reason, Verdict};
use serde_json::json;

/// Verify accepts a corner that stands within this of where the localization puts it, mm.
const VERIFY_MM: f64 = 1.0;

/// Where the panel stands and what its film did.
#[derive(Debug, Default, Clone)]
pub(super) struct Sight {
    /// By the 3D scan.
    located: Option<Rigid<Base, Panel>>,
    /// By the corner too.
    place: Option<Rigid<Base, Panel>>,
    dry: Option<(ColorPicture, f64)>,
    /// The last film.
    pub inspection: Option<Inspection>,
}

/// A film that is being watched.
#[derive(Debug)]
pub(super) struct Filming {
    watch: Watch,
    began: Time,
    frames: u32,
    last: Option<ColorPicture>,
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
        Some(self.place? * job.corners.first()?.teaching.panel_from_camera)
    }

    /// A 3D shot, and the panel in it.
    pub fn locate(
        &mut self,
        job: &Job<'_>,
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        *self = Sight::default();
        let scan = match eyes.scan() {
            Ok(scan) => scan,
            Err(error) => return blind("locate", 0, &error, record),
        };
        record.picture("scan", &scan.picture())?;
        let settings = job.recipe.locate();
        let found = locate::locate(job.panel, &scan, job.calibrations.base_from_camera, settings);
        let (judgement, numbers) = match &found {
            Ok(fit) => (gate::judge(fit, settings), located_numbers(fit, job)),
            Err(error) => (gate::refusal(error), json!({})),
        };
        let grade = grade(&judgement);
        record.finding(&Finding { stage: "locate", pass: 0, judgement, numbers })?;
        if let Ok(fit) = found {
            (self.located, self.place) = (Some(fit.base_from_panel), Some(fit.base_from_panel));
        }
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
            Err(error) => return blind("refine", 0, &error, record),
        };
        record.picture(&format!("corner{moves}"), &picture)?;
        let whole = match look(job, &picture, located, (place, base_from_camera)) {
            Ok(whole) => whole,
            Err(reason) => return unseen("refine", 0, reason, record),
        };
        let (step_mm, settled_mm) = (place_step_mm(&whole, place, job), job.recipe.corner().settled_mm());
        let judgement = refine::judge(&whole, job.recipe.corner());
        let grade = grade(&judgement);
        let numbers = json!({
            "base_from_panel": KukaPose::from_rigid(&whole.base_from_panel), "shift_mm": whole.shift_mm,
            "max_correction_mm": job.recipe.corner().max_correction_mm(), "step_mm": step_mm,
            "settled_mm": settled_mm, "moves": moves, "max_moves": job.recipe.corner().max_moves(),
        });
        record.finding(&Finding { stage: "refine", pass: 0, judgement, numbers })?;
        self.place = Some(whole.base_from_panel);
        // What is rejected is not looked at again from nearer.
        Ok(if step_mm > settled_mm && grade == Grade::Accept { Answer::Displaced } else { Answer::Graded(grade) })
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
            Err(error) => return blind("verify", pass, &error, record),
        };
        record.picture(&format!("verify{pass}"), &picture)?;
        let seen = match look(job, &picture, place, (place, base_from_camera)) {
            Ok(seen) => seen,
            Err(reason) => return unseen("verify", pass, reason, record),
        };
        let off_mm = seen.shift_mm[0].hypot(seen.shift_mm[1]);
        let message = || {
            format!(
                "the corner stands {off_mm:.2} mm from where the localization puts it, allowed are {VERIFY_MM:.2} mm; \
                 has the panel moved?"
            )
        };
        let reasons = if off_mm <= VERIFY_MM { vec![] } else { vec![Reason::new("moved", message())] };
        let judgement = Judgement::of(reasons, vec![]);
        let grade = grade(&judgement);
        let numbers = json!({"off_mm": off_mm, "allowed_mm": VERIFY_MM, "shift_mm": seen.shift_mm});
        record.finding(&Finding { stage: "verify", pass, judgement, numbers })?;
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
                self.dry = Some((picture, now.since_start().as_secs_f64()));
                Ok(Answer::Done)
            }
            Err(error) => blind("dry", 0, &error, record),
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
            Ok(Filming { watch, began: now, frames: 0, last: None })
        });
        match begun {
            Ok(filming) => Ok(Ok(filming)),
            Err(error) => {
                let judgement = Judgement { verdict: Verdict::Invalid, reasons: vec![reason("film", &error)] };
                record.finding(&Finding { stage: "inspect", pass, judgement, numbers: json!({}) })?;
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
            Ok(picture) => picture,
            Err(error) => return blind("inspect", pass, &error, record).map(Err),
        };
        filming.frames += 1;
        if let Err(error) = filming.watch.push(&picture, now.since_start().as_secs_f64(), Phase::Wet) {
            return unseen("inspect", pass, reason("film", &error), record).map(Err);
        }
        filming.last = Some(picture);
        if since_s < demands.observation_s {
            return Ok(Ok(filming));
        }
        self.finish(job, filming, pass, record).map(Err)
    }

    fn finish(
        &mut self,
        job: &Job<'_>,
        filming: Filming,
        pass: u8,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        if let Some(last) = &filming.last {
            record.picture(&format!("film{pass}"), last)?;
        }
        let inspection = match filming.watch.finish() {
            Ok(inspection) => inspection,
            Err(error) => return unseen("inspect", pass, reason("film", &error), record),
        };
        let judgement = inspection.judgement.clone();
        let film = match judgement.verdict {
            Verdict::Pass => Film::Whole,
            Verdict::Fail => Film::Broken,
            _ => Film::Invalid,
        };
        record.finding(&Finding { stage: "inspect", pass, judgement, numbers: film_numbers(&inspection, job) })?;
        self.inspection = Some(inspection);
        Ok(Answer::Filmed(film))
    }
}

/// What a corner picture says about a place: the correction of `place` by the corner as it is seen by a camera that
/// expects it at `expected`.
fn look(
    job: &Job<'_>,
    picture: &ColorPicture,
    place: Rigid<Base, Panel>,
    (expected, base_from_camera): (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
) -> Result<Refined, Reason> {
    let camera = &job.calibrations.flange_camera;
    let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
    let taught: &TaughtCorner = job.corners.first().ok_or_else(no_corner)?;
    let depth_mm = (base_from_camera.inverse() * (expected * taught.point)).mm.z;
    let found = corner::find(&picture.to_gray(), job.recipe.corner(), camera.px_per_mm_at(depth_mm).0)
        .map_err(|error| reason("no_corner", &error))?;
    let view = CornerView { taught, base_from_camera, found_px: found.corner_px };
    refine::refine(place, camera, &[view]).map_err(|error| reason("not_in_view", &error))
}

/// How far the corner's new place is from the one that the camera was sent to, mm.
fn place_step_mm(whole: &Refined, before: Rigid<Base, Panel>, job: &Job<'_>) -> f64 {
    let at_corner = |corner: &TaughtCorner| whole.base_from_panel.distance_at_mm(before, corner.point);
    job.corners.first().map_or(0.0, at_corner)
}

fn located_numbers(fit: &locate::Fit, job: &Job<'_>) -> serde_json::Value {
    let limits = job.recipe.locate();
    json!({
        "base_from_panel": KukaPose::from_rigid(&fit.base_from_panel),
        "rms_mm": fit.rms_mm, "max_rms_mm": limits.max_rms_mm(),
        "overlap": fit.overlap(), "min_overlap": limits.min_overlap(),
        "shift_mm": fit.shift_mm, "max_shift_mm": limits.max_shift_mm(),
        "turn_deg": fit.turn.0, "turn_limit_deg": limits.turn_limit_deg(),
        "tilt_deg": fit.tilt.0, "max_tilt_deg": limits.max_tilt_deg(),
        "uncertainty_mm": fit.uncertainty_mm,
    })
}

fn film_numbers(inspection: &Inspection, job: &Job<'_>) -> serde_json::Value {
    let demands = job.demands();
    let grids: Vec<_> = inspection
        .grids
        .iter()
        .map(|grid| {
            json!({"id": grid.id.to_string(), "failed": grid.failed, "seen": grid.seen,
                   "broken_mm2": grid.broken_mm2, "time_to_break_s": grid.time_to_break_s})
        })
        .collect();
    json!({
        "observed_s": inspection.observation.observed_s, "observation_s": demands.observation_s,
        "frames": inspection.observation.frames, "frames_per_second": demands.frames_per_second,
        "min_break_mm2": demands.min_break_mm2, "breaks": inspection.breaks.len(), "grids": grids,
    })
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

fn rejected(stage: &'static str, pass: u8, reason: Reason, record: &mut dyn Record) -> Result<(), RecordError> {
    let judgement = Judgement::of(vec![reason], vec![]);
    record.finding(&Finding { stage, pass, judgement, numbers: json!({}) })
}

fn blind(
    stage: &'static str,
    pass: u8,
    error: &SightError,
    record: &mut dyn Record,
) -> Result<Answer, DaemonError> {
    rejected(stage, pass, reason("no_picture", error), record)?;
    Ok(Answer::Failed(Trouble::Camera))
}

/// A picture that cannot be read: of a corner that is a rejection, of a film it says nothing.
fn unseen(stage: &'static str, pass: u8, reason: Reason, record: &mut dyn Record) -> Result<Answer, DaemonError> {
    rejected(stage, pass, reason, record)?;
    let of_film = stage == "inspect";
    Ok(if of_film { Answer::Failed(Trouble::Picture) } else { Answer::Graded(Grade::Reject) })
}
