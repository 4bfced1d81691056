//! Legs of a path: straight lines and blended corners.

use super::corner::{Corner, Pose, between};
use super::moves::Lin;

#[derive(Debug, Clone)]
pub(super) enum Leg {
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

impl Leg {
    pub(super) fn length_mm(&self) -> f64 {
        match self {
            Leg::Line { length_mm, .. } => *length_mm,
            Leg::Corner { corner, .. } => corner.length_mm,
        }
    }

    pub(super) fn lin(&self) -> &Lin {
        match self {
            Leg::Line { lin, .. } | Leg::Corner { lin, .. } => lin,
        }
    }

    pub(super) fn pose_at(&self, gone_mm: f64) -> Pose {
        match self {
            Leg::Line { to, length_mm, .. } if gone_mm >= *length_mm => *to,
            Leg::Line { from, to, length_mm, .. } => between(from, to, gone_mm / length_mm),
            Leg::Corner { corner, .. } => corner.pose_at(gone_mm),
        }
    }
}

/// Returns the pose at this distance after the start of the first leg.
pub(super) fn pose_ahead(legs: &[Leg], mut gone_mm: f64) -> Option<Pose> {
    for leg in legs {
        if gone_mm <= leg.length_mm() {
            return Some(leg.pose_at(gone_mm));
        }
        gone_mm -= leg.length_mm();
    }
    legs.last().map(|leg| leg.pose_at(leg.length_mm()))
}
