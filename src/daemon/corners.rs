//! The corner loop: which taught corners are looked at, what their pictures say together, and whether they still stand where
//! they should just before contact.
//!
//! Two corners hold the panel's shift and its turn; more say little more. The first ones in the order of teaching are
//! taken whose moves pass the gate. View n looks at the n-th of them, and round again: so both loops go on from view to view
//! until each chosen corner was seen, and in the first loop until each stood where it was looked for. The corners that hold
//! the place after the first loop are the ones that the second must see: what one of them alone says is not enough then.

use super::ports::{Eyes, Record};
use super::sight::{MISSING, Sight, blind, figure, grade, reason, unseen};
use super::{DaemonError, Job};
use crate::cycle::{Answer, Grade};
use crate::geometry::{Base, ColorPicture, FlangeCamera, Panel, Rigid};
use crate::record::Kind;
use crate::stages::Drawing;
use crate::stages::corners::{Progress, Sighting, Taught, most};
use crate::verdict::Reason;

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
    seen: Vec<Sighting>,
    /// Those by which the place was corrected, once that is done.
    held: Vec<usize>,
    /// Those whose moves did not pass the gate since the loop began, and why.
    left_out: Vec<(usize, String)>,
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
        let all = if self.held.is_empty() { most(job.recipe.corner(), job.corners.len()) } else { self.held.len() };
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

    fn see(&mut self, view: u8, seen: Sighting) {
        if view == 0 {
            self.seen.clear();
        }
        self.seen.retain(|other| other.corner != seen.corner);
        self.seen.push(seen);
    }
}

fn taught<'a>(job: &'a Job<'_>) -> Taught<'a> {
    Taught { corners: job.corners, camera: &job.calibrations.flange_camera, limits: job.recipe.corner() }
}

fn not_in_view(error: impl std::error::Error) -> Reason {
    reason("not_in_view", &error)
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
        let claims_mm = self.located_mm.zip(job.calibrations.hand_eye_mm).map(<[f64; 2]>::from);
        let looked = self.look((job, moves), &picture, (place, base_from_camera)).and_then(|sighting| {
            let progress = Progress { moves: usize::from(moves), is_missing: self.corners.is_missing(job) };
            let claims = (claims_mm, Some(progress));
            let correction = taught(job).refine(located, &self.corners.seen, claims).map_err(not_in_view)?;
            Ok((sighting, correction))
        });
        let (sighting, correction) = match looked {
            Ok(seen) => seen,
            Err(reason) => return self.unseen_corner((Kind::Refine, 0), (reason, &picture), record),
        };
        let corrected = correction.refined.base_from_panel;
        for (place, title) in [
            (place, ("corner_before", "before the correction")),
            (corrected, ("corner_after", "after the correction")),
        ] {
            if let Some(drawing) = taught(job).drawn((&sighting, &picture), place, title) {
                record.figure(&figure(drawing, &picture))?;
            }
        }
        let grade = grade(&correction.judgement);
        record.finding(&correction.finding(&self.corners.left_out()))?;
        self.place = Some(corrected);
        // What is rejected is not looked at again from nearer.
        if correction.wants_another_view && grade != Grade::Reject {
            return Ok(Answer::LookOn);
        }
        self.corners.hold();
        Ok(Answer::Graded(grade))
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
        let looked = self.look((job, view), &picture, (place, base_from_camera)).and_then(|sighting| {
            let (corners, unseen) = (&self.corners.seen, self.corners.unseen());
            Ok((sighting, taught(job).verify(place, corners, unseen).map_err(not_in_view)?))
        });
        let (sighting, verification) = match looked {
            Ok(seen) => seen,
            Err(reason) => return self.unseen_corner((Kind::Verify, pass), (reason, &picture), record),
        };
        if let Some(drawing) = taught(job).drawn((&sighting, &picture), place, ("verify", "before contact")) {
            record.figure(&figure(drawing, &picture))?;
        }
        let grade = grade(&verification.judgement);
        let goes_on = grade == Grade::Accept && self.corners.is_missing(job);
        // A view that others follow need not have seen all.
        let needed = (!goes_on).then_some(self.corners.held.len());
        record.finding(&verification.finding(pass, needed))?;
        Ok(if goes_on { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// The corner that the camera was sent to, in the picture from a view; `place` is where it was looked for.
    fn look(
        &mut self,
        (job, view): (&Job<'_>, u8),
        picture: &ColorPicture,
        place: (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, Reason> {
        let index = self.corners.aimed;
        let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
        let corner = (index, job.corners.get(index).ok_or_else(no_corner)?);
        let found = taught(job).find(corner, picture, place).map_err(|error| reason("no_corner", &error))?;
        self.corners.see(view, found);
        Ok(found)
    }

    /// A picture that shows no corner is shown as it is.
    fn unseen_corner(
        &self,
        (kind, pass): (Kind, u8),
        (reason, picture): (Reason, &ColorPicture),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let which = self.corners.aimed + 1;
        let caption = format!("The flange camera's picture in which corner {which} was not found");
        let bare = Drawing { name: "no_corner".to_owned(), caption, picture: Ok(picture.clone()) };
        record.figure(&figure(bare, picture))?;
        unseen(kind, pass, reason, record)
    }
}

#[cfg(test)]
mod tests;
