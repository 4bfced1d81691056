//! The result from the pictures so far, and which one to take next.

use super::super::super::outcome::Outcome;
use super::super::super::output::tell_line as tell;
use crate::geometry::KukaPose;
use crate::verdict::Verdict;

pub(super) fn say_lens(outcome: &Outcome) {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    if let (Some(rms_px), Some(coverage)) = (number("rms_px"), number("coverage")) {
        tell(&format!(
            "so far: {verdict}, {rms_px:.3} px rms, corners cover {:.0} % of the picture",
            100.0 * coverage
        ));
    }
    say_reasons(outcome);
    match outcome.json.get("next_picture").and_then(serde_json::Value::as_str) {
        Some(next) => tell(&format!("next: {next}")),
        None => tell("enough: no further picture makes the lens's error smaller by 2 % or more"),
    }
}

pub(super) fn say_reasons(outcome: &Outcome) {
    let reasons = outcome.json.get("reasons").and_then(serde_json::Value::as_array);
    for reason in reasons.into_iter().flatten().filter_map(|reason| reason["message"].as_str()) {
        tell(&format!("  {reason}"));
    }
}

/// Whether another pose is worth taking.
pub(super) fn say_mount(outcome: &Outcome) -> bool {
    let number = |key: &str| outcome.json.get(key).and_then(serde_json::Value::as_f64);
    let verdict = outcome.json.get("verdict").and_then(serde_json::Value::as_str).unwrap_or_default();
    let Some(uncertainty_mm) = number("uncertainty_mm") else {
        say_reasons(outcome);
        return true;
    };
    tell(&format!("so far: {verdict}, ± {uncertainty_mm:.3} mm at the panel (95 %)"));
    say_reasons(outcome);
    let (Some(pose), Some(next_mm)) = (next_pose(outcome), number("next_uncertainty_mm")) else {
        tell("enough: no further pose makes the mount's error smaller");
        return verdict != Verdict::Accept.word();
    };
    let is_worth = next_mm < MAX_REMAINING_SHARE * uncertainty_mm && uncertainty_mm > WELL_KNOWN_MM;
    let worth = if is_worth { "next" } else { "enough; the pose that would help most" };
    tell(&format!("{worth}: flange {pose}, for ± {next_mm:.3} mm"));
    is_worth || verdict != Verdict::Accept.word()
}

/// The pose that would help most.
pub(super) fn next_pose(outcome: &Outcome) -> Option<KukaPose> {
    outcome.json.get("next_pose").and_then(|pose| serde_json::from_value(pose.clone()).ok())
}

/// A pose that leaves more of the error is not worth taking.
const MAX_REMAINING_SHARE: f64 = 0.95;

/// Nor is one worth taking below this: the arm comes back to a pose only to about 0.03 mm (data sheet of the KR 6 R700).
const WELL_KNOWN_MM: f64 = 0.02;
