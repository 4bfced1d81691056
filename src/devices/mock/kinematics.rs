//! Forward and inverse kinematics of a six-axis arm with an ortho-parallel basis and a spherical wrist, b = 0.
//!
//! Frames: the base is at the foot of the arm, X forward, Z up; the flange's Z axis points out of the flange. At A =
//! (0, −90, 90, 0, 0, 0) the upper arm is vertical, and the forearm is horizontal and points forward. Then the flange's
//! Z is the base's X, its X points down, and its Y is the base's Y (A 0, B 90, C 0). With all axes at zero both arms
//! are horizontal and point forward.
//!
//! With q = (−A1, A2 + 90°, A3, −A4, A5, −A6), φ = q3 + atan2(a2, c3) and k = hypot(a2, c3):
//!     r = a1 + c2 sin q2 + k sin(q2 + φ),   h = c1 + c2 cos q2 + k cos(q2 + φ)                          (1)
//!     R = Rz(q1) Ry(q2 + q3) Rz(q4) Ry(q5) Rz(q6),   p = (r cos q1, r sin q1, h) + c4 R ẑ               (2)
//! Inverse: the wrist's centre p − c4 R ẑ gives q1 (front, back), q2 and q3 (two elbow solutions), then R gives two
//! wrist solutions. If q5 is zero, only q4 + q6 is defined; q4 keeps its value. Source: Brandstötter, Angerer, Hofbaur,
//! Proc. Austrian Robotics Workshop 2014; KUKA's zero and signs as in kroshu/kuka_robot_descriptions.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Degrees, Flange, Joints, Rigid};
use panelprep_base::number_text::shortest_text;

/// The link lengths of an arm, and the limits of its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    /// Forward distance from axis 1 to axis 2, mm.
    pub a1_mm: f64,
    /// Distance from axis 3 to the axis of the forearm, perpendicular to the forearm, mm; negative if the forearm is
    /// above axis 3.
    pub a2_mm: f64,
    /// Height of axis 2, mm.
    pub c1_mm: f64,
    /// Length of the upper arm, mm.
    pub c2_mm: f64,
    /// Length of the forearm up to the wrist's centre, mm.
    pub c3_mm: f64,
    /// Distance from the wrist's centre to the flange, mm.
    pub c4_mm: f64,
    /// Minimum and maximum angle of each axis, degrees.
    pub limits_deg: [[f64; 2]; 6],
    /// Maximum speed of each axis, degrees per second.
    pub speeds_deg_s: [f64; 6],
}

/// The reason why a flange pose cannot be reached.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// The wrist's centre is too far from axis 2, or too close to it.
    #[error("the wrist's centre is {distance_mm:.1} mm from axis 2 (reachable: {} to {} mm)", allowed_mm[0], allowed_mm[1])]
    Distance {
        /// Measured distance, mm.
        distance_mm: f64,
        /// Minimum and maximum reachable distance, mm.
        allowed_mm: [f64; 2],
    },
    /// In every solution for this pose, an axis is outside of its limits.
    #[error("axis {axis} would be at {}°; the limits are {} to {}°", shortest_text(*angle_deg), allowed_deg[0], allowed_deg[1])]
    AxisLimit {
        /// 1 to 6.
        axis: usize,
        /// The angle of the axis in the solution that is nearest to the current angles.
        angle_deg: f64,
        /// Minimum and maximum angle of the axis.
        allowed_deg: [f64; 2],
    },
}

/// Minimum magnitude of sin q5; below this value the axes 4 and 6 are treated as parallel.
const MIN_SIN_Q5: f64 = 1e-9;

impl Arm {
    /// Returns the link lengths and limits of the KUKA KR 6 R700-2.
    pub const fn kr6_r700_2() -> Self {
        Arm {
            a1_mm: 25.0,
            a2_mm: -25.0,
            c1_mm: 400.0,
            c2_mm: 335.0,
            c3_mm: 365.0,
            c4_mm: 90.0,
            limits_deg: [
                [-170.0, 170.0],
                [-190.0, 45.0],
                [-120.0, 156.0],
                [-185.0, 185.0],
                [-120.0, 120.0],
                [-350.0, 350.0],
            ],
            speeds_deg_s: [360.0, 300.0, 360.0, 450.0, 450.0, 540.0],
        }
    }

    /// Returns the flange pose at these axis angles (forward kinematics).
    pub fn base_from_flange(&self, joints: &Joints) -> Rigid<Base, Flange> {
        let [q1, q2, q3, q4, q5, q6] = model_rad(joints);
        let phi_rad = q3 + self.a2_mm.atan2(self.c3_mm);
        let k_mm = self.a2_mm.hypot(self.c3_mm);
        // Eq. (1)
        let radius_mm = self.a1_mm + self.c2_mm * q2.sin() + k_mm * (q2 + phi_rad).sin();
        let height_mm = self.c1_mm + self.c2_mm * q2.cos() + k_mm * (q2 + phi_rad).cos();
        // Eq. (2)
        let rotation = rotation_z(q1) * rotation_y(q2 + q3) * rotation_z(q4) * rotation_y(q5) * rotation_z(q6);
        let wrist_mm = Vector3::new(radius_mm * q1.cos(), radius_mm * q1.sin(), height_mm);
        let origin_mm = wrist_mm + rotation * Vector3::z() * self.c4_mm;
        Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::from(origin_mm), rotation))
    }

    /// Returns all solutions for this flange pose, up to eight. To each angle a multiple of 360° is added, so that the
    /// angle is within its limits and as close as possible to `near`. Solutions for which this is not possible are
    /// omitted.
    pub fn inverse_solutions(&self, base_from_flange: &Rigid<Base, Flange>, near: &Joints) -> Vec<Joints> {
        let ways = self.solutions_rad(base_from_flange, near);
        ways.iter().filter_map(|&way| self.shift_into_limits(way, near).ok()).map(to_joints).collect()
    }

    /// Returns the axis angles for this flange pose that the arm reaches fastest from the angles `near`.
    ///
    /// # Errors
    /// If the pose is out of reach, or an axis would be outside of its limits.
    pub fn nearest(&self, base_from_flange: &Rigid<Base, Flange>, near: &Joints) -> Result<Joints, Unreachable> {
        let ways = self.solutions_rad(base_from_flange, near);
        if ways.is_empty() {
            return Err(self.distance_error(base_from_flange));
        }
        let best = |ways: &mut dyn Iterator<Item = [f64; 6]>| {
            ways.min_by(|one, other| self.effort_s(one, near).total_cmp(&self.effort_s(other, near)))
        };
        if let Some(inside) = best(&mut ways.iter().filter_map(|&way| self.shift_into_limits(way, near).ok())) {
            return Ok(to_joints(inside));
        }
        let refused = ways.iter().filter_map(|&way| self.shift_into_limits(way, near).err());
        let off_deg = |refused: &Unreachable| match refused {
            Unreachable::AxisLimit { axis, angle_deg, .. } => (angle_deg - angles_deg(near)[axis - 1]).abs(),
            Unreachable::Distance { .. } => f64::INFINITY,
        };
        let nearest = refused.min_by(|one, other| off_deg(one).total_cmp(&off_deg(other)));
        Err(nearest.unwrap_or_else(|| self.distance_error(base_from_flange)))
    }

    /// Checks that all axes are within their limits.
    ///
    /// # Errors
    /// If an axis is outside of its limits; the error names the first one.
    pub fn within_limits(&self, joints: &Joints) -> Result<(), Unreachable> {
        let outside = |(index, angle_deg): (usize, f64)| {
            let allowed_deg = self.limits_deg[index];
            let inside = (allowed_deg[0]..=allowed_deg[1]).contains(&angle_deg);
            (!inside).then_some(Unreachable::AxisLimit { axis: index + 1, angle_deg, allowed_deg })
        };
        angles_deg(joints).into_iter().enumerate().find_map(outside).map_or(Ok(()), Err)
    }

    fn distance_error(&self, base_from_flange: &Rigid<Base, Flange>) -> Unreachable {
        let (across_mm, up_mm) = self.wrist_from_axis_2(&self.wrist_mm(base_from_flange), 1.0);
        let k_mm = self.a2_mm.hypot(self.c3_mm);
        Unreachable::Distance {
            distance_mm: across_mm.hypot(up_mm),
            allowed_mm: [(self.c2_mm - k_mm).abs(), self.c2_mm + k_mm],
        }
    }

    fn wrist_mm(&self, base_from_flange: &Rigid<Base, Flange>) -> Vector3<f64> {
        base_from_flange.origin().mm.coords - base_from_flange.rotation() * Vector3::z() * self.c4_mm
    }

    /// Returns the horizontal and vertical position of the wrist's centre relative to axis 2. `side` is 1 if the arm
    /// reaches forward, and −1 if it reaches backward over axis 1.
    fn wrist_from_axis_2(&self, wrist_mm: &Vector3<f64>, side: f64) -> (f64, f64) {
        (side * wrist_mm.x.hypot(wrist_mm.y) - self.a1_mm, wrist_mm.z - self.c1_mm)
    }

    /// Returns the angles q of every solution for this pose, each between −π and π.
    fn solutions_rad(&self, base_from_flange: &Rigid<Base, Flange>, near: &Joints) -> Vec<[f64; 6]> {
        let wrist_mm = self.wrist_mm(base_from_flange);
        let [near_q1, _, _, near_q4, ..] = model_rad(near);
        // If the wrist's centre is on axis 1, any q1 is a solution.
        let over_axis_1 = wrist_mm.x.hypot(wrist_mm.y) < 1e-9;
        let forward_rad = if over_axis_1 { near_q1 } else { wrist_mm.y.atan2(wrist_mm.x) };
        let k_mm = self.a2_mm.hypot(self.c3_mm);
        let mut ways = Vec::with_capacity(8);
        for (side, q1) in [(1.0, forward_rad), (-1.0, forward_rad + std::f64::consts::PI)] {
            let (across_mm, up_mm) = self.wrist_from_axis_2(&wrist_mm, side);
            let square_mm2 = across_mm * across_mm + up_mm * up_mm;
            let cosine = (square_mm2 - self.c2_mm * self.c2_mm - k_mm * k_mm) / (2.0 * self.c2_mm * k_mm);
            if cosine.abs() > 1.0 {
                continue;
            }
            for phi_rad in [cosine.acos(), -cosine.acos()] {
                let behind_rad = (k_mm * phi_rad.sin()).atan2(self.c2_mm + k_mm * phi_rad.cos());
                let q2 = across_mm.atan2(up_mm) - behind_rad;
                let q3 = phi_rad - self.a2_mm.atan2(self.c3_mm);
                let arm = rotation_z(q1) * rotation_y(q2 + q3);
                let wrist = (arm.inverse() * base_from_flange.isometry().rotation).to_rotation_matrix();
                for [q4, q5, q6] in wrist_solutions_rad(wrist.matrix(), near_q4) {
                    ways.push([q1, q2, q3, q4, q5, q6]);
                }
            }
        }
        ways
    }

    /// Converts the angles q of a solution to the controller's axis angles. To each angle a multiple of 360° is added,
    /// so that the angle is within its limits and as close as possible to `near`.
    fn shift_into_limits(&self, way_rad: [f64; 6], near: &Joints) -> Result<[f64; 6], Unreachable> {
        let (mut wound_deg, near_deg) = (controller_deg(way_rad), angles_deg(near));
        for (index, angle_deg) in wound_deg.iter_mut().enumerate() {
            let [lowest, highest] = self.limits_deg[index];
            let nearest_turn = ((near_deg[index] - *angle_deg) / 360.0).round();
            let turns = [0.0, -1.0, 1.0].map(|more| *angle_deg + 360.0 * (nearest_turn + more));
            // An angle that exceeds its limit only by a rounding error is accepted.
            let inside = |angle: &f64| (lowest - 1e-9..=highest + 1e-9).contains(angle);
            let allowed_deg = self.limits_deg[index];
            let found = turns
                .into_iter()
                .filter(inside)
                .min_by(|one, other| (one - near_deg[index]).abs().total_cmp(&(other - near_deg[index]).abs()));
            *angle_deg =
                found.ok_or(Unreachable::AxisLimit { axis: index + 1, angle_deg: turns[0], allowed_deg })?;
        }
        Ok(wound_deg)
    }

    fn effort_s(&self, way_deg: &[f64; 6], near: &Joints) -> f64 {
        let near_deg = angles_deg(near);
        (0..6).map(|axis| (way_deg[axis] - near_deg[axis]).abs() / self.speeds_deg_s[axis]).sum()
    }
}

/// Returns both wrist solutions for this rotation, or one if the axes 4 and 6 are parallel.
fn wrist_solutions_rad(r: &nalgebra::Matrix3<f64>, near_q4_rad: f64) -> Vec<[f64; 3]> {
    use std::f64::consts::PI;
    let sine = r[(0, 2)].hypot(r[(1, 2)]);
    let q5 = sine.atan2(r[(2, 2)]);
    if sine < MIN_SIN_Q5 {
        // At q5 = 0 the rotation is Rz(q4 + q6). At q5 = π (outside of any limits) it is Rz(q4) Ry(π) Rz(q6).
        let whole_rad = if q5 < 1.0 { r[(1, 0)].atan2(r[(0, 0)]) } else { (-r[(1, 0)]).atan2(-r[(0, 0)]) };
        let q6 = if q5 < 1.0 { whole_rad - near_q4_rad } else { near_q4_rad - whole_rad };
        return vec![[near_q4_rad, q5, q6]];
    }
    let (q4, q6) = (r[(1, 2)].atan2(r[(0, 2)]), r[(2, 1)].atan2(-r[(2, 0)]));
    vec![[q4, q5, q6], [q4 + PI, -q5, q6 + PI]]
}

/// Converts axis angles to an array, axis 1 first.
pub(super) fn angles_deg(joints: &Joints) -> [f64; 6] {
    [joints.a1_deg, joints.a2_deg, joints.a3_deg, joints.a4_deg, joints.a5_deg, joints.a6_deg]
}

/// Converts an array to axis angles, axis 1 first.
pub(super) fn to_joints(angles_deg: [f64; 6]) -> Joints {
    let [a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg] = angles_deg;
    Joints { a1_deg, a2_deg, a3_deg, a4_deg, a5_deg, a6_deg }
}

fn model_rad(joints: &Joints) -> [f64; 6] {
    let [a1, a2, a3, a4, a5, a6] = angles_deg(joints);
    [-a1, a2 + 90.0, a3, -a4, a5, -a6].map(|angle_deg| Degrees(angle_deg).to_rad())
}

fn controller_deg(way_rad: [f64; 6]) -> [f64; 6] {
    let [q1, q2, q3, q4, q5, q6] = way_rad.map(f64::to_degrees);
    [-q1, q2 - 90.0, q3, -q4, q5, -q6]
}

fn rotation_z(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

fn rotation_y(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use panelprep_base::geometry::{KukaPose, Point};
    use proptest::prelude::*;

    const ARM: Arm = Arm::kr6_r700_2();

    fn at(angles: [f64; 6]) -> Rigid<Base, Flange> {
        ARM.base_from_flange(&to_joints(angles))
    }

    fn assert_flange(angles: [f64; 6], origin_mm: [f64; 3], axes: [[f64; 3]; 2]) {
        let pose = at(angles);
        let (origin, turn) = (pose.origin(), pose.rotation());
        assert!(origin.distance_mm(Point::new(Point3::from(origin_mm))) < 1e-9, "{origin:?}");
        assert!((turn * Vector3::x() - Vector3::from(axes[0])).norm() < 1e-12, "x {}", turn * Vector3::x());
        assert!((turn * Vector3::z() - Vector3::from(axes[1])).norm() < 1e-12, "z {}", turn * Vector3::z());
    }

    /// Expected values, calculated by hand, with both arms horizontal: x = 25 + 335 + 365 + 90 = 815. The forearm is 25
    /// above axis 3, so z = 400 + 25.
    #[test]
    fn all_axes_at_zero_stretch_the_arm_forward() {
        assert_flange([0.0; 6], [815.0, 0.0, 425.0], [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]);
    }

    /// Expected values, calculated by hand, with the upper arm vertical: x = 25 + 365 + 90 = 480, z = 400 + 335 + 25 =
    /// 760; A 0, B 90, C 0.
    #[test]
    fn at_home_the_forearm_is_level_and_the_flange_points_forward() {
        let home = [0.0, -90.0, 90.0, 0.0, 0.0, 0.0];
        assert_flange(home, [480.0, 0.0, 760.0], [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]);
        let pose = KukaPose::from_rigid(&at(home));
        assert!((pose.b_deg - 90.0).abs() < 1e-6 && pose.a_deg.abs() < 1e-6 && pose.c_deg.abs() < 1e-6, "{pose}");
    }

    /// Expected values, calculated by hand. A5 = 90 at the home position bends the wrist down: x = 25 + 365 = 390, z =
    /// 760 − 90 = 670, which the pendant shows as A 180, B 0, C 180: the flange's X points backward and its Z down. A1
    /// = 90 rotates clockwise as seen from above, to −y. A6 = 90 rotates the flange clockwise about its Z axis.
    #[test]
    fn axis_signs_are_those_of_the_controller() {
        assert_flange(
            [0.0, -90.0, 90.0, 0.0, 90.0, 0.0],
            [390.0, 0.0, 670.0],
            [[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
        );
        assert_flange(
            [90.0, -90.0, 90.0, 0.0, 0.0, 0.0],
            [0.0, -480.0, 760.0],
            [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
        );
        // The flange is rotated by Rz(−90): its new X axis is its former −Y axis, which is −Y of the base.
        assert_flange([0.0, -90.0, 90.0, 0.0, 0.0, 90.0], [480.0, 0.0, 760.0], [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]);
        assert_flange([0.0, -90.0, 90.0, 90.0, 0.0, 0.0], [480.0, 0.0, 760.0], [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]);
        // Positive A2 and A3 lower the arm. With the upper arm horizontal and the forearm pointing down: x = 25 + 335 +
        // 25, z = 400 − 365 − 90.
        assert_flange([0.0, 0.0, 90.0, 0.0, 0.0, 0.0], [385.0, 0.0, -55.0], [[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
    }

    /// Expected value, calculated by hand: the maximum distance of the wrist's centre from axis 2 is 335 + hypot(25,
    /// 365) = 700.9 mm.
    #[test]
    fn a_pose_out_of_reach_is_refused_with_the_distance() {
        let far = Rigid::<Base, Flange>::from_isometry_unchecked(Isometry3::from_parts(
            Translation3::new(1115.0, 0.0, 400.0),
            at([0.0; 6]).isometry().rotation,
        ));
        let Err(Unreachable::Distance { distance_mm, allowed_mm }) = ARM.nearest(&far, &to_joints([0.0; 6])) else {
            panic!("reached");
        };
        assert!((distance_mm - 1000.0).abs() < 1e-9 && (allowed_mm[1] - 700.855).abs() < 1e-3, "{allowed_mm:?}");
    }

    /// The error names the axis that would be outside of its limits: to reach backward without leaning over axis 1, A1
    /// must be 180°.
    #[test]
    fn an_axis_beyond_its_limits_is_named() {
        let behind = at([178.0, -60.0, 60.0, 0.0, 30.0, 0.0]);
        let mut narrow = ARM;
        narrow.limits_deg[1] = [-80.0, 0.0]; // not over its head either
        let found = narrow.nearest(&behind, &to_joints([170.0, -60.0, 60.0, 0.0, 30.0, 0.0]));
        assert!(matches!(found, Err(Unreachable::AxisLimit { axis: 1, .. })), "{found:?}");
        let over = ARM.within_limits(&to_joints([0.0, 45.1, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!(over, Err(Unreachable::AxisLimit { axis: 2, angle_deg: 45.1, allowed_deg: [-190.0, 45.0] }));
    }

    /// If the axes 4 and 6 are parallel, axis 4 keeps its angle and axis 6 makes the whole rotation.
    #[test]
    fn at_the_wrist_singularity_axis_4_keeps_its_angle() {
        let pose = at([10.0, -80.0, 100.0, 25.0, 0.0, 35.0]);
        let found = ARM.nearest(&pose, &to_joints([10.0, -80.0, 100.0, 40.0, 0.0, 0.0])).expect("reached");
        assert!((found.a4_deg - 40.0).abs() < 1e-9 && (found.a6_deg - 20.0).abs() < 1e-6, "{found:?}");
    }

    fn inside() -> impl Strategy<Value = [f64; 6]> {
        let axis = |index: usize| ARM.limits_deg[index][0]..ARM.limits_deg[index][1];
        [axis(0), axis(1), axis(2), axis(3), axis(4), axis(5)]
    }

    proptest! {
        #[test]
        fn every_inverse_solution_gives_the_pose(angles in inside(), near in inside()) {
            let pose = at(angles);
            for way in ARM.inverse_solutions(&pose, &to_joints(near)) {
                let there = ARM.base_from_flange(&way);
                prop_assert!(there.origin().distance_mm(pose.origin()) < 1e-7, "{way:?}");
                prop_assert!((there.rotation().matrix() - pose.rotation().matrix()).norm() < 1e-8, "{way:?}");
                prop_assert!(ARM.within_limits(&way).is_ok(), "{way:?}");
            }
        }

        /// Away from the singularities of wrist, elbow and shoulder, the solution nearest to the current axis angles
        /// equals these angles.
        #[test]
        fn the_nearest_solution_equals_the_arms_angles(angles in inside()) {
            let pose = at(angles);
            let wrist_mm = ARM.wrist_mm(&pose);
            let phi_deg = angles[2] + ARM.a2_mm.atan2(ARM.c3_mm).to_degrees();
            prop_assume!(angles[4].abs() > 0.1 && phi_deg.abs() > 0.1 && wrist_mm.xy().norm() > 1.0);
            let found = angles_deg(&ARM.nearest(&pose, &to_joints(angles)).expect("reached"));
            for axis in 0..6 {
                prop_assert!((found[axis] - angles[axis]).abs() < 1e-4, "{found:?}");
            }
        }
    }
}
