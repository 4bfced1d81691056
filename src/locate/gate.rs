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

/// The last step of a fit that is at its end moves no point of the panel farther, mm.
pub const MAX_LAST_STEP_MM: f64 = CONVERGED_MM;

/// The smallest share of the outline that must be found, 0…1.
pub fn min_outline_found(limits: &recipe::Locate) -> f64 {
    (limits.min_overlap() - OUTLINE_ALLOWANCE).max(0.0)
}

/// Judges a fit by the recipe's limits.
pub fn judge(fit: &Fit, limits: &recipe::Locate) -> Judgement {
    let mut reject = Vec::new();
    let mut review = Vec::new();
    if exceeds(fit.last_step_mm, CONVERGED_MM) {
        reject.push(Reason::new(
            "not_converged",
            format!(
                "after {} steps the fit still moved by {:.4} mm, allowed are {CONVERGED_MM} mm; scan again",
                fit.iterations, fit.last_step_mm
            ),
        ));
    }
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
    // Where something that is not the panel ended up is no reason for anything.
    if reject.is_empty() {
        motion(fit, limits, &mut reject);
    }
    Judgement::of(reject, review)
}

fn motion(fit: &Fit, limits: &recipe::Locate, reject: &mut Vec<Reason>) {
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
}

fn overlap(fit: &Fit, limits: &recipe::Locate, reject: &mut Vec<Reason>, review: &mut Vec<Reason>) {
    let allowed = limits.min_overlap();
    let outline_allowed = min_outline_found(limits);
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

/// NaN exceeds every limit.
fn exceeds(measured: f64, allowed: f64) -> bool {
    measured.is_nan() || measured > allowed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Base, Degrees, Panel, Rigid};
    use crate::verdict::Verdict;
    use nalgebra::{Isometry3, Matrix6};

    fn good() -> Fit {
        let base_from_panel: Rigid<Base, Panel> = Rigid::claim(Isometry3::identity());
        Fit {
            base_from_panel,
            rms_mm: 0.08,
            outline_rms_mm: 0.1,
            outline_rms_px: 0.25,
            taught_found: 0.99,
            scan_found: 0.98,
            outline_found: 0.97,
            iterations: 5,
            last_step_mm: 0.001,
            covariance: Matrix6::identity(),
            uncertainty_mm: 0.15,
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
        let judgement = judge(fit, recipe.locate());
        (judgement.verdict, judgement.reasons.into_iter().map(|reason| reason.code).collect())
    }

    /// The recipe's defaults: 60 mm, 15°, 15°, 0.25 mm rms, 0.9 of overlap.
    #[test]
    fn each_limit_has_its_reason() {
        assert_eq!(judged(&good()), (Verdict::Accept, vec![]));
        assert_eq!(judged(&Fit { shift_mm: 60.1, ..good() }), (Verdict::Reject, vec!["shift_limit".into()]));
        assert_eq!(judged(&Fit { turn: Degrees(-15.1), ..good() }), (Verdict::Reject, vec!["turn_limit".into()]));
        assert_eq!(judged(&Fit { tilt: Degrees(15.1), ..good() }), (Verdict::Reject, vec!["tilt_limit".into()]));
        assert_eq!(judged(&Fit { rms_mm: 0.26, ..good() }), (Verdict::Reject, vec!["poor_fit".into()]));
        assert_eq!(judged(&Fit { last_step_mm: 0.01, ..good() }), (Verdict::Reject, vec!["not_converged".into()]));
        assert_eq!(judged(&Fit { rms_mm: f64::NAN, ..good() }), (Verdict::Reject, vec!["poor_fit".into()]));
    }

    #[test]
    fn a_little_less_overlap_is_for_a_person_and_much_less_is_no_panel() {
        assert_eq!(judged(&Fit { scan_found: 0.85, ..good() }), (Verdict::Review, vec!["low_overlap".into()]));
        assert_eq!(judged(&Fit { taught_found: 0.79, ..good() }), (Verdict::Reject, vec!["low_overlap".into()]));
        assert_eq!(judged(&Fit { outline_found: 0.7, ..good() }), (Verdict::Review, vec!["low_overlap".into()]));
        assert_eq!(judged(&Fit { outline_found: 0.6, ..good() }), (Verdict::Reject, vec!["low_overlap".into()]));
    }

    /// A wrong panel that ended up far away is a wrong panel, not a shifted one.
    #[test]
    fn a_poor_fit_says_nothing_of_motion() {
        assert_eq!(judged(&Fit { rms_mm: 3.0, shift_mm: 90.0, ..good() }).1, ["poor_fit"]);
    }
}
