//! The joint adjustment of camera mount and board over all pictures, with the noise estimated from the residuals.
//!
//! A corner q of the board is seen by station i at
//!     p = X⁻¹ · Mᵢ(eᵢ) · Y · q,   X = to_from_camera, Y = holder_from_board, Mᵢ = to_from_holder,              (1)
//! where the flange was at `base_from_flange · exp(eᵢ)`: the pose that the robot reports is off by an unknown small
//! twist eᵢ = (ω, v), the same for all corners of a picture. The sum minimised over X, Y and every eᵢ is
//!     Σᵢ Σⱼ |pixelᵢⱼ − π(pᵢⱼ)|² / σ²  +  Σᵢ |ωᵢ|² / σω² + |vᵢ|² / σv².                                        (2)
//! The method is Gauss–Newton on right perturbations, with the eᵢ eliminated picture by picture (Schur complement).
//! Without eᵢ, the corners of a picture would count as independent and the stated uncertainty would be many times
//! too small.
//!
//! σ, σω and σv are estimated, each as Σ v² / redundancy (Förstner's variance components); none is assumed. If the
//! 3D camera measured the corners, its points replace the pixels and σ is in mm. The intrinsics are used as they
//! are; `influence` states the effect of their own error on the mount.

use super::arrangement::{Arrangement, Twist, exp_map, log};
use super::chain::{Chain, MountBoardMatrix, Station, StationGram};
use super::error::CalibError;
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, Isometry3, Matrix3, Matrix6, OMatrix, SMatrix, SVector};
use panelprep_base::geometry::{Board, Frame, PinholeCamera, Point, Rigid};

/// Standard deviations, estimated from the residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of a corner along each axis: px in pictures, mm among 3D points.
    pub corner: f64,
    /// Standard deviation of the flange's reported rotation about each axis, rad.
    pub turn_rad: f64,
    /// Standard deviation of the flange's reported position along each axis, mm.
    pub shift_mm: f64,
}

const NOISE_FLOOR: Noise = Noise { corner: 1e-4, turn_rad: 2e-7, shift_mm: 1e-4 };
const NOISE_START: Noise = Noise { corner: 0.2, turn_rad: 3e-4, shift_mm: 0.1 };
const MAX_STEPS: usize = 200;
/// After this number of steps the iteration may end although the noise estimate still changes slowly, if camera and
/// board no longer move.
const SUFFICIENT_STEPS: usize = 60;
/// The iteration ends when camera and board move by less than this, mm and mrad.
const CONVERGENCE_TOLERANCE: f64 = 1e-7;

/// A camera mount and a board's pose with the evidence for them.
#[derive(Debug, Clone)]
pub struct MountAdjustment<A: Arrangement> {
    /// The camera's mount, the unknown of the calibration.
    pub to_from_camera: Rigid<A::To, A::From>,
    /// The board's pose on its holder.
    pub holder_from_board: Rigid<A::Holder, Board>,
    /// The estimated noise.
    pub noise: Noise,
    /// Number of residuals beyond those that the unknowns can absorb: how well the noise is known.
    pub redundancy: f64,
    /// Covariance of (mount, board), twists on the right, rad and mm.
    pub(super) covariance: MountBoardMatrix,
}

impl<A: Arrangement> MountAdjustment<A> {
    /// Returns the covariance of a point that is fixed to the camera, in the frame that the camera is mounted on, mm².
    pub fn covariance_at(&self, point: Point<A::From>) -> Matrix3<f64> {
        covariance_at(&self.to_from_camera, &self.covariance, point)
    }

    /// Returns a copy with mount and board moved by a small motion, and with another covariance.
    pub(super) fn perturbed(&self, both: &SVector<f64, 12>, covariance: MountBoardMatrix) -> Self {
        let [mount, board] = [0, 6].map(|row| exp_map(&Twist::from(both.fixed_rows::<6>(row))));
        MountAdjustment {
            to_from_camera: Rigid::from_isometry_unchecked(self.to_from_camera.isometry() * mount),
            holder_from_board: Rigid::from_isometry_unchecked(self.holder_from_board.isometry() * board),
            covariance,
            ..self.clone()
        }
    }
}

pub(super) fn covariance_at<To: Frame, C: Frame>(
    to_from_camera: &Rigid<To, C>,
    covariance: &MountBoardMatrix,
    point: Point<C>,
) -> Matrix3<f64> {
    let turn = to_from_camera.rotation().into_inner();
    let mut slope = SMatrix::<f64, 3, 6>::zeros();
    slope.fixed_columns_mut::<3>(0).copy_from(&(-turn * point.mm.coords.cross_matrix()));
    slope.fixed_columns_mut::<3>(3).copy_from(&turn);
    slope * covariance.fixed_view::<6, 6>(0, 0) * slope.transpose()
}

struct State {
    mount: Isometry3<f64>,
    board: Isometry3<f64>,
    deviations: Vec<Isometry3<f64>>,
}

/// Returns 1/σω² and 1/σv² in units of the corners' weight.
pub(super) fn prior_weights(noise: &Noise) -> Matrix6<f64> {
    let [turn, shift] = [noise.turn_rad, noise.shift_mm].map(|sigma| (noise.corner / sigma).powi(2));
    Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift))
}

const WHAT: &str = "camera mount and board";

/// Adjusts camera mount and board from a start value; a given noise is not estimated again.
///
/// # Errors
/// If the unknowns are not determined, or the iteration does not converge.
pub(super) fn adjust<A: Arrangement>(
    camera: &PinholeCamera,
    stations: &[&Station<A::From>],
    start: (&Rigid<A::To, A::From>, &Rigid<A::Holder, Board>),
    given: Option<Noise>,
) -> Result<MountAdjustment<A>, CalibError> {
    let unsettled = CalibError::NotSettled { what: WHAT };
    let mut state = State {
        mount: *start.0.isometry(),
        board: *start.1.isometry(),
        deviations: vec![Isometry3::identity(); stations.len()],
    };
    let mut noise = given.unwrap_or(NOISE_START);
    for index in 1..=MAX_STEPS {
        let mut grams = Vec::with_capacity(stations.len());
        for (station, deviation) in stations.iter().zip(&state.deviations) {
            let chain = Chain::new::<A>(&state.mount, &state.board, &station.base_from_flange, deviation);
            grams.push(chain.gram(camera, &station.observation).ok_or_else(|| unsettled.clone())?);
        }
        let step = Step::solve(&grams, &state.deviations, &noise).ok_or_else(|| unsettled.clone())?;
        let moved = step.apply(&grams, &mut state);
        // Estimated with the unknowns, since neither the robot's repeatability nor the corners' noise in these pictures
        // is known beforehand.
        let estimated = if given.is_some() { noise } else { step.noise(&grams, &state.deviations, &noise) };
        let steady = |old: f64, new: f64| (new / old - 1.0).abs() < 2e-3;
        let is_steady = steady(noise.corner, estimated.corner)
            && steady(noise.turn_rad, estimated.turn_rad)
            && steady(noise.shift_mm, estimated.shift_mm);
        // A few poses hardly determine a small noise of the robot: it still changes slowly while camera and board
        // no longer move.
        let settled = moved < CONVERGENCE_TOLERANCE && (is_steady || index >= SUFFICIENT_STEPS);
        noise = estimated;
        if settled {
            return Ok(MountAdjustment {
                to_from_camera: Rigid::from_isometry_unchecked(state.mount),
                holder_from_board: Rigid::from_isometry_unchecked(state.board),
                noise,
                redundancy: step.redundancy(&noise),
                covariance: step.covariance * noise.corner.powi(2),
            });
        }
    }
    Err(unsettled)
}

/// The solution of the reduced normal equations of (2).
struct Step {
    mount_and_board: SVector<f64, 12>,
    /// Inverse of the reduced normal matrix, in units of the corners' variance.
    covariance: MountBoardMatrix,
    /// Sum of the variances of the flange's deviations in rotation (about ω), in the units of `covariance`;
    /// `shift_variance` is the same for translation (along v).
    turn_variance: f64,
    shift_variance: f64,
    stations: usize,
    flange_inverse: Vec<Matrix6<f64>>,
    flange_gradient: Vec<Twist>,
}

impl Step {
    fn solve(grams: &[StationGram], deviations: &[Isometry3<f64>], noise: &Noise) -> Option<Self> {
        let prior = prior_weights(noise);
        let (mut normal, mut gradient) = (MountBoardMatrix::zeros(), SVector::<f64, 12>::zeros());
        let (mut flange_inverse, mut flange_gradient) = (Vec::new(), Vec::new());
        for (gram, deviation) in grams.iter().zip(deviations) {
            let inverse = (gram.flange() + prior).cholesky()?.inverse();
            let pull = gram.gradient.fixed_rows::<6>(12) - prior * log(deviation);
            // The flange's deviation of each pose is eliminated at once: with it as an unknown the matrix would grow by
            // six for each picture.
            normal += gram.mount_and_board() - gram.cross() * inverse * gram.cross().transpose();
            gradient += gram.gradient.fixed_rows::<12>(0) - gram.cross() * inverse * pull;
            flange_inverse.push(inverse);
            flange_gradient.push(pull);
        }
        let covariance = scaled_inverse(&normal)?;
        let mut variances = Twist::zeros();
        for (gram, inverse) in grams.iter().zip(&flange_inverse) {
            let through = inverse * gram.cross().transpose();
            variances += (inverse + through * covariance * through.transpose()).diagonal();
        }
        Some(Step {
            mount_and_board: covariance * gradient,
            covariance,
            turn_variance: variances.fixed_rows::<3>(0).sum(),
            shift_variance: variances.fixed_rows::<3>(3).sum(),
            stations: grams.len(),
            flange_inverse,
            flange_gradient,
        })
    }

    /// Moves the state and returns how far camera and board moved, mm and mrad.
    fn apply(&self, grams: &[StationGram], state: &mut State) -> f64 {
        let [mount, board] = [0, 6].map(|row| Twist::from(self.mount_and_board.fixed_rows::<6>(row)));
        state.mount *= exp_map(&mount);
        state.board *= exp_map(&board);
        for (index, gram) in grams.iter().enumerate() {
            let twist = self.flange_inverse[index]
                * (self.flange_gradient[index] - gram.cross().transpose() * self.mount_and_board);
            state.deviations[index] *= exp_map(&twist);
        }
        let weigh = |twist: &Twist| twist.fixed_rows::<3>(0).norm() * 1e3 + twist.fixed_rows::<3>(3).norm();
        weigh(&mount) + weigh(&board)
    }

    /// Returns the redundancy of the 3·n rotations and of the 3·n shifts of the flange.
    fn redundancies(&self, noise: &Noise) -> [f64; 2] {
        let all = 3.0 * self.stations as f64;
        let of = |variance: f64, sigma: f64| (all - variance * (noise.corner / sigma).powi(2)).max(1e-9);
        [of(self.turn_variance, noise.turn_rad), of(self.shift_variance, noise.shift_mm)]
    }

    /// Returns the smaller of the redundancies that count: a noise component at its floor does not count.
    fn redundancy(&self, noise: &Noise) -> f64 {
        let [turn, shift] = self.redundancies(noise);
        let counts =
            |sigma: f64, floor: f64, redundancy: f64| if sigma > 1.5 * floor { redundancy } else { f64::INFINITY };
        let least = counts(noise.turn_rad, NOISE_FLOOR.turn_rad, turn)
            .min(counts(noise.shift_mm, NOISE_FLOOR.shift_mm, shift))
            .min(6.0 * self.stations as f64 - 12.0);
        least.max(1.0)
    }

    fn noise(&self, grams: &[StationGram], deviations: &[Isometry3<f64>], noise: &Noise) -> Noise {
        let [turn, shift] = self.redundancies(noise);
        let (mut turns, mut shifts) = (0.0, 0.0);
        for twist in deviations.iter().map(log) {
            turns += twist.fixed_rows::<3>(0).norm_squared();
            shifts += twist.fixed_rows::<3>(3).norm_squared();
        }
        let rows: usize = grams.iter().map(|gram| gram.rows).sum();
        let corners = (rows as f64 - 12.0 - turn - shift).max(1.0);
        let square: f64 = grams.iter().map(|gram| gram.square).sum();
        // A step is limited, so that one bad start does not move a component to a value from which it cannot
        // return.
        let bounded = |new: f64, old: f64, floor: f64| new.sqrt().clamp(0.2 * old, 5.0 * old).max(floor);
        Noise {
            corner: bounded(square / corners, noise.corner, NOISE_FLOOR.corner),
            turn_rad: bounded(turns / turn, noise.turn_rad, NOISE_FLOOR.turn_rad),
            shift_mm: bounded(shifts / shift, noise.shift_mm, NOISE_FLOOR.shift_mm),
        }
    }
}

/// Returns the inverse of a normal matrix of unknowns with different units, scaled to ones on its diagonal first.
pub(super) fn scaled_inverse<D: Dim>(normal: &OMatrix<f64, D, D>) -> Option<OMatrix<f64, D, D>>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    let (rows, columns) = normal.shape_generic();
    // Radians and millimetres differ by a thousand; unscaled, the decomposition loses the digits of the smaller ones.
    let scale = normal.diagonal().map(|entry| if entry > 0.0 { entry.sqrt().recip() } else { f64::NAN });
    let scaled =
        OMatrix::from_fn_generic(rows, columns, |row, column| normal[(row, column)] * scale[row] * scale[column]);
    let inverse = scaled.cholesky()?.inverse();
    Some(OMatrix::from_fn_generic(rows, columns, |row, column| inverse[(row, column)] * scale[row] * scale[column]))
}
