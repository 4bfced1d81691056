//! The parts of the error at the tool that calibrations know, each a radius that holds the error with 95 %, mm.
//!
//! Whole budgets stand in the cycle's record; the panel's place and the surface's fit are not known here.

use super::health::Verification;
use crate::cell::{Mount, MountedPose, ToolMount};

/// Two parts of the budget; `None` while not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// The camera's mount, at the panel: what its calibration states.
    pub hand_eye_mm: Option<f64>,
    /// The robot and its tool: what the tool's calibration states, and what the last touch of known points missed.
    pub robot_mm: Option<f64>,
}

/// The parts from the files in use and the last touch check. A touch is the one look at the robot's absolute error, so
/// without one the robot's part is not measured.
pub fn parts<M: Mount>(
    camera: &MountedPose<M>,
    tool: &MountedPose<ToolMount>,
    last_touch: Option<&Verification>,
) -> Parts {
    let measured = |mm: f64| mm.is_finite().then_some(mm);
    let robot = tool.uncertainty_mm.zip(last_touch).map(|(tool_mm, touch)| tool_mm.hypot(touch.error_mm));
    Parts { hand_eye_mm: camera.uncertainty_mm.and_then(measured), robot_mm: robot.and_then(measured) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::ScannerMount;
    use crate::geometry::KukaPose;

    /// By hand: 0.3 mm of the tool and 0.4 mm missed at the touch are 0.5 mm together.
    #[test]
    fn tool_and_touch_add_as_squares() {
        let mut camera = MountedPose::<ScannerMount>::of(KukaPose::default());
        let mut tool = MountedPose::<ToolMount>::of(KukaPose::default());
        let touch = Verification {
            subject: "tool".to_owned(),
            error_mm: 0.4,
            limit_mm: 0.5,
            calibration_hash: String::new(),
            at_unix_s: 0,
        };
        assert_eq!(parts(&camera, &tool, Some(&touch)), Parts { hand_eye_mm: None, robot_mm: None });
        (camera.uncertainty_mm, tool.uncertainty_mm) = (Some(0.1), Some(0.3));
        let known = parts(&camera, &tool, Some(&touch));
        assert_eq!(known.hand_eye_mm, Some(0.1));
        assert!((known.robot_mm.expect("measured") - 0.5).abs() < 1e-12);
        assert_eq!(parts(&camera, &tool, None).robot_mm, None);
    }
}
