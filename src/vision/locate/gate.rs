//! The acceptance checks of the localization: derive the verdict accept, review or reject from the evidence, with
//! reasons in words.
//!
//! The checks answer three questions in this order. First: is this the taught panel, complete and dry, and has the
//! camera not moved? A bent panel is accepted as this panel as long as a smooth deviation explains its surface; the
//! recipe limits the bend. Second: is the pose accurate enough, and is it unique? Third: is the pose within its limits?
//! Shift, rotation and tilt are judged at the centre of the panel and never at the origin of the base: a small rotation
//! moves a distant origin far, which is no information about the panel. Evidence against the panel itself leads to
//! reject; evidence that a person can judge better leads to review.
//!
//! The fixture shows a motion of the 3D camera since teaching, with an uncertainty. The measured displacement minus
//! this uncertainty is the minimum distance by which the motion of the camera displaced the panel. If too little of the
//! fixture is visible, a motion of the camera cannot be detected.
//!
//! The cause of the uncertainty of a pose determines the remedy: more of the panel in view, a position nearer to the
//! taught one, or a 3D camera with a measured scale.

use super::error::LocateError;
use super::evidence::Fit;
use super::fit::CONVERGED_STEP_MM;
use super::{CompetingPose, OutlineEvidence};
use panelprep_base::number_text::{distinguishable_percents, distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, Judgement, LimitSource, Reason, Severity, Verdict};
use panelprep_cell::recipe;
use panelprep_cell::recipe::Recipe;
use panelprep_cell::record::name;

/// Range below the limit of the overlap in which a person decides, since an object may cover the panel. With an even
/// lower overlap the object is not the panel.
const OVERLAP_REVIEW_MARGIN: f64 = 0.1;
/// Maximum difference by which the found fraction of the outline may be lower than that of the surface: an object that
/// hides an area in the middle of a side also hides the edge there.
const OUTLINE_ALLOWANCE: f64 = 0.15;
/// Maximum fraction of the taught points at which the scan shows a surface farther away; with a larger fraction the
/// panel is not there. Single points of this kind are flying points.
pub const MAX_SEEN_THROUGH_FRACTION: f64 = 0.01;
/// Maximum fraction of the outline in view that is not at its taught position.
pub const MAX_OUTLINE_ABSENT_FRACTION: f64 = 0.08;
/// Minimum fraction of the marks in view that are at their taught positions.
pub const MIN_MARKS_FOUND_FRACTION: f64 = 0.5;
/// Maximum outline residual of a panel of the taught shape, px.
pub const MAX_OUTLINE_RMS_PX: f64 = 0.5;
/// Minimum fraction of the points of a dry panel in view that are measured.
pub const MIN_MEASURED_FRACTION: f64 = 0.9;
/// Maximum increase of the width of a brightness step since teaching, px: with a larger increase the picture is not
/// sharp, or the panel or the camera moved.
pub const MAX_BLUR_PX: f64 = 1.0;
/// Maximum fraction of the panel that may be overexposed.
pub const MAX_OVEREXPOSED_FRACTION: f64 = 0.2;
/// Maximum last step of a converged fit, as a multiple of the step that ends the iteration: rounding errors may prevent
/// a smaller step.
const MAX_LAST_STEP_RATIO: f64 = 5.0;

/// Maximum displacement of any point of the panel by the last step of a converged fit, mm.
pub const MAX_LAST_STEP_MM: f64 = MAX_LAST_STEP_RATIO * CONVERGED_STEP_MM;

/// Returns the minimum fraction of the outline that must be found, 0…1.
pub fn min_outline_found(limits: &recipe::Locate) -> f64 {
    (limits.min_overlap() - OUTLINE_ALLOWANCE).max(0.0)
}

/// Returns the overlap below which the object is not the panel, 0…1; between this and the limit a person decides.
pub(super) fn min_reviewed_overlap(limits: &recipe::Locate) -> f64 {
    (limits.min_overlap() - OVERLAP_REVIEW_MARGIN).max(0.0)
}

/// Returns whether the object is not the taught panel, whatever its pose, and whatever the picture and the camera.
pub(super) fn is_other_panel(fit: &Fit, limits: &recipe::Locate) -> bool {
    Judgement::from_checks(&check_panel(fit, limits)).verdict == Verdict::Reject
}

/// The code of a fit whose last step was too large.
const NOT_CONVERGED: &str = "not_converged";

/// Judges a fit by the limits of the recipe.
pub fn judge(fit: &Fit, recipe: &Recipe) -> Judgement {
    judgement(&checks(fit, recipe))
}

/// Returns the judgement of the checks of a fit. A fit to another object often does not converge either: the reasons
/// about the object come first, because another scan would not help.
pub fn judgement(checks: &[Check]) -> Judgement {
    let mut judgement = Judgement::from_checks(checks);
    judgement.reasons.sort_by_key(|reason| reason.code == NOT_CONVERGED);
    judgement
}

/// Returns the measured values of a fit with their limits, in the order in which they are judged.
pub fn checks(fit: &Fit, recipe: &Recipe) -> Vec<Check> {
    let limits = recipe.locate();
    let of_panel = [check_panel(fit, limits), check_scan_quality(fit), check_camera(fit)].concat();
    // The checks of the panel come first: the pose of another object has no meaning, and its values would hide the one
    // reason that helps.
    let is_rejected = Judgement::from_checks(&of_panel).verdict == Verdict::Reject;
    let bend = vec![check_bend(fit, recipe.surface())];
    let of_pose = [bend, check_fixture(fit), check_pose_uncertainty(fit), check_displacement(fit, limits)].concat();
    // If the object is not the panel, the checks of its pose have no consequence.
    let of_pose = of_pose.into_iter().map(|check| if is_rejected { check.without_consequence() } else { check });
    of_panel.into_iter().chain(of_pose).collect()
}

/// Checks whether the object is the taught panel, and whether it is complete.
fn check_panel(fit: &Fit, limits: &recipe::Locate) -> Vec<Check> {
    let differs = || {
        let [absent, allowed] = distinguishable_percents(fit.outline_absent, MAX_OUTLINE_ABSENT_FRACTION, 0);
        let [off, allowed_off] = distinguishable_texts(fit.outline_rms_px, MAX_OUTLINE_RMS_PX, 2);
        format!(
            "{absent} % of the visible outline is not at its taught position (limit {allowed} %); the rest \
             deviates by {off} px rms (limit {allowed_off} px); check that it is the right panel and that nothing \
             touches its edge"
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
            .with_max(MAX_SEEN_THROUGH_FRACTION, LimitSource::Program)
            .or_reject("seen_through", || {
                let [through, allowed] =
                    distinguishable_percents(fit.seen_through_share, MAX_SEEN_THROUGH_FRACTION, 1);
                format!(
                    "at {through} % of the taught surface, the scan shows another surface behind it (limit {allowed} %), \
                     so the panel is missing there; check that it is the right panel, with the taught side to the \
                     camera"
                )
            }),
        Check::new("outline in view that is elsewhere", "", fit.outline_absent)
            .with_max(MAX_OUTLINE_ABSENT_FRACTION, LimitSource::Program)
            .or_reject("outline_differs", differs),
        Check::new(name::OUTLINE_RESIDUAL, "px", fit.outline_rms_px)
            .with_max(MAX_OUTLINE_RMS_PX, LimitSource::Program)
            .or_reject("outline_differs", differs),
    ];
    checks.extend(check_overlap(fit, limits));
    checks.extend(fit.marks_found.map(check_marks));
    checks
}

/// Checks the bend. It must be small enough for the taught panel, and for a path that follows the bend without the
/// confirmation of a person.
fn check_bend(fit: &Fit, limits: &recipe::Surface) -> Check {
    let limit_mm = limits.max_deviation_mm();
    let check = Check::new(name::BEND_NAME, "mm", fit.deviation_mm)
        .with_max(limit_mm, LimitSource::recipe("surface.max_deviation_mm"));
    // A bend that could not be measured is treated as too large.
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
        .with_min(MIN_MARKS_FOUND_FRACTION, LimitSource::Program)
        .or_review("marks_differ", || {
            let [found, needed] = distinguishable_percents(found, MIN_MARKS_FOUND_FRACTION, 0);
            format!(
                "{found} % of the panel's visible marks are at their taught positions, at least {needed} % are \
                 needed; check that it is the right panel, in the right orientation. If its marks were sanded off, \
                 teach the panel again"
            )
        })
}

/// Checks the quality of the scan: the panel is dry, the picture is sharp and not overexposed.
fn check_scan_quality(fit: &Fit) -> Vec<Check> {
    let blur_px = fit.blur_px();
    vec![
        Check::new("panel in view that gave points", "", fit.measured)
            .with_min(MIN_MEASURED_FRACTION, LimitSource::Program)
            .or_review("points_missing", || {
                let [gave, needed] = distinguishable_percents(fit.measured, MIN_MEASURED_FRACTION, 0);
                format!(
                    "only {gave} % of the visible panel has 3D points, at least {needed} % are needed; dry the \
                     panel, or shade a lamp that it reflects"
                )
            }),
        Check::new("edge wider than at teaching", "px", blur_px)
            .with_max(MAX_BLUR_PX, LimitSource::Program)
            .or_review("blurred", || {
                let [wider, allowed] = distinguishable_texts(blur_px.unwrap_or(0.0), MAX_BLUR_PX, 1);
                format!(
                    "the outline's edge is {wider} px wider than at teaching (limit {allowed} px); check that the \
                     panel does not move during the scan, and that the lens is clean and in focus"
                )
            }),
        Check::new("panel that is overexposed", "", fit.saturated_share)
            .with_max(MAX_OVEREXPOSED_FRACTION, LimitSource::Program)
            .or_review("overexposed", || {
                let [found, allowed] = distinguishable_percents(fit.saturated_share, MAX_OVEREXPOSED_FRACTION, 0);
                format!(
                    "{found} % of the panel is overexposed (limit {allowed} %); lower the exposure or shade the \
                     lamp"
                )
            }),
    ]
}

/// Checks the overlap: enough of the taught panel must be found in the scan, and enough of the scanned panel among the
/// taught points.
fn check_overlap(fit: &Fit, limits: &recipe::Locate) -> [Check; 2] {
    let allowed = limits.min_overlap();
    let outline_allowed = min_outline_found(limits);
    let is_nearly = fit.overlap() >= allowed - OVERLAP_REVIEW_MARGIN
        && fit.outline_found >= outline_allowed - OVERLAP_REVIEW_MARGIN;
    let severity = if is_nearly { Severity::Review } else { Severity::Reject };
    let words = || {
        let [taught, taught_needed] = distinguishable_percents(fit.taught_found, allowed, 0);
        let [outline, outline_needed] = distinguishable_percents(fit.outline_found, outline_allowed, 0);
        let [scan, scan_needed] = distinguishable_percents(fit.scan_found_share, allowed, 0);
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

/// Minimum fraction of the outline that must be visible: with less, a panel is poorly constrained sideways, in
/// particular a flat one.
const MIN_OUTLINE_SEEN_FRACTION: f64 = 0.6;

/// Returns the checks with warnings at teaching: too little of the panel's outline is visible in its own scan. If
/// `fit`, the panel located in that scan, is given, there is also a warning if the fixture shows too little to detect a
/// moved camera.
pub fn teaching_checks(seen: &OutlineEvidence, fit: Option<&Fit>) -> Vec<Check> {
    let share = seen.by_colour + seen.by_depth;
    let outline = Check::new("outline that the scan shows", "", share)
        .with_min(MIN_OUTLINE_SEEN_FRACTION, LimitSource::Program)
        .or_review("outline_unseen", || {
            let [seen, needed] = distinguishable_percents(share, MIN_OUTLINE_SEEN_FRACTION, 0);
            format!(
                "the scan shows {seen} % of the panel's outline, at least {needed} % are needed: only the outline \
                 determines the sideways position of a flat panel; give the panel a background of another \
                 brightness, or scan again with fewer missing points at its edge"
            )
        });
    std::iter::once(outline).chain(fit.map(check_taught_fixture)).collect()
}

/// Returns the verdict if no panel was found: a wrong or missing panel is a verdict, not an error of the program.
pub fn refusal(error: &LocateError) -> Judgement {
    Judgement::new(vec![Reason::new("no_panel", error.to_string())], Vec::new())
}

/// Returns whether the measured value exceeds the limit; NaN exceeds every limit.
pub(super) fn exceeds_limit(measured: f64, allowed: f64) -> bool {
    measured.is_nan() || measured > allowed
}

/// Maximum displacement of the panel by a motion of the camera, mm: with a larger one the camera has moved since
/// teaching.
pub const MAX_CAMERA_MOVED_MM: f64 = 0.25;
/// Maximum value of the smallest detectable displacement of the panel by a motion of the camera, mm: with a larger
/// value the fixture does not show the motion well enough.
pub const MAX_CAMERA_DETECTION_LIMIT_MM: f64 = 0.55;
/// Minimum fraction of the fixture that must be at its taught position: objects are added and removed, the fixture
/// stays.
pub const MIN_UNMOVED_FIXTURE_FRACTION: f64 = 0.4;
/// Returns the smallest displacement by a motion of the camera that is detected, mm, if the fixture determines the
/// camera pose with this uncertainty, 95 %, mm.
pub fn detectable_displacement_mm(uncertainty_mm: f64) -> f64 {
    MAX_CAMERA_MOVED_MM + uncertainty_mm
}

/// Returns whether a fixture that determines the camera pose with this uncertainty, mm, can detect a motion of the
/// camera; `None` means that the fixture contains no information.
pub fn can_detect_motion(uncertainty_mm: Option<f64>) -> bool {
    uncertainty_mm.is_some_and(|mm| detectable_displacement_mm(mm) <= MAX_CAMERA_DETECTION_LIMIT_MM)
}

/// Checks whether the camera has moved since teaching.
fn check_camera(fit: &Fit) -> Vec<Check> {
    let camera = fit.camera.as_ref();
    let (moved_mm, uncertainty_mm) = (camera.map(|it| it.moved_mm), camera.map(|it| it.uncertainty_mm));
    let same = Check::new("fixture that stands where it stood", "", camera.map(|it| it.unmoved_share))
        .with_min(MIN_UNMOVED_FIXTURE_FRACTION, LimitSource::Program);
    let is_other = !same.is_met();
    let same = same.or_reject("camera_moved", || {
        let [same, needed] = distinguishable_percents(
            camera.map_or(f64::NAN, |it| it.unmoved_share),
            MIN_UNMOVED_FIXTURE_FRACTION,
            0,
        );
        format!(
            "only {same} % of the fixture is at its taught position, at least {needed} % are needed; check \
             whether the camera or the fixture was moved, then calibrate and teach again"
        )
    });
    let moved = Check::new("motion less its error", "mm", fit.camera_moved_mm())
        .with_max(MAX_CAMERA_MOVED_MM, LimitSource::Program)
        .or_reject("camera_moved", || {
            let (moved_mm, uncertainty_mm) = (moved_mm.unwrap_or(f64::NAN), uncertainty_mm.unwrap_or(f64::NAN));
            let [least, allowed] = distinguishable_texts(moved_mm - uncertainty_mm, MAX_CAMERA_MOVED_MM, 2);
            format!(
                "the fixture shows that the camera has moved since teaching, which shifts the panel's pose by {} ± \
                 {} mm, at least {least} mm (limit {allowed} mm); calibrate the camera again",
                fixed_decimals(moved_mm, 2),
                fixed_decimals(uncertainty_mm, 2)
            )
        });
    vec![
        same,
        Check::new("camera has moved the panel since teaching, by the fixture", "mm", moved_mm),
        Check::new("error of that, 95 %", "mm", uncertainty_mm),
        // Another fixture gives no information about the motion of the camera.
        if is_other { moved.without_consequence() } else { moved },
    ]
}

/// Checks whether this scan can show that the camera has not moved.
fn check_fixture(fit: &Fit) -> Vec<Check> {
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    let noticed =
        Check::new("a camera is noticed that moves it by", "mm", uncertainty_mm.map(detectable_displacement_mm));
    // The limit applies if the fixture can detect a motion of the camera, now or at teaching.
    let is_shown = can_detect_motion(uncertainty_mm) || can_detect_motion(fit.camera_at_teaching_mm);
    let noticed =
        if is_shown { noticed.with_max(MAX_CAMERA_DETECTION_LIMIT_MM, LimitSource::Program) } else { noticed };
    // If the fixture also showed too little at teaching, there was already a warning then.
    let is_unwatched = !can_detect_motion(uncertainty_mm) && can_detect_motion(fit.camera_at_teaching_mm);
    vec![noticed.with_consequence_if(is_unwatched, Severity::Review, "camera_unwatched", || {
        let seen = uncertainty_mm.map_or("too little of the fixture is visible".to_owned(), |mm| {
            let [noticed, _] =
                distinguishable_texts(detectable_displacement_mm(mm), MAX_CAMERA_DETECTION_LIMIT_MM, 2);
            format!(
                "the fixture shows a motion of the camera only if the motion displaces the panel by {noticed} mm or more"
            )
        });
        format!(
            "it is unknown whether the camera has moved: {seen} (limit {MAX_CAMERA_DETECTION_LIMIT_MM} mm, met at \
             teaching); remove objects in front of the fixture. If the camera was calibrated again since teaching, \
             teach the panel again"
        )
    })]
}

/// Checks whether the taught scan shows enough of the fixture to detect a camera that moved.
fn check_taught_fixture(fit: &Fit) -> Check {
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    Check::new("a camera is noticed that moves the panel by", "mm", uncertainty_mm.map(detectable_displacement_mm))
        .with_max(MAX_CAMERA_DETECTION_LIMIT_MM, LimitSource::Program)
        .with_consequence_if(!can_detect_motion(uncertainty_mm), Severity::Review, "camera_unwatched", || {
            "too little of the fixture is visible to detect a motion of the camera; put fixed objects into view \
             beside the panel, outside of the search box, with clear edges in two directions"
                .to_owned()
        })
}

/// Maximum distance between the results of fits from independent starts, mm.
pub const MAX_DISAGREEMENT_MM: f64 = 0.1;
/// Minimum ratio of the evidence for the pose to the evidence for any other pose.
pub const MIN_EVIDENCE_RATIO: f64 = 2.0;
/// Maximum uncertainty of a usable pose anywhere on the panel, mm: the error of 0.25 mm at one point, times 2.35 / 1.7
/// (`geometry/statistics`).
pub const MAX_UNCERTAINTY_MM: f64 = 0.35;

/// Checks whether the pose of the panel is accurate enough.
fn check_pose_uncertainty(fit: &Fit) -> Vec<Check> {
    let rival = fit.rival.as_ref();
    let ambiguous = |rival: &CompetingPose| {
        let [margin, needed] = distinguishable_texts(rival.evidence_ratio(), MIN_EVIDENCE_RATIO, 1);
        format!(
            "another pose, rotated by {}°, explains the scan about as well: {} mm of outline and surface support \
             only the first pose and {} mm only the other, a ratio of {margin} (at least {needed} is needed); a \
             person must decide which pose is right",
            fixed_decimals(rival.rotation.0, 0),
            fixed_decimals(rival.for_first_mm, 0),
            fixed_decimals(rival.for_rival_mm, 0)
        )
    };
    vec![
        Check::new(name::LOCATION_ERROR, "mm", fit.uncertainty_mm)
            .with_max(MAX_UNCERTAINTY_MM, LimitSource::Program)
            .or_review("uncertain", || {
                let [known, allowed] = distinguishable_texts(fit.uncertainty_mm, MAX_UNCERTAINTY_MM, 2);
                format!(
                    "the uncertainty of the pose is {known} mm at the worst place of the panel (95 %; limit \
                     {allowed} mm); {}",
                    uncertainty_reason(fit)
                )
            }),
        Check::new("error along the weakest direction, 95 %", "mm", fit.weakest_mm),
        Check::new("fits from independent starts, apart", "mm", fit.agreement_mm)
            .with_max(MAX_DISAGREEMENT_MM, LimitSource::Program)
            .or_review("starts_disagree", || {
                let [agreement, allowed] = distinguishable_texts(fit.agreement_mm, MAX_DISAGREEMENT_MM, 3);
                format!("fits from independent starts end {agreement} mm apart (limit {allowed} mm); scan again")
            }),
        Check::new("for this placement against the next best, times", "", rival.map(CompetingPose::evidence_ratio))
            .with_min(MIN_EVIDENCE_RATIO, LimitSource::Program)
            .or_review("ambiguous", || rival.map_or(String::new(), ambiguous)),
    ]
}

/// Returns the cause of the uncertainty of a pose, and the remedy.
fn uncertainty_reason(fit: &Fit) -> String {
    let mm = |value| fixed_decimals(value, 2);
    if fit.uncertainty_at_taught_place_mm <= MAX_UNCERTAINTY_MM {
        format!(
            "the panel's centre is {} mm from its taught position, so the scale error of the 3D camera increases the uncertainty; at \
             the taught position the uncertainty would be {} mm: put the panel nearer to it, measure the camera \
             with `panelprep calibrate scanner`, or correct the pose with two corners",
            fixed_decimals(fit.shift_mm, 0),
            mm(fit.uncertainty_at_taught_place_mm)
        )
    } else if fit.uncertainty_without_scale_mm <= MAX_UNCERTAINTY_MM {
        format!(
            "the scale of the 3D camera varies from scan to scan; without this variation the uncertainty would be \
             {} mm: let the camera warm up, and measure its scale again with `panelprep calibrate scanner`",
            mm(fit.uncertainty_without_scale_mm)
        )
    } else {
        format!(
            "the pose is least certain {}; uncover more of the panel, or correct the pose with two corners",
            fit.weakest_direction.describe()
        )
    }
}

/// Checks whether the pose of the panel is within its limits.
fn check_displacement(fit: &Fit, limits: &recipe::Locate) -> Vec<Check> {
    vec![
        Check::new("shift of the panel's centre", "mm", fit.shift_mm)
            .with_max(limits.max_shift_mm(), LimitSource::recipe("locate.max_shift_mm"))
            .or_reject("shift_limit", || {
                let [shift, allowed] = distinguishable_texts(fit.shift_mm, limits.max_shift_mm(), 1);
                format!(
                    "the panel's centre is {shift} mm from its nominal position (limit {allowed} mm); move the \
                     panel nearer to it"
                )
            }),
        Check::new("turn in the panel's plane, either way", "°", fit.turn.0.abs())
            .with_max(limits.turn_limit_deg(), LimitSource::recipe("locate.turn_limit_deg"))
            .or_reject("turn_limit", || {
                let [turn, allowed] = distinguishable_texts(fit.turn.0.abs(), limits.turn_limit_deg(), 2);
                let sign = if fit.turn.0 < 0.0 { "-" } else { "" };
                format!(
                    "the panel is rotated by {sign}{turn}° in its plane (limit ±{allowed}°); rotate the panel back"
                )
            }),
        Check::new("tilt of the panel's normal", "°", fit.tilt.0)
            .with_max(limits.max_tilt_deg(), LimitSource::recipe("locate.max_tilt_deg"))
            .or_reject("tilt_limit", || {
                let [tilt, allowed] = distinguishable_texts(fit.tilt.0, limits.max_tilt_deg(), 2);
                format!(
                    "the panel's normal is tilted by {tilt}° (limit {allowed}°); align the panel with its fixture"
                )
            }),
    ]
}

#[cfg(test)]
mod tests;
