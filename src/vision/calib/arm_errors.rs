//! The kinematics of an arm whose links differ slightly from their nominal geometry.
//!
//! Forward kinematics of six axes with an ortho-parallel basis and a spherical wrist (Brandstötter, Angerer, Hofbaur
//! 2014). A small motion Eᵢ of six numbers follows each of the first five axes: the axis zero, its two twists, and
//! three lengths. These numbers describe every geometric error of six axes, except the part that the frames at both
//! ends absorb: an error before axis 1 belongs to the base, one after axis 6 to the tool. Under its weight the arm
//! sags about axes 2 and 3 by an angle that is proportional to the lever of the load.

use super::arrangement::{Twist, exp_map};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Flange, Joints, Rigid};
use panelprep_cell::cell::ArmGeometry;

/// The number of an arm's error parameters: six after each of the first five axes, and the sag of axes 2 and 3.
pub const ARM_NUMBERS: usize = panelprep_cell::cell::GEOMETRY_NUMBERS;

/// Returns the usual size of each error parameter, as a standard deviation: rotations in rad, lengths in mm, sag in
/// rad for each mm of lever.
pub fn prior_std() -> [f64; ARM_NUMBERS] {
    std::array::from_fn(|index| match index {
        30 | 31 => SAG,
        index if index % 6 < 3 => ANGLE_PRIOR_RAD,
        _ => LENGTH_MM,
    })
}

/// 0.05°.
const ANGLE_PRIOR_RAD: f64 = 8.7e-4;
const LENGTH_MM: f64 = 0.4;
/// This sag is 0.3 mm at the end of a lever of 600 mm.
const SAG: f64 = 8e-7;

/// Returns the name of an error parameter with the unit in which it is reported, and the factor from the
/// parameter's own unit to that unit.
pub fn name(index: usize) -> (String, f64) {
    const ALONG: [char; 3] = ['x', 'y', 'z'];
    // The first axis turns about z, axes 2, 3 and 5 about y, axis 4 about z.
    const AXIS: [usize; 5] = [2, 1, 1, 2, 1];
    if index >= 30 {
        return (format!("sag of axis {}, µrad for each mm", index - 28), 1e6);
    }
    let (axis, part) = (index / 6, index % 6);
    match part {
        part if part == AXIS[axis] => (format!("zero of axis {}, °", axis + 1), 1f64.to_degrees()),
        part if part < 3 => (format!("twist about {} after axis {}, °", ALONG[part], axis + 1), 1f64.to_degrees()),
        part => (format!("length along {} after axis {}, mm", ALONG[part - 3], axis + 1), 1.0),
    }
}

/// Returns the joint angles in the model's own convention, rad.
fn model_angles_rad(geometry: &ArmGeometry, joints: &Joints) -> [f64; 6] {
    let all = joints.degrees();
    std::array::from_fn(|axis| {
        (all[axis] * f64::from(geometry.signs[axis]) - geometry.offsets_deg[axis]).to_radians()
    })
}

/// Returns the flange's pose of an arm with these errors.
pub fn base_from_flange(
    geometry: &ArmGeometry,
    joints: &Joints,
    errors: &[f64; ARM_NUMBERS],
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

/// Faults of the axes in a file: two axes exchanged, or one with the opposite sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisFault {
    /// Two exchanged axes, numbered from 1.
    Exchanged(usize, usize),
    /// An axis with the opposite sign, numbered from 1.
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
    /// Returns every possible fault.
    pub fn all() -> Vec<AxisFault> {
        let exchanged = (1..=6).flat_map(|one| (one + 1..=6).map(move |two| AxisFault::Exchanged(one, two)));
        exchanged.chain((1..=6).map(AxisFault::Sign)).collect()
    }

    /// Returns the true axis angles if the file has this fault.
    pub fn correct_angles(self, joints: &Joints) -> Joints {
        let mut all = joints.degrees();
        match self {
            AxisFault::Exchanged(one, two) => all.swap(one - 1, two - 1),
            AxisFault::Sign(axis) => all[axis - 1] = -all[axis - 1],
        }
        all.into()
    }
}
