//! The arm's own errors, from pictures of boards and from touches, together with camera mounts, boards and tool tip.
//!
//! Unknown are the arm's numbers p (of `arm_errors`, or of a smooth correction where no axis angles are known), the mount
//! and the board of each rig, the tip and the spots that it touched. A picture gives the board's pose before the camera; with
//! the residual twists r of pictures and vectors of touches, each divided by its deviation,
//!     Σ r² + Σ (p / usual size)²                                                                                  (1)
//! is least. The second sum is what is known of any arm: a number that the data do not tell stays at its drawing's. How
//! well it is told is its deviation after by that before. The scatter is taken from the residuals themselves.
//!
//! What counts is judged on pictures that were left out: the same with and without p.

use super::adjust::scaled_inverse;
use super::arm_errors::ARM_NUMBERS;
use super::arrangement::{Twist, exp, log};
use super::chain::Seen;
use super::detect::Corners;
use super::error::CalibError;
use super::lens_gram::LensGram;
use super::pose::board_pose;
use super::robot_axes::wrong_axes;
pub use super::robot_correction::{Correction, SMOOTH_NUMBERS};
use crate::cell::ArmGeometry;
use crate::geometry::{Base, Camera, Flange, Joints, PinholeCamera, Point, Rigid};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Vector3};

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
        let unsettled = || CalibError::NotSettled { what: "the board's pose" };
        let gram = LensGram::of(camera, corners, &found.camera_from_board).ok_or_else(unsettled)?;
        let of_corners = scaled_inverse(&gram.pose).ok_or_else(unsettled)? * found.rms.max(LEAST_PX).powi(2);
        let far_mm = found.camera_from_board.origin().mm.coords.norm();
        let (turn, shift) = (REPEAT_RAD.powi(2), REPEAT_MM.powi(2) + (far_mm * REPEAT_RAD).powi(2));
        let of_robot = Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift));
        let information = scaled_inverse(&(of_corners + of_robot)).ok_or_else(unsettled)?;
        let camera_from_board = *found.camera_from_board.isometry();
        Ok(ArmView { name, rig, pose, camera_from_board, information })
    }
}

/// A touch: the tool's tip at a spot.
#[derive(Debug, Clone)]
pub struct ArmTouch {
    /// The spot's number; touches of one spot share it.
    pub spot: usize,
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
    state: State,
    covariance: DMatrix<f64>,
}

impl RobotFound {
    /// How far off the corrected tip may be at a pose, 95 %, mm: beside the scatter of a single pose.
    pub fn tip_uncertainty_mm(&self, pose: &ArmPose) -> Option<f64> {
        let place = |state: &State| {
            let tip = Point::<Flange>::new(state.tip.into());
            Some((state.correction.base_from_flange(pose)? * tip).mm.coords)
        };
        let middle = place(&self.state)?;
        let mut slope = DMatrix::zeros(3, self.covariance.nrows());
        for column in 0..self.covariance.nrows() {
            let step = self.covariance[(column, column)].sqrt().max(1e-12);
            let mut change = DVector::zeros(self.covariance.nrows());
            change[column] = step;
            slope.set_column(column, &((place(&self.state.moved(&change))? - middle) / step));
        }
        let spread = &slope * &self.covariance * slope.transpose();
        let largest = spread.symmetric_eigenvalues().max();
        // χ² of three numbers.
        Some((7.815 * largest.max(0.0)).sqrt())
    }
}

#[derive(Debug, Clone)]
struct State {
    correction: Correction,
    corrects: bool,
    rigs: Vec<Rig>,
    tip: Vector3<f64>,
    spots: Vec<Vector3<f64>>,
}

/// Deviation of one touch, mm.
const TOUCH_MM: f64 = 0.1;
const MAX_STEPS: usize = 40;
/// Fewer pictures than this estimate no arm.
pub const MIN_VIEWS: usize = 12;
const GROUPS: usize = 5;

impl State {
    fn count(&self) -> usize {
        self.own() + 12 * self.rigs.len() + if self.spots.is_empty() { 0 } else { 3 + 3 * self.spots.len() }
    }

    /// How many numbers of the correction are free.
    fn own(&self) -> usize {
        if self.corrects { self.correction.numbers().len() } else { 0 }
    }

    fn moved(&self, step: &DVector<f64>) -> State {
        let mut next = self.clone();
        let own = self.own();
        if self.corrects {
            let numbers: Vec<f64> = self.correction.numbers().iter().zip(step.iter()).map(|(n, s)| n + s).collect();
            next.correction = self.correction.with_numbers(&numbers);
        }
        for (index, rig) in next.rigs.iter_mut().enumerate() {
            let twist = |at: usize| Twist::from_iterator(step.rows(own + 12 * index + at, 6).iter().copied());
            rig.mount *= exp(&twist(0));
            rig.board *= exp(&twist(6));
        }
        if !self.spots.is_empty() {
            let at = own + 12 * self.rigs.len();
            let vector = |at: usize| Vector3::from_iterator(step.rows(at, 3).iter().copied());
            next.tip += vector(at);
            next.spots.iter_mut().enumerate().for_each(|(index, spot)| *spot += vector(at + 3 + 3 * index));
        }
        next
    }

    /// Where a picture should show the board.
    fn foretold(&self, view: &ArmView) -> Option<Isometry3<f64>> {
        let flange = *self.correction.base_from_flange(&view.pose)?.isometry();
        let rig = &self.rigs[view.rig];
        Some(match rig.kind {
            RigKind::EyeToHand => rig.mount.inverse() * flange * rig.board,
            RigKind::EyeInHand => (flange * rig.mount).inverse() * rig.board,
        })
    }

    /// The residuals, each divided by its deviation.
    fn residuals(&self, views: &[&ArmView], roots: &[Matrix6<f64>], touches: &[ArmTouch]) -> Option<DVector<f64>> {
        let mut all = Vec::with_capacity(6 * views.len() + 3 * touches.len());
        for (view, root) in views.iter().zip(roots) {
            let twist = root * log(&(view.camera_from_board.inverse() * self.foretold(view)?));
            all.extend(twist.iter().copied());
        }
        for touch in touches {
            let flange = *self.correction.base_from_flange(&touch.pose)?.isometry();
            let off = ((flange * nalgebra::Point3::from(self.tip)).coords - self.spots[touch.spot]) / TOUCH_MM;
            all.extend(off.iter().copied());
        }
        Some(DVector::from_vec(all))
    }
}

/// A settled state, with the covariance of its unknowns.
struct Settled {
    state: State,
    inverse: DMatrix<f64>,
}

/// Levenberg–Marquardt on (1).
fn settle(start: State, views: &[&ArmView], touches: &[ArmTouch]) -> Option<Settled> {
    let roots: Vec<Matrix6<f64>> =
        views.iter().map(|view| Some(view.information.cholesky()?.l().transpose())).collect::<Option<_>>()?;
    let usual = start.correction.usual();
    let mut state = start;
    let mut variance = 1.0;
    let mut damping = 1e-6;
    let cost = |state: &State, residual: &DVector<f64>, variance: f64| {
        let prior = state.correction.numbers().iter().zip(&usual).map(|(n, u)| (n / u).powi(2)).sum::<f64>();
        residual.norm_squared() / variance + if state.corrects { prior } else { 0.0 }
    };
    for _ in 0..MAX_STEPS {
        let residual = state.residuals(views, &roots, touches)?;
        let slope = slope(&state, views, &roots, touches)?;
        let mut normal = slope.transpose() * &slope / variance;
        let mut pull = -(slope.transpose() * &residual) / variance;
        for (index, (number, usual)) in state.correction.numbers().iter().zip(&usual).enumerate().take(state.own())
        {
            normal[(index, index)] += usual.powi(-2);
            pull[index] -= number / usual.powi(2);
        }
        let undamped = normal.clone();
        (0..normal.nrows()).for_each(|at| normal[(at, at)] *= 1.0 + damping);
        let step = scaled_inverse(&normal)? * &pull;
        let next = state.moved(&step);
        let there = next.residuals(views, &roots, touches)?;
        let (before, after) = (cost(&state, &residual, variance), cost(&next, &there, variance));
        if after > before * (1.0 + 1e-12) {
            damping = (damping * 100.0).max(1e-6);
            if damping > 1e9 {
                return None;
            }
            continue;
        }
        damping *= 0.1;
        state = next;
        let inverse = scaled_inverse(&undamped)?;
        // The numbers that the data tell, of those that are free.
        let told: f64 =
            state.count() as f64 - (0..state.own()).map(|at| inverse[(at, at)] / usual[at].powi(2)).sum::<f64>();
        let redundancy = (there.len() as f64 - told).max(1.0);
        let new = (there.norm_squared() / redundancy).max(1.0);
        let steady = (new / variance - 1.0).abs() < 1e-3;
        variance = new;
        if steady && before - after < 1e-9 * before.max(1e-9) {
            return Some(Settled { state, inverse });
        }
    }
    let residual = state.residuals(views, &roots, touches)?;
    let slope = slope(&state, views, &roots, touches)?;
    let mut normal = slope.transpose() * &slope / variance;
    usual.iter().enumerate().take(state.own()).for_each(|(index, usual)| normal[(index, index)] += usual.powi(-2));
    residual.iter().all(|number| number.is_finite()).then_some(())?;
    Some(Settled { inverse: scaled_inverse(&normal)?, state })
}

fn slope(state: &State, views: &[&ArmView], roots: &[Matrix6<f64>], touches: &[ArmTouch]) -> Option<DMatrix<f64>> {
    let usual = state.correction.usual();
    let columns = (0..state.count()).map(|column| {
        let step = if column < state.own() { 1e-2 * usual[column] } else { 1e-6 };
        let mut change = DVector::zeros(state.count());
        change[column] = step;
        let ahead = state.moved(&change).residuals(views, roots, touches)?;
        change[column] = -step;
        let behind = state.moved(&change).residuals(views, roots, touches)?;
        Some((ahead - behind) / (2.0 * step))
    });
    let columns: Vec<DVector<f64>> = columns.collect::<Option<_>>()?;
    Some(DMatrix::from_columns(&columns))
}

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
    let spots = data.touches.iter().map(|touch| touch.spot + 1).max().unwrap_or(0);
    let start = State {
        correction: nominal(data),
        corrects: false,
        rigs: data.rigs.clone(),
        tip: Vector3::new(0.0, 0.0, 100.0),
        spots: (0..spots).map(|spot| first_touch(data, spot)).collect(),
    };
    let plain = settle(start, &views, &data.touches).ok_or_else(unsettled)?;
    let free = State { corrects: true, ..plain.state.clone() };
    let full = settle(free.clone(), &views, &data.touches).ok_or_else(unsettled)?;
    let before = left_out_mm(&plain.state, data).ok_or_else(unsettled)?;
    let after = left_out_mm(&full.state, data).ok_or_else(unsettled)?;
    let usual = full.state.correction.usual();
    let numbers = full.state.correction.numbers().iter().enumerate().map(|(index, value)| {
        let (name, unit) = full.state.correction.name(index);
        let deviation = full.inverse[(index, index)].sqrt();
        Number { name, value: value * unit, uncertainty: 1.96 * deviation * unit, untold: deviation / usual[index] }
    });
    Ok(RobotFound {
        numbers: numbers.collect(),
        correction: full.state.correction.clone(),
        rigs: full.state.rigs.clone(),
        tip_mm: (spots > 0).then_some(full.state.tip),
        left_out_before_mm: before,
        left_out_after_mm: after,
        covariance: full.inverse,
        state: full.state,
    })
}

fn first_touch(data: &RobotData, spot: usize) -> Vector3<f64> {
    let first = data.touches.iter().find(|touch| touch.spot == spot);
    first.map_or(Vector3::zeros(), |touch| touch.pose.base_from_flange.origin().mm.coords)
}

/// Each picture held against the others.
fn left_out_mm(state: &State, data: &RobotData) -> Option<f64> {
    let (mut square, mut count) = (0.0, 0.0);
    for group in 0..GROUPS {
        let (left_out, kept): (Vec<_>, Vec<_>) =
            data.views.iter().enumerate().partition(|(index, _)| index % GROUPS == group);
        let kept: Vec<&ArmView> = kept.into_iter().map(|(_, view)| view).collect();
        let settled = settle(state.clone(), &kept, &data.touches)?;
        for (_, view) in left_out {
            let off = view.camera_from_board.inverse() * settled.state.foretold(view)?;
            square += off.translation.vector.norm_squared();
            count += 1.0;
        }
    }
    Some(f64::sqrt(square / count))
}
