//! Judges a correction by corners: is it within the recipe's limits, consistent with one rigid panel, and in agreement with the 3D scan?
//! Every corner is compared with its limit individually and named by its number among the taught ones. A value that is not a number fails.

use super::super::gate::exceeds;
use super::correction::{CornerReport, Refined};
use crate::recipe;
use crate::verdict::{Judgement, Reason};
use crate::words::{apart, fixed};

/// After the correction the corners of one rigid panel are where they are seen within this, mm.
pub const MAX_LEFT_MM: f64 = 0.3;

/// Judges a correction by the recipe's limit.
pub fn judge(refined: &Refined, limits: &recipe::Corner) -> Judgement {
    let allowed_mm = limits.max_correction_mm();
    let too_far = beyond(refined, (CornerReport::asked_mm, allowed_mm), "correction_limit", |corner, asked_mm| {
        let [asked, allowed] = apart(asked_mm, allowed_mm, 2);
        format!(
            "stands {asked} mm ({} px) from where the 3D scan puts it, allowed are {allowed} mm; has the panel moved since the \
             scan, is the flange pose the picture's?",
            fixed(corner.error_px, 1)
        )
    });
    let unlike = beyond(refined, (|corner| corner.left_mm, MAX_LEFT_MM), "corners_disagree", |_, left_mm| {
        let [left, allowed] = apart(left_mm, MAX_LEFT_MM, 2);
        format!(
            "still stands {left} mm from where it is seen with the best correction of all corners, allowed are {allowed} mm; is \
             each picture of its own corner, are the flange poses theirs?"
        )
    });
    // What is left is left of all of them together.
    Judgement::of(too_far, unlike.into_iter().take(1).collect())
}

/// Judges whether the corners are still where they should be, just before contact.
pub fn judge_stands(seen: &Refined, limits: &recipe::Corner) -> Judgement {
    let allowed_mm = limits.verify_mm();
    let moved = beyond(seen, (CornerReport::asked_mm, allowed_mm), "moved", |_, off_mm| {
        let [off, allowed] = apart(off_mm, allowed_mm, 2);
        format!(
            "stands {off} mm from where the localization puts it, allowed are {allowed} mm, [corner] verify_mm; has the panel \
             moved?"
        )
    });
    Judgement::of(moved, vec![])
}

/// A corner's own error in the plane of its camera, 95 %: edges to a tenth of a pixel, taught and found, mm.
const CORNER_CLAIM_MM: f64 = 0.05;

/// Where a corner stands farther from where the 3D scan puts it than both claim, that is a finding and not a mean; of
/// several the farthest. `claims_mm` are what else is claimed, 95 % each: the localization's and both calibrations'.
pub fn disagreement(refined: &Refined, claims_mm: &[f64]) -> Option<Reason> {
    let claimed_mm = claims_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt().hypot(CORNER_CLAIM_MM);
    // Twice what 95 % stay below: one in ten thousand is beyond it by chance.
    let beyond = beyond(refined, (CornerReport::asked_mm, 2.0 * claimed_mm), "corner_disagrees", |_, asked_mm| {
        let [asked, allowed] = apart(asked_mm, 2.0 * claimed_mm, 2);
        format!(
            "stands {asked} mm from where the 3D scan puts it; scan, corner and calibrations together claim {} mm (95 %), and \
             allowed is twice as much, {allowed} mm: one of them is wrong, verify the calibrations",
            fixed(claimed_mm, 2)
        )
    });
    beyond.into_iter().next()
}

/// A reason for each corner of which something is more than allowed, the most first; `words` go on after its name.
fn beyond(
    refined: &Refined,
    (measured, allowed): (fn(&CornerReport) -> f64, f64),
    code: &'static str,
    words: impl Fn(&CornerReport, f64) -> String,
) -> Vec<Reason> {
    // Without its sign what is not a number counts as the most.
    let measured = |corner| (corner, measured(corner).abs());
    let mut beyond: Vec<(&CornerReport, f64)> = refined.corners.iter().map(measured).collect();
    beyond.retain(|(_, measured)| exceeds(*measured, allowed));
    beyond.sort_by(|a, b| b.1.total_cmp(&a.1));
    let reason = |(corner, measured): (&CornerReport, f64)| {
        Reason::new(code, format!("corner {} {}", corner.corner + 1, words(corner, measured)))
    };
    beyond.into_iter().map(reason).collect()
}
