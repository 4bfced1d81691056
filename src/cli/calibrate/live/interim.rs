//! The result from the pictures so far, and the next picture to take.

use super::super::super::outcome::Outcome;
use super::super::super::output::write_progress as tell;
use panelprep_base::geometry::KukaPose;
use panelprep_base::verdict::Verdict;

pub(super) fn report_lens(outcome: &Outcome) {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    if let (Some(rms_px), Some(coverage)) = (number("rms_px"), number("coverage")) {
        tell(&format!(
            "so far: {verdict}, residuals {rms_px:.3} px rms, corners cover {:.0} % of the picture",
            100.0 * coverage
        ));
    }
    report_reasons(outcome);
    match outcome.json.get("next_picture").and_then(serde_json::Value::as_str) {
        Some(next) => tell(&format!("next: {next}")),
        None => tell("enough pictures: no further picture reduces the lens's error by 2 % or more"),
    }
}

pub(super) fn report_reasons(outcome: &Outcome) {
    let reasons = outcome.json.get("reasons").and_then(serde_json::Value::as_array);
    for reason in reasons.into_iter().flatten().filter_map(|reason| reason["message"].as_str()) {
        tell(&format!("  {reason}"));
    }
}

/// Reports the mount so far; returns whether another pose is useful.
pub(super) fn report_mount(outcome: &Outcome) -> bool {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    let Some(uncertainty_mm) = number("uncertainty_mm") else {
        report_reasons(outcome);
        return true;
    };
    tell(&format!("so far: {verdict}, uncertainty ± {uncertainty_mm:.3} mm at the panel (95 %)"));
    report_reasons(outcome);
    let (Some(pose), Some(next_mm)) = (suggest_next_pose(outcome), number("next_uncertainty_mm")) else {
        tell("enough poses: no further pose reduces the mount's uncertainty");
        return verdict != Verdict::Accept.keyword();
    };
    // The next pose is chosen for the pictures: its error is compared with theirs, not with that of the points.
    let by_pictures_mm = number("picture_uncertainty_mm").unwrap_or(uncertainty_mm);
    let is_worth = next_mm < MAX_REMAINING_SHARE * by_pictures_mm && by_pictures_mm > SUFFICIENT_ERROR_MM;
    let worth = if is_worth { "next" } else { "enough poses; the most useful further pose" };
    tell(&format!("{worth}: flange {pose}, then the uncertainty is ± {next_mm:.3} mm"));
    is_worth || verdict != Verdict::Accept.keyword()
}

/// Returns the pose that would improve the result most.
pub(super) fn suggest_next_pose(outcome: &Outcome) -> Option<KukaPose> {
    outcome.json.get("next_pose").and_then(|pose| serde_json::from_value(pose.clone()).ok())
}

/// Another pose is only useful if less than this share of the error remains after it.
const MAX_REMAINING_SHARE: f64 = 0.95;

/// If the error is below this value, no further pose is useful: the arm returns to a pose only with about 0.03 mm
/// (data sheet of the KR 6 R700).
const SUFFICIENT_ERROR_MM: f64 = 0.02;
