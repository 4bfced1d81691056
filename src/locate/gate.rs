//! The gate of the localization: turns evidence into accept, review or reject, each with reasons in words.
//!
//! Shift, turn and tilt are judged at the panel's centre, never at the base's origin: a small turn moves a far origin by
//! much, and that says nothing about the panel.

use super::LocateError;
use super::evidence::Fit;
use super::point_to_plane::CONVERGED_MM;
use crate::recipe;
use crate::verdict::{Judgement, Reason};

/// An overlap this much below the limit is a person's matter: perhaps something covers the panel. Below it is no panel.
const REVIEW_OVERLAP: f64 = 0.1;
/// So much less of the outline than of the surface may be found: what hides a patch in the middle of a side hides its edge.
const OUTLINE_ALLOWANCE: f64 = 0.15;

/// Judges a fit by the recipe's limits.
pub fn judge(fit: &Fit, limits: &recipe::Locate) -> Judgement {
    let mut reject = Vec::new();
    let mut review = Vec::new();
    if fit.last_step_mm.is_nan() || fit.last_step_mm > CONVERGED_MM {
        reject.push(Reason::new(
            "not_converged",
            format!(
                "after {} steps the fit still moved by {:.4} mm, allowed are {CONVERGED_MM} mm; scan again",
                fit.iterations, fit.last_step_mm
            ),
        ));
    }
    let exceeds = |measured: f64, allowed: f64| measured.is_nan() || measured > allowed;
    if exceeds(fit.rms_mm, limits.max_rms_mm()) {
        reject.push(Reason::new(
            "poor_fit",
            format!(
                "the scan differs from the taught panel by {:.3} mm rms, allowed are {:.3} mm; is it the right panel, \
                 dry and clean?",
                fit.rms_mm,
                limits.max_rms_mm()
            ),
        ));
    }
    overlap(fit, limits, &mut reject, &mut review);
    if exceeds(fit.shift_mm, limits.max_shift_mm()) {
        reject.push(Reason::new(
            "shift_limit",
            format!(
                "the panel's centre stands {:.1} mm from its nominal place, allowed are {:.1} mm; put it nearer",
                fit.shift_mm,
                limits.max_shift_mm()
            ),
        ));
    }
    if exceeds(fit.turn.0.abs(), limits.turn_limit_deg()) {
        reject.push(Reason::new(
            "turn_limit",
            format!(
                "the panel is turned by {:.2}° in its plane, allowed are {:.2}°; turn it back",
                fit.turn.0,
                limits.turn_limit_deg()
            ),
        ));
    }
    if exceeds(fit.tilt.0, limits.max_tilt_deg()) {
        reject.push(Reason::new(
            "tilt_limit",
            format!(
                "the panel's normal is tilted by {:.2}°, allowed are {:.2}°; set it upright",
                fit.tilt.0,
                limits.max_tilt_deg()
            ),
        ));
    }
    Judgement::of(reject, review)
}

fn overlap(fit: &Fit, limits: &recipe::Locate, reject: &mut Vec<Reason>, review: &mut Vec<Reason>) {
    let allowed = limits.min_overlap();
    let outline_allowed = (allowed - OUTLINE_ALLOWANCE).max(0.0);
    if fit.overlap() >= allowed && fit.outline_found >= outline_allowed {
        return;
    }
    let reason = Reason::new(
        "low_overlap",
        format!(
            "{:.0} % of the taught surface, {:.0} % of its outline and {:.0} % of the scanned one have a partner, allowed \
             are {:.0}, {:.0} and {:.0} %; is it the right panel, and is nothing before it?",
            100.0 * fit.taught_found,
            100.0 * fit.outline_found,
            100.0 * fit.scan_found,
            100.0 * allowed,
            100.0 * outline_allowed,
            100.0 * allowed
        ),
    );
    let nearly = fit.overlap() >= allowed - REVIEW_OVERLAP && fit.outline_found >= outline_allowed - REVIEW_OVERLAP;
    if nearly { review.push(reason) } else { reject.push(reason) }
}

/// The verdict where nothing was found: a bad panel is a verdict, not a fault.
pub fn refusal(error: &LocateError) -> Judgement {
    Judgement::of(vec![Reason::new("no_panel", error.to_string())], Vec::new())
}
