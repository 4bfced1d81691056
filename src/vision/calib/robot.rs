//! Estimates the errors of an arm from pictures of boards and from touches, together with camera mounts, boards and
//! tool tip.
//!
//! The unknowns are the arm's parameters p (of `arm_errors`, or of a smooth correction if no axis angles are known),
//! the mount and the board of each rig, the tip and the spots that it touched. A picture gives the pose of the board in
//! the camera frame. The sum to be minimised is
//!     Σ r² + Σ (p / usual size)²                                                                                  (1)
//! with the residuals r, each divided by its standard deviation: residual twists of pictures, and residual vectors of
//! touches. The second sum is prior knowledge of any arm: a parameter that the data do not determine keeps its nominal
//! value. The ratio of its standard deviation after the estimate to that before states how well the parameter is
//! determined. The scatter is estimated from the residuals, and the size of the prior from the arm's parameters.
//!
//! The result is judged by cross-validation on pictures that were left out, with and without p. It states the
//! uncertainty of the corrected arm anywhere in its volume. Wrong axis angles in the file are detected first: two axes
//! are exchanged, one axis has the wrong sign, or the angles are those of another arm.

use super::adjust::scaled_inverse;
use super::arm_errors;
use super::arm_errors::{ARM_PARAMETER_COUNT, AxisFault};
pub use super::arm_errors::{ArmPose, Correction, SMOOTH_PARAMETER_COUNT};
use super::error::CalibError;
use super::quantile::radius_95;
pub use super::robot_settle::{ArmTouch, ArmView, Rig, RigKind, RobotData, TouchTarget};
use super::robot_settle::{ConvergedState, REPEATABILITY_MM, State, levenberg_marquardt};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};
use panelprep_base::geometry::statistics::{NORMAL_TWO_SIDED_95, mean};
use panelprep_base::geometry::{Base, Flange, Joints, Point, Rigid};
use panelprep_base::number_text::distinguishable_texts;

/// Minimum number of pictures from which the errors of an arm are estimated.
pub const MIN_VIEWS: usize = 12;
/// Number of iterations in which the size of the arm's parameters is estimated.
const SCALE_ITERATIONS: usize = 3;
/// Number of groups for the cross-validation; one group of pictures at a time is left out.
const GROUPS: usize = 5;

/// Returns the initial correction: geometric if every pose has its axis angles, otherwise smooth over the measured
/// volume.
fn initial_correction(data: &RobotData) -> Correction {
    let poses = || data.views.iter().map(|view| &view.pose).chain(data.touches.iter().map(|touch| &touch.pose));
    if poses().all(|pose| pose.joints.is_some()) {
        return Correction::Geometry { geometry: data.geometry, errors: [0.0; ARM_PARAMETER_COUNT] };
    }
    let along = |axis: usize| poses().map(move |pose| pose.base_from_flange.origin().mm[axis]);
    let low: [f64; 3] = std::array::from_fn(|axis| along(axis).fold(f64::INFINITY, f64::min));
    let high: [f64; 3] = std::array::from_fn(|axis| along(axis).fold(f64::NEG_INFINITY, f64::max));
    Correction::Smooth {
        middle_mm: std::array::from_fn(|axis| (low[axis] + high[axis]) / 2.0),
        half_mm: std::array::from_fn(|axis| ((high[axis] - low[axis]) / 2.0).max(50.0)),
        numbers: [0.0; SMOOTH_PARAMETER_COUNT],
    }
}

/// Estimates the errors of the arm.
///
/// # Errors
/// If there are too few pictures, the axis angles contradict the pictures or the poses of the controller, the touches
/// do not determine the tip, or the iteration does not converge.
pub fn calibrate(data: &RobotData) -> Result<RobotFound, CalibError> {
    let unsettled = || CalibError::NotSettled { what: "the adjustment of the arm" };
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
        correction: initial_correction(data),
        corrects: false,
        size: 1.0,
        rigs: data.rigs.clone(),
        touches: !data.touches.is_empty(),
        tip: Vector3::new(0.0, 0.0, 100.0),
        spots: (0..spots).map(|spot| first_touch(data, spot)).collect(),
    };
    // The first minimisation is without a correction: it gives the start values, and the residuals for the comparison
    // that shows whether the correction helps.
    let plain = levenberg_marquardt(start, &views, &data.touches).ok_or_else(unsettled)?;
    let free = State { corrects: true, ..plain.state.clone() };
    let mut full = levenberg_marquardt(free, &views, &data.touches).ok_or_else(unsettled)?;
    // The size of the errors of this arm is not known beforehand; a prior for a good arm would hide the errors of a bad
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
        EstimatedParameter {
            name,
            value: value * unit,
            uncertainty: NORMAL_TWO_SIDED_95 * deviation * unit,
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

/// Returns the problem of the touches: a target that cannot be touched, or touches that do not determine the tip.
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
    // The unknown position of each spot uses up one touch, and the tip needs two.
    let (touch_count, needed) = (data.touches.len(), free.len() + 2);
    (touch_count > 0 && touch_count < needed).then(|| {
        format!(
            "{touch_count} touches do not determine the tip (at least {needed} touches are needed): touch each spot \
             several times, each time with another orientation of the tool"
        )
    })
}

/// Returns the cross-validation residual for each axis of the view, without the noise of the pictures and the
/// uncertainty of the arm's parameters, mm. If there are pictures of a fixed camera, only they are used: the board on
/// the flange is about as far from the flange as a tool.
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
        let of_numbers = position_covariance(full, &place)? * (GROUPS as f64 / (GROUPS - 1) as f64);
        let of_picture = scaled_inverse(&view.information)?.fixed_view::<3, 3>(3, 3).into_owned();
        let turn = view.camera_from_board.rotation.to_rotation_matrix();
        let expected = turn.matrix() * (of_numbers + of_picture) * turn.matrix().transpose();
        square += (turn * off).xy().norm_squared() - expected[(0, 0)] - expected[(1, 1)];
        count += 2.0;
    }
    // The repeatability in the data sheet of a robot is three standard deviations.
    Some((square / f64::max(count, 1.0)).max(0.0).sqrt().max(REPEATABILITY_MM / 3.0))
}

/// Index of a picture, and the error of the board position predicted from the other pictures, in the board frame, mm.
type LeftOutError = (usize, Vector3<f64>);

fn rms_mm(left_out: &[LeftOutError]) -> f64 {
    mean(left_out.iter().map(|(_, off)| off.norm_squared())).map_or(0.0, f64::sqrt)
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

/// An estimated parameter of the correction.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedParameter {
    /// Name of the parameter, with its unit.
    pub name: String,
    /// Value of the parameter.
    pub value: f64,
    /// Uncertainty of the parameter, 95 %.
    pub uncertainty: f64,
    /// Ratio of the parameter's standard deviation after the estimate to that before: 1 if the data contain no
    /// information, 0 if they determine the parameter completely.
    pub remaining_share: f64,
}

/// The estimated errors of an arm with the evidence for them.
#[derive(Debug, Clone)]
pub struct RobotFound {
    /// The correction of the flange pose.
    pub correction: Correction,
    /// The parameters of the correction, with their uncertainties.
    pub numbers: Vec<EstimatedParameter>,
    /// The rigs, calculated with the correction.
    pub rigs: Vec<Rig>,
    /// The tip in the flange frame, if there were touches, mm.
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
    /// Residual of a single pose along each axis that no parameter of the arm explains, mm.
    pub(super) scatter_mm: f64,
}

/// Returns the derivative of a position, in mm, with respect to each unknown; `None` if the position cannot be
/// computed.
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
fn position_covariance(
    settled: &ConvergedState,
    place: &dyn Fn(&State) -> Option<Vector3<f64>>,
) -> Option<Matrix3<f64>> {
    let slope = position_jacobian(&settled.state, &settled.inverse, place)?;
    let spread = &slope * &settled.inverse * slope.transpose();
    Some(spread.fixed_view::<3, 3>(0, 0).into_owned())
}

impl State {
    /// Returns the tip at a pose: in the frame of the fixed camera if there is one, otherwise in the base frame. The
    /// error is evaluated relative to the camera, because the tip must reach the position that the camera sees.
    pub(super) fn tip_position(&self, pose: &ArmPose) -> Option<Vector3<f64>> {
        let tip = self.correction.base_from_flange(pose)? * Point::<Flange>::new(self.tip.into());
        let fixed = self.rigs.iter().find(|rig| rig.kind == RigKind::EyeToHand);
        let camera_from_base = fixed.map_or_else(Isometry3::identity, |rig| rig.mount.inverse());
        Some((camera_from_base * tip.mm).coords)
    }
}

impl RobotFound {
    /// Returns the uncertainty of the position of the corrected tip at a pose, relative to the fixed camera (without
    /// one, to the base), 95 %, mm. The scatter of left-out pictures is included. `None` if the correction needs axis
    /// angles and there are none.
    pub fn tip_uncertainty_mm(&self, pose: &ArmPose) -> Option<f64> {
        let slope = position_jacobian(&self.state, &self.covariance, &|state| state.tip_position(pose))?;
        Some(self.radius_mm(&(&slope * &self.covariance * slope.transpose())))
    }

    pub(super) fn radius_mm(&self, spread: &DMatrix<f64>) -> f64 {
        let of_numbers = spread.fixed_view::<3, 3>(0, 0).into_owned();
        radius_95(&(of_numbers + Matrix3::identity() * self.scatter_mm.powi(2)), 1e5)
    }

    /// Returns the tip in the flange frame without a correction, if there were touches, mm.
    pub fn uncorrected_tip_mm(&self) -> Option<Vector3<f64>> {
        self.uncorrected.touches.then_some(self.uncorrected.tip)
    }

    /// Returns the rigs, calculated without a correction.
    pub fn uncorrected_rigs(&self) -> &[Rig] {
        &self.uncorrected.rigs
    }
}

/// Maximum difference between the pose by the axis angles and the controller's pose, if both belong to one robot:
/// position (`MAX_POSITION_DIFFERENCE_MM`) and rotation (`MAX_ROTATION_DIFFERENCE_DEG`).
const MAX_POSITION_DIFFERENCE_MM: f64 = 5.0;
const MAX_ROTATION_DIFFERENCE_DEG: f64 = 1.0;
/// Maximum difference between the rotation angles of board and flange from picture to picture, degrees rms.
const MAX_SCREW_ANGLE_DIFFERENCE_DEG: f64 = 0.7;
/// Maximum difference between the shifts of board and flange along the rotation axis, mm rms.
const MAX_SCREW_SHIFT_DIFFERENCE_MM: f64 = 5.0;
/// Minimum and maximum angle of a rotation with a well-defined axis.
const AXIS_ROTATION_RANGE_DEG: (f64, f64) = (5.0, 170.0);

/// Checks whether the axis angles agree with the controller's poses and the pictures. If not, returns the error of the
/// angles that explains the difference.
fn axis_angle_problem(data: &RobotData) -> Option<String> {
    if data.views.iter().all(|view| view.pose.joints.is_none()) {
        return None;
    }
    let drawn = |joints: &Joints| arm_errors::base_from_flange(&data.geometry, joints, &[0.0; ARM_PARAMETER_COUNT]);
    let poses = || data.views.iter().filter_map(|view| Some((&view.pose, view.pose.joints.as_ref()?)));
    let misfit = |mend: &dyn Fn(&Joints) -> Joints| -> (f64, f64) {
        poses().fold((0.0, 0.0), |(mm, deg), (pose, joints)| {
            let off = pose.base_from_flange.inverse() * drawn(&mend(joints));
            (f64::max(mm, off.origin().mm.coords.norm()), f64::max(deg, off.rotation_angle().0))
        })
    };
    let screws = |mend: &dyn Fn(&Joints) -> Joints| screw_misfit(data, &|joints| drawn(&mend(joints)));
    let fits = |(deg, mm): (f64, f64)| deg <= MAX_SCREW_ANGLE_DIFFERENCE_DEG && mm <= MAX_SCREW_SHIFT_DIFFERENCE_MM;
    let agrees = |mend: &dyn Fn(&Joints) -> Joints| {
        let (mm, deg) = misfit(mend);
        mm <= MAX_POSITION_DIFFERENCE_MM && deg <= MAX_ROTATION_DIFFERENCE_DEG
    };
    let is_stated = poses().any(|(pose, joints)| {
        let off = pose.base_from_flange.inverse() * drawn(joints);
        off.origin().mm.coords.norm() > 1e-6 || off.rotation_angle().0 > 1e-6
    });
    let same = |joints: &Joints| *joints;
    let ((mm, deg), (turn_deg, shift_mm)) = (misfit(&same), screws(&same));
    if agrees(&same) && fits((turn_deg, shift_mm)) {
        return None;
    }
    let fault = AxisFault::all().into_iter().find(|fault| {
        let mend = |joints: &Joints| fault.correct_angles(joints);
        fits(screws(&mend)) && (!is_stated || agrees(&mend))
    });
    let why = match fault {
        Some(fault) => format!("{fault} in the file; after this correction all data agree"),
        None => {
            "no exchange of two axes and no wrong sign explains this; check that [arm] has the lengths of this \
             arm, and that the poses are those of the flange at these pictures, without a tool or a base"
                .to_owned()
        }
    };
    let ([mm, most_mm], [deg, most_deg]) = (
        distinguishable_texts(mm, MAX_POSITION_DIFFERENCE_MM, 1),
        distinguishable_texts(deg, MAX_ROTATION_DIFFERENCE_DEG, 1),
    );
    let [turn, most_turn] = distinguishable_texts(turn_deg, MAX_SCREW_ANGLE_DIFFERENCE_DEG, 1);
    let [shift, most_shift] = distinguishable_texts(shift_mm, MAX_SCREW_SHIFT_DIFFERENCE_MM, 1);
    Some(format!(
        "axis angles and base_from_flange differ by up to {mm} mm and {deg}° (limits {most_mm} mm and \
         {most_deg}°); between pictures, the motions of the board and of the flange by its axis angles differ by \
         {turn}° and {shift} mm rms (limits {most_turn}° and {most_shift} mm); {why}"
    ))
}

/// Returns the rms difference between the motions of a board and of the flange from picture to picture: the rotation
/// angle, degrees, and the shift along the rotation axis, mm. Both are the same for a screw motion from every
/// viewpoint, so neither mount nor board pose is needed.
fn screw_misfit(data: &RobotData, flange: &dyn Fn(&Joints) -> Rigid<Base, Flange>) -> (f64, f64) {
    let (mut turns, mut shifts, mut count) = (0.0, 0.0, 0.0_f64);
    for (rig, kind) in data.rigs.iter().map(|rig| rig.kind).enumerate() {
        let views: Vec<&ArmView> = data.views.iter().filter(|view| view.rig == rig).collect();
        for (one, two) in views.iter().zip(views.iter().skip(1)) {
            let (Some(from), Some(to)) = (&one.pose.joints, &two.pose.joints) else { continue };
            let moved = *(flange(from).inverse() * flange(to)).isometry();
            let (from, to) = (one.camera_from_board, two.camera_from_board);
            let seen = match kind {
                RigKind::EyeToHand => from.inverse() * to,
                RigKind::EyeInHand => from * to.inverse(),
            };
            let screw = |motion: &Isometry3<f64>| {
                let along = motion.rotation.axis().map_or(0.0, |axis| motion.translation.vector.dot(&axis));
                (motion.rotation.angle().to_degrees(), along)
            };
            let ((moved_deg, moved_mm), (seen_deg, seen_mm)) = (screw(&moved), screw(&seen));
            turns += (moved_deg - seen_deg).powi(2);
            // The axis of a small rotation is poorly determined, and the axis of a rotation by 180° has no sign.
            let has_axis = |deg: &f64| (AXIS_ROTATION_RANGE_DEG.0..AXIS_ROTATION_RANGE_DEG.1).contains(deg);
            let is_screw = has_axis(&moved_deg) && has_axis(&seen_deg);
            shifts += if is_screw { (moved_mm - seen_mm).powi(2) } else { 0.0 };
            count += 1.0;
        }
    }
    ((turns / count.max(1.0)).sqrt(), (shifts / count.max(1.0)).sqrt())
}
