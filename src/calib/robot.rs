//! The arm's own errors, from pictures of boards and from touches, together with camera mounts, boards and tool tip.
//!
//! Unknown are the arm's numbers p (of `arm_errors`, or of a smooth correction where no axis angles are known), the mount
//! and the board of each rig, the tip and the spots that it touched. A picture gives the board's pose before the camera; with
//! the residual twists r of pictures and vectors of touches, each divided by its deviation,
//!     Σ r² + Σ (p / usual size)²                                                                                  (1)
//! is least. The second sum is what is known of any arm: a number that the data do not tell stays at its drawing's. How
//! well it is told is its deviation after by that before. The scatter is taken from the residuals themselves, and how far this
//! arm is from the usual one from its numbers.
//!
//! What counts is judged on pictures that were left out: the same with and without p.

use super::adjust::scaled_inverse;
use super::arm_errors::ARM_NUMBERS;
use super::arrangement::Twist;
use super::chain::Seen;
use super::detect::Corners;
use super::error::CalibError;
use super::lens_gram::LensGram;
use super::pose::board_pose;
use super::robot_axes::wrong_axes;
pub use super::robot_correction::{Correction, SMOOTH_NUMBERS};
use super::robot_settle::{Settled, State, settle};
use super::robot_spread::spread;
use crate::cell::ArmGeometry;
use crate::geometry::{Base, Board, Camera, Flange, Joints, PinholeCamera, Point, Rigid};
use nalgebra::{DMatrix, Isometry3, Matrix6, Vector3};

/// Which of camera and board moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RigKind {
    /// The camera stands, the board is on the flange.
    EyeToHand,
    /// The camera is on the flange, the board stands.
    EyeInHand,
}

/// A camera with the board that it looks at, and where both are about.
#[derive(Debug, Clone)]
pub struct Rig {
    /// Which moves.
    pub kind: RigKind,
    /// Where the camera sits: on the base, or on the flange.
    pub mount: Isometry3<f64>,
    /// Where the board sits: on the flange, or on the base.
    pub board: Isometry3<f64>,
}

/// Where the robot was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPose {
    /// The axes, where they are known.
    pub joints: Option<Joints>,
    /// The flange by the controller.
    pub base_from_flange: Rigid<Base, Flange>,
}

/// A picture.
#[derive(Debug, Clone)]
pub struct ArmView {
    /// Its name in messages.
    pub name: String,
    /// Which rig took it.
    pub rig: usize,
    /// Where the robot was.
    pub pose: ArmPose,
    /// Where it shows the board.
    pub camera_from_board: Isometry3<f64>,
    /// The information of that pose: the inverse of its covariance, in rad and mm.
    pub information: Matrix6<f64>,
    /// How far off its corners are, rms, px.
    pub rms_px: f64,
}

/// The robot comes back to a pose to so many mm, and degrees in rad.
const REPEAT_MM: f64 = 0.03;
const REPEAT_RAD: f64 = 5e-5;
/// Corners are never better than so many px.
const LEAST_PX: f64 = 0.02;

impl ArmView {
    /// From the corners that a picture shows.
    ///
    /// # Errors
    /// Where they determine no pose.
    pub fn seen(
        name: String,
        rig: usize,
        pose: ArmPose,
        camera: &PinholeCamera,
        corners: &Corners,
    ) -> Result<Self, CalibError> {
        let found = board_pose::<Camera>(camera, &Seen::Pixels(corners.clone()))?;
        let unsettled = CalibError::NotSettled { what: "the board's pose" };
        let information = information(camera, corners, &found.camera_from_board, found.rms).ok_or(unsettled)?;
        let camera_from_board = *found.camera_from_board.isometry();
        Ok(ArmView { name, rig, pose, camera_from_board, information, rms_px: found.rms })
    }
}

/// The information of the board's pose in a picture whose corners are this far off.
pub(super) fn information(
    camera: &PinholeCamera,
    corners: &Corners,
    camera_from_board: &Rigid<Camera, Board>,
    rms_px: f64,
) -> Option<Matrix6<f64>> {
    let gram = LensGram::of(camera, corners, camera_from_board)?;
    let of_corners = scaled_inverse(&gram.pose)? * rms_px.max(LEAST_PX).powi(2);
    let far_mm = camera_from_board.origin().mm.coords.norm();
    let (turn, shift) = (REPEAT_RAD.powi(2), REPEAT_MM.powi(2) + (far_mm * REPEAT_RAD).powi(2));
    let of_robot = Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift));
    scaled_inverse(&(of_corners + of_robot))
}

/// What the tip touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Touched {
    /// A spot by its number, which stands still and is not known; touches of one spot share it.
    Spot(usize),
    /// A corner of the board that stands still before the camera on the flange.
    Corner {
        /// The rig of that board.
        rig: usize,
        /// The corner.
        place: Point<Board>,
    },
    /// A place that the fixed camera sees.
    Seen {
        /// The rig of that camera.
        rig: usize,
        /// The place.
        place: Point<Camera>,
    },
}

/// A touch of the tool's tip.
#[derive(Debug, Clone)]
pub struct ArmTouch {
    /// What it touches.
    pub at: Touched,
    /// Where the robot was.
    pub pose: ArmPose,
}

/// What is measured.
#[derive(Debug, Clone)]
pub struct RobotData {
    /// The arm, as drawn.
    pub geometry: ArmGeometry,
    /// The rigs.
    pub rigs: Vec<Rig>,
    /// The pictures.
    pub views: Vec<ArmView>,
    /// The touches.
    pub touches: Vec<ArmTouch>,
}

/// One number of the correction.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    /// What it is, with its unit.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// How far off it may be, 95 %.
    pub uncertainty: f64,
    /// Its deviation after by that before: 1 where the data say nothing, 0 where they say all.
    pub untold: f64,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct RobotFound {
    /// The correction.
    pub correction: Correction,
    /// Its numbers.
    pub numbers: Vec<Number>,
    /// The rigs as they come out with it.
    pub rigs: Vec<Rig>,
    /// The tip on the flange, where there were touches, mm.
    pub tip_mm: Option<Vector3<f64>>,
    /// How far pictures that were left out put the board from where it should be, rms, mm: with mounts and boards alone.
    pub left_out_before_mm: f64,
    /// The same with the correction.
    pub left_out_after_mm: f64,
    pub(super) plain: State,
    pub(super) state: State,
    pub(super) covariance: DMatrix<f64>,
    pub(super) variance: f64,
    /// What is left of a single pose that no number of the arm tells, each way, mm.
    pub(super) scatter_mm: f64,
}

/// Fewer pictures than this estimate no arm.
pub const MIN_VIEWS: usize = 12;
/// How often it is asked how large this arm's numbers are.
const SIZINGS: usize = 3;
/// Pictures are left out in so many groups.
pub(super) const GROUPS: usize = 5;

/// The correction to begin with: geometry where every pose has its axis angles, else smooth over the measured volume.
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

/// Estimates the arm.
///
/// # Errors
/// Where there are too few pictures, axis angles contradict the pictures or the controller's poses, or nothing settles.
pub fn calibrate(data: &RobotData) -> Result<RobotFound, CalibError> {
    let unsettled = || CalibError::NotSettled { what: "the arm" };
    if data.views.len() < MIN_VIEWS {
        let message = format!("{} pictures show the board, {MIN_VIEWS} are needed for an arm", data.views.len());
        return Err(CalibError::Points(message));
    }
    if let Some(message) = wrong_axes(data) {
        return Err(CalibError::Points(message));
    }
    let views: Vec<&ArmView> = data.views.iter().collect();
    if let Some(message) = wrong_touch(data) {
        return Err(CalibError::Points(message));
    }
    let spot_of = |touch: &ArmTouch| if let Touched::Spot(spot) = touch.at { spot + 1 } else { 0 };
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
    let plain = settle(start, &views, &data.touches).ok_or_else(unsettled)?;
    let free = State { corrects: true, ..plain.state.clone() };
    let mut full = settle(free, &views, &data.touches).ok_or_else(unsettled)?;
    for _ in 0..SIZINGS {
        let resized = State { size: full.size(), ..full.state };
        full = settle(resized, &views, &data.touches).ok_or_else(unsettled)?;
    }
    let before = left_out(&plain.state, data).ok_or_else(unsettled)?;
    let after = left_out(&full.state, data).ok_or_else(unsettled)?;
    let usual = full.state.usual();
    let numbers = full.state.correction.numbers().iter().enumerate().map(|(index, value)| {
        let (name, unit) = full.state.correction.name(index);
        let deviation = full.inverse[(index, index)].sqrt();
        Number { name, value: value * unit, uncertainty: 1.96 * deviation * unit, untold: deviation / usual[index] }
    });
    Ok(RobotFound {
        numbers: numbers.collect(),
        correction: full.state.correction.clone(),
        rigs: full.state.rigs.clone(),
        tip_mm: full.state.touches.then_some(full.state.tip),
        left_out_before_mm: rms_mm(&before),
        left_out_after_mm: rms_mm(&after),
        scatter_mm: scatter_mm(&full, data, &after).ok_or_else(unsettled)?,
        plain: plain.state,
        covariance: full.inverse,
        variance: full.variance,
        state: full.state,
    })
}

/// A touch of what cannot be touched, and touches that tell no tip.
fn wrong_touch(data: &RobotData) -> Option<String> {
    let is_other = |touch: &&ArmTouch| match touch.at {
        Touched::Spot(_) => false,
        Touched::Corner { rig, .. } => data.rigs.get(rig).is_none_or(|rig| rig.kind != RigKind::EyeInHand),
        Touched::Seen { rig, .. } => data.rigs.get(rig).is_none_or(|rig| rig.kind != RigKind::EyeToHand),
    };
    if data.touches.iter().any(|touch| is_other(&touch)) {
        return Some(
            "a corner is touched on a board that stands still, and a place that the fixed camera sees".to_owned(),
        );
    }
    let free: std::collections::BTreeSet<usize> = data
        .touches
        .iter()
        .filter_map(|touch| if let Touched::Spot(spot) = touch.at { Some(spot) } else { None })
        .collect();
    // A spot takes up one of its touches, the tip another.
    let (told, needed) = (data.touches.len(), free.len() + 2);
    (told > 0 && told < needed).then(|| {
        format!("{told} touches tell no tip, {needed} are needed: touch each spot several times, the tool turned differently")
    })
}

/// What pictures that were left out are off by, each way across the view, beyond their own noise and that of the arm's
/// numbers, mm: of the fixed camera where there is one, since the board on the flange is about as far out as a tool.
fn scatter_mm(full: &Settled, data: &RobotData, left_out: &[LeftOut]) -> Option<f64> {
    let is_fixed = |view: &ArmView| data.rigs[view.rig].kind == RigKind::EyeToHand;
    let has_fixed = data.views.iter().any(is_fixed);
    let (mut square, mut count) = (0.0, 0.0);
    for (index, off) in left_out {
        let view = &data.views[*index];
        if has_fixed && !is_fixed(view) {
            continue;
        }
        let place = |state: &State| {
            Some((view.camera_from_board.inverse() * state.foretold(view.rig, &view.pose)?).translation.vector)
        };
        let of_numbers = spread(full, &place)? * (GROUPS as f64 / (GROUPS - 1) as f64);
        let of_picture = scaled_inverse(&view.information)?.fixed_view::<3, 3>(3, 3).into_owned();
        let turn = view.camera_from_board.rotation.to_rotation_matrix();
        let expected = turn.matrix() * (of_numbers + of_picture) * turn.matrix().transpose();
        square += (turn * off).xy().norm_squared() - expected[(0, 0)] - expected[(1, 1)];
        count += 2.0;
    }
    // A robot's stated repeatability is three deviations.
    Some((square / f64::max(count, 1.0)).max(0.0).sqrt().max(REPEAT_MM / 3.0))
}

/// A picture's number, and how far off the others foretell its board, seen from the board, mm.
type LeftOut = (usize, Vector3<f64>);

fn rms_mm(left_out: &[LeftOut]) -> f64 {
    let square: f64 = left_out.iter().map(|(_, off)| off.norm_squared()).sum();
    (square / left_out.len().max(1) as f64).sqrt()
}

fn first_touch(data: &RobotData, spot: usize) -> Vector3<f64> {
    let first = data.touches.iter().find(|touch| touch.at == Touched::Spot(spot));
    first.map_or(Vector3::zeros(), |touch| touch.pose.base_from_flange.origin().mm.coords)
}

/// Each picture held against the others.
fn left_out(state: &State, data: &RobotData) -> Option<Vec<LeftOut>> {
    let mut all = Vec::new();
    for group in 0..GROUPS {
        let (left_out, kept): (Vec<_>, Vec<_>) =
            data.views.iter().enumerate().partition(|(index, _)| index % GROUPS == group);
        let kept: Vec<&ArmView> = kept.into_iter().map(|(_, view)| view).collect();
        let settled = settle(state.clone(), &kept, &data.touches)?;
        for (index, view) in left_out {
            let off = view.camera_from_board.inverse() * settled.state.foretold(view.rig, &view.pose)?;
            all.push((index, off.translation.vector));
        }
    }
    Some(all)
}
