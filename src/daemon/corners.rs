//! The corner loop: which taught corners are looked at, what their pictures say together, and whether they still stand where
//! they should just before contact.
//!
//! Two corners hold the panel's shift and its turn; more say little more. The first ones in the order of teaching are
//! taken whose moves pass the gate. View n looks at the n-th of them, and round again: so both loops go on from view to view
//! until each chosen corner was seen, and in the first loop until each stood where it was looked for. The corners that hold
//! the place after the first loop are the ones that the second must see: what one of them alone says is not enough then.

mod after_view;

use super::figures::{self, Sighting};
use super::ports::{CameraPort, Record};
use super::sight::{MISSING, Sight, blind, grade, reason, unseen};
use super::{DaemonError, Job, findings};
use crate::cycle::{Answer, Grade};
use crate::geometry::{Base, ColorPicture, FlangeCamera, Panel, Rigid};
use crate::locate::corner;
use crate::locate::refine::{self, CornerView, Refined};
use crate::panel::TaughtCorner;
use crate::record::Kind;
use crate::verdict::{Judgement, Reason};
use after_view::Loop;

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
    /// Those by which the place was corrected, once that is done.
    held: Vec<usize>,
    /// Those whose moves did not pass the gate since the loop began, and why.
    left_out: Vec<(usize, String)>,
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
        let all = if self.held.is_empty() { (0..job.corners.len()).collect() } else { self.held.clone() };
        all.into_iter().filter(|index| !self.chosen[..view].contains(index)).collect()
    }

    /// Begins to choose a corner for a view.
    pub fn begin_choice(&mut self, view: u8) {
        if view == 0 {
            self.left_out.clear();
        }
    }

    /// The move to this corner does not pass the gate.
    pub fn leave_out(&mut self, corner: usize, why: &str) {
        self.left_out.push((corner, why.to_owned()));
    }

    /// Those by which the place was corrected, in the order of the views; none before that is done.
    pub fn held(&self) -> &[usize] {
        &self.held
    }

    /// Why corners were left out, in words.
    fn left_out(&self) -> Vec<String> {
        self.left_out.iter().map(|(corner, why)| format!("corner {}: {why}", corner + 1)).collect()
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
        let all = if self.held.is_empty() { most(job) } else { self.held.len() };
        if self.no_more { self.chosen.len().min(all) } else { all }
    }

    /// The corners seen are the ones that hold the place from now on.
    fn hold(&mut self) {
        self.held = self.chosen.clone();
        self.held.retain(|corner| self.seen.iter().any(|seen| seen.corner == *corner));
    }

    fn is_missing(&self, job: &Job<'_>) -> bool {
        self.seen.len() < self.wanted(job)
    }

    /// Where no move leads to a corner that holds the place, it does not hold it any more.
    fn unseen(&self) -> Option<Reason> {
        let is_seen = |corner: &&usize| self.seen.iter().any(|seen| seen.corner == **corner);
        let missing: Vec<String> =
            self.held.iter().filter(|it| !is_seen(it)).map(|corner| format!("corner {}", corner + 1)).collect();
        (self.no_more && !missing.is_empty()).then(|| {
            let message = format!(
                "{} corrected the place and cannot be looked at again: {}; clear the way, or dry the panel and locate it anew",
                missing.join(" and "),
                self.left_out().join("; ")
            );
            Reason::new("corner_unseen", message)
        })
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
            Some(CornerView {
                corner: seen.corner,
                taught: job.corners.get(seen.corner)?,
                base_from_camera,
                found_px,
            })
        };
        let views: Vec<CornerView<'_>> = self.seen.iter().filter_map(view).collect();
        refine::refine(place, &job.calibrations.flange_camera, &views)
            .map_err(|error| reason("not_in_view", &error))
    }

    /// How far a corner's new place is from the one that the camera was sent to, at most, mm.
    fn step_mm(&self, refined: &Refined) -> f64 {
        let step_mm = |seen: &Seen| refined.base_from_panel.distance_at_mm(seen.looked_for, seen.sighting.corner);
        // Without its sign what is not a number counts as the most.
        self.seen.iter().map(|seen| step_mm(seen).abs()).max_by(f64::total_cmp).unwrap_or(f64::NAN)
    }
}

impl Sight {
    /// A corner picture from `base_from_camera`, and what all of them say about the place. `moves` were made before.
    pub fn refine(
        &mut self,
        job: &Job<'_>,
        (moves, base_from_camera): (u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn CameraPort,
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
        let claims_mm = self.located_mm.zip(job.calibrations.hand_eye_mm);
        let loop_is = Loop {
            is_missing: self.corners.is_missing(job),
            is_last: usize::from(moves) >= limits.max_moves(),
            step_mm,
        };
        let judgement = loop_is.judged(&whole, claims_mm.map(<[f64; 2]>::from), limits);
        let (grade, is_done) = (grade(&judgement), loop_is.is_done(limits));
        let which = self.corners.aimed + 1;
        let before =
            figures::corner(job, &picture, (sighting, place), (which, "corner_before", "before the correction"));
        let after = (sighting, whole.base_from_panel);
        let after = figures::corner(job, &picture, after, (which, "corner_after", "after the correction"));
        for figure in before.iter().chain(&after) {
            record.figure(figure)?;
        }
        let left_out = self.corners.left_out();
        let views = (moves, step_mm, is_done || loop_is.is_last);
        record.finding(&findings::refined(&whole, judgement, views, &left_out, job))?;
        self.place = Some(whole.base_from_panel);
        let answer = loop_is.answer(grade, limits);
        if answer != Answer::LookOn {
            self.corners.hold();
        }
        Ok(answer)
    }

    /// The corners again, wet or dry: do they still stand where the localization puts them?
    pub fn verify(
        &mut self,
        job: &Job<'_>,
        (pass, view, base_from_camera): (u8, u8, Rigid<Base, FlangeCamera>),
        eyes: &mut dyn CameraPort,
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
        let unseen = Judgement::of(self.corners.unseen().into_iter().collect(), vec![]);
        let judgement = refine::judge_stands(&seen, job.recipe.corner()).and(unseen);
        let (grade, is_missing) = (grade(&judgement), self.corners.is_missing(job));
        let title = (which, "verify", "before contact");
        if let Some(figure) = figures::corner(job, &picture, (sighting, place), title) {
            record.figure(&figure)?;
        }
        let goes_on = grade == Grade::Accept && is_missing;
        // A view that others follow need not have seen all.
        let needed = (!goes_on).then_some(self.corners.held.len());
        record.finding(&findings::verified(&seen, judgement, (pass, needed), job))?;
        Ok(if goes_on { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// The corner that the camera was sent to, in the picture from a view; `place` is where it was looked for.
    fn look(
        &mut self,
        (job, view): (&Job<'_>, u8),
        picture: &ColorPicture,
        (place, base_from_camera): (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, Reason> {
        let index = self.corners.aimed;
        let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
        let taught: &TaughtCorner = job.corners.get(index).ok_or_else(no_corner)?;
        let expected = base_from_camera.inverse() * (place * taught.point);
        let (settings, camera) = (job.recipe.corner(), &job.calibrations.flange_camera);
        let found = corner::find_taught(&picture.to_gray(), (settings, index), camera, expected)
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

#[cfg(test)]
mod tests;
