//! Evaluates corner pictures: corrects the panel's pose by all corners, and checks before contact whether the corners
//! are still at their positions.

use super::answers::{MISSING, camera_fault_answer, figure, grade_judgement, reason, unusable_picture_answer};
use super::error::DaemonError;
use super::perception::Perception;
use super::ports::{CameraPort, Record};
use super::setup::CycleSetup;
use crate::stages::ResultDrawing;
use crate::stages::corners::{CornerReference, Progress, Sighting};
use panelprep_base::geometry::{Base, ColorPicture, FlangeCamera, Panel, Rigid};
use panelprep_base::verdict::Reason;
use panelprep_cell::cycle::{Answer, Grade};
use panelprep_cell::record::Kind;

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
            Err(reason) => return self.unseen_corner((Kind::Refine, 0), (reason, &picture), record),
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
        // A rejected corner is not viewed again from nearer.
        if correction.is_another_view_useful && grade != Grade::Reject {
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
            Err(error) => return camera_fault_answer(Kind::Verify, pass, &error, record),
        };
        record.picture(&format!("verify{view}"), &picture)?;
        let looked = self.find_corner((cycle, view), &picture, (place, base_from_camera)).and_then(|sighting| {
            let (corners, unseen) = (&self.corners.sightings, self.corners.missing_corner_reason());
            Ok((sighting, taught(cycle).verify(place, corners, unseen).map_err(not_in_view_reason)?))
        });
        let (sighting, verification) = match looked {
            Ok(seen) => seen,
            Err(reason) => return self.unseen_corner((Kind::Verify, pass), (reason, &picture), record),
        };
        if let Some(drawing) = taught(cycle).draw_corner((&sighting, &picture), place, ("verify", "before contact"))
        {
            record.figure(&figure(drawing, &picture))?;
        }
        let grade = grade_judgement(&verification.judgement);
        let goes_on = grade == Grade::Accept && self.corners.is_missing(cycle);
        // If other views follow this one, not all corners must have been seen yet.
        let needed = (!goes_on).then_some(self.corners.correction_corners().len());
        record.finding(&verification.finding(pass, needed))?;
        Ok(if goes_on { Answer::LookOn } else { Answer::Graded(grade) })
    }

    /// Finds the corner to which the camera was sent in the picture of a view; `place` states where the corner is
    /// expected.
    fn find_corner(
        &mut self,
        (cycle, view): (&CycleSetup, u8),
        picture: &ColorPicture,
        place: (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, Reason> {
        let index = self.corners.aimed_corner();
        let no_corner = || Reason::new("no_corner", "no corner of this panel was taught");
        let corner = (index, cycle.corners.get(index).ok_or_else(no_corner)?);
        let found = taught(cycle).find(corner, picture, place).map_err(|error| reason("no_corner", &error))?;
        self.corners.record_sighting(view, found);
        Ok(found)
    }

    /// Records a picture in which no corner was found, without a drawing on it.
    fn unseen_corner(
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
