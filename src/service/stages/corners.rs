//! Evaluation of the flange camera's pictures of taught corners: the correction of a localization, and, immediately
//! before contact, the check whether the corners are still where the localization predicts them.
//!
//! Each corner is searched for in its own picture. Then all corners together correct or confirm the panel's pose; if
//! several corners were seen, the result never depends on one corner alone.

use super::ResultDrawing;
use crate::report;
use panelprep_base::geometry::{Base, ColorPicture, FlangeCamera, KukaPose, Panel, PinholeCamera, Pixel, Rigid};
use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::{Judgement, LimitSource, Reason, Severity};
use panelprep_cell::cell::LensExtent;
use panelprep_cell::panel::TaughtCorner;
use panelprep_cell::recipe;
use panelprep_cell::record::{Check, Finding, Kind, name};
use panelprep_vision::calib::health;
use panelprep_vision::locate::corner::{self, CornerError};
use panelprep_vision::locate::refine::{self, CornerView, RefineError, RefinedPose};
use serde_json::json;

/// Maximum number of corners that are viewed: two determine the shift and the rotation of the panel, and more corners
/// add little accuracy.
const MAX_CORNERS: usize = 2;

/// Returns the maximum number of views in a loop, if all `taught` corners can be seen.
pub fn max_views(limits: &recipe::Corner, taught: usize) -> usize {
    MAX_CORNERS.min(limits.max_moves() + 1).min(taught)
}

/// The data with which corner pictures are compared.
#[derive(Debug, Clone, Copy)]
pub struct CornerReference<'a> {
    /// The taught corners, in the order of teaching.
    pub corners: &'a [TaughtCorner],
    /// The flange camera.
    pub camera: &'a PinholeCamera,
    /// The part of the flange camera's picture in which its lens is calibrated; the position of a corner outside of it
    /// is not trusted.
    pub lens: &'a LensExtent,
    /// The recipe's `[corner]`.
    pub limits: &'a recipe::Corner,
}

/// A taught corner that was detected in a picture.
#[derive(Debug, Clone, Copy)]
pub struct Sighting {
    /// Index of the corner among the taught corners, from 0.
    pub corner: usize,
    /// The taught data of the corner.
    pub taught: TaughtCorner,
    /// The pose of the camera at the picture.
    pub base_from_camera: Rigid<Base, FlangeCamera>,
    /// The detected position of the corner in the picture, px.
    pub found_px: Pixel,
    /// The assumed pose of the panel, from which the search position was computed.
    pub search_pose: Rigid<Base, Panel>,
}

/// The state of a loop of views, in which the camera moves closer from picture to picture.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// Number of moves after the first picture.
    pub moves: usize,
    /// Whether at least one corner has not been seen yet.
    pub is_missing: bool,
}

impl CornerReference<'_> {
    /// Detects a taught corner in a picture; `place` is the assumed pose of the panel.
    ///
    /// # Errors
    /// If the picture shows no corner of the panel.
    pub fn find(
        &self,
        (corner, taught): (usize, &TaughtCorner),
        picture: &ColorPicture,
        (place, base_from_camera): (Rigid<Base, Panel>, Rigid<Base, FlangeCamera>),
    ) -> Result<Sighting, CornerError> {
        let expected = base_from_camera.inverse() * (place * taught.point);
        let found = corner::find_taught(&picture.to_gray(), (self.limits, corner), self.camera, expected)?;
        Ok(Sighting { corner, taught: *taught, base_from_camera, found_px: found.corner_px, search_pose: place })
    }

    /// Returns the pose that results from all sightings together, starting from an assumed pose of the panel.
    fn combine_sightings(
        &self,
        place: Rigid<Base, Panel>,
        sightings: &[Sighting],
    ) -> Result<RefinedPose, RefineError> {
        let views: Vec<CornerView<'_>> = sightings.iter().map(Sighting::view).collect();
        refine::refine(place, self.camera, &views)
    }

    /// Corrects a localization by corner pictures. `claims_mm` are the uncertainties of localization and calibrations,
    /// 95 %, if they are known; `progress` is given if the pictures are those of a loop of views.
    ///
    /// # Errors
    /// If there is no sighting, or a corner is not in front of its camera.
    pub fn refine(
        &self,
        located: Rigid<Base, Panel>,
        sightings: &[Sighting],
        (claims_mm, progress): (Option<[f64; 2]>, Option<Progress>),
    ) -> Result<Correction, RefineError> {
        let refined = self.combine_sightings(located, sightings)?;
        let views = progress.map(|progress| ViewLoop {
            progress,
            is_last: progress.moves >= self.limits.max_moves(),
            step_mm: step_mm(&refined, sightings),
        });
        let correction = Correction::judge_correction(refined, claims_mm, views, self.limits);
        Ok(correction.with_check(self.lens_extent_check(sightings)))
    }

    /// Returns a failed check if a corner was detected outside of the calibrated part of the lens.
    fn lens_extent_check(&self, sightings: &[Sighting]) -> Option<Check> {
        let outside = health::lens_extent_refusal(self.lens, sightings.iter().map(|sighting| sighting.found_px))?;
        let check = Check::new("corner where the lens is known", "", None);
        Some(check.with_reason(Some(outside), Severity::Reject))
    }

    /// Checks whether the corners are where the pose `place` predicts them. `unseen` states which of the corners that
    /// determine the pose cannot be seen again, if there are any.
    ///
    /// # Errors
    /// The errors of [`CornerReference::refine`].
    pub fn verify(
        &self,
        place: Rigid<Base, Panel>,
        sightings: &[Sighting],
        unseen: Option<Reason>,
    ) -> Result<Verification, RefineError> {
        let seen = self.combine_sightings(place, sightings)?;
        let count = Check::new(name::CORNERS, "", seen.corners.len() as f64).with_reason(unseen, Severity::Review);
        let mut checks = refine::position_checks(&seen, self.limits);
        checks.extend(self.lens_extent_check(sightings).map(|check| check.with_max_severity(Severity::Review)));
        let judgement = Judgement::from_checks(&checks).combined_with(Judgement::from_checks([&count]));
        Ok(Verification { checks, count, judgement })
    }

    /// Draws the corner in its picture, at the detected position and at the position predicted from a pose of the
    /// panel; `None` if the predicted position is not in front of the camera.
    pub fn draw_corner(
        &self,
        (sighting, picture): (&Sighting, &ColorPicture),
        place: Rigid<Base, Panel>,
        (name, title): (&str, &str),
    ) -> Option<ResultDrawing> {
        let in_camera = sighting.base_from_camera.inverse() * (place * sighting.taught.point);
        let view = report::CornerView {
            picture,
            expected_px: self.camera.project(in_camera)?,
            found_px: sighting.found_px,
            px_per_mm: self.camera.px_per_mm_at(in_camera.mm.z).0,
        };
        let which = sighting.corner + 1;
        let caption = format!("Flange camera picture of corner {which}, {title}: expected and found position");
        Some(ResultDrawing::new(name, caption, view.draw(title)))
    }
}

impl Sighting {
    fn view(&self) -> CornerView<'_> {
        let Sighting { corner, taught, base_from_camera, found_px, .. } = self;
        CornerView { corner: *corner, taught, base_from_camera: *base_from_camera, found_px: *found_px }
    }
}

/// Returns the maximum distance between the corrected position of a corner and its position in the assumed pose, mm.
fn step_mm(refined: &RefinedPose, sightings: &[Sighting]) -> f64 {
    let step_mm =
        |seen: &Sighting| refined.base_from_panel.distance_at_mm(seen.search_pose, seen.taught.point).abs();
    // `abs` makes the sign of a NaN positive, so that a NaN is treated as the maximum distance.
    sightings.iter().map(step_mm).max_by(f64::total_cmp).unwrap_or(f64::NAN)
}

/// The state of a loop of views after a picture.
#[derive(Debug, Clone, Copy)]
struct ViewLoop {
    progress: Progress,
    /// Whether no further view follows.
    is_last: bool,
    /// The maximum distance between the corrected position of a corner and its search position, mm.
    step_mm: f64,
}

impl ViewLoop {
    fn has_converged(self, limits: &recipe::Corner) -> bool {
        self.step_mm <= limits.settled_mm()
    }

    /// Returns whether all corners were seen from close range.
    fn are_all_seen(self, limits: &recipe::Corner) -> bool {
        !self.progress.is_missing && self.has_converged(limits)
    }

    /// Returns the checks of a loop of views: it converges, needs at most the permitted number of moves, and has seen
    /// all corners.
    fn checks(self, seen: usize, limits: &recipe::Corner) -> [Check; 3] {
        let (is_done, step_mm) = (self.are_all_seen(limits), self.step_mm);
        let step = Check::new("corner from where it was looked for", "mm", step_mm);
        // A loop that has not converged continues with a move and another picture, so the limit applies only at its
        // end.
        let step = if is_done || self.is_last {
            step.with_max(limits.settled_mm(), LimitSource::recipe("corner.settled_mm"))
        } else {
            step
        };
        let is_unsettled = self.is_last && !self.has_converged(limits);
        let is_unseen = self.is_last && self.progress.is_missing;
        [
            step.with_consequence_if(is_unsettled, Severity::Reject, "not_settled", || not_converged_text(step_mm, limits)),
            Check::new(name::CORRECTION_MOVES_NAME, "", self.progress.moves as f64)
                .with_max(limits.max_moves() as f64, LimitSource::recipe("corner.max_moves")),
            Check::new(name::CORNERS, "", seen as f64).with_consequence_if(is_unseen, Severity::Reject, "corner_unseen", || {
                format!(
                    "not all corners were seen within {} moves ([corner] max_moves); clear what covers the corner \
                     or blocks the arm's way to it",
                    limits.max_moves()
                )
            }),
        ]
    }
}

fn not_converged_text(step_mm: f64, limits: &recipe::Corner) -> String {
    let (settled_mm, moves) = (limits.settled_mm(), limits.max_moves());
    let [step, settled] = distinguishable_texts(step_mm, settled_mm, 2);
    format!(
        "after {moves} moves ([corner] max_moves), a corner is still {step} mm from its expected position (limit \
         {settled} mm, settled_mm); check the hand-eye calibration, and that the panel does not move"
    )
}

/// A localization that was corrected by corner pictures.
#[derive(Debug, Clone)]
pub struct Correction {
    /// The corrected pose and its evidence.
    pub refined: RefinedPose,
    /// Every check of the correction.
    pub checks: Vec<Check>,
    /// The verdict.
    pub judgement: Judgement,
    /// Whether another view may help: not all corners were seen from close range, and moves are left.
    pub is_another_view_useful: bool,
}

impl Correction {
    fn judge_correction(
        refined: RefinedPose,
        claims_mm: Option<[f64; 2]>,
        views: Option<ViewLoop>,
        limits: &recipe::Corner,
    ) -> Self {
        let is_done = views.is_none_or(|views| views.are_all_seen(limits));
        let wants_another_view = !is_done && views.is_some_and(|views| !views.is_last);
        // Contradictions between corners become reasons for a review only after all corners were seen from close range.
        // A check that rejects does not wait for another view.
        let claims_mm = claims_mm.filter(|_| is_done);
        let is_open = |check: &Check| wants_another_view && check.severity < Severity::Reject;
        let of_corners: Vec<Check> = refine::checks(&refined, limits)
            .into_iter()
            .map(|check| if is_open(&check) { check.without_consequence() } else { check })
            .collect();
        let seen = refined.corners.len();
        let mut of_views = match views {
            Some(views) => views.checks(seen, limits).to_vec(),
            None => vec![Check::new(name::CORNERS, "", seen as f64)],
        };
        of_views.extend(claims_mm.and_then(|claims_mm| refine::worst_disagreement(&refined, &claims_mm)));
        let judgement = Judgement::from_checks(&of_corners).combined_with(Judgement::from_checks(&of_views));
        let checks = [of_corners, correction_motion(&refined).to_vec(), of_views].concat();
        Correction { refined, checks, judgement, is_another_view_useful: wants_another_view }
    }

    /// Adds a failed check of the pictures themselves to the result, if there is one.
    fn with_check(mut self, of_pictures: Option<Check>) -> Self {
        if let Some(check) = of_pictures {
            self.judgement = self.judgement.combined_with(Judgement::from_checks([&check]));
            self.checks.push(check);
        }
        self
    }

    /// Returns the result for the record; `left_out` states which corners the arm could not reach, and why.
    pub fn finding(&self, left_out: &[String]) -> Finding {
        let finding = Finding::new(Kind::Refine, 0, self.judgement.clone())
            .with_detail("base_from_panel", json!(KukaPose::from_rigid(&self.refined.base_from_panel)))
            .with_checks(self.checks.iter().cloned());
        if left_out.is_empty() { finding } else { finding.with_detail("corners_left_out", json!(left_out)) }
    }
}

/// Returns the shift and the rotation by which the correction changes the panel's pose.
fn correction_motion(refined: &RefinedPose) -> [Check; 3] {
    let [x_mm, y_mm] = refined.shift_mm;
    let first = refined.corners.first().map_or(String::new(), |corner| format!("corner {}", corner.corner + 1));
    let turned_deg = (refined.corners.len() > 1).then_some(refined.rotation.0);
    [
        Check::new(format!("correction along the camera's x at {first}"), "mm", x_mm),
        Check::new(format!("correction along the camera's y at {first}"), "mm", y_mm),
        Check::new("turned by two corners", "°", turned_deg),
    ]
}

/// The result of the verification immediately before contact.
#[derive(Debug, Clone)]
pub struct Verification {
    /// Checks of the distance of each corner from its position according to the localization.
    pub checks: Vec<Check>,
    /// The number of corners that were seen.
    count: Check,
    /// The verdict.
    pub judgement: Judgement,
}

impl Verification {
    /// Returns the result for the record; after the last view, at least `needed` corners must have been seen.
    pub fn finding(&self, pass: u8, needed: Option<usize>) -> Finding {
        let count = match needed {
            Some(needed) => self.count.clone().with_min(needed as f64, LimitSource::Program),
            None => self.count.clone(),
        };
        Finding::new(Kind::Verify, pass, self.judgement.clone())
            .with_checks(self.checks.iter().cloned())
            .with_checks([count])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::geometry::Degrees;
    use panelprep_base::verdict::Verdict;
    use panelprep_cell::panel::panel_from_base_at_teaching;
    use panelprep_cell::recipe::Recipe;
    use panelprep_vision::locate::refine::CornerReport;

    fn recipe() -> Recipe {
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        Recipe::check("test.toml", text).unwrap_or_else(|problems| panic!("{problems}"))
    }

    /// Returns a correction by two corners that contradict each other: each requires a shift of 1 mm, and a residual of
    /// 0.4 mm remains; the limit for one rigid panel is 0.3 mm.
    fn corners_that_contradict() -> RefinedPose {
        let expected_px = Pixel::at(0.0, 0.0);
        let report = |corner| CornerReport {
            corner,
            expected_px,
            error_px: 10.0,
            shift_mm: [1.0, 0.0],
            remaining_shift_mm: 0.4,
        };
        let base_from_panel = panel_from_base_at_teaching().inverse();
        let corners = vec![report(0), report(1)];
        RefinedPose { base_from_panel, shift_mm: [1.0, 0.0], rotation: Degrees(0.0), error_px: 10.0, corners }
    }

    fn views(is_missing: bool, is_last: bool, step_mm: f64) -> ViewLoop {
        ViewLoop { progress: Progress { moves: 1, is_missing }, is_last, step_mm }
    }

    fn codes(judgement: &Judgement) -> Vec<&str> {
        judgement.reasons.iter().map(|reason| &*reason.code).collect()
    }

    /// A reason for a review does not hide the rejection of a pose that does not converge: no person may accept such a
    /// pose.
    #[test]
    fn a_review_does_not_hide_a_rejection() {
        let recipe = recipe();
        let judged = |views: ViewLoop, claims_mm| {
            Correction::judge_correction(corners_that_contradict(), claims_mm, Some(views), recipe.corner())
                .judgement
        };
        let judgement = judged(views(false, true, 0.9), Some([0.1; 2]));
        let codes_of_both = vec!["not_settled", "corners_disagree"];
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Reject, codes_of_both));
        let judgement = judged(views(false, true, 0.1), Some([0.1; 2]));
        let both = vec!["corners_disagree", "corner_disagrees"];
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Review, both));
        for wrong in [views(false, true, f64::NAN), views(true, true, 0.1)] {
            assert_eq!(judged(wrong, None).verdict, Verdict::Reject, "{wrong:?}");
        }
    }

    /// If another view follows, the reasons for a review are not final, and no person is asked to decide about them.
    #[test]
    fn a_view_before_the_last_one_gives_no_review() {
        let recipe = recipe();
        let judged = |views: ViewLoop| {
            Correction::judge_correction(corners_that_contradict(), Some([0.1; 2]), Some(views), recipe.corner())
        };
        let (followed, last) = (judged(views(true, false, 2.0)), judged(views(false, true, 0.1)));
        assert_eq!((followed.judgement.verdict, last.judgement.verdict), (Verdict::Accept, Verdict::Review));
        assert!(followed.finding(&[]).checks.iter().all(Check::is_met));
    }

    /// A corner is measured less accurately from a large distance: while moves are left, it is viewed from close range
    /// before its reasons for a review are reported.
    #[test]
    fn views_are_requested_until_all_corners_were_seen_closely() {
        let recipe = recipe();
        let wants = |views: Option<ViewLoop>| {
            Correction::judge_correction(corners_that_contradict(), Some([0.1; 2]), views, recipe.corner())
                .is_another_view_useful
        };
        assert!(wants(Some(views(false, false, 2.0))) && wants(Some(views(true, false, 0.1))));
        assert!(!wants(Some(views(false, false, 0.1))) && !wants(Some(views(false, true, 2.0))));
        assert!(!wants(None), "pictures that were not taken in a loop are all there are");
    }

    /// Pictures from files are evaluated like those of a loop that has seen all corners from close range.
    #[test]
    fn a_completed_loop_judges_like_a_command() {
        let recipe = recipe();
        let judged =
            |views| Correction::judge_correction(corners_that_contradict(), Some([0.1; 2]), views, recipe.corner());
        let (command, done) = (judged(None), judged(Some(views(false, false, 0.1))));
        assert_eq!(command.judgement, done.judgement);
        let numbers = |correction: &Correction| -> Vec<(String, Option<f64>)> {
            let of_loop = ["corner from where it was looked for", name::CORRECTION_MOVES_NAME];
            let checks = correction.checks.iter().filter(|check| !of_loop.contains(&&*check.name));
            checks.map(|check| (check.name.clone(), check.value)).collect()
        };
        assert_eq!(numbers(&command), numbers(&done));
    }
}
