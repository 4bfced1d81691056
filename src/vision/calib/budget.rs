//! The parts of the error at the tool that calibrations determine, mm, each as the radius that contains 95 % of the
//! errors.
//!
//! The complete budget is part of the record of the cycle; the pose of the panel and the fit of its surface are not
//! known here.

use super::health::Verification;

/// Two parts of the error budget; `None` while a part is not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// Uncertainty of the mounts of both cameras at the panel, as stated by their calibrations, mm.
    pub hand_eye_mm: Option<f64>,
    /// Robot and tool, mm: the uncertainty that the tool calibration states, and the error of the last touch of known
    /// points.
    pub robot_mm: Option<f64>,
}

/// Returns the parts of the budget from the stated uncertainties of the files in use, mm, and from the last touch check
/// in the tool's file. Only a touch shows the absolute error of the robot, so without a touch the robot's part is not
/// measured.
pub fn parts(mounts_mm: [Option<f64>; 2], tool_mm: Option<f64>, last_touch: Option<&Verification>) -> Parts {
    let both = |one: Option<f64>, other: Option<f64>| Some(one?.hypot(other?)).filter(|mm| mm.is_finite());
    let [scanner_mm, flange_mm] = mounts_mm;
    Parts { hand_eye_mm: both(scanner_mm, flange_mm), robot_mm: both(tool_mm, last_touch.map(|touch| touch.error)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value, calculated by hand: an uncertainty of the tool of 0.3 mm and an error of the touch of 0.4 mm are
    /// √(0.3² + 0.4²) = 0.5 mm.
    #[test]
    fn tool_and_touch_errors_are_added_as_root_sum_of_squares() {
        let touch = Verification {
            struck: None,
            subject: "tool".to_owned(),
            error: 0.4,
            limit: 0.5,
            calibration_hash: String::new(),
            at_unix_s: 0,
        };
        let unknown = Parts { hand_eye_mm: None, robot_mm: None };
        assert_eq!(parts([None, Some(0.1)], None, Some(&touch)), unknown);
        let known = parts([Some(0.05), Some(0.12)], Some(0.3), Some(&touch));
        assert!((known.hand_eye_mm.expect("stated") - 0.13).abs() < 1e-12);
        assert!((known.robot_mm.expect("measured") - 0.5).abs() < 1e-12);
        assert_eq!(parts([None; 2], Some(0.3), None), unknown);
    }
}
