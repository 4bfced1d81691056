//! The lines of a path, and the poses on them that are checked.

use crate::path::kinematics::JointAngles;
use nalgebra::Isometry3;
use panelprep_base::geometry::{Base, Flange, Frame, Point, Rigid, Tool};

/// One line of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLine {
    /// The pose at the end of the line.
    pub base_from_tool: Rigid<Base, Tool>,
    /// Speed of the tool centre point on this line, mm/s.
    pub feed_mm_s: f64,
    /// Rounding at the end of the line, mm; 0 stops there.
    pub blend_mm: f64,
}

/// One checked pose of a path.
pub(super) struct CheckedPose {
    pub index: usize,
    pub base_from_flange: Rigid<Base, Flange>,
    pub tip: Point<Base>,
    /// Time since the previous checked pose, s.
    pub seconds: f64,
    /// Time in which the speed may change since the previous checked pose, s; `None` if the arm stops in between.
    pub change_s: Option<f64>,
    /// Whether a waypoint ends here.
    pub is_end: bool,
    pub solutions: Vec<JointAngles>,
}

/// Returns the pose at a fraction of a straight line, rotated by the same fraction of the angle.
pub fn interpolate_pose<To: Frame>(from: Rigid<To, Tool>, to: Rigid<To, Tool>, share: f64) -> Rigid<To, Tool> {
    let (from, to) = (from.isometry(), to.isometry());
    let place = from.translation.vector.lerp(&to.translation.vector, share);
    // Between opposite rotations the interpolation is not unique; the check at the end finds the jump.
    let turned = from.rotation.try_slerp(&to.rotation, share, 1e-9).unwrap_or(to.rotation);
    Rigid::from_isometry_unchecked(Isometry3::from_parts(place.into(), turned))
}
