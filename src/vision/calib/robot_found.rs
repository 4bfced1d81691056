//! The result of a calibration of an arm.

use super::robot_correction::Correction;
use super::robot_data::Rig;
use super::robot_settle::State;
use nalgebra::{DMatrix, Vector3};

/// One parameter of the correction.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    /// The parameter's name, with its unit.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// The parameter's uncertainty, 95 %.
    pub uncertainty: f64,
    /// The parameter's standard deviation after the estimate divided by that before: 1 if the data carry no
    /// information, 0 if they determine the parameter completely.
    pub remaining_share: f64,
}

/// The estimated model with its evidence.
#[derive(Debug, Clone)]
pub struct RobotFound {
    /// The correction.
    pub correction: Correction,
    /// Its numbers.
    pub numbers: Vec<Number>,
    /// The rigs as calculated with the correction.
    pub rigs: Vec<Rig>,
    /// The tip on the flange, if there were touches, mm.
    pub tip_mm: Option<Vector3<f64>>,
    /// The rms distance of the board from its expected position in left-out pictures, with only mounts and boards
    /// estimated, mm.
    pub uncorrected_left_out_mm: f64,
    /// The rms distance of the board from its expected position in left-out pictures, with the correction, mm.
    pub corrected_left_out_mm: f64,
    pub(super) uncorrected: State,
    pub(super) state: State,
    pub(super) covariance: DMatrix<f64>,
    pub(super) variance: f64,
    /// The residual of a single pose that no parameter of the arm explains, along each axis, mm.
    pub(super) scatter_mm: f64,
}
