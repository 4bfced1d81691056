//! The angles of the robot's six axes.

use serde::{Deserialize, Serialize};

/// The positions of the six axes, degrees, as the controller writes them. Never wrapped: A4 and A6 turn past ±180°.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joints {
    /// Axis 1, degrees.
    pub a1_deg: f64,
    /// Axis 2, degrees.
    pub a2_deg: f64,
    /// Axis 3, degrees.
    pub a3_deg: f64,
    /// Axis 4, degrees.
    pub a4_deg: f64,
    /// Axis 5, degrees.
    pub a5_deg: f64,
    /// Axis 6, degrees.
    pub a6_deg: f64,
}

impl Joints {
    /// The angles of axes 1 to 6, degrees.
    pub fn degrees(&self) -> [f64; 6] {
        [self.a1_deg, self.a2_deg, self.a3_deg, self.a4_deg, self.a5_deg, self.a6_deg]
    }

    /// Returns the largest difference between the axis angles of the two postures, degrees.
    pub fn max_difference_deg(&self, other: &Joints) -> f64 {
        self.degrees().iter().zip(other.degrees()).map(|(own, other)| (own - other).abs()).fold(0.0, f64::max)
    }
}

impl From<[f64; 6]> for Joints {
    /// Creates joints from the angles of axes 1 to 6, degrees.
    fn from([a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg]: [f64; 6]) -> Self {
        Joints { a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axis_that_is_farthest_off_counts() {
        let (one, other) =
            (Joints::from([1.0, -90.0, 90.0, 0.0, 5.0, 6.0]), Joints::from([1.5, -90.0, 87.0, 0.0, 5.0, 8.0]));
        assert_eq!((one.max_difference_deg(&other), one.max_difference_deg(&one)), (3.0, 0.0));
    }
}
