//! How the flange is where the controller does not say: by the arm's geometry, or by a motion that changes smoothly with place.

use super::arm_errors::{self, ARM_NUMBERS};
use super::arrangement::Twist;
use super::robot::ArmPose;
use crate::cell::{ArmGeometry, RobotCorrection};
use crate::geometry::{Base, Flange, Rigid};
use nalgebra::Isometry3;

/// How the flange is where the controller does not say.
#[derive(Debug, Clone, PartialEq)]
pub enum Correction {
    /// By the arm's geometry.
    Geometry {
        /// The arm as drawn.
        geometry: ArmGeometry,
        /// Its errors.
        errors: [f64; ARM_NUMBERS],
    },
    /// By a motion that changes smoothly with the flange's place.
    Smooth {
        /// The middle of the measured volume, mm.
        middle_mm: [f64; 3],
        /// Its half size, mm.
        half_mm: [f64; 3],
        /// Turns (rad) and shifts (mm) at the middle, and how they change along x, y, z to the volume's side.
        numbers: [f64; SMOOTH_NUMBERS],
    },
}

/// Numbers of a smooth correction.
pub const SMOOTH_NUMBERS: usize = 24;

impl Correction {
    /// The correction that a file holds, of the arm as drawn; `None` where its numbers are of another kind.
    pub fn of_file(file: &RobotCorrection, geometry: ArmGeometry) -> Option<Self> {
        match (file.kind.as_str(), file.middle_mm, file.half_mm) {
            ("geometry", ..) => {
                Some(Correction::Geometry { geometry, errors: file.numbers.as_slice().try_into().ok()? })
            }
            ("smooth", Some(middle_mm), Some(half_mm)) => {
                Some(Correction::Smooth { middle_mm, half_mm, numbers: file.numbers.as_slice().try_into().ok()? })
            }
            _ => None,
        }
    }

    /// Where the flange truly is; `None` where the correction needs axis angles and there are none.
    pub fn base_from_flange(&self, pose: &ArmPose) -> Option<Rigid<Base, Flange>> {
        match self {
            Correction::Geometry { geometry, errors } => {
                let joints = pose.joints.as_ref()?;
                // What the controller's own numbers differ from the drawing by stays.
                let drawn = arm_errors::base_from_flange(geometry, joints, &[0.0; ARM_NUMBERS]);
                let real = arm_errors::base_from_flange(geometry, joints, errors);
                Some(pose.base_from_flange * (drawn.inverse() * real))
            }
            Correction::Smooth { middle_mm, half_mm, numbers } => {
                let place = pose.base_from_flange.origin().mm;
                let part = |axis: usize| (place[axis] - middle_mm[axis]) / half_mm[axis];
                let by = [1.0, part(0), part(1), part(2)];
                let twist =
                    Twist::from_fn(|row, _| (0..4).map(|column| numbers[6 * column + row] * by[column]).sum());
                let bare = pose.base_from_flange.isometry();
                let turn = nalgebra::UnitQuaternion::from_scaled_axis(twist.fixed_rows::<3>(0).into_owned());
                let shift = bare.translation.vector + twist.fixed_rows::<3>(3);
                Some(Rigid::claim(Isometry3::from_parts(shift.into(), turn * bare.rotation)))
            }
        }
    }

    pub(super) fn numbers(&self) -> &[f64] {
        match self {
            Correction::Geometry { errors, .. } => errors,
            Correction::Smooth { numbers, .. } => numbers,
        }
    }

    pub(super) fn with_numbers(&self, new: &[f64]) -> Self {
        let mut changed = self.clone();
        match &mut changed {
            Correction::Geometry { errors, .. } => errors.copy_from_slice(new),
            Correction::Smooth { numbers, .. } => numbers.copy_from_slice(new),
        }
        changed
    }

    pub(super) fn usual(&self) -> Vec<f64> {
        match self {
            Correction::Geometry { .. } => arm_errors::usual().to_vec(),
            Correction::Smooth { .. } => {
                (0..SMOOTH_NUMBERS).map(|i| if i % 6 < 3 { 8.7e-4 } else { 0.5 }).collect()
            }
        }
    }

    /// The name of a number with its unit, and how many of those one of it is.
    pub fn name(&self, index: usize) -> (String, f64) {
        match self {
            Correction::Geometry { .. } => arm_errors::name(index),
            Correction::Smooth { .. } => {
                let change = ["in the middle", "along x", "along y", "along z"][index / 6];
                let about = ['x', 'y', 'z'][index % 3];
                match index % 6 < 3 {
                    true => (format!("turn about {about} {change}, °"), 1f64.to_degrees()),
                    false => (format!("shift along {about} {change}, mm"), 1.0),
                }
            }
        }
    }
}
