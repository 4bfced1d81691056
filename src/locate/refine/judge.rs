//! What a correction by corners is worth: within the recipe's limits, of one rigid panel, and in agreement with the 3D scan.

use super::{CornerReport, Refined};
use crate::recipe;
use crate::verdict::{Judgement, Reason};

/// After the correction the corners of one rigid panel stand where they are seen within this, mm.
pub const MAX_LEFT_MM: f64 = 0.3;

/// Judges a correction by the recipe's limit.
pub fn judge(refined: &Refined, limits: &recipe::Corner) -> Judgement {
    let allowed = limits.max_correction_mm();
    let too_far = |(index, corner): (usize, &CornerReport)| {
        let asked_mm = corner.asked_mm();
        (asked_mm.is_nan() || asked_mm > allowed).then(|| {
            Reason::new(
                "correction_limit",
                format!(
                    "corner {} stands {asked_mm:.2} mm ({:.1} px) from where the 3D scan puts it, allowed are \
                     {allowed:.2} mm; has the panel moved since the scan, is the flange pose the picture's?",
                    index + 1,
                    corner.error_px
                ),
            )
        })
    };
    let left_mm = refined.corners.iter().map(|corner| corner.left_mm).fold(0.0, f64::max);
    let unlike = (left_mm.is_nan() || left_mm > MAX_LEFT_MM).then(|| {
        Reason::new(
            "corners_disagree",
            format!(
                "with the best correction a corner still stands {left_mm:.2} mm from where it is seen, allowed are \
                 {MAX_LEFT_MM} mm; is each picture of its own corner, are the flange poses theirs?"
            ),
        )
    });
    Judgement::of(refined.corners.iter().enumerate().filter_map(too_far).collect(), unlike.into_iter().collect())
}

/// Judges whether the corners still stand where they should, just before contact.
pub fn judge_stands(seen: &Refined, limits: &recipe::Corner) -> Judgement {
    let allowed_mm = limits.verify_mm();
    let moved = |(index, corner): (usize, &CornerReport)| {
        let off_mm = corner.asked_mm();
        (off_mm.is_nan() || off_mm > allowed_mm).then(|| {
            Reason::new(
                "moved",
                format!(
                    "the corner of picture {} stands {off_mm:.2} mm from where the localization puts it, allowed are \
                     {allowed_mm:.2} mm, [corner] verify_mm; has the panel moved?",
                    index + 1
                ),
            )
        })
    };
    Judgement::of(seen.corners.iter().enumerate().filter_map(moved).collect(), vec![])
}

/// A corner's own error in the plane of its camera, 95 %: edges to a tenth of a pixel, taught and found, mm.
const CORNER_CLAIM_MM: f64 = 0.05;

/// Where a corner stands farther from where the 3D scan puts it than both claim, that is a finding and not a mean.
/// `claims_mm` are what else is claimed, 95 % each: the localization's and both calibrations'.
pub fn disagreement(refined: &Refined, claims_mm: &[f64]) -> Option<Reason> {
    let claimed_mm = claims_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt().hypot(CORNER_CLAIM_MM);
    let asked = refined.corners.iter().map(|corner| corner.asked_mm());
    let (index, asked_mm) = asked.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    // Twice what 95 % stay below: one in ten thousand is beyond it by chance.
    (asked_mm > 2.0 * claimed_mm).then(|| {
        Reason::new(
            "corner_disagrees",
            format!(
                "corner {} stands {asked_mm:.2} mm from where the 3D scan puts it; scan, corner and calibrations together \
                 claim {claimed_mm:.2} mm (95 %): one of them is wrong, verify the calibrations",
                index + 1
            ),
        )
    })
}
