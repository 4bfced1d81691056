//! The parts of the error at the tool that calibrations determine, mm, each as the radius that contains 95 % of the
//! errors.
//!
//! The complete budget is part of the cycle's record; the panel's pose and the surface's fit are not known here.

use super::health::Verification;

/// Two parts of the budget; `None` while not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// The uncertainty of the mounts of both cameras at the panel, as stated by their calibrations.
    pub hand_eye_mm: Option<f64>,
    /// The robot and its tool: the uncertainty that the tool's calibration states, and the error of the last touch
    /// of known points.
    pub robot_mm: Option<f64>,
}

/// Returns the parts of the budget from the stated uncertainties of the files in use, mm, and the last touch check
/// of the tool's file. Only a touch shows the robot's absolute error, so without one the robot's part is not
/// measured.
pub fn parts(mounts_mm: [Option<f64>; 2], tool_mm: Option<f64>, last_touch: Option<&Verification>) -> Parts {
    let both = |one: Option<f64>, other: Option<f64>| Some(one?.hypot(other?)).filter(|mm| mm.is_finite());
    let [scanner_mm, flange_mm] = mounts_mm;
    Parts { hand_eye_mm: both(scanner_mm, flange_mm), robot_mm: both(tool_mm, last_touch.map(|touch| touch.error)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: an uncertainty of the tool of 0.3 mm and an error of the touch of 0.4 mm give √(0.3² + 0.4²)
    /// = 0.5 mm.
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
