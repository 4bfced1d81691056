//! An arm with manufacturing errors: it differs from its nominal geometry by a given error at the tool.
//!
//! The simulated controller computes with the nominal geometry of a KUKA KR 6 R700-2; this module computes the true
//! pose of the flange. Errors of the links' lengths, axis zeros and twists are drawn for each seed. The weights of
//! upper arm, forearm and wrist bend the drives of axes 2, 3 and 5, and the gears of axes 1 to 3 have a periodic error.
//! The model that a calibration of the arm estimates does not contain this bending and the gear errors. Therefore the
//! calibration is tested on an arm that its model does not describe exactly.
//!
//! Chain: with q = (−A1, A2 + 90°, A3, −A4, A5, −A6), each plus its zero, and small rotations Tᵢ,
//!     Rz(q1) T₁ (a1, b, c1) Ry(q2) T₂ (0, 0, c2) Ry(q3) T₃ (a2, 0, c3) Rz(q4) T₄ Ry(q5) T₅ Rz(q6) (0, 0, c4)
//! Lengths and signs: kroshu/kuka_robot_descriptions.

use super::noise::{NormalStream, RandomPurpose, Seed};
use nalgebra::{Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::statistics::mean;
use panelprep_base::geometry::{Base, Flange, Joints, Rigid, Tool};

/// The distance of the simulated tool's pad from the flange along the flange's axis, mm.
pub const TOOL_LENGTH_MM: f64 = 120.0;

/// Nominal lengths a1, b, c1, c2, a2, c3, c4, mm.
const NOMINAL_LENGTHS_MM: [f64; 7] = [25.0, 0.0, 400.0, 335.0, -25.0, 365.0, 90.0];
/// Maximum error of an axis zero, rad, before all errors are scaled to the requested error at the tool.
const MAX_ZERO_ERROR_RAD: f64 = 8.7e-4;
/// Maximum error of a twist between two axes, rad, before scaling.
const MAX_TWIST_ERROR_RAD: f64 = 5e-4;
/// Maximum error of a link's length, mm, before scaling.
const MAX_LENGTH_ERROR_MM: f64 = 0.4;
/// Weights of upper arm, forearm, and wrist with tool, N.
const WEIGHTS_N: [f64; 3] = [90.0, 60.0, 45.0];
/// Mean compliance of the drives of axes 2, 3 and 5, rad/(N mm), before scaling.
const MEAN_COMPLIANCE: f64 = 6e-9;
/// Maximum amplitude of the gears' error, rad, before all errors are scaled.
const MAX_GEAR_ERROR_RAD: f64 = 3e-5;
/// Number of periods of the gears' error in one rotation of axes 1 to 3.
const GEAR_PERIODS: [f64; 3] = [3.0, 4.0, 5.0];

/// A pose of the flange as the controller reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportedFlangePose {
    /// The reported pose of the flange.
    pub base_from_flange: Rigid<Base, Flange>,
    /// The axis angles; `None` if the arm has the nominal geometry.
    pub joints: Option<Joints>,
}

/// An arm with its manufacturing errors.
#[derive(Debug, Clone, PartialEq)]
pub struct RealArm {
    zeros_rad: [f64; 6],
    twists_rad: [[f64; 2]; 5],
    lengths_mm: [f64; 7],
    compliance: [f64; 3],
    gears_rad: [f64; 3],
}

impl RealArm {
    /// Creates the arm of this seed. `error_mm` is the error at its tool, rms over poses in front of the panel, mm.
    pub fn new(seed: u64, error_mm: f64) -> Self {
        let mut normal = NormalStream::new(Seed(seed).stream(RandomPurpose::Arm, 0));
        let mut even = |most: f64| (2.0 * normal.next_uniform() - 1.0) * most;
        let drawn = RealArm {
            zeros_rad: std::array::from_fn(|_| even(MAX_ZERO_ERROR_RAD)),
            twists_rad: std::array::from_fn(|_| std::array::from_fn(|_| even(MAX_TWIST_ERROR_RAD))),
            lengths_mm: std::array::from_fn(|_| even(MAX_LENGTH_ERROR_MM)),
            compliance: std::array::from_fn(|_| MEAN_COMPLIANCE * (0.75 + even(0.25))),
            gears_rad: std::array::from_fn(|_| even(MAX_GEAR_ERROR_RAD)),
        };
        let found_mm = drawn.error_mm();
        drawn.with_scaled_errors(error_mm / found_mm)
    }

    fn with_scaled_errors(&self, by: f64) -> Self {
        RealArm {
            zeros_rad: self.zeros_rad.map(|number| number * by),
            twists_rad: self.twists_rad.map(|pair| pair.map(|number| number * by)),
            lengths_mm: self.lengths_mm.map(|number| number * by),
            compliance: self.compliance.map(|number| number * by),
            gears_rad: self.gears_rad.map(|number| number * by),
        }
    }

    /// Returns the error at a tool of 120 mm, rms over poses in front of the panel, mm.
    pub fn error_mm(&self) -> f64 {
        let tip = nalgebra::Point3::new(0.0, 0.0, TOOL_LENGTH_MM);
        let mut off_mm2 = Vec::new();
        for a1_deg in [-25.0, 0.0, 25.0] {
            for a2_deg in [-110.0, -90.0, -70.0] {
                for a3_deg in [90.0, 110.0, 130.0] {
                    for a5_deg in [-40.0, 0.0, 40.0] {
                        let joints = Joints { a1_deg, a2_deg, a3_deg, a4_deg: 0.0, a5_deg, a6_deg: 90.0 };
                        let [real, drawn] = [self.base_from_flange(&joints), nominal_flange(&joints)];
                        off_mm2.push((real.isometry() * tip - drawn.isometry() * tip).norm_squared());
                    }
                }
            }
        }
        mean(off_mm2).map_or(0.0, f64::sqrt)
    }

    /// Returns the flange's true pose at these axis angles.
    pub fn base_from_flange(&self, joints: &Joints) -> Rigid<Base, Flange> {
        let mut q = axis_angles_rad(joints);
        for (axis, periods) in GEAR_PERIODS.iter().enumerate() {
            q[axis] += self.gears_rad[axis] * (periods * q[axis]).sin();
        }
        (0..6).for_each(|axis| q[axis] += self.zeros_rad[axis]);
        let moments = weight_moments(&q);
        for (axis, moment) in [1, 2, 4].into_iter().zip(moments) {
            q[axis] += self.compliance[[0, 0, 1, 0, 2][axis]] * moment;
        }
        let lengths_mm: [f64; 7] = std::array::from_fn(|index| NOMINAL_LENGTHS_MM[index] + self.lengths_mm[index]);
        chain_pose(&q, &lengths_mm, &self.twists_rad)
    }

    /// Returns the true pose of the simulated tool's pad at these axis angles. The length of the tool is
    /// [`TOOL_LENGTH_MM`], independent of any calibration.
    pub fn base_from_tool(&self, joints: &Joints) -> Rigid<Base, Tool> {
        self.base_from_flange(joints)
            * Rigid::from_isometry_unchecked(Isometry3::translation(0.0, 0.0, TOOL_LENGTH_MM))
    }

    /// Returns the axis angles at which the flange truly has this pose. The search starts at `near` and ignores the
    /// axes' limits; `None` if it does not converge.
    pub fn solve_true_joints(&self, base_from_flange: &Rigid<Base, Flange>, near: &Joints) -> Option<Joints> {
        let wanted = base_from_flange.isometry();
        let off = |joints: &Joints| -> SVector<f64, 6> {
            let there = *self.base_from_flange(joints).isometry();
            let shift = wanted.translation.vector - there.translation.vector;
            let turn = (wanted.rotation * there.rotation.inverse()).scaled_axis() * LEVER_MM;
            SVector::from_iterator(shift.iter().chain(turn.iter()).copied())
        };
        let moved = |joints: &Joints, by: &SVector<f64, 6>| -> Joints {
            let all = joints.degrees();
            std::array::from_fn::<f64, 6, _>(|axis| all[axis] + by[axis]).into()
        };
        let mut joints = *near;
        for _ in 0..STEPS {
            let here = off(&joints);
            if here.norm() < CONVERGENCE_MM {
                return Some(joints);
            }
            let slope = SMatrix::<f64, 6, 6>::from_columns(&std::array::from_fn::<_, 6, _>(|axis| {
                let mut by = SVector::zeros();
                by[axis] = 1e-4;
                (here - off(&moved(&joints, &by))) / 1e-4
            }));
            let step = slope.try_inverse()? * here;
            joints = moved(&joints, &(step * (MAX_STEP_DEG / step.amax()).min(1.0)));
        }
        None
    }
}

impl RealArm {
    /// Returns the pose that the controller reports if the flange is at this true pose. `None` if the arm cannot reach
    /// the pose with its elbow up and its wrist not flipped, within the limits of its axes.
    pub fn reported_pose(&self, base_from_flange: &Rigid<Base, Flange>) -> Option<ReportedFlangePose> {
        let within = |joints: &Joints| {
            joints
                .degrees()
                .iter()
                .zip(WORKING_RANGE_DEG)
                .all(|(angle, [least, most])| (least..=most).contains(angle))
        };
        let reached =
            |near: &[f64; 6]| self.solve_true_joints(base_from_flange, &Joints::from(*near)).filter(within);
        let joints = SEARCH_STARTS_DEG.iter().find_map(reached)?;
        Some(ReportedFlangePose { base_from_flange: nominal_flange(&joints), joints: Some(joints) })
    }
}

/// Lowest and highest working angle of each axis: some degrees within the limits of a KR 6 R700-2.
const WORKING_RANGE_DEG: [[f64; 2]; 6] =
    [[-160.0, 160.0], [-180.0, 40.0], [-60.0, 150.0], [-120.0, 120.0], [-115.0, 115.0], [-340.0, 340.0]];

/// Start values of the search for the axis angles of a pose, degrees: in front of the panel, over a table, and with the
/// flange upward.
const SEARCH_STARTS_DEG: [[f64; 6]; 4] = [
    [0.0, -120.0, 145.0, 0.0, -25.0, 90.0],
    [0.0, -75.0, 95.0, 0.0, 60.0, 0.0],
    [0.0, -60.0, 120.0, 0.0, -100.0, 0.0],
    [-30.0, -80.0, 110.0, 40.0, 60.0, 60.0],
];

/// Lever arm that converts a rotation to a distance, mm.
const LEVER_MM: f64 = 300.0;
const STEPS: usize = 100;
const CONVERGENCE_MM: f64 = 1e-7;
/// Maximum rotation of an axis in one step of the search, degrees.
const MAX_STEP_DEG: f64 = 15.0;

/// Returns the flange's pose according to the nominal geometry, which is the pose that the controller reports.
pub fn nominal_flange(joints: &Joints) -> Rigid<Base, Flange> {
    chain_pose(&axis_angles_rad(joints), &NOMINAL_LENGTHS_MM, &[[0.0; 2]; 5])
}

fn axis_angles_rad(joints: &Joints) -> [f64; 6] {
    let [a1, a2, a3, a4, a5, a6] = joints.degrees();
    [-a1, a2 + 90.0, a3, -a4, a5, -a6].map(f64::to_radians)
}

/// Computes the moments of the weights about axes 2, 3 and 5, N mm, each positive in the axis's direction of rotation.
fn weight_moments(q: &[f64; 6]) -> [f64; 3] {
    let [_, _, _, c2, a2, c3, c4] = NOMINAL_LENGTHS_MM;
    let lean = q[1] + q[2];
    let (elbow, wrist) = (c2 * q[1].sin(), a2 * lean.cos() + c3 * lean.sin());
    // The weight of the wrist acts at the flange; its lever arm depends on the angles of axes 4 and 5.
    let tool = c4 * (lean.sin() * q[4].cos() + lean.cos() * q[4].sin() * q[3].cos());
    let [upper, fore, hand] = WEIGHTS_N;
    let about_3 = fore * wrist / 2.0 + hand * (wrist + tool);
    let about_2 = upper * elbow / 2.0 + fore * (elbow + wrist / 2.0) + hand * (elbow + wrist + tool);
    [about_2, about_3, hand * tool * q[3].cos()]
}

fn chain_pose(q: &[f64; 6], lengths_mm: &[f64; 7], twists_rad: &[[f64; 2]; 5]) -> Rigid<Base, Flange> {
    let [a1, b, c1, c2, a2, c3, c4] = *lengths_mm;
    let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
    // The two axes of a twist are perpendicular to the joint's axis: x and z for joints that rotate about y.
    let tilt = |axis: usize| {
        let [one, other] = twists_rad[axis];
        match axis {
            0 | 3 => about(Vector3::new(one, other, 0.0), 1.0),
            _ => about(Vector3::new(one, 0.0, other), 1.0),
        }
    };
    let (y, z) = (Vector3::y(), Vector3::z());
    let pose: Isometry3<f64> = about(z, q[0])
        * tilt(0)
        * Translation3::new(a1, b, c1)
        * about(y, q[1])
        * tilt(1)
        * Translation3::new(0.0, 0.0, c2)
        * about(y, q[2])
        * tilt(2)
        * Translation3::new(a2, 0.0, c3)
        * about(z, q[3])
        * tilt(3)
        * about(y, q[4])
        * tilt(4)
        * about(z, q[5])
        * Translation3::new(0.0, 0.0, c4);
    Rigid::from_isometry_unchecked(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand for a vertical upper arm and a horizontal forearm: x = 25 + 365 + 90, z =
    /// 400 + 335 + 25.
    #[test]
    fn the_nominal_geometry_is_that_of_the_kr_6() {
        let home = Joints::from([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]);
        assert!((nominal_flange(&home).origin().mm - nalgebra::Point3::new(480.0, 0.0, 760.0)).norm() < 1e-9);
        assert_eq!(RealArm::new(1, 1.0).with_scaled_errors(0.0).base_from_flange(&home), nominal_flange(&home));
    }

    /// Expected values, calculated by hand: in the home position no moment acts on the upper arm. The forearm has 60 N
    /// at 182.5 mm, the wrist 45 N at 455 mm.
    #[test]
    fn moments_of_the_weights_agree_with_hand_calculation() {
        let [about_2, about_3, about_5] =
            weight_moments(&axis_angles_rad(&Joints::from([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])));
        assert!((about_3 - (60.0 * 182.5 + 45.0 * 455.0)).abs() < 1e-6, "{about_3}");
        assert!((about_2 - about_3).abs() < 1e-6 && (about_5 - 45.0 * 90.0).abs() < 1e-6, "{about_2} {about_5}");
    }

    #[test]
    fn an_arm_has_the_stated_error_and_reaches_a_true_pose() {
        for seed in 1..=5 {
            let arm = RealArm::new(seed, 1.0);
            assert!((arm.error_mm() - 1.0).abs() < 0.02, "{}", arm.error_mm());
            let near = Joints::from([5.0, -100.0, 115.0, 3.0, -20.0, 80.0]);
            let wanted = nominal_flange(&Joints::from([10.0, -95.0, 110.0, 5.0, -30.0, 90.0]));
            let joints = arm.solve_true_joints(&wanted, &near).expect("in reach");
            let there = arm.base_from_flange(&joints);
            assert!(there.origin().distance_mm(wanted.origin()) < 1e-6);
            assert!(nominal_flange(&joints).origin().distance_mm(wanted.origin()) > 0.1);
        }
    }
}
