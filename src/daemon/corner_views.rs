//! Evaluates corner pictures: corrects the panel's pose by all corners, and checks before contact whether the corners
//! are still at their positions.

use super::answers::{MISSING, blind, figure, grade, reason, unseen};
use super::error::DaemonError;
use super::perception::Perception;
use super::ports::{CameraPort, Record};
use super::setup::CycleSetup;
use crate::cycle::{Answer, Grade};
use crate::geometry::{Base, ColorPicture, FlangeCamera, Panel, Rigid};
use crate::record::Kind;
use crate::stages::Drawing;
use crate::stages::corners::{Progress, Sighting, Taught};
use crate::verdict::Reason;

fn taught<'a>(cycle: &'a CycleSetup) -> Taught<'a> {
    Taught {
        corners: &cycle.corners,
        camera: &cycle.calibrations.flange_camera,
        lens: &cycle.lens,
        limits: cycle.recipe.corner(),
    }
}

fn not_in_view(error: impl std::error::Error) -> Reason {
    reason("not_in_view", &error)
}

impl Perception {
    /// Takes a corner picture from `base_from_camera`, and corrects the panel's pose by all corner pictures. `moves`
    /// is the number of moves made before.
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
            Err(error) => return blind(Kind::Refine, 0, &error, record),
        };
        record.picture(&format!("corner{moves}"), &picture)?;
        let claims_mm = self.located_mm.zip(cycle.calibrations.hand_eye_mm).map(<[f64; 2]>::from);
        let looked = self.look((cycle, moves), &picture, (place, base_from_camera)).and_then(|sighting| {
            let progress = Progress { moves: usize::from(moves), is_missing: self.corners.is_missing(cycle) };
            let claims = (claims_mm, Some(progress));
            let correction = taught(cycle).refine(located, &self.corners.seen, claims).map_err(not_in_view)?;
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
            if let Some(drawing) = taught(cycle).drawn((&sighting, &picture), place, title) {
                record.figure(&figure(drawing, &picture))?;
            }
        }
        let found = correction.finding(&self.corners.left_out());
        let grade = grade(&found.judgement);
        record.finding(&found)?;
        self.place = Some(corrected);
        // A rejected corner is not viewed again from nearer.
        if correction.wants_another_view && grade != Grade::Reject {
            return Ok(Answer::LookOn);
        }
        self.corners.hold();
        Ok(Answer::Graded(grade))
    }

    /// Views the corners again, wet or dry, and checks whether they are still at the positions that the localization
    /// gives.
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
            Err(error) => return blind(Kind::Verify, pass, &error, record),
        };
        record.picture(&format!("verify{view}"), &picture)?;
        let looked = self.look((cycle, view), &picture, (place, base_from_camera)).and_then(|sighting| {
            let (corners, unseen) = (&self.corners.seen, self.corners.unseen());
            Ok((sighting, taught(cycle).verify(place, corners, unseen).map_err(not_in_view)?))
        });
        let (sighting, verification) = match looked {
            Ok(seen) => seen,
            Err(reason) => return self.unseen_corner((Kind::Verify, pass), (reason, &picture), record),
        };
        if let Some(drawing) = taught(cycle).drawn((&sighting, &picture), place, ("verify", "before contact")) {
            record.figure(&figure(drawing, &picture))?;
        }
        let grade = grade(&verification.judgement);
        let goes_on = grade == Grade::Accept && self.corners.is_missing(cycle);
        // If other views follow this one, not all corners must have been seen yet.
        let needed = (!goes_on).then_some(self.corners.held().len());
        record.finding(&verification.finding(pass, needed))?;
        Ok(if goes_on { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// Finds the corner to which the camera was sent in the picture of a view; `place` states where the corner is
    /// expected.
    fn look(
        &mut self,
        (cycle, view): (&CycleSetup, u8),
        picture: &ColorPicture,
        place: (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, Reason> {
        let index = self.corners.aimed();
        let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
        let corner = (index, cycle.corners.get(index).ok_or_else(no_corner)?);
        let found = taught(cycle).find(corner, picture, place).map_err(|error| reason("no_corner", &error))?;
        self.corners.see(view, found);
        Ok(found)
    }

    /// Records a picture in which no corner was found, without a drawing on it.
    fn unseen_corner(
        &self,
        (kind, pass): (Kind, u8),
        (reason, picture): (Reason, &ColorPicture),
        record: &mut dyn Record,
    ) -> Result<Answer, DaemonError> {
        let which = self.corners.aimed() + 1;
        let caption = format!("The flange camera's picture in which corner {which} was not found");
        let bare = Drawing { name: "no_corner".to_owned(), caption, picture: Ok(picture.clone()) };
        record.figure(&figure(bare, picture))?;
        unseen(kind, pass, reason, record)
    }
}
