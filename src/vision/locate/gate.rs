//! The gate of the localization: turns evidence into accept, review or reject, each with reasons in words.
//!
//! The gate answers three questions in this order. Is this the taught panel, complete and dry, and has the camera not
//! moved? A panel that is bent is this panel as long as a smooth deviation explains its surface; the recipe limits how
//! far it may be bent. Is its pose known well enough, and is it unique? Is the pose within its limits? Shift, rotation
//! and tilt are judged at the panel's centre and never at the base's origin: a small rotation moves a distant origin
//! far, which is not information about the panel. Evidence against the panel itself leads to reject; evidence that a
//! person can judge better leads to review.

mod camera;
mod pose;

pub use camera::{MAX_CAMERA_MOVED_MM, MAX_CAMERA_NOTICED_MM, MIN_FIXTURE_SAME, can_detect_motion, noticed_mm};
pub use pose::{MAX_DISAGREEMENT_MM, MAX_UNCERTAINTY_MM, MIN_MARGIN};

use super::LocateError;
use super::OutlineEvidence;
use super::evidence::Fit;
use super::fit::CONVERGED_MM;
use panelprep_base::number_text::{distinguishable_percents, distinguishable_texts};
use panelprep_base::verdict::{Check, Judgement, LimitSource, Reason, Severity, Verdict};
use panelprep_cell::recipe::{self, Recipe};
use panelprep_cell::record::name;

/// If the overlap is below the limit by at most this, a person decides: an object may cover the panel. An even lower
/// overlap means that the object is not the panel.
const REVIEW_OVERLAP: f64 = 0.1;
/// The found fraction of the outline may be this much lower than that of the surface: an object that hides a patch in
/// the middle of a side also hides the edge there.
const OUTLINE_ALLOWANCE: f64 = 0.15;
/// Maximum fraction of taught points at which the scan shows something farther away; above this the panel is not
/// there. Single points of this kind are flying points.
pub const MAX_SEEN_THROUGH_SHARE: f64 = 0.01;
/// Maximum fraction of the outline in view that is not at its taught place.
pub const MAX_OUTLINE_ABSENT: f64 = 0.08;
/// Minimum fraction of the panel's marks in view that are at their taught place.
pub const MIN_MARKS_FOUND: f64 = 0.5;
/// Maximum outline residual of a panel of the taught shape, px.
pub const MAX_OUTLINE_RMS_PX: f64 = 0.5;
/// Minimum fraction of measured points that a dry panel gives.
pub const MIN_MEASURED: f64 = 0.9;
/// Maximum increase of the width of a brightness step since teaching, px: with a larger increase the picture is not
/// sharp, or the panel or the camera moved.
pub const MAX_BLUR_PX: f64 = 1.0;
/// Maximum fraction of the panel that may be overexposed.
pub const MAX_SATURATED: f64 = 0.2;
/// The maximum last step of a converged fit, as a multiple of the step that ends the iteration, because rounding
/// errors may prevent a smaller step.
const MAX_LAST_STEPS: f64 = 5.0;

/// The maximum movement of any point of the panel by the last step of a converged fit, mm.
pub const MAX_LAST_STEP_MM: f64 = MAX_LAST_STEPS * CONVERGED_MM;

/// Returns the smallest fraction of the outline that must be found, 0…1.
pub fn min_outline_found(limits: &recipe::Locate) -> f64 {
    (limits.min_overlap() - OUTLINE_ALLOWANCE).max(0.0)
}

/// The code of a fit that still moved in its last step.
const NOT_CONVERGED: &str = "not_converged";

/// Judges a fit by the recipe's limits.
pub fn judge(fit: &Fit, recipe: &Recipe) -> Judgement {
    judgement(&checks(fit, recipe))
}

/// Returns the judgement of a fit's checks. A fit to another object often does not converge either: the reasons that
/// name the object come first, because another scan would not help.
pub fn judgement(checks: &[Check]) -> Judgement {
    let mut judgement = Judgement::from_checks(checks);
    judgement.reasons.sort_by_key(|reason| reason.code == NOT_CONVERGED);
    judgement
}

/// Returns every number of a fit with its limit, in the order in which they are judged.
pub fn checks(fit: &Fit, recipe: &Recipe) -> Vec<Check> {
    let limits = recipe.locate();
    let of_panel = [panel(fit, limits), picture(fit), camera::camera(fit)].concat();
    // Judged first: a pose of another object has no meaning, and its numbers would hide the one reason that helps.
    let is_rejected = Judgement::from_checks(&of_panel).verdict == Verdict::Reject;
    let bend = vec![check_bend(fit, recipe.surface())];
    let of_pose =
        [bend, camera::check_fixture(fit), pose::check_pose_uncertainty(fit), pose::motion(fit, limits)].concat();
    // If the object is not the panel, the checks of its pose are informational.
    let of_pose = of_pose.into_iter().map(|check| if is_rejected { check.without_consequence() } else { check });
    of_panel.into_iter().chain(of_pose).collect()
}

/// Checks whether it is the taught panel, and whether it is complete.
fn panel(fit: &Fit, limits: &recipe::Locate) -> Vec<Check> {
    let differs = || {
        let [absent, allowed] = distinguishable_percents(fit.outline_absent, MAX_OUTLINE_ABSENT, 0);
        let [off, allowed_off] = distinguishable_texts(fit.outline_rms_px, MAX_OUTLINE_RMS_PX, 2);
        format!(
            "{absent} % of the visible outline is not at its taught position (limit {allowed} %); the rest is \
             {off} px off (limit {allowed_off} px); check that it is the right panel and that nothing touches its \
             edge"
        )
    };
    let mut checks = vec![
        Check::new("last step of the fit", "mm", fit.last_step_mm)
            .with_max(MAX_LAST_STEP_MM, LimitSource::Program)
            .or_reject(NOT_CONVERGED, || {
                let (steps, step_mm) = (fit.iterations, fit.last_step_mm);
                let [step, allowed] = distinguishable_texts(step_mm, MAX_LAST_STEP_MM, 4);
                format!(
                    "the fit did not converge in {steps} iterations: last step {step} mm (limit {allowed} mm); \
                         scan again"
                )
            }),
        Check::new(name::RESIDUAL, "mm", fit.rms_mm)
            .with_max(limits.max_rms_mm(), LimitSource::recipe("locate.max_rms_mm"))
            .or_reject("poor_fit", || {
                let [rms, allowed] = distinguishable_texts(fit.rms_mm, limits.max_rms_mm(), 3);
                format!(
                    "the scan differs from the taught panel by {rms} mm rms, apart from any smooth bend (limit \
                     {allowed} mm); check that it is the right panel, dry and clean, and that nothing is on it"
                )
            }),
        Check::new("taught surface that is seen through", "", fit.seen_through_share)
            .with_max(MAX_SEEN_THROUGH_SHARE, LimitSource::Program)
            .or_reject("seen_through", || {
                let [through, allowed] =
                    distinguishable_percents(fit.seen_through_share, MAX_SEEN_THROUGH_SHARE, 1);
                format!(
                    "at {through} % of the taught surface, the scan sees something behind it (limit {allowed} %), \
                     so the panel is missing there; check that it is the right panel, with the taught side to the \
                     camera"
                )
            }),
        Check::new("outline in view that is elsewhere", "", fit.outline_absent)
            .with_max(MAX_OUTLINE_ABSENT, LimitSource::Program)
            .or_reject("outline_differs", differs),
        Check::new(name::OUTLINE_RESIDUAL, "px", fit.outline_rms_px)
            .with_max(MAX_OUTLINE_RMS_PX, LimitSource::Program)
            .or_reject("outline_differs", differs),
    ];
    checks.extend(overlap(fit, limits));
    checks.extend(fit.marks_found.map(check_marks));
    checks
}

/// Checks the bend. It must be small enough that this may be the taught panel, and that its path may follow the
/// bend without a person's confirmation.
fn check_bend(fit: &Fit, limits: &recipe::Surface) -> Check {
    let limit_mm = limits.max_deviation_mm();
    let check = Check::new(name::BEND_NAME, "mm", fit.deviation_mm)
        .with_max(limit_mm, LimitSource::recipe("surface.max_deviation_mm"));
    // A bend that could not be measured counts as too large.
    let is_bent = fit.deviation_mm.is_none_or(|mm| exceeds_limit(mm, limit_mm));
    check.with_consequence_if(is_bent, Severity::Review, "bent", || match fit.deviation_mm {
        Some(mm) => {
            let [mm, limit_mm] = distinguishable_texts(mm, limit_mm, 2);
            format!(
                "the panel is bent by up to {mm} mm relative to the taught panel (limit {limit_mm} mm); check that \
                 it is the right panel, clamped as at teaching"
            )
        }
        None => {
            "too little of the panel's surface is visible to measure its bend; uncover the panel, dry it, then \
             scan again"
                .to_owned()
        }
    })
}

/// Checks whether the panel has the taught marks.
fn check_marks(found: f64) -> Check {
    Check::new("marks in view that are where the taught ones are", "", found)
        .with_min(MIN_MARKS_FOUND, LimitSource::Program)
        .reviews("marks_differ", || {
            let [found, needed] = distinguishable_percents(found, MIN_MARKS_FOUND, 0);
            format!(
                "{found} % of the panel's visible marks are at their taught positions, at least {needed} % are \
                 needed; check that it is the right panel, in the right orientation. If its marks were sanded off, \
                 teach the panel again"
            )
        })
}

/// Checks whether the scan is good: dry, sharp, not overexposed.
fn picture(fit: &Fit) -> Vec<Check> {
    let blur_px = fit.blur_px();
    vec![
        Check::new("panel in view that gave points", "", fit.measured)
            .with_min(MIN_MEASURED, LimitSource::Program)
            .reviews("points_missing", || {
                let [gave, needed] = distinguishable_percents(fit.measured, MIN_MEASURED, 0);
                format!(
                    "only {gave} % of the visible panel has 3D points, at least {needed} % are needed; dry the \
                     panel, or shade a lamp that it reflects"
                )
            }),
        Check::new("edge wider than at teaching", "px", blur_px)
            .with_max(MAX_BLUR_PX, LimitSource::Program)
            .reviews("blurred", || {
                let [wider, allowed] = distinguishable_texts(blur_px.unwrap_or(0.0), MAX_BLUR_PX, 1);
                format!(
                    "the outline's edge is {wider} px wider than at teaching (limit {allowed} px); check that the \
                     panel does not move during the scan, and that the lens is clean and in focus"
                )
            }),
        Check::new("panel that is overexposed", "", fit.saturated_share)
            .with_max(MAX_SATURATED, LimitSource::Program)
            .reviews("overexposed", || {
                let [found, allowed] = distinguishable_percents(fit.saturated_share, MAX_SATURATED, 0);
                format!(
                    "{found} % of the panel is overexposed (limit {allowed} %); lower the exposure or shade the \
                     lamp"
                )
            }),
    ]
}

/// Checks the overlap: whether enough of the taught panel is found in the scan, and enough of the scan's panel
/// among the taught points.
fn overlap(fit: &Fit, limits: &recipe::Locate) -> [Check; 2] {
    let allowed = limits.min_overlap();
    let outline_allowed = min_outline_found(limits);
    let is_nearly =
        fit.overlap() >= allowed - REVIEW_OVERLAP && fit.outline_found >= outline_allowed - REVIEW_OVERLAP;
    let severity = if is_nearly { Severity::Review } else { Severity::Reject };
    let words = || {
        let [taught, taught_needed] = distinguishable_percents(fit.taught_found, allowed, 0);
        let [outline, outline_needed] = distinguishable_percents(fit.outline_found, outline_allowed, 0);
        let [scan, scan_needed] = distinguishable_percents(fit.scan_found, allowed, 0);
        format!(
            "{taught} % of the taught surface, {outline} % of its outline and {scan} % of the scanned surface \
             match; at least {taught_needed}, {outline_needed} and {scan_needed} % are needed; check that it is \
             the right panel and that nothing is in front of it"
        )
    };
    let set_by = || LimitSource::recipe("locate.min_overlap");
    [
        Check::new("overlap", "", fit.overlap()).with_min(allowed, set_by()).with_consequence(
            severity,
            "low_overlap",
            words,
        ),
        Check::new("outline found", "", fit.outline_found).with_min(outline_allowed, set_by()).with_consequence(
            severity,
            "low_overlap",
            words,
        ),
    ]
}

/// If a smaller fraction of the outline is seen, a panel is poorly constrained sideways, in particular a flat panel.
const MIN_OUTLINE_SEEN_SHARE: f64 = 0.6;

/// Returns the warnings at teaching: too little of the panel's outline is seen in its own scan. `fit` is the panel
/// located in that scan; with it there is also a warning if the fixture shows too little to detect a moved camera.
pub fn teaching_warnings(seen: &OutlineEvidence, fit: Option<&Fit>) -> Vec<Check> {
    let share = seen.by_colour + seen.by_depth;
    let outline = Check::new("outline that the scan shows", "", share)
        .with_min(MIN_OUTLINE_SEEN_SHARE, LimitSource::Program)
        .reviews("outline_unseen", || {
            let [seen, needed] = distinguishable_percents(share, MIN_OUTLINE_SEEN_SHARE, 0);
            format!(
                "the scan shows {seen} % of the panel's outline, at least {needed} % are needed: only the outline \
                 determines the sideways position of a flat panel; give the panel a background of another \
                 brightness, or scan again with fewer missing points at its edge"
            )
        });
    std::iter::once(outline).chain(fit.map(camera::check_taught_fixture)).collect()
}

/// The verdict if nothing was found: a bad panel is a verdict, not a fault.
pub fn refusal(error: &LocateError) -> Judgement {
    Judgement::new(vec![Reason::new("no_panel", error.to_string())], Vec::new())
}

/// Returns whether the measurement exceeds the limit; NaN exceeds every limit.
pub(super) fn exceeds_limit(measured: f64, allowed: f64) -> bool {
    measured.is_nan() || measured > allowed
}

#[cfg(test)]
mod tests {
    use super::super::{CameraCheck, CompetingPose, WeakestMotion};
    use super::*;
    use nalgebra::{Isometry3, Matrix6};
    use panelprep_base::geometry::{Base, Degrees, Panel, Rigid};
    use panelprep_base::verdict::Verdict;

    pub(super) fn good() -> Fit {
        let base_from_panel: Rigid<Base, Panel> = Rigid::from_isometry_unchecked(Isometry3::identity());
        Fit {
            base_from_panel,
            rms_mm: 0.08,
            deviation_mm: Some(0.3),
            outline_rms_mm: 0.1,
            outline_rms_px: 0.25,
            taught_found: 0.99,
            scan_found: 0.98,
            outline_found: 0.97,
            seen_through_share: 0.001,
            outline_absent: 0.01,
            marks_found: None,
            measured: 0.99,
            edge_width_px: Some(1.3),
            taught_edge_width_px: 1.2,
            saturated_share: 0.0,
            iterations: 5,
            last_step_mm: 0.001,
            agreement_mm: 0.01,
            rival: None,
            camera: Some(CameraCheck { moved_mm: 0.02, uncertainty_mm: 0.05, unmoved_share: 0.9 }),
            camera_at_teaching_mm: None,
            weakest_direction: WeakestMotion::Normal,
            covariance: Matrix6::identity(),
            centre: panelprep_base::geometry::Point::at(0.0, 0.0, 700.0),
            uncertainty_mm: 0.15,
            uncertainty_at_taught_place_mm: 0.14,
            uncertainty_without_scale_mm: 0.13,
            weakest_mm: 0.07,
            shift_mm: 20.0,
            turn: Degrees(-5.0),
            tilt: Degrees(3.0),
            points: 12_000,
        }
    }

    fn judged(fit: &Fit) -> (Verdict, Vec<std::borrow::Cow<'static, str>>) {
        let text = "panel = \"p\"\n[region]\ncorners_px = [[0, 0], [9, 0], [9, 9], [0, 9]]\nrows = 1\ncolumns = 1\n\
                    [locate]\nbox_min_mm = [0, 0, 0]\nbox_max_mm = [1, 1, 1]\n";
        let recipe = recipe::Recipe::check("test.toml", text).unwrap_or_else(|problems| panic!("{problems}"));
        let judgement = judge(fit, &recipe);
        (judgement.verdict, judgement.reasons.into_iter().map(|reason| reason.code).collect())
    }

    /// The recipe's defaults: 60 mm, 15°, 15°, 0.25 mm rms, 0.75 of overlap.
    #[test]
    fn each_limit_has_its_reason() {
        assert_eq!(judged(&good()), (Verdict::Accept, vec![]));
        assert_eq!(judged(&Fit { shift_mm: 60.1, ..good() }), (Verdict::Reject, vec!["shift_limit".into()]));
        assert_eq!(judged(&Fit { turn: Degrees(-15.1), ..good() }), (Verdict::Reject, vec!["turn_limit".into()]));
        assert_eq!(judged(&Fit { tilt: Degrees(15.1), ..good() }), (Verdict::Reject, vec!["tilt_limit".into()]));
        assert_eq!(judged(&Fit { rms_mm: 0.26, ..good() }), (Verdict::Reject, vec!["poor_fit".into()]));
        assert_eq!(judged(&Fit { last_step_mm: 0.011, ..good() }), (Verdict::Reject, vec!["not_converged".into()]));
        assert_eq!(judged(&Fit { rms_mm: f64::NAN, ..good() }), (Verdict::Reject, vec!["poor_fit".into()]));
        let other_panel = Fit { last_step_mm: 0.9, rms_mm: 1.0, ..good() };
        assert_eq!(judged(&other_panel).1, ["poor_fit", "not_converged"], "the cause first");
    }

    #[test]
    fn a_little_less_overlap_is_for_a_person_and_much_less_is_no_panel() {
        assert_eq!(judged(&Fit { scan_found: 0.7, ..good() }), (Verdict::Review, vec!["low_overlap".into()]));
        assert_eq!(judged(&Fit { taught_found: 0.64, ..good() }), (Verdict::Reject, vec!["low_overlap".into()]));
        assert_eq!(judged(&Fit { outline_found: 0.55, ..good() }), (Verdict::Review, vec!["low_overlap".into()]));
        assert_eq!(judged(&Fit { outline_found: 0.45, ..good() }), (Verdict::Reject, vec!["low_overlap".into()]));
    }

    #[test]
    fn what_is_not_the_panel_is_rejected_and_what_a_person_may_judge_is_not() {
        let reject = |fit: Fit, code: &'static str| assert_eq!(judged(&fit), (Verdict::Reject, vec![code.into()]));
        let review = |fit: Fit, code: &'static str| assert_eq!(judged(&fit), (Verdict::Review, vec![code.into()]));
        reject(Fit { seen_through_share: 0.03, ..good() }, "seen_through");
        reject(Fit { outline_absent: 0.2, ..good() }, "outline_differs");
        reject(Fit { outline_rms_px: f64::NAN, ..good() }, "outline_differs");
        review(Fit { measured: 0.8, ..good() }, "points_missing");
        review(Fit { marks_found: Some(0.49), ..good() }, "marks_differ");
        assert_eq!(judged(&Fit { marks_found: Some(0.5), ..good() }).0, Verdict::Accept);
        review(Fit { edge_width_px: Some(2.3), ..good() }, "blurred");
        review(Fit { saturated_share: 0.3, ..good() }, "overexposed");
        review(Fit { deviation_mm: Some(2.01), ..good() }, "bent");
        review(Fit { deviation_mm: Some(f64::NAN), ..good() }, "bent");
        review(Fit { deviation_mm: None, ..good() }, "bent");
        review(Fit { uncertainty_mm: 0.36, ..good() }, "uncertain");
        review(Fit { agreement_mm: f64::INFINITY, ..good() }, "starts_disagree");
    }

    /// By hand: 0.35 mm with an uncertainty of 0.05 mm is at least 0.3 mm; 0.35 ± 0.15 mm may be 0.2 mm. A rival
    /// that is supported by 20 mm, against 40 mm for the first pose, has a margin of 48/28 = 1.7.
    #[test]
    fn a_moved_camera_and_a_rival() {
        let camera = |moved_mm, uncertainty_mm, same| {
            judged(&Fit { camera: Some(CameraCheck { moved_mm, uncertainty_mm, unmoved_share: same }), ..good() })
        };
        assert_eq!(camera(0.35, 0.05, 0.9), (Verdict::Reject, vec!["camera_moved".into()]));
        assert_eq!(camera(0.35, 0.15, 0.9).0, Verdict::Accept);
        assert_eq!(camera(0.0, 0.05, 0.3), (Verdict::Reject, vec!["camera_moved".into()]));
        let rival = |for_first_mm, for_rival_mm| {
            let base_from_panel = good().base_from_panel;
            judged(&Fit {
                rival: Some(CompetingPose {
                    base_from_panel,
                    rotation: Degrees(180.0),
                    for_first_mm,
                    for_rival_mm,
                }),
                ..good()
            })
        };
        assert_eq!(rival(40.0, 20.0), (Verdict::Review, vec!["ambiguous".into()]));
        assert_eq!(rival(40.0, 0.0).0, Verdict::Accept);
    }

    /// By hand: with an uncertainty of 0.2 mm, a moved camera is detected from 0.45 mm on. With 0.31 mm it is detected
    /// from 0.56 mm on, which is more than 0.55. With an uncertainty of 2 mm, a measured motion of 2 mm does not show
    /// that the camera moved.
    #[test]
    fn a_camera_that_no_client_watches_any_more_is_for_a_person() {
        let told =
            |uncertainty_mm| Some(CameraCheck { moved_mm: uncertainty_mm, uncertainty_mm, unmoved_share: 0.9 });
        let judged = |camera, camera_at_teaching_mm| judged(&Fit { camera, camera_at_teaching_mm, ..good() });
        for camera in [None, told(0.31), told(2.0)] {
            assert_eq!(judged(camera, Some(0.2)), (Verdict::Review, vec!["camera_unwatched".into()]), "{camera:?}");
            assert_eq!(judged(camera, Some(0.31)).0, Verdict::Accept, "teaching has warned: {camera:?}");
            assert_eq!(judged(camera, None).0, Verdict::Accept, "{camera:?}");
        }
        assert_eq!(judged(told(0.2), Some(0.1)).0, Verdict::Accept);
    }

    /// A wrong panel that ends up far away is reported as a wrong panel, not as a shifted one.
    #[test]
    fn a_poor_fit_gives_no_information_on_motion() {
        assert_eq!(judged(&Fit { rms_mm: 3.0, shift_mm: 90.0, ..good() }).1, ["poor_fit"]);
    }
}
