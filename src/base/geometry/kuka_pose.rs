//! KUKA's pose, X Y Z A B C, and the angles of the robot's six axes, as they are written in messages, logs and files.
//!
//! `R = Rz(A)·Ry(B)·Rx(C)` (thesis Eq. 3.4 as corrected: r22 = cA cC + sA sB sC). The inverse is `A = atan2(r21, r11)`,
//! `B = atan2(−r31, hypot(r11, r21))`, `C = atan2(r32, r33)` (Eq. 3.3 as corrected). At |B| = 90° only A ± C is
//! determined: A is then set to 0, and C contains the whole rotation. Near |B| = 90° small errors change A and C by
//! large amounts. Therefore compare rotations, not angles, and convert a pose to a [`Rigid`] before multiplying it.

use super::rigid::{Degrees, Frame, Rigid};
use crate::number_text::fixed_decimals;
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Position in mm and Z-Y′-X″ angles in degrees, as the controller writes them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KukaPose {
    /// X, mm.
    pub x_mm: f64,
    /// Y, mm.
    pub y_mm: f64,
    /// Z, mm.
    pub z_mm: f64,
    /// Rotation about Z, degrees.
    pub a_deg: f64,
    /// Rotation about the new Y, degrees.
    pub b_deg: f64,
    /// Rotation about the newest X, degrees.
    pub c_deg: f64,
}

/// Minimum cosine of B at which the angles A and C can be separated.
const MIN_COS_B: f64 = 1e-9;

impl KukaPose {
    /// Returns the transform of this pose. The caller states the frames.
    pub fn to_rigid<To: Frame, From: Frame>(self) -> Rigid<To, From> {
        let turn = |axis: nalgebra::Unit<Vector3<f64>>, deg: f64| {
            UnitQuaternion::from_axis_angle(&axis, Degrees(deg).to_rad())
        };
        let rotation = turn(Vector3::z_axis(), self.a_deg)
            * turn(Vector3::y_axis(), self.b_deg)
            * turn(Vector3::x_axis(), self.c_deg);
        Rigid::from_isometry_unchecked(Isometry3::from_parts(
            Translation3::new(self.x_mm, self.y_mm, self.z_mm),
            rotation,
        ))
    }

    /// Returns the pose of this transform.
    pub fn from_rigid<To: Frame, From: Frame>(rigid: &Rigid<To, From>) -> Self {
        let position = rigid.origin().mm;
        let [a_deg, b_deg, c_deg] = angles_deg(&rigid.rotation());
        KukaPose { x_mm: position.x, y_mm: position.y, z_mm: position.z, a_deg, b_deg, c_deg }
    }

    /// Returns true if no number is NaN or infinite.
    pub fn is_finite(&self) -> bool {
        [self.x_mm, self.y_mm, self.z_mm, self.a_deg, self.b_deg, self.c_deg].iter().all(|n| n.is_finite())
    }
}

impl std::fmt::Display for KukaPose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = [self.x_mm, self.y_mm, self.z_mm].map(|mm| fixed_decimals(mm, 3));
        let [a, b, c] = [self.a_deg, self.b_deg, self.c_deg].map(|deg| fixed_decimals(deg, 4));
        write!(f, "X {x} Y {y} Z {z} mm, A {a} B {b} C {c}°")
    }
}

// Returns A, B and C of a rotation by Eq. 3.3 as corrected, degrees.
fn angles_deg(rotation: &Rotation3<f64>) -> [f64; 3] {
    let r = rotation.matrix();
    let cos_b = r[(0, 0)].hypot(r[(1, 0)]);
    let b_rad = (-r[(2, 0)]).atan2(cos_b);
    let (a_rad, c_rad) = if cos_b < MIN_COS_B {
        // With A = 0: r22 = cos C and r23 = −sin C.
        (0.0, (-r[(1, 2)]).atan2(r[(1, 1)]))
    } else {
        (r[(1, 0)].atan2(r[(0, 0)]), r[(2, 1)].atan2(r[(2, 2)]))
    };
    [a_rad, b_rad, c_rad].map(f64::to_degrees)
}

/// The angles of the six axes, degrees, as the controller writes them. The angles are never wrapped, because A4 and A6
/// can rotate beyond ±180°.
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
    /// Returns the angles of axes 1 to 6, degrees.
    pub fn degrees(&self) -> [f64; 6] {
        [self.a1_deg, self.a2_deg, self.a3_deg, self.a4_deg, self.a5_deg, self.a6_deg]
    }

    /// Returns the largest difference between the corresponding axis angles of two postures, degrees.
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
    use super::super::rigid::{Base, Point, Tool};
    use super::*;
    use nalgebra::Point3;
    use proptest::prelude::*;

    /// Expected value, calculated by hand: Ry(90)·ẑ = x̂, then Rz(90)·x̂ = ŷ. The wrong order of the rotations would
    /// give x̂; with A and C exchanged the result would be −ŷ.
    #[test]
    fn the_tool_axis_is_rotated_by_b_and_then_by_a() {
        let pose = KukaPose { x_mm: 100.0, a_deg: 90.0, b_deg: 90.0, ..KukaPose::default() };
        let tip = pose.to_rigid::<Base, Tool>() * Point::<Tool>::at(0.0, 0.0, 10.0);
        assert!((tip.mm - Point3::new(100.0, 10.0, 0.0)).norm() < 1e-9, "{tip:?}");
    }

    /// Expected value, calculated by hand for A = 30°, B = 20°, C = 10°: r22 = cA cC + sA sB sC = 0.8529 + 0.0297 =
    /// 0.8826. The equation printed in the thesis gives 0.8232.
    #[test]
    fn equation_3_4_has_the_corrected_sign() {
        let pose = KukaPose { a_deg: 30.0, b_deg: 20.0, c_deg: 10.0, ..KukaPose::default() };
        let r = pose.to_rigid::<Base, Tool>().rotation();
        assert!((r.matrix()[(1, 1)] - 0.882_564).abs() < 1e-6, "{r}");
        assert!((r.matrix()[(2, 0)] + 0.342_020).abs() < 1e-6);
    }

    /// At B = 90° the pose (40, 90, 10) has the same rotation as (0, 90, −30), because the rotation depends only on C −
    /// A.
    #[test]
    fn at_b_of_90_degrees_a_is_zero_and_the_rotation_is_kept() {
        for (b_deg, c_expected_deg) in [(90.0, -30.0), (-90.0, 50.0)] {
            let pose = KukaPose { a_deg: 40.0, b_deg, c_deg: 10.0, ..KukaPose::default() };
            let rigid = pose.to_rigid::<Base, Tool>();
            let back = KukaPose::from_rigid(&rigid);
            assert_eq!(back.a_deg, 0.0);
            assert!((back.c_deg - c_expected_deg).abs() < 1e-6, "{back}");
            assert!((back.to_rigid::<Base, Tool>().rotation().matrix() - rigid.rotation().matrix()).norm() < 1e-9);
        }
    }

    proptest! {
        #[test]
        fn pose_and_transform_convert_into_each_other(
            a_deg in -180.0..180.0f64, b_deg in -89.99..89.99f64, c_deg in -180.0..180.0f64,
        ) {
            let pose = KukaPose { x_mm: 1.0, y_mm: -2.0, z_mm: 3.0, a_deg, b_deg, c_deg };
            let back = KukaPose::from_rigid(&pose.to_rigid::<Base, Tool>());
            prop_assert!((back.a_deg - a_deg).abs() < 1e-7 && (back.b_deg - b_deg).abs() < 1e-7);
            prop_assert!((back.c_deg - c_deg).abs() < 1e-7 && (back.y_mm + 2.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_largest_difference_of_an_axis_counts() {
        let (one, other) =
            (Joints::from([1.0, -90.0, 90.0, 0.0, 5.0, 6.0]), Joints::from([1.5, -90.0, 87.0, 0.0, 5.0, 8.0]));
        assert_eq!((one.max_difference_deg(&other), one.max_difference_deg(&one)), (3.0, 0.0));
    }
}
