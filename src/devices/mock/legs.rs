//! Legs of a path: straight lines and blended corners.

use super::corner::{Corner, Pose, interpolate_pose};
use super::moves::Lin;

#[derive(Debug, Clone)]
pub(super) enum MoverLeg {
    /// A straight line; `stops` is true if the arm stops at its end.
    Line {
        from: Pose,
        to: Pose,
        length_mm: f64,
        lin: Lin,
        stops: bool,
    },
    Corner {
        corner: Box<Corner>,
        lin: Lin,
    },
}

impl MoverLeg {
    pub(super) fn length_mm(&self) -> f64 {
        match self {
            MoverLeg::Line { length_mm, .. } => *length_mm,
            MoverLeg::Corner { corner, .. } => corner.length_mm,
        }
    }

    pub(super) fn linear_motion(&self) -> &Lin {
        match self {
            MoverLeg::Line { lin, .. } | MoverLeg::Corner { lin, .. } => lin,
        }
    }

    pub(super) fn pose_at(&self, gone_mm: f64) -> Pose {
        match self {
            MoverLeg::Line { to, length_mm, .. } if gone_mm >= *length_mm => *to,
            MoverLeg::Line { from, to, length_mm, .. } => interpolate_pose(from, to, gone_mm / length_mm),
            MoverLeg::Corner { corner, .. } => corner.pose_at(gone_mm),
        }
    }
}

/// Returns the pose at this distance after the start of the first leg.
pub(super) fn pose_ahead(legs: &[MoverLeg], mut gone_mm: f64) -> Option<Pose> {
    for leg in legs {
        if gone_mm <= leg.length_mm() {
            return Some(leg.pose_at(gone_mm));
        }
        gone_mm -= leg.length_mm();
    }
    legs.last().map(|leg| leg.pose_at(leg.length_mm()))
}
