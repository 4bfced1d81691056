//! The data for the calibration of an arm (rigs of camera and board, pictures, and touches), and the minimisation of
//! (1) of `robot` over them: Levenberg–Marquardt over the arm's parameters, mounts, boards, tip and spots.

use super::adjust::scaled_inverse;
use super::arm_errors::{ArmPose, Correction};
use super::chain::{BoardObservation, Twist, board_pose, exp_map, log};
use super::detect::Corners;
use super::error::CalibError;
use super::lens_fit::LensGram;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Vector3};
use panelprep_base::geometry::{Board, Camera, PinholeCamera, Point, Rigid};
use panelprep_cell::cell::ArmGeometry;

/// The kind of a rig: which of camera and board moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RigKind {
    /// The camera is fixed, the board is on the flange.
    EyeToHand,
    /// The camera is on the flange, the board is fixed.
    EyeInHand,
}

/// A camera with the board that it sees, and the approximate poses of both.
#[derive(Debug, Clone)]
pub struct Rig {
    /// Whether the camera or the board moves.
    pub kind: RigKind,
    /// The mount of the camera: on the base, or on the flange.
    pub mount: Isometry3<f64>,
    /// The mount of the board: on the flange, or on the base.
    pub board: Isometry3<f64>,
}

/// A picture of a board, with the pose of the arm.
#[derive(Debug, Clone)]
pub struct ArmView {
    /// Name of the picture in messages.
    pub name: String,
    /// Index of the rig that captured the picture.
    pub rig: usize,
    /// The pose of the arm at the picture.
    pub pose: ArmPose,
    /// The pose of the board in the picture.
    pub camera_from_board: Isometry3<f64>,
    /// Information of this pose: the inverse of its covariance, in rad and mm.
    pub information: Matrix6<f64>,
    /// Residual of the corners of the board, rms, px.
    pub rms_px: f64,
}

/// Repeatability of the robot, mm; `REPEATABILITY_RAD` is the repeatability of its rotation, rad.
pub(super) const REPEATABILITY_MM: f64 = 0.03;
const REPEATABILITY_RAD: f64 = 5e-5;
/// Minimum error of a corner that is assumed, px.
const MIN_CORNER_ERROR_PX: f64 = 0.02;

impl ArmView {
    /// Creates a view from the corners in a picture.
    ///
    /// # Errors
    /// If the corners determine no pose.
    pub fn from_corners(
        name: String,
        rig: usize,
        pose: ArmPose,
        camera: &PinholeCamera,
        corners: &Corners,
    ) -> Result<Self, CalibError> {
        let found = board_pose::<Camera>(camera, &BoardObservation::Pixels(corners.clone()))?;
        let unsettled = CalibError::NotSettled { what: "the computation of the board's pose" };
        let information = information(camera, corners, &found.camera_from_board, found.rms).ok_or(unsettled)?;
        let camera_from_board = *found.camera_from_board.isometry();
        Ok(ArmView { name, rig, pose, camera_from_board, information, rms_px: found.rms })
    }
}

/// Returns the information on the pose of the board from a picture with this error of its corners.
pub(super) fn information(
    camera: &PinholeCamera,
    corners: &Corners,
    camera_from_board: &Rigid<Camera, Board>,
    rms_px: f64,
) -> Option<Matrix6<f64>> {
    let gram = LensGram::compute(camera, corners, camera_from_board)?;
    let of_corners = scaled_inverse(&gram.pose)? * rms_px.max(MIN_CORNER_ERROR_PX).powi(2);
    let far_mm = camera_from_board.origin().mm.coords.norm();
    let (turn, shift) =
        (REPEATABILITY_RAD.powi(2), REPEATABILITY_MM.powi(2) + (far_mm * REPEATABILITY_RAD).powi(2));
    let of_robot = Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift));
    scaled_inverse(&(of_corners + of_robot))
}

/// The target that the tip touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TouchTarget {
    /// A fixed spot at an unknown position, by its number; all touches of one spot have the same number.
    Spot(usize),
    /// A corner of the fixed board that the camera on the flange sees.
    Corner {
        /// Index of the rig with this board.
        rig: usize,
        /// The touched corner, on the board.
        place: Point<Board>,
    },
    /// A position that the fixed camera sees.
    Seen {
        /// Index of the rig with this camera.
        rig: usize,
        /// The touched position in the camera frame.
        place: Point<Camera>,
    },
}

/// A touch of the tool's tip.
#[derive(Debug, Clone)]
pub struct ArmTouch {
    /// The touched target.
    pub target: TouchTarget,
    /// The pose of the arm at the touch.
    pub pose: ArmPose,
}

/// The measured data: pictures of boards and touches.
#[derive(Debug, Clone)]
pub struct RobotData {
    /// The nominal geometry of the arm.
    pub geometry: ArmGeometry,
    /// The rigs of camera and board.
    pub rigs: Vec<Rig>,
    /// The pictures of the boards.
    pub views: Vec<ArmView>,
    /// The touches of the tip.
    pub touches: Vec<ArmTouch>,
}

/// Standard deviation of one touch, mm.
const TOUCH_STD_MM: f64 = 0.1;
/// Standard deviation of the tip's distance from the flange, mm: the prior if touches do not determine the tip.
const TIP_PRIOR_MM: f64 = 300.0;
const MAX_STEPS: usize = 40;
/// Minimum and maximum ratio of the errors of an arm to the usual ones.
const ERROR_FACTOR_RANGE: (f64, f64) = (0.3, 4.0);

/// The parameters that are estimated, with a flag for each optional part.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub correction: Correction,
    /// Whether the parameters of the correction are free.
    pub corrects: bool,
    /// Ratio of the size of this arm's parameters to the usual size.
    pub size: f64,
    pub rigs: Vec<Rig>,
    /// Whether the tip is free.
    pub touches: bool,
    pub tip: Vector3<f64>,
    pub spots: Vec<Vector3<f64>>,
}

impl State {
    pub fn count(&self) -> usize {
        self.tip_index() + if self.touches { 3 + 3 * self.spots.len() } else { 0 }
    }

    /// Returns the index of the tip among the unknowns.
    pub fn tip_index(&self) -> usize {
        self.free_parameter_count() + 12 * self.rigs.len()
    }

    /// Returns the prior standard deviation of each parameter of the correction.
    pub fn parameter_priors(&self) -> Vec<f64> {
        self.correction.parameter_priors().into_iter().map(|usual| usual * self.size).collect()
    }

    /// Returns the number of free parameters of the correction.
    pub fn free_parameter_count(&self) -> usize {
        if self.corrects { self.correction.numbers().len() } else { 0 }
    }

    pub fn perturbed(&self, step: &DVector<f64>) -> State {
        let mut next = self.clone();
        let own = self.free_parameter_count();
        if self.corrects {
            let numbers: Vec<f64> = self.correction.numbers().iter().zip(step.iter()).map(|(n, s)| n + s).collect();
            next.correction = self.correction.with_parameters(&numbers);
        }
        for (index, rig) in next.rigs.iter_mut().enumerate() {
            let twist = |at: usize| Twist::from_iterator(step.rows(own + 12 * index + at, 6).iter().copied());
            rig.mount *= exp_map(&twist(0));
            rig.board *= exp_map(&twist(6));
        }
        if self.touches {
            let at = self.tip_index();
            let vector = |at: usize| Vector3::from_iterator(step.rows(at, 3).iter().copied());
            next.tip += vector(at);
            next.spots.iter_mut().enumerate().for_each(|(index, spot)| *spot += vector(at + 3 + 3 * index));
        }
        next
    }

    /// Predicts the pose of the board in a picture of a rig at this arm pose.
    pub fn predict_board_pose(&self, rig: usize, pose: &ArmPose) -> Option<Isometry3<f64>> {
        let flange = *self.correction.base_from_flange(pose)?.isometry();
        let rig = &self.rigs[rig];
        Some(match rig.kind {
            RigKind::EyeToHand => rig.mount.inverse() * flange * rig.board,
            RigKind::EyeInHand => (flange * rig.mount).inverse() * rig.board,
        })
    }

    /// Returns the residuals, each divided by its standard deviation.
    fn residuals(&self, views: &[&ArmView], roots: &[Matrix6<f64>], touches: &[ArmTouch]) -> Option<DVector<f64>> {
        let mut all = Vec::with_capacity(6 * views.len() + 3 * touches.len());
        for (view, root) in views.iter().zip(roots) {
            let twist =
                root * log(&(view.camera_from_board.inverse() * self.predict_board_pose(view.rig, &view.pose)?));
            all.extend(twist.iter().copied());
        }
        for touch in touches {
            let flange = *self.correction.base_from_flange(&touch.pose)?.isometry();
            let touched = match &touch.target {
                TouchTarget::Spot(spot) => self.spots[*spot],
                TouchTarget::Corner { rig, place } => (self.rigs[*rig].board * place.mm).coords,
                TouchTarget::Seen { rig, place } => (self.rigs[*rig].mount * place.mm).coords,
            };
            let off = ((flange * nalgebra::Point3::from(self.tip)).coords - touched) / TOUCH_STD_MM;
            all.extend(off.iter().copied());
        }
        Some(DVector::from_vec(all))
    }
}

/// A converged state, with the covariance of its unknowns and the ratio of the variance of the residuals to the stated
/// variance.
pub(super) struct ConvergedState {
    pub state: State,
    pub inverse: DMatrix<f64>,
    pub variance: f64,
}

impl ConvergedState {
    /// Returns the scale factor of this arm's parameters relative to their prior standard deviations: the variance
    /// component of the second sum of (1), from the parameters that the data determine (Förstner, as in `adjust`).
    pub fn size(&self) -> f64 {
        let (mut square, mut redundancy) = (0.0, 0.0);
        for (index, (number, usual)) in
            self.state.correction.numbers().iter().zip(self.state.parameter_priors()).enumerate()
        {
            square += (number / usual).powi(2);
            // A parameter that the data do not determine keeps the standard deviation of its prior and adds nothing
            // here.
            redundancy += (1.0 - self.inverse[(index, index)] / usual.powi(2)).max(0.0);
        }
        let grown = (square / f64::max(redundancy, 1.0)).sqrt();
        (self.state.size * grown).clamp(ERROR_FACTOR_RANGE.0, ERROR_FACTOR_RANGE.1)
    }
}

/// Returns the prior knowledge: index, value and standard deviation of each unknown that has a prior.
fn prior_knowledge(state: &State, usual: &[f64]) -> Vec<(usize, f64, f64)> {
    let numbers = state.correction.numbers().iter().zip(usual).take(state.free_parameter_count()).enumerate();
    let mut all: Vec<_> = numbers.map(|(index, (number, usual))| (index, *number, *usual)).collect();
    if state.touches {
        all.extend((0..3).map(|axis| (state.tip_index() + axis, state.tip[axis], TIP_PRIOR_MM)));
    }
    all
}

/// Minimises (1) by Levenberg–Marquardt; `None` if the iteration does not converge.
pub(super) fn levenberg_marquardt(
    start: State,
    views: &[&ArmView],
    touches: &[ArmTouch],
) -> Option<ConvergedState> {
    let roots: Vec<Matrix6<f64>> =
        views.iter().map(|view| Some(view.information.cholesky()?.l().transpose())).collect::<Option<_>>()?;
    let usual = start.parameter_priors();
    let mut state = start;
    let mut variance = 1.0;
    let mut damping = 1e-6;
    let cost = |state: &State, residual: &DVector<f64>, variance: f64| {
        let prior = prior_knowledge(state, &usual).iter().map(|(_, n, u)| (n / u).powi(2)).sum::<f64>();
        residual.norm_squared() / variance + prior
    };
    for _ in 0..MAX_STEPS {
        let residual = state.residuals(views, &roots, touches)?;
        let slope = compute_jacobian(&state, views, &roots, touches)?;
        let mut normal = slope.transpose() * &slope / variance;
        let mut pull = -(slope.transpose() * &residual) / variance;
        for (index, number, usual) in prior_knowledge(&state, &usual) {
            normal[(index, index)] += usual.powi(-2);
            pull[index] -= number / usual.powi(2);
        }
        let undamped = normal.clone();
        (0..normal.nrows()).for_each(|at| normal[(at, at)] *= 1.0 + damping);
        let step = scaled_inverse(&normal)? * &pull;
        let next = state.perturbed(&step);
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
        // Number of free parameters that the data determine.
        let parameters: f64 = state.count() as f64
            - (0..state.free_parameter_count()).map(|at| inverse[(at, at)] / usual[at].powi(2)).sum::<f64>();
        let redundancy = (there.len() as f64 - parameters).max(1.0);
        let new = (there.norm_squared() / redundancy).max(1.0);
        let steady = (new / variance - 1.0).abs() < 1e-3;
        variance = new;
        if steady && before - after < 1e-9 * before.max(1e-9) {
            return Some(ConvergedState { state, inverse, variance });
        }
    }
    let residual = state.residuals(views, &roots, touches)?;
    let slope = compute_jacobian(&state, views, &roots, touches)?;
    let mut normal = slope.transpose() * &slope / variance;
    prior_knowledge(&state, &usual)
        .into_iter()
        .for_each(|(index, _, usual)| normal[(index, index)] += usual.powi(-2));
    residual.iter().all(|number| number.is_finite()).then_some(())?;
    Some(ConvergedState { inverse: scaled_inverse(&normal)?, state, variance })
}

fn compute_jacobian(
    state: &State,
    views: &[&ArmView],
    roots: &[Matrix6<f64>],
    touches: &[ArmTouch],
) -> Option<DMatrix<f64>> {
    let usual = state.correction.parameter_priors();
    let columns = (0..state.count()).map(|column| {
        let step = if column < state.free_parameter_count() { 1e-2 * usual[column] } else { 1e-6 };
        let mut change = DVector::zeros(state.count());
        change[column] = step;
        let ahead = state.perturbed(&change).residuals(views, roots, touches)?;
        change[column] = -step;
        let behind = state.perturbed(&change).residuals(views, roots, touches)?;
        Some((ahead - behind) / (2.0 * step))
    });
    let columns: Vec<DVector<f64>> = columns.collect::<Option<_>>()?;
    Some(DMatrix::from_columns(&columns))
}
