//! Suggests the pose that would improve the calibration of an arm most, and reports whether any further pose would
//! improve it.
//!
//! The board of a rig is simulated in parts of the camera's picture, tilted and rotated, within the range of its
//! observed distances. The caller states which of these flange poses the arm can reach, and with which axis angles. A
//! picture has the information W, and J is the derivative of its twist with respect to the unknowns. The picture
//! reduces their covariance C to
//!     C − C Jᵀ (J C Jᵀ + W⁻¹)⁻¹ J C.                                                                          (1)
//! The best picture is the one that minimises the uncertainty of the least certain determined parameter.

use super::adjust::scaled_inverse;
use super::arm_errors::ArmPose;
use super::board::Board;
use super::chain::log;
use super::detect::Corners;
use super::robot;
use super::robot::RobotFound;
use super::robot_settle::{ArmView, RigKind, information};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::{Base, Camera, Degrees, Flange, PinholeCamera, Pixel, Rigid, median};
use rayon::prelude::*;

/// A flange pose at which the camera of a rig would see its board.
#[derive(Debug, Clone)]
pub struct Viewpoint {
    /// Index of the rig whose camera would see its board.
    pub rig: usize,
    /// The flange pose at this viewpoint.
    pub base_from_flange: Rigid<Base, Flange>,
    information: Matrix6<f64>,
}

/// A pose that the arm can reach.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// The view from this pose.
    pub viewpoint: Viewpoint,
    /// The pose of the arm.
    pub pose: ArmPose,
}

/// The recommended next pose.
#[derive(Debug, Clone)]
pub struct NextPose {
    /// Index of the rig whose board the picture shows.
    pub rig: usize,
    /// The pose of the arm.
    pub pose: ArmPose,
    /// The least certain parameter among those that the data determine.
    pub weakest_parameter: String,
    /// Ratio of the standard deviation of this parameter after the picture to that before.
    pub weakest_share: f64,
    /// Ratio of the stated error of the tip after the best picture to that before, as the median over the volume.
    pub tip_share: f64,
}

impl NextPose {
    /// Returns whether no further picture would reduce the stated error of the tip enough.
    pub fn is_sufficient(&self) -> bool {
        self.tip_share > MAX_REMAINING_FRACTION
    }
}

/// Maximum fraction of the tip's stated error that may remain after a useful picture.
const MAX_REMAINING_FRACTION: f64 = 0.95;
/// Maximum ratio of the standard deviation of a determined parameter to its usual one.
pub const MAX_DETERMINED_STD_RATIO: f64 = 0.7;
const PARTS: [f64; 3] = [0.28, 0.5, 0.72];
const TILTS_DEG: [f64; 2] = [20.0, 42.0];
const CANDIDATE_ROTATIONS: usize = 4;
const DIRECTIONS: usize = 6;

/// Returns the flange poses at which the camera of a rig would see the complete board.
pub fn viewpoints(
    found: &RobotFound,
    views: &[ArmView],
    rig: usize,
    (camera, board): (&PinholeCamera, &Board),
) -> Vec<Viewpoint> {
    let own = || views.iter().filter(|view| view.rig == rig);
    let mut far: Vec<f64> = own().map(|view| view.camera_from_board.translation.vector.norm()).collect();
    far.sort_by(f64::total_cmp);
    let mut off: Vec<f64> = own().map(|view| view.rms_px).collect();
    let (Some(near_mm), Some(far_mm), Some(rms_px)) = (far.first().copied(), far.last().copied(), median(&mut off))
    else {
        return Vec::new();
    };
    let mut all = Vec::new();
    for depth_mm in [near_mm, (near_mm + far_mm) / 2.0, far_mm] {
        for (across, down) in PARTS.iter().flat_map(|across| PARTS.iter().map(move |down| (across, down))) {
            let pixel = Pixel::at(across * camera.width_px as f64, down * camera.height_px as f64);
            let Some(ray) = camera.unproject::<Camera>(pixel) else { continue };
            for turn in candidate_rotations() {
                let seen =
                    Translation3::from(ray.mm * depth_mm) * turn * Translation3::from(-board.centre().mm.coords);
                all.extend(viewpoint(found, rig, (camera, board), &Rigid::from_isometry_unchecked(seen), rms_px));
            }
        }
    }
    all
}

/// Returns rotations of the board: flat and tilted in several directions, each rotated about the line of sight by
/// several angles.
fn candidate_rotations() -> Vec<UnitQuaternion<f64>> {
    let about = |index: usize, count: usize| std::f64::consts::TAU * index as f64 / count as f64;
    let tilt = |tilt_deg: f64| {
        (0..DIRECTIONS).map(move |direction| {
            let angle = about(direction, DIRECTIONS);
            Vector3::new(angle.cos(), angle.sin(), 0.0) * Degrees(tilt_deg).to_rad()
        })
    };
    let tilts = std::iter::once(Vector3::zeros()).chain(TILTS_DEG.into_iter().flat_map(tilt));
    tilts
        .flat_map(|tilt| {
            (0..CANDIDATE_ROTATIONS).map(move |turn| {
                UnitQuaternion::from_scaled_axis(tilt)
                    * UnitQuaternion::from_scaled_axis(Vector3::z() * about(turn, CANDIDATE_ROTATIONS))
            })
        })
        .collect()
}

/// Returns the flange pose of one view; `None` if the board leaves the picture.
fn viewpoint(
    found: &RobotFound,
    rig: usize,
    (camera, board): (&PinholeCamera, &Board),
    camera_from_board: &Rigid<Camera, panelprep_base::geometry::Board>,
    rms_px: f64,
) -> Option<Viewpoint> {
    let corners: Corners = board
        .corners()
        .into_iter()
        .map(|q| Some((q, camera.project_inside(*camera_from_board * q)?)))
        .collect::<Option<_>>()?;
    let information = information(camera, &corners, camera_from_board, rms_px)?;
    let (rig_is, seen) = (&found.rigs[rig], camera_from_board.isometry());
    let base_from_flange: Isometry3<f64> = match rig_is.kind {
        RigKind::EyeToHand => rig_is.mount * seen * rig_is.board.inverse(),
        RigKind::EyeInHand => rig_is.board * seen.inverse() * rig_is.mount.inverse(),
    };
    Some(Viewpoint { rig, base_from_flange: Rigid::from_isometry_unchecked(base_from_flange), information })
}

/// The fractions that would remain after a picture: of the error of the least certain determined parameter, and of the
/// error of the tip.
struct InformationGain {
    weakest_share: f64,
    tip_share: f64,
}

/// Returns the best of the candidates; `volume` contains the poses at which the error of the tip is evaluated. `None`
/// if there is no candidate, or the data determine no parameter.
pub fn best_next_pose(found: &RobotFound, candidates: &[Candidate], volume: &[ArmPose]) -> Option<NextPose> {
    let own = found.state.free_parameter_count();
    let determined = (0..own).filter(|index| found.numbers[*index].remaining_share < MAX_DETERMINED_STD_RATIO);
    let weakest = determined
        .max_by(|a, b| found.numbers[*a].remaining_share.total_cmp(&found.numbers[*b].remaining_share))?;
    let slopes: Vec<DMatrix<f64>> = volume
        .iter()
        .filter_map(|pose| {
            robot::position_jacobian(&found.state, &found.covariance, &|state| state.tip_position(pose))
        })
        .collect();
    let gains: Vec<Option<InformationGain>> =
        candidates.par_iter().map(|candidate| compute_gain(found, candidate, weakest, &slopes)).collect();
    let by = |criterion: fn(&InformationGain) -> f64| {
        let all = gains.iter().enumerate().filter_map(|(index, gain)| Some((index, criterion(gain.as_ref()?))));
        all.min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let ((index, weakest_share), (_, tip_share)) = (by(|gain| gain.weakest_share)?, by(|gain| gain.tip_share)?);
    let best = &candidates[index];
    let weakest = found.numbers[weakest].name.clone();
    Some(NextPose {
        rig: best.viewpoint.rig,
        pose: best.pose,
        weakest_parameter: weakest,
        weakest_share,
        tip_share,
    })
}

/// Computes the information gain of a picture at this pose by (1).
fn compute_gain(
    found: &RobotFound,
    candidate: &Candidate,
    weakest: usize,
    tips: &[DMatrix<f64>],
) -> Option<InformationGain> {
    let (rig, pose) = (candidate.viewpoint.rig, &candidate.pose);
    let covariance = &found.covariance;
    let middle = found.state.predict_board_pose(rig, pose)?;
    let mut slope = DMatrix::zeros(6, covariance.nrows());
    for column in 0..covariance.nrows() {
        let step = 0.1 * covariance[(column, column)].sqrt().max(1e-12);
        let mut change = DVector::zeros(covariance.nrows());
        change[column] = step;
        let moved = found.state.perturbed(&change).predict_board_pose(rig, pose)?;
        slope.set_column(column, &(log(&(middle.inverse() * moved)) / step));
    }
    let noise = scaled_inverse(&candidate.viewpoint.information)? * found.variance;
    let known = covariance * slope.transpose();
    let through: Matrix6<f64> = (&slope * &known).fixed_view::<6, 6>(0, 0) + noise;
    let inverse = scaled_inverse(&through)?;
    let row = known.row(weakest).transpose();
    let before = covariance[(weakest, weakest)];
    let after = before - (row.transpose() * inverse * &row)[(0, 0)];
    let radii = |with: bool| -> Vec<f64> {
        let radius = |tip: &DMatrix<f64>| {
            let there = tip * covariance * tip.transpose();
            let less = tip * &known;
            found.radius_mm(&if with { there - &less * inverse * less.transpose() } else { there })
        };
        tips.iter().map(radius).collect()
    };
    let tip_share = match (median(&mut radii(true)), median(&mut radii(false))) {
        (Some(after), Some(before)) if before > 0.0 => after / before,
        _ => 1.0,
    };
    Some(InformationGain { weakest_share: (after.max(0.0) / before).sqrt(), tip_share })
}
