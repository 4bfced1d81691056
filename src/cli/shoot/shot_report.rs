//! The report about a shot.

use super::super::outcome::Outcome;
use panelprep_devices::cameras::{Conditions, PictureQuality};
use serde_json::{Value, json};

/// Adds what the camera reports about a shot, as text and for scripts.
pub(super) fn conditions(outcome: &mut Outcome, description: &mut Value, conditions: Conditions) {
    let Conditions { exposure_us, camera_c, throttled_ms } = conditions;
    (description["exposure_us"], description["camera_c"], description["throttled_ms"]) =
        (json!(exposure_us), json!(camera_c), json!(throttled_ms));
    let words = [
        exposure_us.map(|us| format!("exposed for {:.2} ms", us / 1_000.0)),
        camera_c.map(|celsius| format!("camera temperature {celsius:.1} °C")),
        throttled_ms.map(|ms| format!("the camera paused for {ms:.0} ms because it is hot")),
    ];
    let words: Vec<String> = words.into_iter().flatten().collect();
    if !words.is_empty() {
        outcome.add_line(format!("  {}", words.join(", ")));
    }
}

pub(super) fn describe_quality(quality: &PictureQuality) -> String {
    format!(
        "sharpness {:.1} grey levels per pixel at the steepest edges, saturated {:.2} %, dark {:.1} %, mean grey level {:.0} of 255",
        quality.sharpness_gray_per_px,
        100.0 * quality.saturated_share,
        100.0 * quality.dark_share,
        quality.mean_gray
    )
}
