//! Computes the axis angles for a flange pose of the cell's arm, with an analytic solver.
//!
//! A pose has up to eight solutions: arm forward or reaching over axis 1, elbow up or down, wrist normal or flipped.
//! Each axis may also be rotated by a further 360°. The solver is `rs-opw-kinematics`; it checks its results with its
//! own forward kinematics. If the arm's own errors were calibrated, all poses here are the true poses of the flange.
//! The controller, which knows only the nominal geometry, then receives corrected poses: `sent_flange`. Speed limits,
//! paths and panels are handled in `reach`. Source: Brandstötter, Angerer, Hofbaur, Proc. Austrian Robotics Workshop
//! 2014.

use super::obstacles::Obstacles;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep_cell::cell::{Arm, ArmGeometry};
use panelprep_vision::calib::robot::{ArmPose, Correction};
use rs_opw_kinematics::glam::{DQuat, DVec3};
use rs_opw_kinematics::kinematic_traits::{Kinematics as _, Pose};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use std::sync::Arc;

/// Angles of axes 1 to 6, degrees.
pub(super) type JointAngles = [f64; 6];

/// The kinematic model of an arm.
#[derive(Debug, Clone)]
pub struct Kinematics {
    arm: Arm,
    solver: OPWKinematics,
    correction: Option<Correction>,
    obstacles: Option<Arc<Obstacles>>,
    least_mm: Option<Arc<Vec<[f64; 4]>>>,
}

/// Maximum change of an axis angle, degrees, at which the iteration for a corrected arm has converged.
const CONVERGENCE_DEG: f64 = 1e-9;
const MAX_STEPS: usize = 10;

/// The points at which the centre line of the arm bends: axis 2, axis 3, the wrist's centre, the flange.
pub(super) type CentreLine = [Point<Base>; 4];

impl Kinematics {
    /// Creates the kinematics of the cell's arm.
    pub fn new(arm: &Arm) -> Self {
        let ArmGeometry { a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs } = *arm.geometry();
        let parameters = Parameters {
            a1: a1_mm,
            a2: a2_mm,
            b: b_mm,
            c1: c1_mm,
            c2: c2_mm,
            c3: c3_mm,
            c4: c4_mm,
            offsets: offsets_deg.map(f64::to_radians),
            sign_corrections: signs,
            dof: 6,
        };
        let correction = arm.correction().map(|numbers| Correction::new(numbers, *arm.geometry()));
        Kinematics {
            arm: arm.clone(),
            solver: OPWKinematics::new(parameters),
            correction,
            obstacles: None,
            least_mm: None,
        }
    }

    /// Returns the arm with these obstacles, which a scan showed.
    #[must_use]
    pub fn with_obstacles(self, obstacles: Arc<Obstacles>) -> Self {
        Kinematics { obstacles: Some(obstacles), ..self }
    }

    /// Returns the arm with these required distances from the obstacles instead of the configured ones, mm: for each
    /// obstacle, one distance for each part of the arm.
    #[must_use]
    pub(super) fn with_least_distances(self, least_mm: Vec<[f64; 4]>) -> Self {
        Kinematics { least_mm: Some(Arc::new(least_mm)), ..self }
    }

    /// Returns the required distances of the arm's parts from this obstacle, mm; `None` if the configured distances
    /// apply.
    pub(super) fn least_mm(&self, obstacle: usize) -> Option<&[f64; 4]> {
        self.least_mm.as_deref().and_then(|least_mm| least_mm.get(obstacle))
    }

    /// Returns the obstacles that the arm must avoid.
    pub(super) fn obstacles(&self) -> Option<&Obstacles> {
        self.obstacles.as_deref()
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Returns the true flange pose at these axis angles; `None` if an angle is not finite.
    pub fn base_from_flange(&self, joints: &Joints) -> Option<Rigid<Base, Flange>> {
        let drawn = self.nominal_flange(joints)?;
        match &self.correction {
            Some(correction) => {
                correction.base_from_flange(&ArmPose { joints: Some(*joints), base_from_flange: drawn })
            }
            None => Some(drawn),
        }
    }

    /// Returns the flange pose of the arm with its nominal geometry, which is the pose that the controller computes.
    pub fn nominal_flange(&self, joints: &Joints) -> Option<Rigid<Base, Flange>> {
        let pose = self.solver.try_forward(&joints.degrees().map(f64::to_radians)).ok()?;
        let (t, q) = (pose.translation, pose.rotation);
        let turn = UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z));
        Some(Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), turn)))
    }

    /// Returns the true flange pose for the pose and the axis angles that the controller reports.
    pub fn true_flange(&self, reported: Rigid<Base, Flange>, joints: &Joints) -> Rigid<Base, Flange> {
        let pose = ArmPose { joints: Some(*joints), base_from_flange: reported };
        self.correction.as_ref().and_then(|correction| correction.base_from_flange(&pose)).unwrap_or(reported)
    }

    /// Returns the pose to send to the controller so that the flange truly reaches this pose, and the axis angles at
    /// that pose, in the configuration of `near`; `None` if the pose cannot be reached.
    pub fn sent_flange(
        &self,
        base_from_flange: &Rigid<Base, Flange>,
        near: &Joints,
    ) -> Option<(Rigid<Base, Flange>, Joints)> {
        let Some(correction) = &self.correction else {
            let joints = nearest_solution(&self.nominal_solutions(base_from_flange), &near.degrees())?;
            return Some((*base_from_flange, joints.into()));
        };
        let mut at = near.degrees();
        for _ in 0..MAX_STEPS {
            let sent = correction.sent_flange(base_from_flange, &at.into());
            let next = nearest_solution(&self.nominal_solutions(&sent), &at)?;
            let moved_deg = (0..6).map(|axis| (next[axis] - at[axis]).abs()).fold(0.0, f64::max);
            at = next;
            if moved_deg < CONVERGENCE_DEG {
                return Some((sent, at.into()));
            }
        }
        None
    }

    /// Returns whether this pose lies in the volume in which the arm's correction was measured; always true without a
    /// correction.
    pub fn is_correction_measured(&self, base_from_flange: &Rigid<Base, Flange>) -> bool {
        self.correction.as_ref().is_none_or(|correction| correction.covers(base_from_flange))
    }

    /// Returns all solutions for this flange pose, with each axis within ±180°, regardless of the axes' limits. The
    /// list is empty if the pose is out of reach.
    pub(super) fn inverse_solutions(&self, base_from_flange: &Rigid<Base, Flange>) -> Vec<JointAngles> {
        let drawn = self.nominal_solutions(base_from_flange);
        if self.correction.is_none() {
            return drawn;
        }
        let settled = |way: JointAngles| Some(self.sent_flange(base_from_flange, &way.into())?.1.degrees());
        drawn.into_iter().filter_map(settled).collect()
    }

    fn nominal_solutions(&self, base_from_flange: &Rigid<Base, Flange>) -> Vec<JointAngles> {
        let (t, q) = (base_from_flange.isometry().translation.vector, base_from_flange.isometry().rotation.coords);
        let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
        let Ok(pose) = Pose::try_from_parts(DVec3::new(t.x, t.y, t.z), rotation) else { return Vec::new() };
        self.solver.inverse(&pose).into_iter().map(|way| way.map(f64::to_degrees)).collect()
    }

    /// Returns the distance of the wrist's centre beyond the arm's reach, mm; 0 if it is within reach.
    pub(super) fn reach_excess_mm(&self, base_from_flange: &Rigid<Base, Flange>) -> f64 {
        let g = self.arm.geometry();
        let wrist = wrist_centre(base_from_flange, g);
        // Coordinates relative to axis 2, in the plane of the arm when the arm faces the wrist.
        let forward = (wrist.x.hypot(wrist.y).powi(2) - g.b_mm * g.b_mm).max(0.0).sqrt() - g.a1_mm;
        let distance_mm = forward.hypot(wrist.z - g.c1_mm);
        let forearm_mm = g.a2_mm.hypot(g.c3_mm);
        (distance_mm - g.c2_mm - forearm_mm).max((g.c2_mm - forearm_mm).abs() - distance_mm).max(0.0)
    }

    /// Returns the angle between the elbow and the extended arm, degrees.
    pub(super) fn elbow_deg(&self, angles: &JointAngles) -> f64 {
        let g = self.arm.geometry();
        let q3_deg = angles[2] * f64::from(g.signs[2]) - g.offsets_deg[2];
        let bend_deg = (q3_deg + g.a2_mm.atan2(g.c3_mm).to_degrees()).rem_euclid(360.0);
        bend_deg.min(360.0 - bend_deg)
    }

    /// Returns the distance of the wrist's centre from axis 1, mm.
    pub(super) fn overhead_mm(&self, base_from_flange: &Rigid<Base, Flange>) -> f64 {
        wrist_centre(base_from_flange, self.arm.geometry()).xy().norm()
    }

    /// Returns the points at which the arm's centre line bends, in the base.
    pub(super) fn centre_line(&self, angles: &JointAngles) -> CentreLine {
        let g = self.arm.geometry();
        let q = |axis: usize| (angles[axis] * f64::from(g.signs[axis]) - g.offsets_deg[axis]).to_radians();
        let [q1, q2, q3] = [q(0), q(1), q(2)];
        let turned = |x: f64, z: f64| {
            Point::at(x * q1.cos() - g.b_mm * q1.sin(), x * q1.sin() + g.b_mm * q1.cos(), g.c1_mm + z)
        };
        let (x_elbow, z_elbow) = (g.a1_mm + g.c2_mm * q2.sin(), g.c2_mm * q2.cos());
        let lean = q2 + q3;
        let (x_wrist, z_wrist) = (
            x_elbow + g.a2_mm * lean.cos() + g.c3_mm * lean.sin(),
            z_elbow - g.a2_mm * lean.sin() + g.c3_mm * lean.cos(),
        );
        let wrist = turned(x_wrist, z_wrist);
        let flange = self.base_from_flange(&Joints::from(*angles)).map_or(wrist, |pose| pose.origin());
        [turned(g.a1_mm, 0.0), turned(x_elbow, z_elbow), wrist, flange]
    }
}

/// Returns the solution nearest to the current axis angles, with each axis shifted by a multiple of 360°.
pub(super) fn nearest_solution(ways: &[JointAngles], at: &JointAngles) -> Option<JointAngles> {
    let wound = |way: &JointAngles| -> JointAngles {
        std::array::from_fn(|axis| way[axis] + 360.0 * ((at[axis] - way[axis]) / 360.0).round())
    };
    let apart = |way: &JointAngles| (0..6).map(|axis| (way[axis] - at[axis]).abs()).fold(0.0, f64::max);
    ways.iter().map(wound).min_by(|a, b| apart(a).total_cmp(&apart(b)))
}

fn wrist_centre(base_from_flange: &Rigid<Base, Flange>, geometry: &ArmGeometry) -> Vector3<f64> {
    let turn = base_from_flange.isometry().rotation;
    base_from_flange.isometry().translation.vector - turn * Vector3::z() * geometry.c4_mm
}

#[cfg(test)]
mod tests {
    use super::*;
    use panelprep_cell::cell::{Cell, CorrectionNumbers, PRESETS};
    use proptest::prelude::*;

    fn kr6() -> Kinematics {
        Kinematics::new(Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}")).arm())
    }

    /// Expected values, calculated by hand. (1) Home, A = (0, −90, 90, 0, 0, 0): upper arm vertical, forearm
    /// horizontal: x = 25 + 365 + 90 = 480, z = 400 + 335 + 25 = 760, flange Z along base X, flange X down. (2) A =
    /// (90, 0, 90, 0, 0, 0): rotated clockwise to −y, upper arm horizontal, forearm vertically down: 25 + 335 + 25 =
    /// 385 from axis 1, z = 400 − 365 − 90 = −55, flange Z down.
    #[test]
    fn two_flange_poses_agree_with_hand_calculation() {
        let kr6 = kr6();
        for (angles, origin_mm, z, x) in [
            ([0.0, -90.0, 90.0, 0.0, 0.0, 0.0], [480.0, 0.0, 760.0], Vector3::x(), -Vector3::z()),
            ([90.0, 0.0, 90.0, 0.0, 0.0, 0.0], [0.0, -385.0, -55.0], -Vector3::z(), Vector3::y()),
        ] {
            let pose = kr6.base_from_flange(&Joints::from(angles)).expect("numbers");
            assert!((pose.origin().mm.coords - Vector3::from(origin_mm)).norm() < 1e-9, "{pose:?}");
            assert!((pose.rotation() * Vector3::z() - z).norm() < 1e-9);
            assert!((pose.rotation() * Vector3::x() - x).norm() < 1e-9, "{}", pose.rotation() * Vector3::x());
            let [_, elbow, wrist, flange] = kr6.centre_line(&angles);
            assert!(flange.distance_mm(pose.origin()) < 1e-9);
            assert!((wrist.distance_mm(flange) - 90.0).abs() < 1e-9);
            assert!((elbow.distance_mm(wrist) - 365.0f64.hypot(25.0)).abs() < 1e-9);
        }
    }

    /// Expected values from public models (URDF) of these arms: the flange's position and its Z axis at some axis
    /// angles, computed from the joint frames of the models with another program.
    #[test]
    fn named_arms_agree_with_their_public_models() {
        const MODELS: [(&str, JointAngles, [f64; 3], [f64; 3]); 21] = [
            (
                "kr6-r700-2",
                [-40.4, -90.5, 34.6, -98.0, 8.2, -30.8],
                [185.550, 174.608, 1126.010],
                [0.318525, 0.456554, 0.830723],
            ),
            (
                "kr6-r700-sixx",
                [-101.3, -33.6, -106.0, -15.2, -98.6, -93.8],
                [30.848, -48.535, 718.344],
                [0.353078, -0.443959, -0.823551],
            ),
            (
                "kr6-r900-2",
                [-17.3, 17.4, -86.2, -63.4, 29.2, 102.6],
                [594.114, 226.166, 730.690],
                [0.366115, 0.570923, 0.734851],
            ),
            (
                "kr6-r900-sixx",
                [17.7, -51.3, 109.1, -103.9, 82.2, -48.2],
                [580.516, -104.504, 419.304],
                [0.553160, 0.832989, 0.011986],
            ),
            (
                "kr8-r1440-2-arc-hw",
                [-81.5, -93.4, -43.9, 72.5, -73.2, 18.7],
                [-146.438, -485.683, 1303.556],
                [-0.963236, -0.268207, -0.015551],
            ),
            (
                "kr8-r2100-2-arc-hw",
                [31.8, -47.7, 10.9, -100.2, -100.9, -67.4],
                [1176.875, -820.664, 1960.886],
                [-0.549429, -0.796471, -0.252512],
            ),
            (
                "kr10-r900-2",
                [41.3, -46.4, -42.6, 19.6, -10.7, -45.9],
                [234.274, -198.353, 1238.567],
                [-0.077393, 0.150894, 0.985516],
            ),
            (
                "kr10-r1100-2",
                [67.5, -3.0, -58.6, 17.1, 5.8, 86.0],
                [325.650, -793.178, 968.846],
                [0.186143, -0.527038, 0.829205],
            ),
            (
                "kr10-r1420",
                [52.6, -62.9, 110.0, -87.5, -18.8, 58.9],
                [553.014, -765.718, 468.455],
                [0.141881, -0.715654, -0.683892],
            ),
            (
                "kr12-r1450-3-hw",
                [-79.8, -26.8, -105.6, 38.6, 60.6, 16.7],
                [54.769, 58.845, 1082.519],
                [0.565361, 0.072809, 0.821624],
            ),
            (
                "kr16-r1100-3",
                [86.1, -61.4, 44.8, 21.6, 18.3, -10.0],
                [50.400, -892.247, 1128.992],
                [-0.047767, -0.998822, -0.008520],
            ),
            (
                "kr16-r1610-2",
                [77.9, 55.1, -5.9, 37.6, -100.7, 46.2],
                [345.304, -1173.100, -418.203],
                [0.684321, -0.331941, 0.649246],
            ),
            (
                "kr16-r2010-2",
                [33.7, 63.8, 73.8, -49.4, -26.2, 38.7],
                [-39.259, -35.466, -1175.013],
                [-0.576053, -0.018754, -0.817197],
            ),
            (
                "kr20-r1810-2",
                [-109.4, -31.7, -76.1, -87.8, -101.1, 61.5],
                [1.526, 447.338, 1673.037],
                [0.917260, 0.347389, -0.194821],
            ),
            (
                "kr20-r3100",
                [-84.9, -71.4, -25.0, 85.1, -96.1, -11.6],
                [-120.450, 355.531, 3399.253],
                [-0.993232, 0.015796, -0.115069],
            ),
            (
                "kr30-r2100",
                [11.3, 39.6, 73.2, 83.4, -50.8, -19.4],
                [494.336, 46.452, -1079.986],
                [-0.008814, 0.786788, -0.617161],
            ),
            (
                "kr50-r2100",
                [-32.4, 39.8, 104.9, -80.0, -74.2, -61.4],
                [110.579, -137.452, -687.923],
                [0.401647, -0.867420, -0.293706],
            ),
            (
                "kr50-r2500",
                [-61.1, -29.9, 20.4, -54.4, -113.7, -18.6],
                [1191.651, 1873.668, 1523.173],
                [0.417699, -0.783900, 0.459378],
            ),
            (
                "kr70-r2100",
                [-30.0, -15.7, 103.8, 43.7, 3.6, 27.0],
                [968.602, 549.956, -401.751],
                [0.011055, -0.043709, -0.998983],
            ),
            (
                "kr120-r2700-2",
                [40.4, -108.7, 91.6, 64.2, 85.8, 68.3],
                [740.016, -883.293, 2118.378],
                [-0.431432, -0.811886, -0.393328],
            ),
            (
                "kr120-r2500-pro",
                [-24.7, -54.9, -90.9, 30.8, -100.3, -99.2],
                [79.100, 155.605, 2039.977],
                [-0.507730, 0.320996, -0.799482],
            ),
        ];
        assert_eq!(
            MODELS.map(|(name, ..)| name).to_vec(),
            PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>()
        );
        for (name, angles, origin_mm, z) in MODELS {
            let cell = Cell::check("cell.toml", &format!("[arm]\nmodel = \"{name}\"\n"));
            let arm = Kinematics::new(cell.unwrap_or_else(|problems| panic!("{problems}")).arm());
            let pose = arm.base_from_flange(&Joints::from(angles)).expect("numbers");
            // The published lengths of the models are rounded to 0.01 mm, and some of the angles to 1e-5 rad.
            assert!((pose.origin().mm.coords - Vector3::from(origin_mm)).norm() < 0.02, "{name}: {pose:?}");
            assert!((pose.rotation() * Vector3::z() - Vector3::from(z)).norm() < 3e-5, "{name}: {pose:?}");
        }
    }

    /// Expected values, calculated by hand: the wrist's centre reaches 335 + hypot(25, 365) = 700.855 mm from axis 2.
    /// At 1000 mm in front of axis 2, the distance beyond the reach is 299.145 mm.
    #[test]
    fn the_distance_beyond_the_reach_agrees_with_hand_calculation() {
        let level = kr6().base_from_flange(&Joints::from([0.0; 6])).expect("numbers").rotation();
        let far = Isometry3::from_parts(Translation3::new(1_115.0, 0.0, 400.0), level.into());
        let far: Rigid<Base, Flange> = Rigid::from_isometry_unchecked(far);
        assert!((kr6().reach_excess_mm(&far) - 299.145).abs() < 1e-3);
        assert_eq!(kr6().inverse_solutions(&far), Vec::<JointAngles>::new());
    }

    /// Two corrections: the errors of an arm of this class, and a smooth correction over a panel.
    fn corrections() -> [CorrectionNumbers; 2] {
        let geometry = std::array::from_fn(|index| match index {
            30 | 31 => 8e-7,
            index if index % 6 < 3 => 8e-4 * (index as f64).sin(),
            _ => 0.4 * (index as f64).cos(),
        });
        let smooth = std::array::from_fn(|index| if index % 6 < 3 { 5e-4 } else { 0.3 } * (index as f64).cos());
        let (middle_mm, half_mm) = ([480.0, 0.0, 400.0], [250.0, 300.0, 300.0]);
        [CorrectionNumbers::Geometry(geometry), CorrectionNumbers::Smooth { middle_mm, half_mm, numbers: smooth }]
    }

    /// Expected value, calculated by hand: an error of 0.001 rad in the zero of axis 1 rotates the whole arm. At 480 mm
    /// in front of axis 1, this is 0.48 mm.
    #[test]
    fn an_axis_zero_error_rotates_the_corrected_arm() {
        let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
        let mut errors = [0.0; 32];
        errors[2] = 0.001;
        let arm = Kinematics::new(cell.with_arm_correction(CorrectionNumbers::Geometry(errors)).arm());
        let home = Joints::from([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]);
        let (real, drawn) =
            (arm.base_from_flange(&home).expect("numbers"), arm.nominal_flange(&home).expect("numbers"));
        let off = (real.origin() - drawn.origin()).mm;
        assert!((off - Vector3::new(0.0, 0.48, 0.0)).norm() < 1e-3, "{off}");
        assert!((arm.true_flange(drawn, &home).origin() - real.origin()).mm.norm() < 1e-9);
    }

    proptest! {
        /// The pose that is sent to the controller brings the corrected arm to the required pose, in the requested
        /// configuration.
        #[test]
        fn sent_poses_bring_the_corrected_flange_to_the_required_pose(angles in prop::array::uniform6(-60.0..60.0f64)) {
            for numbers in corrections() {
                let cell = Cell::check("cell.toml", "").unwrap_or_else(|e| panic!("{e}"));
                let arm = Kinematics::new(cell.with_arm_correction(numbers).arm());
                let near = Joints::from([angles[0], angles[1] - 60.0, angles[2] + 90.0, angles[3], angles[4] + 65.0, angles[5]]);
                prop_assume!(near.a5_deg.abs() > 5.0 && arm.elbow_deg(&near.degrees()) > 5.0);
                let wanted = arm.base_from_flange(&near).expect("numbers");
                prop_assume!(arm.overhead_mm(&wanted) > 30.0);
                let (sent, joints) = arm.sent_flange(&wanted, &near).expect("within reach");
                let there = arm.true_flange(sent, &joints);
                prop_assert!(there.origin().distance_mm(wanted.origin()) < 1e-6);
                prop_assert!((there.inverse() * wanted).rotation_angle().0 < 1e-6);
                prop_assert!(sent.origin().distance_mm(wanted.origin()) > 1e-3, "it was corrected");
                let by_controller = arm.nominal_flange(&joints).expect("numbers");
                prop_assert!(by_controller.origin().distance_mm(sent.origin()) < 1e-5);
                let apart = (0..6).map(|axis| (joints.degrees()[axis] - near.degrees()[axis]).abs());
                prop_assert!(apart.fold(0.0, f64::max) < 1e-5);
                let same = arm.inverse_solutions(&wanted).iter().filter(|way| {
                    let there = arm.base_from_flange(&Joints::from(**way)).expect("numbers");
                    there.origin().distance_mm(wanted.origin()) > 1e-6
                }).count();
                prop_assert_eq!(same, 0, "every way leads back");
            }
        }

        #[test]
        fn every_axis_solution_gives_the_pose_again(angles in prop::array::uniform6(-115.0..115.0f64)) {
            let kr6 = kr6();
            prop_assume!(angles[4].abs() > 1.0 && kr6.elbow_deg(&angles) > 1.0);
            let pose = kr6.base_from_flange(&Joints::from(angles)).expect("numbers");
            prop_assume!(kr6.overhead_mm(&pose) > 5.0);
            let ways = kr6.inverse_solutions(&pose);
            let apart = |way: &JointAngles, axis: usize| {
                let apart_deg = (way[axis] - angles[axis]).rem_euclid(360.0);
                apart_deg.min(360.0 - apart_deg)
            };
            let same = |way: &&JointAngles| (0..6).all(|axis| apart(way, axis) < 1e-4);
            prop_assert_eq!(ways.iter().filter(same).count(), 1, "{:?}", ways);
            for way in &ways {
                let there = kr6.base_from_flange(&Joints::from(*way)).expect("numbers");
                prop_assert!(there.origin().distance_mm(pose.origin()) < 1e-3);
                prop_assert!((there.inverse() * pose).rotation_angle().0 < 1e-4);
                prop_assert!((kr6.centre_line(way)[2].mm.coords - wrist_centre(&pose, kr6.arm.geometry())).norm() < 1e-3);
            }
        }
    }
}
