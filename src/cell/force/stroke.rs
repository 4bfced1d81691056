//! The gate before a contact motion: whether the tool's stroke accommodates all errors of the path.
//!
//! The tool centre point is calibrated at half the stroke s. On the panel the tool is then extended by
//!
//! ```text
//! s/2 − press_in ± e,     e = e_tool + e_surface + e_chord                                        (1)
//! ```
//!
//! with e_tool the error at the tool, 95 %, e_surface the distance of the fitted surface from the scan, 95 %, and
//! e_chord the largest distance of a straight line between two waypoints from the surface. All of (1) must be
//! within the middle two thirds of the stroke. The errors are added, not squared: a systematic error would not
//! average out along a path.

use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};
use panelprep_base::verdict::{Check, LimitSource, Severity};

/// Fraction of the stroke, centred on its middle, that may be used in contact.
pub const MIDDLE_SHARE: f64 = 2.0 / 3.0;

/// The check's name.
pub const TOOL_STROKE: &str = "compliant tool, from the middle of its stroke at most";

/// Returns the part of the stroke that may be used in contact, mm from fully back.
pub fn middle_mm(stroke_mm: f64) -> [f64; 2] {
    let half = MIDDLE_SHARE / 2.0;
    [(0.5 - half) * stroke_mm, (0.5 + half) * stroke_mm]
}

/// Checks whether the stroke accommodates the errors along the path, (1), all in mm; an error that is not stated is
/// refused.
pub fn check_stroke(stroke_mm: f64, press_in_mm: f64, errors_mm: [Option<f64>; 3]) -> Check {
    let allowed_mm = MIDDLE_SHARE / 2.0 * stroke_mm;
    // Added and not squared: the errors of tool, surface and lines may all lie in the same direction along a whole
    // path.
    let sum_mm = errors_mm.into_iter().try_fold(press_in_mm.abs(), |sum_mm, error_mm| Some(sum_mm + error_mm?));
    let check = Check::new(TOOL_STROKE, "mm", sum_mm).with_max(allowed_mm, LimitSource::cell("tool.stroke_mm"));
    let is_within = sum_mm.is_some() && check.is_met();
    check.with_consequence_if(!is_within, Severity::Reject, "tool_stroke", || match sum_mm {
        Some(sum_mm) => {
            let [found, allowed] = distinguishable_texts(sum_mm, allowed_mm, 2);
            format!(
                "the compliant tool may be {found} mm from the middle of its stroke, by the errors of tool, \
                 surface and lines, and the press-in (limit {allowed} mm for a stroke of {} mm); use a smaller \
                 press_in_mm or chord_error_mm, or calibrate the tool more accurately",
                fixed_decimals(stroke_mm, 1)
            )
        }
        None => "a compliant tool requires the error at the tool: state [limits] tool_error_mm in the cell's file"
            .to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_base::verdict::{Judgement, Verdict};

    /// Calculated by hand: 30 mm of stroke allow 10 mm about the middle: 5 to 25 mm. 8 + 1 + 0.5 + 0.4 is 9.9; with
    /// 0.6 the sum is 10.1.
    #[test]
    fn errors_and_press_in_must_stay_in_the_middle() {
        assert_eq!(middle_mm(30.0).map(|mm| (mm * 1e9).round() / 1e9), [5.0, 25.0]);
        let verdict = |errors| Judgement::from_checks([&check_stroke(30.0, 8.0, errors)]).verdict;
        assert_eq!(verdict([Some(1.0), Some(0.5), Some(0.4)]), Verdict::Accept);
        assert_eq!(verdict([Some(1.0), Some(0.5), Some(0.6)]), Verdict::Reject);
        let unknown = check_stroke(30.0, 0.0, [None, Some(0.1), Some(0.1)]);
        assert!(unknown.reason().is_some_and(|reason| reason.message.contains("tool_error_mm")));
    }
}
