//! The kinematics of an arm whose links differ slightly from their nominal geometry, and the true pose of its flange.
//!
//! Forward kinematics of six axes with an ortho-parallel basis and a spherical wrist (Brandstötter, Angerer, Hofbaur
//! 2014). A small motion Eᵢ with six parameters follows each of the first five axes: the zero of the axis, its two
//! twists, and three lengths. These parameters describe every geometric error of six axes, except the part that the
//! frames at both ends absorb: an error before axis 1 belongs to the base, an error after axis 6 to the tool. Under its
//! weight the arm sags about axes 2 and 3 by an angle that is proportional to the lever of the load.
//!
//! The true pose of the flange differs from the controller's pose by the geometry of the arm, or by a motion that
//! varies smoothly over the volume. If the controller reports the pose N, the true pose of the flange is T:
//!     geometry, by the axis angles q:  T = N F₀(q)⁻¹ F(q),   F₀ nominal forward kinematics, F with the errors      (1)
//!     smooth, by the position p of N:  T = (exp r(p) R, p + t(p)), r and t linear in p, constant outside the volume (2)
//! To bring the flange to T, the controller is sent the N for which (1) or (2) gives T.

use super::chain::{Twist, exp_map};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
pub use panelprep_cell::cell::SMOOTH_PARAMETER_COUNT;
use panelprep_cell::cell::{ArmGeometry, CorrectionNumbers};

/// Number of error parameters of an arm: six after each of the first five axes, and the sag of axes 2 and 3.
pub const ARM_PARAMETER_COUNT: usize = panelprep_cell::cell::GEOMETRY_PARAMETER_COUNT;

/// Returns the usual standard deviation of each error parameter: rotations in rad, lengths in mm, sag in rad per mm of
/// lever.
pub fn prior_std() -> [f64; ARM_PARAMETER_COUNT] {
    std::array::from_fn(|index| match index {
        30 | 31 => SAG_PRIOR_RAD_PER_MM,
        index if index % 6 < 3 => ANGLE_PRIOR_RAD,
        _ => LENGTH_PRIOR_MM,
    })
}

/// Prior standard deviation of a rotation, rad: 0.05°.
const ANGLE_PRIOR_RAD: f64 = 8.7e-4;
const LENGTH_PRIOR_MM: f64 = 0.4;
/// Standard deviation of the sag, rad per mm: 0.3 mm at the end of a lever of 600 mm.
const SAG_PRIOR_RAD_PER_MM: f64 = 8e-7;

/// Returns the name of an error parameter with the unit in which it is reported, and the factor that converts the
/// parameter to this unit.
pub fn name(index: usize) -> (String, f64) {
    const AXIS_NAMES: [char; 3] = ['x', 'y', 'z'];
    // Axis 1 rotates about z, axes 2, 3 and 5 about y, axis 4 about z.
    const ROTATION_AXES: [usize; 5] = [2, 1, 1, 2, 1];
    if index >= 30 {
        return (format!("sag of axis {}, µrad for each mm", index - 28), 1e6);
    }
    let (axis, part) = (index / 6, index % 6);
    match part {
        part if part == ROTATION_AXES[axis] => (format!("zero of axis {}, °", axis + 1), 1f64.to_degrees()),
        part if part < 3 => {
            (format!("twist about {} after axis {}, °", AXIS_NAMES[part], axis + 1), 1f64.to_degrees())
        }
        part => (format!("length along {} after axis {}, mm", AXIS_NAMES[part - 3], axis + 1), 1.0),
    }
}

/// Returns the joint angles in the convention of the kinematic model, rad.
fn model_angles_rad(geometry: &ArmGeometry, joints: &Joints) -> [f64; 6] {
    let all = joints.degrees();
    std::array::from_fn(|axis| {
        (all[axis] * f64::from(geometry.signs[axis]) - geometry.offsets_deg[axis]).to_radians()
    })
}

/// Returns the flange pose of an arm with these errors.
pub fn base_from_flange(
    geometry: &ArmGeometry,
    joints: &Joints,
    errors: &[f64; ARM_PARAMETER_COUNT],
) -> Rigid<Base, Flange> {
    let g = geometry;
    let mut q = model_angles_rad(g, joints);
    let lean = q[1] + q[2];
    let from_elbow = g.a2_mm * lean.cos() + g.c3_mm * lean.sin();
    q[1] += errors[30] * (from_elbow + g.c2_mm * q[1].sin());
    q[2] += errors[31] * from_elbow;
    let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
    let off =
        |axis: usize| -> Isometry3<f64> { exp_map(&Twist::from_column_slice(&errors[6 * axis..6 * axis + 6])) };
    let (y, z) = (Vector3::y(), Vector3::z());
    let pose: Isometry3<f64> = about(z, q[0])
        * off(0)
        * Translation3::new(g.a1_mm, g.b_mm, g.c1_mm)
        * about(y, q[1])
        * off(1)
        * Translation3::new(0.0, 0.0, g.c2_mm)
        * about(y, q[2])
        * off(2)
        * Translation3::new(g.a2_mm, 0.0, g.c3_mm)
        * about(z, q[3])
        * off(3)
        * about(y, q[4])
        * off(4)
        * about(z, q[5])
        * Translation3::new(0.0, 0.0, g.c4_mm);
    Rigid::from_isometry_unchecked(pose)
}

/// A possible error in the axis angles of a file: two axes are exchanged, or one has the wrong sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisFault {
    /// Two exchanged axes, numbered from 1.
    Exchanged(usize, usize),
    /// An axis with the wrong sign, numbered from 1.
    Sign(usize),
}

impl std::fmt::Display for AxisFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            AxisFault::Exchanged(one, two) => write!(f, "axes {one} and {two} are exchanged"),
            AxisFault::Sign(axis) => write!(f, "axis {axis} has the wrong sign"),
        }
    }
}

impl AxisFault {
    /// Returns all possible errors of the axis angles.
    pub fn all() -> Vec<AxisFault> {
        let exchanged = (1..=6).flat_map(|one| (one + 1..=6).map(move |two| AxisFault::Exchanged(one, two)));
        exchanged.chain((1..=6).map(AxisFault::Sign)).collect()
    }

    /// Returns the true axis angles if the file has this error.
    pub fn correct_angles(self, joints: &Joints) -> Joints {
        let mut all = joints.degrees();
        match self {
            AxisFault::Exchanged(one, two) => all.swap(one - 1, two - 1),
            AxisFault::Sign(axis) => all[axis - 1] = -all[axis - 1],
        }
        all.into()
    }
}

/// The pose of the arm, as the controller reports it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPose {
    /// The axis angles, if they are known.
    pub joints: Option<Joints>,
    /// The flange pose that the controller reports.
    pub base_from_flange: Rigid<Base, Flange>,
}

/// The correction of the flange pose: how the true pose differs from the controller's.
#[derive(Debug, Clone, PartialEq)]
pub enum Correction {
    /// A correction with errors of the arm geometry.
    Geometry {
        /// The nominal geometry of the arm.
        geometry: ArmGeometry,
        /// The error parameters of the arm, in the order of [`name`].
        errors: [f64; ARM_PARAMETER_COUNT],
    },
    /// A correction with a motion that changes smoothly with the position of the flange.
    Smooth {
        /// The centre of the measured volume, mm.
        middle_mm: [f64; 3],
        /// Half the size of the measured volume, mm.
        half_mm: [f64; 3],
        /// Rotations (rad) and shifts (mm) in the centre, and their changes along x, y and z from the centre to the
        /// side of the volume.
        numbers: [f64; SMOOTH_PARAMETER_COUNT],
    },
}

/// Number of fixed-point iterations that invert (2); each reduces the error to about a thousandth.
const INVERSE_ITERATIONS: usize = 8;
/// Maximum distance outside of the measured volume at which the corrected arm may measure or touch, as a fraction of
/// half the size of the volume.
const MAX_EXTRAPOLATION: f64 = 0.1;

impl Correction {
    /// Creates the correction from these parameters and the arm's nominal geometry.
    pub fn new(numbers: &CorrectionNumbers, geometry: ArmGeometry) -> Self {
        match *numbers {
            CorrectionNumbers::Geometry(errors) => Correction::Geometry { geometry, errors },
            CorrectionNumbers::Smooth { middle_mm, half_mm, numbers } => {
                Correction::Smooth { middle_mm, half_mm, numbers }
            }
        }
    }

    /// Returns the correction's parameters in the form of the file.
    pub fn for_file(&self) -> CorrectionNumbers {
        match *self {
            Correction::Geometry { errors, .. } => CorrectionNumbers::Geometry(errors),
            Correction::Smooth { middle_mm, half_mm, numbers } => {
                CorrectionNumbers::Smooth { middle_mm, half_mm, numbers }
            }
        }
    }

    /// Returns the true pose of the flange by (1) or (2); `None` if the correction needs axis angles and there are
    /// none.
    pub fn base_from_flange(&self, pose: &ArmPose) -> Option<Rigid<Base, Flange>> {
        match self {
            // A difference between the parameters of the controller and the nominal geometry is preserved.
            Correction::Geometry { geometry, errors } => {
                Some(pose.base_from_flange * flange_deviation(geometry, errors, pose.joints.as_ref()?))
            }
            Correction::Smooth { .. } => {
                let (turn, shift) = self.motion_at(pose.base_from_flange.origin());
                let bare = pose.base_from_flange.isometry();
                let place = bare.translation.vector + shift;
                Some(Rigid::from_isometry_unchecked(Isometry3::from_parts(place.into(), turn * bare.rotation)))
            }
        }
    }

    /// Returns the pose that must be sent to the controller so that the flange reaches `base_from_flange`; `joints` are
    /// the axis angles there.
    pub fn sent_flange(&self, base_from_flange: &Rigid<Base, Flange>, joints: &Joints) -> Rigid<Base, Flange> {
        match self {
            Correction::Geometry { geometry, errors } => {
                *base_from_flange * flange_deviation(geometry, errors, joints).inverse()
            }
            Correction::Smooth { .. } => {
                let wanted = base_from_flange.isometry();
                let mut place = wanted.translation.vector;
                for _ in 0..INVERSE_ITERATIONS {
                    place = wanted.translation.vector - self.motion_at(Point::new(place.into())).1;
                }
                let (turn, _) = self.motion_at(Point::new(place.into()));
                Rigid::from_isometry_unchecked(Isometry3::from_parts(
                    place.into(),
                    turn.inverse() * wanted.rotation,
                ))
            }
        }
    }

    /// Returns whether the correction is valid at this pose of the flange.
    pub fn covers(&self, base_from_flange: &Rigid<Base, Flange>) -> bool {
        match self {
            Correction::Geometry { .. } => true,
            Correction::Smooth { middle_mm, half_mm, .. } => {
                let place = base_from_flange.origin().mm;
                (0..3)
                    .all(|axis| (place[axis] - middle_mm[axis]).abs() <= (1.0 + MAX_EXTRAPOLATION) * half_mm[axis])
            }
        }
    }

    /// Returns the rotation, and the shift in mm, of a smooth correction at a position.
    fn motion_at(&self, place: Point<Base>) -> (UnitQuaternion<f64>, nalgebra::Vector3<f64>) {
        let Correction::Smooth { middle_mm, half_mm, numbers } = self else {
            return (UnitQuaternion::identity(), nalgebra::Vector3::zeros());
        };
        let edge = 1.0 + MAX_EXTRAPOLATION;
        let part = |axis: usize| ((place.mm[axis] - middle_mm[axis]) / half_mm[axis]).clamp(-edge, edge);
        let by = [1.0, part(0), part(1), part(2)];
        let twist = Twist::from_fn(|row, _| (0..4).map(|column| numbers[6 * column + row] * by[column]).sum());
        let turn = UnitQuaternion::from_scaled_axis(twist.fixed_rows::<3>(0).into_owned());
        (turn, twist.fixed_rows::<3>(3).into_owned())
    }

    pub(super) fn numbers(&self) -> &[f64] {
        match self {
            Correction::Geometry { errors, .. } => errors,
            Correction::Smooth { numbers, .. } => numbers,
        }
    }

    pub(super) fn with_parameters(&self, new: &[f64]) -> Self {
        let mut changed = self.clone();
        match &mut changed {
            Correction::Geometry { errors, .. } => errors.copy_from_slice(new),
            Correction::Smooth { numbers, .. } => numbers.copy_from_slice(new),
        }
        changed
    }

    pub(super) fn parameter_priors(&self) -> Vec<f64> {
        match self {
            Correction::Geometry { .. } => prior_std().to_vec(),
            Correction::Smooth { .. } => {
                (0..SMOOTH_PARAMETER_COUNT).map(|i| if i % 6 < 3 { 8.7e-4 } else { 0.5 }).collect()
            }
        }
    }

    /// Returns the name of a parameter with its unit, and the factor that converts the parameter to this unit.
    pub fn name(&self, index: usize) -> (String, f64) {
        match self {
            Correction::Geometry { .. } => name(index),
            Correction::Smooth { .. } => {
                let change = ["in the middle", "along x", "along y", "along z"][index / 6];
                let about = ['x', 'y', 'z'][index % 3];
                match index % 6 < 3 {
                    true => (format!("rotation about {about} {change}, °"), 1f64.to_degrees()),
                    false => (format!("shift along {about} {change}, mm"), 1.0),
                }
            }
        }
    }
}

/// Returns the flange pose of the real arm relative to the flange of the nominal arm, at these axis angles.
fn flange_deviation(
    geometry: &ArmGeometry,
    errors: &[f64; ARM_PARAMETER_COUNT],
    joints: &Joints,
) -> Rigid<Flange, Flange> {
    let drawn = base_from_flange(geometry, joints, &[0.0; ARM_PARAMETER_COUNT]);
    drawn.inverse() * base_from_flange(geometry, joints, errors)
}
