//! Checks whether the 3D camera has moved since teaching, and whether this scan could show it.
//!
//! The fixture shows the motion with an error. The measured motion minus this error is the smallest distance by which
//! the camera's motion displaced the panel. A fixture that shows too little cannot detect a camera motion.

use super::super::evidence::Fit;
use panelprep_base::number_text::{distinguishable_percents, distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Severity};

/// A camera motion that displaces the panel by more than this distance, mm, means that the camera has moved since
/// teaching.
pub const MAX_CAMERA_MOVED_MM: f64 = 0.25;
/// A fixture that shows camera motion must detect a motion that displaces the panel by this distance, mm.
pub const MAX_CAMERA_NOTICED_MM: f64 = 0.55;
/// Minimum fraction of the fixture that must lie at its taught place: objects come and go, the fixture stays.
pub const MIN_FIXTURE_SAME: f64 = 0.4;
/// Returns the smallest camera motion that is noticed, mm, if the fixture determines the camera's pose with this
/// uncertainty, 95 %, mm.
pub fn noticed_mm(uncertainty_mm: f64) -> f64 {
    MAX_CAMERA_MOVED_MM + uncertainty_mm
}

/// Returns whether a fixture that gives the camera's pose with this uncertainty, mm, can detect a motion of the
/// camera; `None` means that the fixture carries no information.
pub fn can_detect_motion(uncertainty_mm: Option<f64>) -> bool {
    uncertainty_mm.is_some_and(|mm| noticed_mm(mm) <= MAX_CAMERA_NOTICED_MM)
}

/// Checks that the camera has not moved since teaching.
pub(super) fn camera(fit: &Fit) -> Vec<Check> {
    let camera = fit.camera.as_ref();
    let (moved_mm, uncertainty_mm) = (camera.map(|it| it.moved_mm), camera.map(|it| it.uncertainty_mm));
    let same = Check::new("fixture that stands where it stood", "", camera.map(|it| it.unmoved_share))
        .with_min(MIN_FIXTURE_SAME, LimitSource::Program);
    let is_other = !same.is_met();
    let same = same.or_reject("camera_moved", || {
        let [same, needed] =
            distinguishable_percents(camera.map_or(f64::NAN, |it| it.unmoved_share), MIN_FIXTURE_SAME, 0);
        format!(
            "only {same} % of the fixture is where it was at teaching, at least {needed} % are needed; check \
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
        // A different fixture gives no information about the camera's motion.
        if is_other { moved.without_consequence() } else { moved },
    ]
}

/// Checks whether this scan can show that the camera has not moved.
pub(super) fn check_fixture(fit: &Fit) -> Vec<Check> {
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    let noticed = Check::new("a camera is noticed that moves it by", "mm", uncertainty_mm.map(noticed_mm));
    // The limit applies if the fixture can detect a motion of the camera, now or at teaching.
    let is_shown = can_detect_motion(uncertainty_mm) || can_detect_motion(fit.camera_at_teaching_mm);
    let noticed = if is_shown { noticed.with_max(MAX_CAMERA_NOTICED_MM, LimitSource::Program) } else { noticed };
    // If the fixture at teaching also shows too little, a warning was already given at teaching.
    let is_unwatched = !can_detect_motion(uncertainty_mm) && can_detect_motion(fit.camera_at_teaching_mm);
    vec![noticed.with_consequence_if(is_unwatched, Severity::Review, "camera_unwatched", || {
        let seen = uncertainty_mm.map_or("too little of the fixture is visible".to_owned(), |mm| {
            let [noticed, _] = distinguishable_texts(noticed_mm(mm), MAX_CAMERA_NOTICED_MM, 2);
            format!(
                "the fixture reveals a movement of the camera only if it shifts the panel by {noticed} mm or more"
            )
        });
        format!(
            "it is unknown whether the camera has moved: {seen} (limit {MAX_CAMERA_NOTICED_MM} mm, met at \
             teaching); remove objects in front of the fixture. If the camera was calibrated again since teaching, \
             teach the panel again"
        )
    })]
}

/// Checks whether the taught scan shows enough of the fixture to notice a camera that moved.
pub(super) fn check_taught_fixture(fit: &Fit) -> Check {
    let uncertainty_mm = fit.camera.map(|camera| camera.uncertainty_mm);
    Check::new("a camera is noticed that moves the panel by", "mm", uncertainty_mm.map(noticed_mm))
        .with_max(MAX_CAMERA_NOTICED_MM, LimitSource::Program)
        .with_consequence_if(!can_detect_motion(uncertainty_mm), Severity::Review, "camera_unwatched", || {
            "too little of the fixture is visible to detect a movement of the camera; put fixed objects into view \
             beside the panel, outside of the search box, with clear edges in two directions"
                .to_owned()
        })
}
