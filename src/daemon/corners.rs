//! The corner loop: which taught corners are looked at, what their pictures say together, and whether they still stand where
//! they should just before contact.
//!
//! Two corners hold the panel's shift and its turn; more say little more. The first ones in the order of teaching are
//! taken whose moves pass the gate. View n looks at the n-th of them, and round again: so both loops go on from view to view
//! until each chosen corner was seen, and in the first loop until each stood where it was looked for.

use super::figures::{self, Sighting};
use super::ports::{Eyes, Record};
use super::sight::{MISSING, Sight, blind, grade, reason, unseen};
use super::{DaemonError, Job, findings};
use crate::cycle::{Answer, Grade};
use crate::geometry::{Base, ColorPicture, FlangeCamera, Panel, Rigid};
use crate::locate::corner;
use crate::locate::refine::{self, CornerView, Refined};
use crate::panel::TaughtCorner;
use crate::record::Kind;
use crate::verdict::{Judgement, Reason, Verdict};

/// Corners that are looked at, at most.
const MOST: usize = 2;

/// How many corners a loop looks at where all can be.
pub(super) fn most(job: &Job<'_>) -> usize {
    MOST.min(job.recipe.corner().max_moves() + 1).min(job.corners.len())
}

/// The corners of a loop; indices count the taught ones.
#[derive(Debug, Default, Clone)]
pub(super) struct Corners {
    /// In the order of the views.
    chosen: Vec<usize>,
    /// The one that the camera is sent to.
    aimed: usize,
    /// No other's move passes the gate.
    no_more: bool,
    /// The last picture of each.
    seen: Vec<Seen>,
}

/// A corner's picture, and the place by which the camera was sent there.
#[derive(Debug, Clone, Copy)]
struct Seen {
    corner: usize,
    sighting: Sighting,
    looked_for: Rigid<Base, Panel>,
}

impl Corners {
    /// The taught corner that the camera is sent to, or was last.
    pub fn aimed(&self) -> usize {
        self.aimed
    }

    /// The corners that may be chosen at a view, in order; none where it was chosen before.
    pub fn candidates(&self, view: u8, job: &Job<'_>) -> Vec<usize> {
        let view = usize::from(view);
        if view > 0 && (view >= self.wanted(job) || view > self.chosen.len()) {
            return Vec::new();
        }
        (0..job.corners.len()).filter(|index| !self.chosen[..view].contains(index)).collect()
    }

    /// Chooses a corner for a view.
    pub fn choose(&mut self, view: u8, corner: usize) {
        self.chosen.truncate(usize::from(view));
        self.chosen.push(corner);
        (self.aimed, self.no_more) = (corner, false);
    }

    /// No candidate's move passes the gate: the corners chosen before are all there are.
    pub fn end_choice(&mut self, view: u8) {
        self.chosen.truncate(usize::from(view).max(1));
        self.no_more = true;
    }

    /// Goes round to the corner of a view that follows the chosen ones.
    pub fn go_round(&mut self, view: u8) {
        if let Some(&corner) = self.chosen.get(usize::from(view) % self.chosen.len().max(1)) {
            self.aimed = corner;
        }
    }

    /// How many corners are to be seen.
    fn wanted(&self, job: &Job<'_>) -> usize {
        let all = most(job);
        if self.no_more { self.chosen.len().min(all) } else { all }
    }

    fn is_missing(&self, job: &Job<'_>) -> bool {
        self.seen.len() < self.wanted(job)
    }

    fn see(&mut self, view: u8, seen: Seen) {
        if view == 0 {
            self.seen.clear();
        }
        self.seen.retain(|other| other.corner != seen.corner);
        self.seen.push(seen);
    }

    /// What all pictures together say about a place.
    fn refined(&self, job: &Job<'_>, place: Rigid<Base, Panel>) -> Result<Refined, Reason> {
        let view = |seen: &Seen| {
            let Sighting { base_from_camera, found_px, .. } = seen.sighting;
            Some(CornerView { taught: job.corners.get(seen.corner)?, base_from_camera, found_px })
        };
        let views: Vec<CornerView<'_>> = self.seen.iter().filter_map(view).collect();
        refine::refine(place, &job.calibrations.flange_camera, &views)
            .map_err(|error| reason("not_in_view", &error))
    }

    /// How far a corner's new place is from the one that the camera was sent to, at most, mm.
    fn step_mm(&self, refined: &Refined) -> f64 {
        let step_mm = |seen: &Seen| refined.base_from_panel.distance_at_mm(seen.looked_for, seen.sighting.corner);
        self.seen.iter().map(step_mm).fold(0.0, f64::max)
    }
}

impl Sight {
    /// A corner picture from `base_from_camera`, and what all of them say about the place. `moves` were made before.
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
        let looked = self.look((job, moves), &picture, (place, base_from_camera));
        let (sighting, whole) = match looked.and_then(|it| Ok((it, self.corners.refined(job, located)?))) {
            Ok(seen) => seen,
            Err(reason) => return self.unseen_corner((Kind::Refine, 0), (reason, &picture), record),
        };
        let (limits, step_mm) = (job.recipe.corner(), self.corners.step_mm(&whole));
        let (is_missing, displaced) = (self.corners.is_missing(job), step_mm > limits.settled_mm());
        let is_last = usize::from(moves) >= limits.max_moves();
        let mut judgement = refine::judge(&whole, limits);
        // What a corner finds is a finding once all have been seen from near.
        let is_done = !is_missing && !displaced;
        let claims = self.located_mm.zip(job.calibrations.hand_eye_mm).filter(|_| is_done);
        let found =
            claims.and_then(|(located_mm, hand_eye_mm)| refine::disagreement(&whole, &[located_mm, hand_eye_mm]));
        if let (Some(reason), Verdict::Accept) = (found, judgement.verdict) {
            judgement = Judgement::of(vec![], vec![reason]);
        }
        if displaced && is_last && judgement.verdict == Verdict::Accept {
            judgement = Judgement::of(vec![not_settled(step_mm, job)], vec![]);
        }
        let grade = grade(&judgement);
        let which = self.corners.aimed + 1;
        let before =
            figures::corner(job, &picture, (sighting, place), (which, "corner_before", "before the correction"));
        let after = (sighting, whole.base_from_panel);
        let after = figures::corner(job, &picture, after, (which, "corner_after", "after the correction"));
        for figure in before.iter().chain(&after) {
            record.figure(figure)?;
        }
        record.finding(&findings::refined(&whole, judgement, (moves, step_mm, is_done || is_last), job))?;
        self.place = Some(whole.base_from_panel);
        // What is rejected is not looked at again from nearer.
        Ok(if grade == Grade::Accept && !is_done { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// The corners again, wet or dry: do they still stand where the localization puts them?
    pub fn verify(
        &mut self,
        job: &Job<'_>,
        (pass, view, base_from_camera): (u8, u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn Eyes,
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let Some(place) = self.place else { return Ok(MISSING) };
        let picture = match eyes.corner_picture() {
            Ok(picture) => picture,
            Err(error) => return blind(Kind::Verify, pass, &error, record),
        };
        record.picture(&format!("verify{view}"), &picture)?;
        let looked = self.look((job, view), &picture, (place, base_from_camera));
        let (sighting, seen) = match looked.and_then(|it| Ok((it, self.corners.refined(job, place)?))) {
            Ok(seen) => seen,
            Err(reason) => return self.unseen_corner((Kind::Verify, pass), (reason, &picture), record),
        };
        let which = self.corners.aimed + 1;
        let (judgement, is_missing) =
            (refine::judge_stands(&seen, job.recipe.corner()), self.corners.is_missing(job));
        let grade = grade(&judgement);
        let title = (which, "verify", "before contact");
        if let Some(figure) = figures::corner(job, &picture, (sighting, place), title) {
            record.figure(&figure)?;
        }
        record.finding(&findings::verified(&seen, judgement, (pass, which), job))?;
        Ok(if grade == Grade::Accept && is_missing { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// The corner that the camera was sent to, in the picture from a view; `place` is where it was looked for.
    fn look(
        &mut self,
        (job, view): (&Job<'_>, u8),
        picture: &ColorPicture,
        (place, base_from_camera): (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, Reason> {
        let (camera, index) = (&job.calibrations.flange_camera, self.corners.aimed);
        let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
        let taught: &TaughtCorner = job.corners.get(index).ok_or_else(no_corner)?;
        let depth_mm = (base_from_camera.inverse() * (place * taught.point)).mm.z;
        let (settings, px_per_mm) = (job.recipe.corner(), camera.px_per_mm_at(depth_mm).0);
        let found = corner::find(&picture.to_gray(), settings, settings.which().of(index), px_per_mm)
            .map_err(|error| reason("no_corner", &error))?;
        let sighting = Sighting { base_from_camera, found_px: found.corner_px, corner: taught.point };
        self.corners.see(view, Seen { corner: index, sighting, looked_for: place });
        Ok(sighting)
    }

    /// A picture that shows no corner is shown as it is.
    fn unseen_corner(
        &self,
        (kind, pass): (Kind, u8),
        (reason, picture): (Reason, &ColorPicture),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        record.figure(&figures::no_corner(self.corners.aimed + 1, picture))?;
        unseen(kind, pass, reason, record)
    }
}

fn not_settled(step_mm: f64, job: &Job<'_>) -> Reason {
    let limits = job.recipe.corner();
    let (settled_mm, moves) = (limits.settled_mm(), limits.max_moves());
    let message = format!(
        "after {moves} moves, [corner] max_moves, a corner still stands {step_mm:.2} mm from where it was looked for, \
         allowed are {settled_mm:.2} mm, settled_mm; is the hand-eye calibration good, does the panel move?"
    );
    Reason::new("not_settled", message)
}
