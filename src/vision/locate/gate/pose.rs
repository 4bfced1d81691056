//! Checks whether the panel's pose is known well enough, unique and allowed.
//!
//! The cause of a pose's uncertainty decides what helps: more of the panel in view, a place nearer to the taught one,
//! or a 3D camera with a measured scale.

use super::super::CompetingPose;
use super::super::evidence::Fit;
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource};
use panelprep_cell::recipe;
use panelprep_cell::record::name;

/// Largest distance between the results of fits from independent starts, mm.
pub const MAX_DISAGREEMENT_MM: f64 = 0.1;
/// Smallest ratio of the support of the pose to the support of any other pose.
pub const MIN_MARGIN: f64 = 2.0;
/// Largest stated error of a usable pose anywhere on the panel, mm: the error of 0.25 mm at one place, times 2.35 /
/// 1.7 (`geometry/statistics`).
pub const MAX_UNCERTAINTY_MM: f64 = 0.35;

/// Checks whether the panel's pose is known well enough.
pub(super) fn check_pose_uncertainty(fit: &Fit) -> Vec<Check> {
    let rival = fit.rival.as_ref();
    let ambiguous = |rival: &CompetingPose| {
        let [margin, needed] = distinguishable_texts(rival.evidence_ratio(), MIN_MARGIN, 1);
        format!(
            "another pose, turned by {}°, explains the scan about as well: {} mm of outline and surface support \
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
            .reviews("uncertain", || {
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
            .reviews("starts_disagree", || {
                let [agreement, allowed] = distinguishable_texts(fit.agreement_mm, MAX_DISAGREEMENT_MM, 3);
                format!("fits from independent starts end {agreement} mm apart (limit {allowed} mm); scan again")
            }),
        Check::new("for this placement against the next best, times", "", rival.map(CompetingPose::evidence_ratio))
            .with_min(MIN_MARGIN, LimitSource::Program)
            .reviews("ambiguous", || rival.map_or(String::new(), ambiguous)),
    ]
}

/// States what makes a pose uncertain, and what helps.
fn uncertainty_reason(fit: &Fit) -> String {
    let mm = |value| fixed_decimals(value, 2);
    if fit.uncertainty_at_taught_place_mm <= MAX_UNCERTAINTY_MM {
        format!(
            "the panel's centre is {} mm from its taught position, so the scale error of the 3D camera counts; at \
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

/// Checks whether the panel's pose is within its limits.
pub(super) fn motion(fit: &Fit, limits: &recipe::Locate) -> Vec<Check> {
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
                    "the panel is turned by {sign}{turn}° in its plane (limit ±{allowed}°); turn the panel back"
                )
            }),
        Check::new("tilt of the panel's normal", "°", fit.tilt.0)
            .with_max(limits.max_tilt_deg(), LimitSource::recipe("locate.max_tilt_deg"))
            .or_reject("tilt_limit", || {
                let [tilt, allowed] = distinguishable_texts(fit.tilt.0, limits.max_tilt_deg(), 2);
                format!("the panel's normal is tilted by {tilt}° (limit {allowed}°); set the panel upright")
            }),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::tests::good;
    use super::*;
    use panelprep_base::verdict::Judgement;

    /// An uncertainty of 0.41 mm is too large. If it would be at most the allowed 0.35 mm without one of the
    /// causes, this cause is named.
    #[test]
    fn an_uncertain_pose_names_its_cause_and_what_helps_against_that() {
        let words = |uncertainty_at_taught_place_mm, uncertainty_without_scale_mm| {
            let fit = Fit {
                uncertainty_mm: 0.41,
                uncertainty_at_taught_place_mm,
                uncertainty_without_scale_mm,
                ..good()
            };
            Judgement::from_checks(&check_pose_uncertainty(&fit))
                .reasons
                .into_iter()
                .map(|reason| reason.message)
                .collect::<String>()
        };
        let far = words(0.27, 0.26);
        assert!(
            far.contains("is 20 mm from") && far.contains("would be 0.27 mm") && far.contains("nearer"),
            "{far}"
        );
        let from_scan_to_scan = words(0.40, 0.26);
        assert!(from_scan_to_scan.contains("would be 0.26 mm"), "{from_scan_to_scan}");
        assert!(
            from_scan_to_scan.contains("warm up") && !from_scan_to_scan.contains("nearer"),
            "{from_scan_to_scan}"
        );
        let by_surface = words(0.40, 0.39);
        assert!(by_surface.contains("uncover more of the panel") && !by_surface.contains("scale"), "{by_surface}");
    }
}
