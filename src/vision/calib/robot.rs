//! Estimates the arm's own errors from pictures of boards and from touches, together with camera mounts, boards and
//! tool tip.
//!
//! The unknowns are the arm's parameters p (of `arm_errors`, or of a smooth correction if no axis angles are known),
//! the mount and the board of each rig, the tip and the spots that it touched. A picture gives the pose of the board
//! in the camera's frame. With the residual twists r of pictures and the residual vectors of touches, each divided by
//! its standard deviation,
//!     Σ r² + Σ (p / usual size)²                                                                                  (1)
//! is minimised. The second sum is prior knowledge of any arm: a parameter that the data do not determine keeps its
//! nominal value. The ratio of its standard deviation after the estimate to that before states how well it is
//! determined. The scatter is estimated from the residuals, and the size of the prior from the arm's parameters.
//!
//! The result is judged by cross-validation on pictures that were left out, with and without p.

use super::adjust::scaled_inverse;
use super::arm_errors::ARM_NUMBERS;
use super::error::CalibError;
use super::robot_axes::axis_angle_problem;
pub use super::robot_correction::{ArmPose, Correction, SMOOTH_NUMBERS};
use super::robot_data::REPEAT_MM;
pub use super::robot_data::{ArmTouch, ArmView, Rig, RigKind, RobotData, TouchTarget};
pub use super::robot_found::{Number, RobotFound};
use super::robot_settle::{ConvergedState, State, levenberg_marquardt};
use super::robot_spread::spread;
use nalgebra::Vector3;

/// Minimum number of pictures: with fewer, no arm is estimated.
pub const MIN_VIEWS: usize = 12;
/// Number of times that the size of this arm's parameters is estimated.
const SCALE_ITERATIONS: usize = 3;
/// The number of groups in which pictures are left out.
pub(super) const GROUPS: usize = 5;

/// Returns the initial correction: geometry if every pose has its axis angles, else smooth over the measured
/// volume.
fn nominal(data: &RobotData) -> Correction {
    let poses = || data.views.iter().map(|view| &view.pose).chain(data.touches.iter().map(|touch| &touch.pose));
    if poses().all(|pose| pose.joints.is_some()) {
        return Correction::Geometry { geometry: data.geometry, errors: [0.0; ARM_NUMBERS] };
    }
    let along = |axis: usize| poses().map(move |pose| pose.base_from_flange.origin().mm[axis]);
    let low: [f64; 3] = std::array::from_fn(|axis| along(axis).fold(f64::INFINITY, f64::min));
    let high: [f64; 3] = std::array::from_fn(|axis| along(axis).fold(f64::NEG_INFINITY, f64::max));
    Correction::Smooth {
        middle_mm: std::array::from_fn(|axis| (low[axis] + high[axis]) / 2.0),
        half_mm: std::array::from_fn(|axis| ((high[axis] - low[axis]) / 2.0).max(50.0)),
        numbers: [0.0; SMOOTH_NUMBERS],
    }
}

/// Estimates the arm's errors.
///
/// # Errors
/// If there are too few pictures, axis angles contradict the pictures or the controller's poses, touches do not
/// determine the tip, or the iteration does not converge.
pub fn calibrate(data: &RobotData) -> Result<RobotFound, CalibError> {
    let unsettled = || CalibError::NotSettled { what: "the arm" };
    if data.views.len() < MIN_VIEWS {
        let message = format!(
            "{} pictures show the board; at least {MIN_VIEWS} are needed to calibrate an arm",
            data.views.len()
        );
        return Err(CalibError::Points(message));
    }
    if let Some(message) = axis_angle_problem(data) {
        return Err(CalibError::Points(message));
    }
    let views: Vec<&ArmView> = data.views.iter().collect();
    if let Some(message) = touch_problem(data) {
        return Err(CalibError::Points(message));
    }
    let spot_of = |touch: &ArmTouch| if let TouchTarget::Spot(spot) = touch.target { spot + 1 } else { 0 };
    let spots = data.touches.iter().map(spot_of).max().unwrap_or(0);
    let start = State {
        correction: nominal(data),
        corrects: false,
        size: 1.0,
        rigs: data.rigs.clone(),
        touches: !data.touches.is_empty(),
        tip: Vector3::new(0.0, 0.0, 100.0),
        spots: (0..spots).map(|spot| first_touch(data, spot)).collect(),
    };
    // First without corrections: it gives the start, and the residuals with which the correction must be compared to
    // prove that it helps.
    let plain = levenberg_marquardt(start, &views, &data.touches).ok_or_else(unsettled)?;
    let free = State { corrects: true, ..plain.state.clone() };
    let mut full = levenberg_marquardt(free, &views, &data.touches).ok_or_else(unsettled)?;
    // How large this arm's errors are is not known beforehand; a prior for a good arm would hide the errors of a bad
    // one.
    for _ in 0..SCALE_ITERATIONS {
        let resized = State { size: full.size(), ..full.state };
        full = levenberg_marquardt(resized, &views, &data.touches).ok_or_else(unsettled)?;
    }
    let before = cross_validate(&plain.state, data).ok_or_else(unsettled)?;
    let after = cross_validate(&full.state, data).ok_or_else(unsettled)?;
    let usual = full.state.parameter_priors();
    let numbers = full.state.correction.numbers().iter().enumerate().map(|(index, value)| {
        let (name, unit) = full.state.correction.name(index);
        let deviation = full.inverse[(index, index)].sqrt();
        Number {
            name,
            value: value * unit,
            uncertainty: 1.96 * deviation * unit,
            remaining_share: deviation / usual[index],
        }
    });
    Ok(RobotFound {
        numbers: numbers.collect(),
        correction: full.state.correction.clone(),
        rigs: full.state.rigs.clone(),
        tip_mm: full.state.touches.then_some(full.state.tip),
        uncorrected_left_out_mm: rms_mm(&before),
        corrected_left_out_mm: rms_mm(&after),
        scatter_mm: scatter_mm(&full, data, &after).ok_or_else(unsettled)?,
        uncorrected: plain.state,
        covariance: full.inverse,
        variance: full.variance,
        state: full.state,
    })
}

/// Returns what is wrong with the touches: an object that cannot be touched, or touches that do not determine the
/// tip.
fn touch_problem(data: &RobotData) -> Option<String> {
    let is_other = |touch: &&ArmTouch| match touch.target {
        TouchTarget::Spot(_) => false,
        TouchTarget::Corner { rig, .. } => data.rigs.get(rig).is_none_or(|rig| rig.kind != RigKind::EyeInHand),
        TouchTarget::Seen { rig, .. } => data.rigs.get(rig).is_none_or(|rig| rig.kind != RigKind::EyeToHand),
    };
    if data.touches.iter().any(|touch| is_other(&touch)) {
        return Some(
            "a board corner can be touched only if the board does not move, and a point that a camera sees only if \
             the camera is fixed"
                .to_owned(),
        );
    }
    let free: std::collections::BTreeSet<usize> = data
        .touches
        .iter()
        .filter_map(|touch| if let TouchTarget::Spot(spot) = touch.target { Some(spot) } else { None })
        .collect();
    // Each spot uses up one touch, and the tip needs two.
    let (touch_count, needed) = (data.touches.len(), free.len() + 2);
    (touch_count > 0 && touch_count < needed).then(|| {
        format!(
            "{touch_count} touches do not determine the tip (at least {needed} touches are needed): touch each spot \
                 several times with the tool turned differently"
        )
    })
}

/// Returns the cross-validation residual for each axis of the view, without the noise of the pictures and of the
/// arm's parameters, mm. Only the fixed camera's pictures are used, if there are any, since the board on the flange
/// is about as far from it as a tool.
fn scatter_mm(full: &ConvergedState, data: &RobotData, left_out: &[LeftOutError]) -> Option<f64> {
    let is_fixed = |view: &ArmView| data.rigs[view.rig].kind == RigKind::EyeToHand;
    let has_fixed = data.views.iter().any(is_fixed);
    let (mut square, mut count) = (0.0, 0.0);
    for (index, off) in left_out {
        let view = &data.views[*index];
        if has_fixed && !is_fixed(view) {
            continue;
        }
        let place = |state: &State| {
            Some(
                (view.camera_from_board.inverse() * state.predict_board_pose(view.rig, &view.pose)?)
                    .translation
                    .vector,
            )
        };
        let of_numbers = spread(full, &place)? * (GROUPS as f64 / (GROUPS - 1) as f64);
        let of_picture = scaled_inverse(&view.information)?.fixed_view::<3, 3>(3, 3).into_owned();
        let turn = view.camera_from_board.rotation.to_rotation_matrix();
        let expected = turn.matrix() * (of_numbers + of_picture) * turn.matrix().transpose();
        square += (turn * off).xy().norm_squared() - expected[(0, 0)] - expected[(1, 1)];
        count += 2.0;
    }
    // The stated repeatability of a robot is three standard deviations.
    Some((square / f64::max(count, 1.0)).max(0.0).sqrt().max(REPEAT_MM / 3.0))
}

/// A picture's number, and the error with which the other pictures predict its board, in the board's frame, mm.
type LeftOutError = (usize, Vector3<f64>);

fn rms_mm(left_out: &[LeftOutError]) -> f64 {
    let square: f64 = left_out.iter().map(|(_, off)| off.norm_squared()).sum();
    (square / left_out.len().max(1) as f64).sqrt()
}

fn first_touch(data: &RobotData, spot: usize) -> Vector3<f64> {
    let first = data.touches.iter().find(|touch| touch.target == TouchTarget::Spot(spot));
    first.map_or(Vector3::zeros(), |touch| touch.pose.base_from_flange.origin().mm.coords)
}

/// Predicts each picture from the pictures of the other groups and returns the errors.
fn cross_validate(state: &State, data: &RobotData) -> Option<Vec<LeftOutError>> {
    let mut all = Vec::new();
    for group in 0..GROUPS {
        let (left_out, kept): (Vec<_>, Vec<_>) =
            data.views.iter().enumerate().partition(|(index, _)| index % GROUPS == group);
        let kept: Vec<&ArmView> = kept.into_iter().map(|(_, view)| view).collect();
        let settled = levenberg_marquardt(state.clone(), &kept, &data.touches)?;
        for (index, view) in left_out {
            let off = view.camera_from_board.inverse() * settled.state.predict_board_pose(view.rig, &view.pose)?;
            all.push((index, off.translation.vector));
        }
    }
    Some(all)
}
