//! Judges a correction by corners: whether it is within the recipe's limits, consistent with one rigid panel, and in
//! agreement with the 3D scan. Every corner is compared with its limit individually and named by its number among the
//! taught ones. A NaN violates its limit.

use super::super::gate::exceeds_limit;
use super::correction::{CornerReport, RefinedPose};
use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, Judgement, LimitSource, Severity};
use panelprep_cell::recipe;

/// Largest accepted distance between a corner of a rigid panel and its measured position after the correction, mm.
pub const MAX_CORNER_DISTANCE_MM: f64 = 0.3;

/// Judges a correction by the recipe's limit.
pub fn judge(refined: &RefinedPose, limits: &recipe::Corner) -> Judgement {
    Judgement::from_checks(&checks(refined, limits))
}

/// Returns two lists of checks: the shift that each corner indicates, and the distance left after the common
/// correction; the largest first in both lists.
pub fn checks(refined: &RefinedPose, limits: &recipe::Corner) -> Vec<Check> {
    let allowed_mm = limits.max_correction_mm();
    let asked = sorted_by_size(refined, CornerReport::indicated_shift_mm).into_iter().flat_map(|(corner, asked_mm)| {
        let words = || {
            let [asked, allowed] = distinguishable_texts(asked_mm, allowed_mm, 2);
            format!(
                "{} is {asked} mm ({} px) from its position in the 3D scan (limit {allowed} mm); check whether the \
                 panel has moved since the scan, and whether the flange pose belongs to the picture",
                name(corner),
                fixed_decimals(corner.error_px, 1)
            )
        };
        [
            Check::new(format!("{} from where the scan puts it", name(corner)), "mm", asked_mm)
                .with_max(allowed_mm, LimitSource::recipe("corner.max_correction_mm"))
                .or_reject("correction_limit", words),
            Check::new(format!("{} from there in the picture", name(corner)), "px", corner.error_px),
        ]
    });
    let several = refined.corners.len() > 1;
    let left = sorted_by_size(refined, |corner| corner.remaining_shift_mm).into_iter().enumerate();
    let left = left.map(|(index, (corner, left_mm))| {
        let is_told = several.then_some(left_mm);
        let check = Check::new(format!("{} off after the correction", name(corner)), "mm", is_told)
            .with_max(MAX_CORNER_DISTANCE_MM, LimitSource::Program)
            .with_consequence_if(
                exceeds_limit(left_mm, MAX_CORNER_DISTANCE_MM),
                Severity::Review,
                "corners_disagree",
                || {
                    let [left, allowed] = distinguishable_texts(left_mm, MAX_CORNER_DISTANCE_MM, 2);
                    format!(
                        "{} is still {left} mm from its position in the picture after the best correction of all \
                     corners (limit {allowed} mm); check that each picture shows its own corner and has its own \
                     flange pose",
                        name(corner)
                    )
                },
            );
        // Only the corner with the largest distance left has a consequence: the distances left result from one
        // correction of all corners together.
        if index == 0 { check } else { check.without_consequence() }
    });
    asked.chain(left).collect()
}

/// Judges whether the corners are still at their expected positions, just before contact.
pub fn judge_standing_panel(seen: &RefinedPose, limits: &recipe::Corner) -> Judgement {
    Judgement::from_checks(&position_checks(seen, limits))
}

/// Checks the distance of each corner from its position according to the localization, the largest first. A corner
/// that is elsewhere needs a person's decision: no contact follows, the panel is dried and located again.
pub fn position_checks(seen: &RefinedPose, limits: &recipe::Corner) -> Vec<Check> {
    let allowed_mm = limits.verify_mm();
    let checks = sorted_by_size(seen, CornerReport::indicated_shift_mm).into_iter().flat_map(|(corner, off_mm)| {
        let [x_mm, y_mm] = corner.shift_mm;
        let words = || {
            let [off, allowed] = distinguishable_texts(off_mm, allowed_mm, 2);
            format!(
                "{} is {off} mm from its located position (limit {allowed} mm, [corner] verify_mm); check whether \
                 the panel has moved",
                name(corner)
            )
        };
        [
            Check::new(format!("{} from where the localization puts it", name(corner)), "mm", off_mm)
                .with_max(allowed_mm, LimitSource::recipe("corner.verify_mm"))
                .reviews("moved", words),
            Check::new(format!("{} along the camera's x", name(corner)), "mm", x_mm),
            Check::new(format!("{} along the camera's y", name(corner)), "mm", y_mm),
        ]
    });
    checks.collect()
}

/// Name of the number that [`worst_disagreement`] judges.
pub const FARTHEST_CORNER: &str = "farthest corner, against what scan, corner and calibrations claim";

/// Stated error of one corner in the plane of its camera, 95 %, mm: edges to a tenth of a pixel, taught and found.
const CORNER_CLAIM_MM: f64 = 0.05;

/// Reports the corner that is farther from its position by the 3D scan than the stated errors of both allow. This is a
/// finding and is not averaged; of several corners, the farthest is reported. `claims_mm` contains the other stated
/// errors, 95 % each: the localization's and both calibrations'. `None` if there is no corner.
pub fn worst_disagreement(refined: &RefinedPose, claims_mm: &[f64]) -> Option<Check> {
    let claimed_mm = claims_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt().hypot(CORNER_CLAIM_MM);
    // Twice the 95 % bound: by chance, one value in ten thousand is larger.
    let allowed_mm = 2.0 * claimed_mm;
    let (corner, asked_mm) = sorted_by_size(refined, CornerReport::indicated_shift_mm).into_iter().next()?;
    let check = Check::new(FARTHEST_CORNER, "mm", asked_mm);
    // If the position is not known at all, there is no limit.
    let check = if allowed_mm.is_finite() { check.with_max(allowed_mm, LimitSource::Program) } else { check };
    Some(check.with_consequence_if(exceeds_limit(asked_mm, allowed_mm), Severity::Review, "corner_disagrees", || {
        let [asked, allowed] = distinguishable_texts(asked_mm, allowed_mm, 2);
        format!(
            "{} is {asked} mm from its position in the 3D scan; the stated errors of scan, corner and calibrations \
             give {} mm (95 %), and the limit is twice this value, {allowed} mm: one of these errors is wrong; \
             verify the calibrations",
            name(corner),
            fixed_decimals(claimed_mm, 2)
        )
    }))
}

/// Sorts the corners by the absolute value of a measurement, largest first.
fn sorted_by_size(refined: &RefinedPose, measured: impl Fn(&CornerReport) -> f64) -> Vec<(&CornerReport, f64)> {
    // Without its sign, NaN sorts as the largest value.
    let mut corners: Vec<_> = refined.corners.iter().map(|corner| (corner, measured(corner).abs())).collect();
    corners.sort_by(|a, b| b.1.total_cmp(&a.1));
    corners
}

fn name(corner: &CornerReport) -> String {
    format!("corner {}", corner.corner + 1)
}
