//! The joint adjustment of camera mount and board over all pictures, with the noise estimated from the residuals; its
//! start value, and the influence of a station or of the lens on its result.
//!
//! A corner q of the board is seen by station i at
//!     p = X⁻¹ · Mᵢ(eᵢ) · Y · q,   X = to_from_camera, Y = holder_from_board, Mᵢ = to_from_holder,              (1)
//! where the flange was at `base_from_flange · exp(eᵢ)`: the reported pose of the robot has an unknown small error, the
//! twist eᵢ = (ω, v), which is the same for all corners of a picture. The sum minimised over X, Y and every eᵢ is
//!     Σᵢ Σⱼ |pixelᵢⱼ − π(pᵢⱼ)|² / σ²  +  Σᵢ |ωᵢ|² / σω² + |vᵢ|² / σv².                                        (2)
//! The method is Gauss–Newton on right perturbations, with the eᵢ eliminated picture by picture (Schur complement).
//! Without eᵢ, the corners of a picture would be treated as independent and the stated uncertainty would be many times
//! too small.
//!
//! σ, σω and σv are estimated, each as Σ v² / redundancy (Förstner's variance components); none is assumed. If the 3D
//! camera measured the corners, its points replace the pixels and σ is in mm. The intrinsics are kept fixed;
//! [`lens_covariance_effect`] states the effect of their error on the mount.
//!
//! The start value is a consensus, robust against a few wrong poses. Three stations at a time give the mount in closed
//! form (Park & Martin). With this mount every station predicts the pose of the board on its holder, and correct
//! stations agree. The best mount has the least median of these distances (Rousseeuw, J. Am. Stat. Assoc. 79, 1984),
//! which tolerates almost half of all poses being wrong.
//!
//! The influence of one station, or of a lens error, is known to first order from the normal equations. A station adds
//! its information Λᵢ to Λ = Σ Λᵢ, and its gradient gᵢ. Without this station the result moves by −(Λ − Λᵢ)⁻¹ gᵢ. A
//! station that was not part of the adjustment is compared with the result. A lens error δ moves the result by Λ⁻¹ B δ,
//! with B the derivatives of the corners with respect to the lens. A lens of covariance C therefore adds Λ⁻¹ B C Bᵀ
//! Λ⁻¹. This is the largest part if the robot is accurate: if the principal point is wrong by 0.1 px, the mount is
//! rotated by the angle that 0.1 px subtends.

use super::chain::{Arrangement, Chain, MountBoardMatrix, Station, StationGram, Twist, exp_map, log};
use super::error::CalibError;
use super::foreign;
use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, Isometry3, Matrix3, Matrix6, OMatrix, SMatrix, SVector};
use panelprep_base::geometry::{Base, Board, Flange, Frame, PinholeCamera, Point, Rigid, median};
use panelprep_cell::cell::LensCovariance;

/// Standard deviations of the corners and of the flange poses, estimated from the residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of a corner along each axis: px in pictures, mm among 3D points.
    pub corner: f64,
    /// Standard deviation of the reported flange rotation about each axis, rad.
    pub turn_rad: f64,
    /// Standard deviation of the reported flange position along each axis, mm.
    pub shift_mm: f64,
}

const MIN_NOISE: Noise = Noise { corner: 1e-4, turn_rad: 2e-7, shift_mm: 1e-4 };
const START_NOISE: Noise = Noise { corner: 0.2, turn_rad: 3e-4, shift_mm: 0.1 };
const MAX_STEPS: usize = 200;
/// Minimum number of iterations after which the adjustment may end when camera and board no longer move, although the
/// noise estimate still changes slowly.
const SUFFICIENT_ITERATIONS: usize = 60;
/// Maximum motion of camera and board in the last iteration, mm and mrad.
const CONVERGENCE_TOLERANCE: f64 = 1e-7;

/// The adjusted poses of camera mount and board, with the evidence for them.
#[derive(Debug, Clone)]
pub struct MountAdjustment<A: Arrangement> {
    /// The camera mount, the unknown of the calibration.
    pub to_from_camera: Rigid<A::To, A::From>,
    /// The pose of the board on its holder.
    pub holder_from_board: Rigid<A::Holder, Board>,
    /// The noise of corners and flange poses, estimated from the residuals.
    pub noise: Noise,
    /// Number of residuals beyond those that the unknowns can absorb: a measure of the accuracy of the noise estimate.
    pub redundancy: f64,
    /// Covariance of (mount, board), as right twists, rad and mm.
    pub(super) covariance: MountBoardMatrix,
}

impl<A: Arrangement> MountAdjustment<A> {
    /// Returns the covariance of a point that is fixed to the camera, in the frame on which the camera is mounted, mm².
    pub fn covariance_at(&self, point: Point<A::From>) -> Matrix3<f64> {
        covariance_at(&self.to_from_camera, &self.covariance, point)
    }

    /// Returns a copy in which mount and board are moved by a small motion, with another covariance.
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

/// Returns the prior weights 1/σω² and 1/σv² in units of the weight of a corner.
pub(super) fn prior_weights(noise: &Noise) -> Matrix6<f64> {
    let [turn, shift] = [noise.turn_rad, noise.shift_mm].map(|sigma| (noise.corner / sigma).powi(2));
    Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift))
}

const ADJUSTED: &str = "the adjustment of camera mount and board";

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
    let unsettled = CalibError::NotSettled { what: ADJUSTED };
    let mut state = State {
        mount: *start.0.isometry(),
        board: *start.1.isometry(),
        deviations: vec![Isometry3::identity(); stations.len()],
    };
    let mut noise = given.unwrap_or(START_NOISE);
    for index in 1..=MAX_STEPS {
        let mut grams = Vec::with_capacity(stations.len());
        for (station, deviation) in stations.iter().zip(&state.deviations) {
            let chain = Chain::new::<A>(&state.mount, &state.board, &station.base_from_flange, deviation);
            grams.push(chain.gram(camera, &station.observation).ok_or_else(|| unsettled.clone())?);
        }
        let step = Step::solve(&grams, &state.deviations, &noise).ok_or_else(|| unsettled.clone())?;
        let moved = step.apply(&grams, &mut state);
        // The noise is estimated with the unknowns, since neither the repeatability of the robot nor the noise of the
        // corners in these pictures is known beforehand.
        let estimated = if given.is_some() { noise } else { step.noise(&grams, &state.deviations, &noise) };
        let steady = |old: f64, new: f64| (new / old - 1.0).abs() < 2e-3;
        let is_steady = steady(noise.corner, estimated.corner)
            && steady(noise.turn_rad, estimated.turn_rad)
            && steady(noise.shift_mm, estimated.shift_mm);
        // A few poses hardly determine a small noise of the robot: its estimate still changes slowly when camera and
        // board no longer move.
        let settled = moved < CONVERGENCE_TOLERANCE && (is_steady || index >= SUFFICIENT_ITERATIONS);
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
    /// Sum of the variances of the flange deviations in rotation (about ω), in the units of `covariance`;
    /// `shift_variance` is the sum in translation (along v).
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
            // The deviation of each flange pose is eliminated immediately: as an unknown it would enlarge the matrix by
            // six rows for each picture.
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

    /// Moves the state and returns the motion of camera and board, mm and mrad.
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

    /// Returns the smaller redundancy of the noise components that are above their minimum.
    fn redundancy(&self, noise: &Noise) -> f64 {
        let [turn, shift] = self.redundancies(noise);
        let counts =
            |sigma: f64, floor: f64, redundancy: f64| if sigma > 1.5 * floor { redundancy } else { f64::INFINITY };
        let least = counts(noise.turn_rad, MIN_NOISE.turn_rad, turn)
            .min(counts(noise.shift_mm, MIN_NOISE.shift_mm, shift))
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
        // The change is limited: otherwise one bad start moves a component to a value from which it cannot return.
        let bounded = |new: f64, old: f64, floor: f64| new.sqrt().clamp(0.2 * old, 5.0 * old).max(floor);
        Noise {
            corner: bounded(square / corners, noise.corner, MIN_NOISE.corner),
            turn_rad: bounded(turns / turn, noise.turn_rad, MIN_NOISE.turn_rad),
            shift_mm: bounded(shifts / shift, noise.shift_mm, MIN_NOISE.shift_mm),
        }
    }
}

/// Returns the inverse of a normal matrix of unknowns with different units. The matrix is first scaled to ones on its
/// diagonal.
pub(super) fn scaled_inverse<D: Dim>(normal: &OMatrix<f64, D, D>) -> Option<OMatrix<f64, D, D>>
where
    DefaultAllocator: Allocator<D, D> + Allocator<D>,
{
    let (rows, columns) = normal.shape_generic();
    // Values in radians and in millimetres differ by a factor of a thousand: without the scaling, the digits of the
    // smaller ones are lost in the decomposition.
    let scale = normal.diagonal().map(|entry| if entry > 0.0 { entry.sqrt().recip() } else { f64::NAN });
    let scaled =
        OMatrix::from_fn_generic(rows, columns, |row, column| normal[(row, column)] * scale[row] * scale[column]);
    let inverse = scaled.cholesky()?.inverse();
    Some(OMatrix::from_fn_generic(rows, columns, |row, column| inverse[(row, column)] * scale[row] * scale[column]))
}

/// Maximum number of triples of stations that are tried; more triples are sampled at equal steps.
const MAX_TRIPLES: usize = 800;
/// Minimum rotation between the three stations of a start value, rad.
pub(super) const MIN_START_ROTATION_RAD: f64 = 0.05;
/// Maximum median distance of the boards in a consensus, mm.
const MAX_CONSENSUS_MEDIAN_MM: f64 = 15.0;
/// Minimum spread of the rotations about their second principal axis that determines a mount, degrees.
pub(super) const MIN_ROTATION_SPREAD_DEG: f64 = 4.0;

pub(super) struct Start<A: Arrangement> {
    pub to_from_camera: Rigid<A::To, A::From>,
    pub holder_from_board: Rigid<A::Holder, Board>,
    /// For each station, the distance of its board from the board of the best station, mm.
    pub distances_mm: Vec<f64>,
    pub median_mm: f64,
}

/// Returns the spread of the rotations between stations about the second of their principal axes, degrees (root mean
/// square over all pairs).
pub(super) fn second_axis_deg(turns: &[Isometry3<f64>]) -> f64 {
    let (mut spread, mut pairs) = (Matrix3::zeros(), 0.0);
    for (index, first) in turns.iter().enumerate() {
        for second in &turns[index + 1..] {
            let axis = (first.rotation.inverse() * second.rotation).scaled_axis();
            spread += axis * axis.transpose();
            pairs += 1.0;
        }
    }
    let mut eigen: [f64; 3] = spread.symmetric_eigenvalues().into();
    eigen.sort_by(f64::total_cmp);
    (eigen[1].max(0.0) / f64::max(pairs, 1.0)).sqrt().to_degrees()
}

pub(super) fn start_by_consensus<A: Arrangement>(
    to_from_holder: &[Rigid<A::To, A::Holder>],
    camera_from_board: &[Rigid<A::From, Board>],
    places: &[Point<Board>],
) -> Result<Start<A>, CalibError> {
    let moved: Vec<Isometry3<f64>> = to_from_holder.iter().map(|pose| pose.isometry().inverse()).collect();
    let seen: Vec<Isometry3<f64>> = camera_from_board.iter().map(|pose| *pose.isometry()).collect();
    let mut best: Option<Start<A>> = None;
    for triple in index_triples(seen.len()) {
        let pick = |poses: &[Isometry3<f64>]| triple.map(|index| poses[index]);
        if second_axis_deg(&pick(&moved)).to_radians() < MIN_START_ROTATION_RAD {
            continue;
        }
        let Some(mount) = foreign::solve_hand_eye_park(&pick(&moved), &pick(&seen)) else { continue };
        let mount: Rigid<A::To, A::From> = Rigid::from_isometry_unchecked(mount);
        let boards: Vec<Rigid<A::Holder, Board>> = to_from_holder
            .iter()
            .zip(camera_from_board)
            .map(|(moved, seen)| moved.inverse() * mount * *seen)
            .collect();
        let found = medoid(mount, &boards, places);
        if best.as_ref().is_none_or(|best| found.median_mm < best.median_mm) {
            best = Some(found);
        }
    }
    let none = CalibError::TooLittleRotation {
        about_second_axis_deg: second_axis_deg(&moved),
        needed_deg: MIN_ROTATION_SPREAD_DEG,
    };
    let best = best.ok_or(none)?;
    if best.median_mm > MAX_CONSENSUS_MEDIAN_MM {
        return Err(CalibError::NoConsensus { poses: seen.len(), median_mm: best.median_mm, readings: vec![] });
    }
    Ok(best)
}

/// Returns the station whose board pose agrees best with those of the other stations.
fn medoid<A: Arrangement>(
    to_from_camera: Rigid<A::To, A::From>,
    boards: &[Rigid<A::Holder, Board>],
    places: &[Point<Board>],
) -> Start<A> {
    let distances = |board: &Rigid<A::Holder, Board>| -> (f64, Vec<f64>) {
        let apart = |other: &Rigid<A::Holder, Board>| {
            places.iter().map(|&place| board.distance_at_mm(*other, place)).sum::<f64>() / places.len() as f64
        };
        let distances: Vec<f64> = boards.iter().map(apart).collect();
        // One value is the station's distance from itself, zero: this is the median of the others.
        (median(&mut distances.clone()).unwrap_or(f64::INFINITY), distances)
    };
    let mut all = boards.iter().map(|board| (*board, distances(board)));
    let first =
        all.next().unwrap_or((Rigid::from_isometry_unchecked(Isometry3::identity()), (f64::INFINITY, vec![])));
    let (holder_from_board, (median_mm, distances_mm)) =
        all.fold(first, |best, next| if next.1.0 < best.1.0 { next } else { best });
    Start { to_from_camera, holder_from_board, distances_mm, median_mm }
}

pub(super) fn index_triples(count: usize) -> impl Iterator<Item = [usize; 3]> {
    let all = count * count.saturating_sub(1) * count.saturating_sub(2) / 6;
    let stride = all.div_ceil(MAX_TRIPLES).max(1);
    (0..count)
        .flat_map(move |a| (a + 1..count).flat_map(move |b| (b + 1..count).map(move |c| [a, b, c])))
        .step_by(stride)
}

/// Returns the information (inverse covariance) that a station adds, and its gradient for mount and board, in rad and
/// mm. Used to exclude a station, and to select the next station.
pub(super) fn information<A: Arrangement>(
    camera: &PinholeCamera,
    adjusted: &MountAdjustment<A>,
    station: &Station<A::From>,
) -> Option<(MountBoardMatrix, SVector<f64, 12>)> {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &Isometry3::identity());
    let gram = chain.gram(camera, &station.observation)?;
    let inverse = (gram.flange() + prior_weights(&adjusted.noise)).cholesky()?.inverse();
    let reduced = gram.mount_and_board() - gram.cross() * inverse * gram.cross().transpose();
    let pull = gram.gradient.fixed_rows::<12>(0) - gram.cross() * inverse * gram.gradient.fixed_rows::<6>(12);
    let weight = adjusted.noise.corner.powi(-2);
    Some((reduced * weight, pull * weight))
}

/// Minimum standard deviation of the position of an arm, mm: a third of the pose repeatability of a KR 6 R700, ±0.03 mm
/// (data sheet). The minimum standard deviation of its rotation, `MIN_ARM_ROTATION_RAD`, causes this shift at 350 mm,
/// half of the arm's reach. With this minimum, a few poses that match better by chance do not make another pose appear
/// wrong.
const MIN_ARM_SHIFT_MM: f64 = 0.01;
const MIN_ARM_ROTATION_RAD: f64 = 3e-5;

/// Returns how improbable a station is, compared with an adjustment without it: the squared length, in standard
/// deviations, of the twist by which the flange would have to be moved. The expected value is 6.
pub(super) fn outlier_statistic<A: Arrangement>(
    camera: &PinholeCamera,
    adjusted: &MountAdjustment<A>,
    station: &Station<A::From>,
    camera_from_board: &Rigid<A::From, Board>,
) -> f64 {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let needed = needed_flange(adjusted, camera_from_board);
    let deviation = (station.base_from_flange.inverse() * needed).isometry().to_owned();
    let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &deviation);
    let found = chain.gram(camera, &station.observation).and_then(|gram| {
        let inverse = gram.flange().cholesky()?.inverse();
        let through = inverse * gram.cross().transpose();
        let noise = &adjusted.noise;
        let [turn, shift] =
            [noise.turn_rad.max(MIN_ARM_ROTATION_RAD).powi(2), noise.shift_mm.max(MIN_ARM_SHIFT_MM).powi(2)];
        let robot = Matrix6::from_diagonal(&Twist::new(turn, turn, turn, shift, shift, shift));
        let spread = inverse * noise.corner.powi(2) + robot + through * adjusted.covariance * through.transpose();
        let twist = log(&deviation);
        Some(twist.dot(&(spread.cholesky()?.inverse() * twist)))
    });
    found.unwrap_or(f64::INFINITY)
}

/// Returns the flange pose for which the picture would show the board as it does.
pub(super) fn needed_flange<A: Arrangement>(
    adjusted: &MountAdjustment<A>,
    camera_from_board: &Rigid<A::From, Board>,
) -> Rigid<Base, Flange> {
    let to_from_holder = adjusted.to_from_camera * *camera_from_board * adjusted.holder_from_board.inverse();
    let bare = *to_from_holder.isometry();
    Rigid::from_isometry_unchecked(if A::EYE_IN_HAND { bare.inverse() } else { bare })
}

/// Returns the covariance that the uncertainty of a lens adds to mount and board; `None` if a corner is behind the
/// camera.
pub(super) fn lens_covariance_effect<A: Arrangement>(
    camera: &PinholeCamera,
    adjusted: &MountAdjustment<A>,
    stations: &[&Station<A::From>],
    lens: &LensCovariance,
) -> Option<MountBoardMatrix> {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let mut pull = SMatrix::<f64, 12, 9>::zeros();
    for station in stations {
        let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &Isometry3::identity());
        let (gram, lens) =
            (chain.gram(camera, &station.observation)?, chain.lens_cross(camera, &station.observation)?);
        let inverse = (gram.flange() + prior_weights(&adjusted.noise)).cholesky()?.inverse();
        pull += lens.fixed_rows::<12>(0) - gram.cross() * inverse * lens.fixed_rows::<6>(12);
    }
    let moved = adjusted.covariance * pull * adjusted.noise.corner.powi(-2);
    Some(moved * lens * moved.transpose())
}

/// Returns the inverse of a covariance or an information matrix of mount and board.
pub(super) fn inverse(normal: &MountBoardMatrix) -> Option<MountBoardMatrix> {
    scaled_inverse(normal)
}
