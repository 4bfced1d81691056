//! The uncertainty of the corrected arm anywhere in its volume.

use super::quantile::radius_95;
use super::robot_correction::ArmPose;
use super::robot_data::{Rig, RigKind};
use super::robot_found::RobotFound;
use super::robot_settle::{ConvergedState, State};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};
use panelprep_base::geometry::{Flange, Point};

/// Returns the derivative of a position with respect to each unknown, the position in mm; `None` if the position
/// cannot be computed.
pub(super) fn position_jacobian(
    state: &State,
    covariance: &DMatrix<f64>,
    place: &dyn Fn(&State) -> Option<Vector3<f64>>,
) -> Option<DMatrix<f64>> {
    let middle = place(state)?;
    let mut slope = DMatrix::zeros(3, covariance.nrows());
    for column in 0..covariance.nrows() {
        let step = 0.1 * covariance[(column, column)].sqrt().max(1e-12);
        let mut change = DVector::zeros(covariance.nrows());
        change[column] = step;
        slope.set_column(column, &((place(&state.perturbed(&change))? - middle) / step));
    }
    Some(slope)
}

/// Returns the covariance of a position, mm².
pub(super) fn spread(
    settled: &ConvergedState,
    place: &dyn Fn(&State) -> Option<Vector3<f64>>,
) -> Option<Matrix3<f64>> {
    let slope = position_jacobian(&settled.state, &settled.inverse, place)?;
    let spread = &slope * &settled.inverse * slope.transpose();
    Some(spread.fixed_view::<3, 3>(0, 0).into_owned())
}

impl State {
    /// Returns the tip at a pose: in the frame of the fixed camera if there is one, else in the base. The tip must
    /// reach the position that the camera sees.
    pub(super) fn tip_position(&self, pose: &ArmPose) -> Option<Vector3<f64>> {
        let tip = self.correction.base_from_flange(pose)? * Point::<Flange>::new(self.tip.into());
        let fixed = self.rigs.iter().find(|rig| rig.kind == RigKind::EyeToHand);
        let camera_from_base = fixed.map_or_else(Isometry3::identity, |rig| rig.mount.inverse());
        Some((camera_from_base * tip.mm).coords)
    }
}

impl RobotFound {
    /// Returns the uncertainty of the corrected tip's position at a pose, relative to the fixed camera (without one,
    /// to the base), 95 %, mm. The scatter of left-out pictures is included. `None` if the correction needs axis
    /// angles and there are none.
    pub fn tip_uncertainty_mm(&self, pose: &ArmPose) -> Option<f64> {
        let slope = position_jacobian(&self.state, &self.covariance, &|state| state.tip_position(pose))?;
        Some(self.radius_mm(&(&slope * &self.covariance * slope.transpose())))
    }

    pub(super) fn radius_mm(&self, spread: &DMatrix<f64>) -> f64 {
        let of_numbers = spread.fixed_view::<3, 3>(0, 0).into_owned();
        radius_95(&(of_numbers + Matrix3::identity() * self.scatter_mm.powi(2)), 1e5)
    }

    /// Returns the tip on the flange without a correction, if there were touches, mm.
    pub fn uncorrected_tip_mm(&self) -> Option<Vector3<f64>> {
        self.uncorrected.touches.then_some(self.uncorrected.tip)
    }

    /// Returns the rigs as calculated without a correction.
    pub fn uncorrected_rigs(&self) -> &[Rig] {
        &self.uncorrected.rigs
    }
}
