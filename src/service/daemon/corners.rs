//! The corner loop: decides which taught corners are viewed, combines the results of their pictures, and checks just
//! before contact that the corners are still at their expected positions.
//!
//! Two corners determine the panel's shift and rotation; more corners improve the result little. The loop uses the
//! first corners, in the order of teaching, whose moves pass the path checks. View n shows the n-th of these corners;
//! after the last corner, the views begin again with the first corner.
//!
//! There are two loops: one corrects the pose, the other verifies it. Both continue until each chosen corner was seen;
//! the first one also until each corner was at its expected position. The loop that verifies the pose must see all
//! corners by which the pose was corrected, so that one corner alone is never enough.

use crate::setup::CycleSetup;
use crate::stages::corners::{Sighting, max_views};
use panelprep_base::verdict::Reason;

/// The corners of a corner loop, as indices of the taught corners.
#[derive(Debug, Default, Clone)]
pub(super) struct CornerLoop {
    /// The chosen corners, in the order of the views.
    selected: Vec<usize>,
    /// The corner to which the camera is sent, as index of the taught corners.
    aimed: usize,
    /// Whether the moves to all other corners fail the path checks.
    is_exhausted: bool,
    /// The last picture of each corner.
    pub(super) sightings: Vec<Sighting>,
    /// The corners by which the panel's pose was corrected; empty before the correction.
    held: Vec<usize>,
    /// The corners whose moves have failed the path checks since the loop began, with the reasons.
    left_out: Vec<(usize, String)>,
}

impl CornerLoop {
    /// Returns the taught corner to which the camera is being sent, or was sent last.
    pub fn aimed_corner(&self) -> usize {
        self.aimed
    }

    /// Returns the corners that may be chosen for a view, in order; empty if a corner was already chosen for this view.
    pub fn candidates(&self, view: u8, cycle: &CycleSetup) -> Vec<usize> {
        let view = usize::from(view);
        if view > 0 && (view >= self.required_count(cycle) || view > self.selected.len()) {
            return Vec::new();
        }
        let all = if self.held.is_empty() { (0..cycle.corners.len()).collect() } else { self.held.clone() };
        all.into_iter().filter(|index| !self.selected[..view].contains(index)).collect()
    }

    /// Begins the choice of a corner for a view.
    pub fn begin_selection(&mut self, view: u8) {
        if view == 0 {
            self.left_out.clear();
        }
    }

    /// Records that the move to this corner fails the path checks, and why.
    pub fn exclude_corner(&mut self, corner: usize, why: &str) {
        self.left_out.push((corner, why.to_owned()));
    }

    /// Returns the corners by which the panel's pose was corrected, in the order of the views; empty before the
    /// correction.
    pub fn correction_corners(&self) -> &[usize] {
        &self.held
    }

    /// Describes the excluded corners and the reasons.
    pub fn describe_excluded(&self) -> Vec<String> {
        self.left_out.iter().map(|(corner, why)| format!("corner {}: {why}", corner + 1)).collect()
    }

    /// Chooses a corner for a view.
    pub fn choose(&mut self, view: u8, corner: usize) {
        self.selected.truncate(usize::from(view));
        self.selected.push(corner);
        (self.aimed, self.is_exhausted) = (corner, false);
    }

    /// Ends the choice without a result: the moves to all candidates fail the path checks, so only the corners that
    /// were chosen before remain.
    pub fn end_selection(&mut self, view: u8) {
        self.selected.truncate(usize::from(view).max(1));
        self.is_exhausted = true;
    }

    /// Aims at the corner of a view; after the last chosen corner, the views begin again with the first corner.
    pub fn advance_to_view(&mut self, view: u8) {
        if let Some(&corner) = self.selected.get(usize::from(view) % self.selected.len().max(1)) {
            self.aimed = corner;
        }
    }

    /// Returns the number of corners that must be seen.
    fn required_count(&self, cycle: &CycleSetup) -> usize {
        let all = if self.held.is_empty() {
            max_views(cycle.recipe.corner(), cycle.corners.len())
        } else {
            self.held.len()
        };
        if self.is_exhausted { self.selected.len().min(all) } else { all }
    }

    /// Stores the chosen corners that were seen, as the corners by which the panel's pose is corrected.
    pub fn hold(&mut self) {
        self.held = self.selected.clone();
        self.held.retain(|corner| self.sightings.iter().any(|seen| seen.corner == *corner));
    }

    pub fn is_missing(&self, cycle: &CycleSetup) -> bool {
        self.sightings.len() < self.required_count(cycle)
    }

    /// Returns a reason if no permitted move leads to one of the corners by which the pose was corrected, because that
    /// corner then cannot confirm the pose.
    pub fn missing_corner_reason(&self) -> Option<Reason> {
        let is_seen = |corner: &&usize| self.sightings.iter().any(|seen| seen.corner == **corner);
        let missing: Vec<String> =
            self.held.iter().filter(|it| !is_seen(it)).map(|corner| format!("corner {}", corner + 1)).collect();
        (self.is_exhausted && !missing.is_empty()).then(|| {
            let message = format!(
                "{} corrected the panel's pose and cannot be viewed again for verification: {}. Remove the cause, \
                 or dry the panel and locate it again",
                missing.join(" and "),
                self.describe_excluded().join("; ")
            );
            Reason::new("corner_unseen", message)
        })
    }

    pub fn record_sighting(&mut self, view: u8, seen: Sighting) {
        if view == 0 {
            self.sightings.clear();
        }
        self.sightings.retain(|other| other.corner != seen.corner);
        self.sightings.push(seen);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::{Pixel, Point, Rigid, Vector};
    use panelprep_cell::panel::{CornerTeaching, TaughtCorner, panel_from_base_at_teaching};

    /// Corners 2 and 1 determine the pose of the panel. Before contact, no permitted motion leads to corner 1, and
    /// corner 2 alone is not enough.
    #[test]
    fn corners_of_the_correction_must_be_seen_again() {
        let place = panel_from_base_at_teaching().inverse();
        let (reference_px, panel_from_camera) =
            (Pixel::at(0.0, 0.0), Rigid::from_isometry_unchecked(*place.isometry()));
        let taught = TaughtCorner {
            teaching_data: CornerTeaching { reference_px, panel_from_camera },
            point: Point::at(0.0, 0.0, 0.0),
            normal: Vector::new(nalgebra::Vector3::z()),
        };
        let sighting = |corner: usize| Sighting {
            corner,
            taught,
            base_from_camera: Rigid::from_isometry_unchecked(*place.isometry()),
            found_px: reference_px,
            search_pose: place,
        };
        let mut corners = CornerLoop::default();
        let look = |corners: &mut CornerLoop, view: u8, corner: usize| {
            corners.choose(view, corner);
            corners.record_sighting(view, sighting(corner));
        };
        look(&mut corners, 0, 1);
        look(&mut corners, 1, 0);
        assert!(corners.missing_corner_reason().is_none() && corners.correction_corners().is_empty());
        corners.hold();
        assert_eq!(corners.correction_corners(), [1, 0]);
        corners.begin_selection(0);
        look(&mut corners, 0, 1);
        corners.choose(1, 0);
        corners.exclude_corner(0, "a post is in the way");
        corners.end_selection(1);
        corners.advance_to_view(1);
        assert_eq!(corners.aimed_corner(), 1);
        let unseen = corners.missing_corner_reason().expect("a reason");
        assert_eq!(unseen.code, "corner_unseen");
        assert!(unseen.message.starts_with("corner 1 ") && unseen.message.contains("a post"), "{}", unseen.message);
        // After all corners were seen, no corner is missing.
        look(&mut corners, 1, 0);
        assert!(corners.missing_corner_reason().is_none());
    }
}
