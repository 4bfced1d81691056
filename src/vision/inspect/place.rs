//! Checks before any film runs: whether the panel is at its pose, and whether the pixels are fine enough.

use panelprep_base::number_text::distinguishable_texts;
use panelprep_base::verdict::Reason;

/// Largest accepted distance of the panel's outline in the dry picture from its position calculated from the pose, px.
/// If the panel is in place, the distance is a few tenths of a pixel, from the errors of pose and calibration.
pub const MAX_OFF_PX: f64 = 1.5;

/// Returns a reason if breaks that must fail a grid may be missed: the smallest break that is surely found is
/// larger than the smallest break that fails a grid.
pub fn too_coarse(detection_limit_mm2: f64, min_break_mm2: f64) -> Option<Reason> {
    // If a value is NaN, the limit is not met.
    let is_fine = detection_limit_mm2 <= min_break_mm2;
    (!is_fine).then(|| {
        let message = format!(
            "the smallest break that is reliably detected is {detection_limit_mm2:.1} mm², but a grid fails from \
             {min_break_mm2:.1} mm² of broken film, so smaller breaks may be missed: bring the camera nearer, use \
             all of its pixels, or, if the process allows it, state a larger min_break_mm2 in the recipe's \
             [inspect]"
        );
        Reason::new("detection_limit", message)
    })
}

/// Returns the reason if the panel is not at the place where the grids are looked for.
pub fn displaced_panel_reason(off_px: Option<f64>, (assumed, has_dry): (bool, bool)) -> Option<Reason> {
    let message = match off_px {
        Some(off_px) if off_px <= MAX_OFF_PX => return None,
        None if !assumed || !has_dry => return None,
        None => "the panel is assumed to be in its nominal pose, but the dry picture cannot confirm it, because \
                 the panel's outline has too little contrast"
            .to_owned(),
        Some(off_px) => {
            let taken = if assumed { "its assumed nominal position" } else { "its located position" };
            let [off, allowed] = distinguishable_texts(off_px, MAX_OFF_PX, 1);
            format!(
                "in the dry picture the panel's outline lies {off} px or more from {taken} (limit {allowed} px), \
                 so the wrong areas would be judged"
            )
        }
    };
    let remedy =
        if assumed { "state --located with the output of `panelprep locate`" } else { "locate the panel again" };
    Some(Reason::new("elsewhere", format!("{message}: {remedy}")))
}
