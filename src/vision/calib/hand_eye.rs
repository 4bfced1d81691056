//! Hand-eye calibration from many poses, with its evidence, and the next pose that would improve it most.
//!
//! The steps are:
//! 1. Compute the pose of the board in each picture.
//! 2. Compute a closed-form start value by consensus.
//! 3. Adjust the stations that agree together (`adjust`).
//! 4. Test every station against the adjustment without it.
//! 5. Report the stations that fail the test (`station_diagnosis`).
//!
//! The result states its uncertainty, in mm at a point of the panel, computed from the noise that the residuals show.
//! If the residuals of neighbouring poses are similar, several poses have the weight of one (`quantile`). `gate` judges
//! whether the uncertainty is small enough.
//!
//! To suggest the next pose, each present pose is tilted and rotated about the centre of the board, and moved nearer
//! and farther. Only poses that keep the whole board in the picture are considered. For each, the information of (2) in
//! `adjust` predicts the uncertainty at the panel; the best pose has the smallest.

use super::adjust::{MIN_ROTATION_SPREAD_DEG, MountAdjustment, covariance_at};
use super::board::Board;
use super::chain::{Arrangement, BoardObservation, BoardPose, LengthFactor, Station, Twist, board_pose, log};
use super::error::{CalibError, PoseReading};
use super::quantile::radius_95;
use super::square::SquareSize;
use super::station_diagnosis::SuspectStation;
use super::{adjust, quantile, readings, square, station_diagnosis};
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use panelprep_base::geometry::statistics::{f_quantile, mean};
use panelprep_base::geometry::{
    Base, Board as BoardFrame, Degrees, Flange, Frame, KukaPose, PinholeCamera, Point, Rigid, Vector,
};
use panelprep_cell::cell::LensCovariance;

/// Minimum number of stations: with fewer, the result cannot be checked.
pub const MIN_STATIONS: usize = 5;
/// Probability that a calibration excludes a correct station.
const FALSE_ALARM_PROBABILITY: f64 = 1e-3;
/// Maximum distance of a station that is used in the first adjustment, as a multiple of the median distance.
const MAX_START_MEDIANS: f64 = 3.0;
const MAX_ROUNDS: usize = 10;
/// Maximum relative error of the size of the squares at which correct poses do not appear wrong.
const MAX_SQUARE_SIZE_ERROR: f64 = 0.001;
/// Maximum residual of the poses, mm; with a larger one, other interpretations of the poses are tried as well.
const MAX_PLAUSIBLE_RMS_MM: f64 = 0.5;

/// The difference between the pose of the board from the picture and its pose from the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Name of the picture.
    pub name: String,
    /// Distance at the centre of the board, mm.
    pub distance_mm: f64,
    /// Angle of the rotation between the two poses, degrees.
    pub angle_deg: f64,
    /// Whether the picture was used for the result.
    pub used: bool,
    /// Root mean square of the corner residuals in the board pose of this picture: px, or mm for 3D points.
    pub corners_rms: f64,
}

/// A calibrated mount with its evidence.
#[derive(Debug, Clone)]
pub struct HandEye<A: Arrangement> {
    /// The adjusted mount and board, with noise and covariance.
    pub adjustment: MountAdjustment<A>,
    /// The residual of each picture, in the order of the input.
    pub residuals: Vec<Residual>,
    /// Root mean square of the used residuals, mm.
    pub rms_mm: f64,
    /// Root mean square of the used residuals, degrees.
    pub rms_deg: f64,
    /// The point for which the uncertainty is stated, in the camera frame.
    pub stated_point: Point<A::From>,
    /// Radius that contains the error at the stated point with 95 % probability, mm.
    pub uncertainty_mm: f64,
    /// Number of poses that have the weight of one independent pose, because the errors of the arm are similar in
    /// neighbouring poses; 1 if the errors are independent.
    pub correlated_pose_count: f64,
    /// Contribution of the lens to the covariance of the stated point, mm²; zero if the lens is treated as exact.
    pub lens_mm2: Matrix3<f64>,
    /// Distance by which the stated point moves if the picture with the largest influence is excluded, mm, and the name
    /// of this picture.
    pub worst_leave_one_out: (f64, String),
    /// Spread of the rotations about the second of their principal axes, degrees.
    pub second_axis_deg: f64,
    /// The outlier stations, with the probable cause. They are judged with squares of the size that the motions show.
    pub suspects: Vec<SuspectStation>,
    /// The size of the board's squares that the motions of the robot show; `None` if the poses do not determine it.
    pub square: Option<SquareSize<A>>,
    /// The focal length that the motions of the robot show. It is not determined if the squares have another size,
    /// since both have nearly the same effect.
    pub focal: Option<SquareSize<A>>,
    /// Other interpretations of the poses that match far better than the poses as written.
    pub readings: Vec<PoseReading>,
}

impl<A: Arrangement> HandEye<A> {
    /// Returns the covariance of the stated point, mm².
    pub fn covariance_mm2(&self) -> Matrix3<f64> {
        self.adjustment.covariance_at(self.stated_point) * self.correlated_pose_count + self.lens_mm2
    }

    /// Returns the number of degrees of freedom from which the covariance was estimated.
    pub fn redundancy(&self) -> f64 {
        redundancy(&self.adjustment, self.correlated_pose_count)
    }

    /// Returns this result for a lens with this covariance, which increases the stated uncertainty. The pose does not
    /// change; it is valid for this lens. Points of a 3D camera hardly depend on the lens, so their uncertainty does
    /// not change.
    ///
    /// # Errors
    /// If a corner would be behind the camera.
    pub fn with_lens_uncertainty(
        self,
        camera: &PinholeCamera,
        stations: &[Station<A::From>],
        lens: &LensCovariance,
    ) -> Result<Self, CalibError> {
        let used = stations.iter().zip(&self.residuals).filter(|(_, residual)| residual.used);
        let used: Vec<&Station<A::From>> = used.map(|(station, _)| station).collect();
        let unsettled = CalibError::NotSettled { what: "the computation of the lens's share of the uncertainty" };
        let added = adjust::lens_covariance_effect(camera, &self.adjustment, &used, lens).ok_or(unsettled)?;
        let lens_mm2 = adjust::covariance_at(&self.adjustment.to_from_camera, &added, self.stated_point);
        let covariance_mm2 =
            self.adjustment.covariance_at(self.stated_point) * self.correlated_pose_count + lens_mm2;
        let radius_mm = radius_95(&covariance_mm2, self.redundancy());
        let square = self.square.and_then(|size| size.with_lens_uncertainty(camera, &used, lens));
        let focal = self.focal.and_then(|size| size.with_lens_uncertainty(camera, &used, lens));
        let uncertainty_mm = with_size_uncertainty(
            radius_mm,
            &self.adjustment,
            [square.as_ref(), focal.as_ref()],
            self.stated_point,
        );
        Ok(HandEye { lens_mm2, uncertainty_mm, square, focal, ..self })
    }

    /// Returns how far the stated point moves if the focal length that the motions show replaces the stated focal
    /// length, mm.
    pub fn focal_moves_mm(&self) -> Option<f64> {
        self.focal.as_ref().map(|size| size.moves_mm(&self.adjustment, self.stated_point))
    }

    /// Returns how far the stated point moves if the size of the squares that the motions show replaces the stated
    /// size, mm.
    pub fn square_moves_mm(&self) -> Option<f64> {
        self.square.as_ref().map(|size| size.moves_mm(&self.adjustment, self.stated_point))
    }

    /// Returns the contribution of the lens to the uncertainty, mm, 95 %; 0 if the lens is treated as exact.
    pub fn lens_uncertainty_mm(&self) -> f64 {
        radius_95(&self.lens_mm2, f64::INFINITY)
    }

    /// Returns whether the stated 95 % region, an ellipsoid about the stated point, contains an error of this size and
    /// direction.
    pub fn region_contains(&self, error: Vector<A::To>) -> bool {
        let reach = 3.0 * f_quantile(3.0, self.redundancy(), 0.95);
        let inverse = self.covariance_mm2().try_inverse();
        inverse.is_some_and(|inverse| error.mm.dot(&(inverse * error.mm)) <= reach)
    }
}

/// Calibrates a mount. `at` is the point at which the uncertainty is stated, in the camera frame; by default, the
/// centre of the observed board positions.
///
/// # Errors
/// If there are too few stations, they rotate too little, their angles look like radians, or they contradict each
/// other.
pub fn hand_eye<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    stations: &[Station<A::From>],
    at: Option<Point<A::From>>,
) -> Result<HandEye<A>, CalibError> {
    check_station_count(stations)?;
    let poses: Vec<BoardPose<A::From>> =
        stations.iter().map(|station| board_pose(camera, &station.observation)).collect::<Result<_, _>>()?;
    check_rotation_spread(stations, &poses)?;
    let moved: Vec<_> = stations.iter().map(|station| A::to_from_holder(&station.base_from_flange)).collect();
    let seen: Vec<_> = poses.iter().map(|pose| pose.camera_from_board).collect();
    let [origin, right, far, low] = board.outer_corners();
    let rim: Vec<_> =
        [origin, right, far, low].iter().filter_map(|&(column, row)| board.corner(column, row)).collect();
    // Other interpretations are tried only if the poses as written do not match: a wrong interpretation can match a few
    // poses by chance.
    let start = adjust::start_by_consensus::<A>(&moved, &seen, &rim).map_err(|error| match error {
        CalibError::NoConsensus { poses: count, median_mm, .. } => {
            let readings = readings::fitting_readings::<A>(camera, board, stations, &poses);
            CalibError::NoConsensus { poses: count, median_mm, readings }
        }
        error => error,
    })?;
    // If the poses are few and scatter, they are too few but not wrong. Therefore the first adjustment uses at least
    // the minimum number of stations.
    let mut sorted = start.distances_mm.clone();
    sorted.sort_by(f64::total_cmp);
    let needed = MIN_STATIONS.max(stations.len().div_ceil(2)).min(sorted.len());
    let reach_mm = (MAX_START_MEDIANS * start.median_mm.max(1e-3)).max(sorted[needed - 1]);
    let begin: Vec<bool> = start.distances_mm.iter().map(|distance| *distance <= reach_mm).collect();
    let all = StationSet { camera, stations, poses: &poses };
    let (adjusted, used) = all.reject_outliers((start.to_from_camera, start.holder_from_board), begin)?;
    let size = all.determine_square_size(&adjusted, &used);
    // Below this relative error, the size changes no pose noticeably; with another size, wrong poses could appear
    // correct.
    let true_size =
        size.as_ref().filter(|size| size.contradicts_stated() && (size.ratio - 1.0).abs() > MAX_SQUARE_SIZE_ERROR);

    let focal = match &size {
        // The two scale factors have nearly the same effect in the pictures, so the focal length is determined only if
        // the squares agree.
        Some(size) if !size.contradicts_stated() => {
            let chosen: Vec<_> =
                stations.iter().zip(&used).filter(|(_, used)| **used).map(|(one, _)| one).collect();
            square::measure(camera, &chosen, &adjusted, LengthFactor::Focal)
        }
        _ => None,
    };
    let residuals = all.residuals(&adjusted, board, &used);
    let middle = at.unwrap_or_else(|| board_centre_in_camera(board, &poses, &used));
    let poses_each = quantile::correlated_pose_count(&all.deviations(&adjusted, &used));
    let covariance_mm2 = adjusted.covariance_at(middle) * poses_each;
    let radius_mm = radius_95(&covariance_mm2, redundancy(&adjusted, poses_each));
    let uncertainty_mm = with_size_uncertainty(radius_mm, &adjusted, [size.as_ref(), focal.as_ref()], middle);
    let leave_one_out = all.leave_one_out(&adjusted, &used, middle);
    let over_used = |value: fn(&Residual) -> f64| {
        let squares = residuals.iter().filter(|r| r.used).map(|r| value(r).powi(2));
        mean(squares).map_or(f64::NAN, f64::sqrt)
    };
    let suspects = match true_size {
        // The poses are correct if only the stated size of the squares contradicts them.
        Some(_) => vec![],
        None => station_diagnosis::name(
            camera,
            board,
            &adjusted,
            stations,
            &poses,
            &used,
            outlier_limit(&adjusted, stations.len()),
        ),
    };
    let turns: Vec<_> =
        moved.iter().zip(&used).filter(|(_, used)| **used).map(|(m, _)| m.isometry().inverse()).collect();
    let rms_mm = over_used(|residual| residual.distance_mm);
    let doubtful = !suspects.is_empty() || rms_mm > MAX_PLAUSIBLE_RMS_MM;
    let readings = if doubtful { readings::fitting_readings::<A>(camera, board, stations, &poses) } else { vec![] };
    Ok(HandEye {
        rms_mm,
        rms_deg: over_used(|residual| residual.angle_deg),
        second_axis_deg: adjust::second_axis_deg(&turns),
        adjustment: adjusted,
        residuals,
        stated_point: middle,
        uncertainty_mm,
        correlated_pose_count: poses_each,
        lens_mm2: Matrix3::zeros(),
        worst_leave_one_out: leave_one_out,
        suspects,
        square: size,
        focal,
        readings,
    })
}

/// Returns the degrees of freedom if several poses have the weight of one.
fn redundancy<A: Arrangement>(adjusted: &MountAdjustment<A>, poses_each: f64) -> f64 {
    (adjusted.redundancy / poses_each).max(1.0)
}

/// Returns the stated radius, increased by the effect of squares and focal length if the motions contradict them.
fn with_size_uncertainty<A: Arrangement>(
    radius_mm: f64,
    adjusted: &MountAdjustment<A>,
    sizes: [Option<&SquareSize<A>>; 2],
    at: Point<A::From>,
) -> f64 {
    let contradicting = sizes.into_iter().flatten().filter(|size| size.contradicts_stated());
    // The contradiction is not resolved here: the error of the mount may be as large as the difference between the two
    // results.
    contradicting.fold(radius_mm, |radius_mm, size| radius_mm.hypot(size.moves_mm(adjusted, at)))
}

fn check_station_count<C: Frame>(stations: &[Station<C>]) -> Result<(), CalibError> {
    if stations.len() < MIN_STATIONS {
        let (found, needed) = (stations.len(), MIN_STATIONS);
        return Err(CalibError::TooFewPictures { found, given: found, needed, first_reason: None });
    }
    Ok(())
}

/// Refuses poses that rotate too little, and poses with angles that look like radians.
fn check_rotation_spread<C: Frame>(stations: &[Station<C>], poses: &[BoardPose<C>]) -> Result<(), CalibError> {
    let seen: Vec<_> = poses.iter().map(|pose| pose.camera_from_board.isometry().inverse()).collect();
    let said: Vec<_> = stations.iter().map(|station| *station.base_from_flange.isometry()).collect();
    let largest = |turns: &[nalgebra::Isometry3<f64>]| {
        let pairs = turns.iter().enumerate().flat_map(|(i, a)| turns[i + 1..].iter().map(move |b| (a, b)));
        Degrees::from_rad(pairs.map(|(a, b)| a.rotation.angle_to(&b.rotation)).fold(0.0, f64::max)).0
    };
    let (seen_deg, said_deg) = (largest(&seen), largest(&said));
    // If angles in radians are read as degrees, the rotation of the flange is 1/57 of the rotation that the pictures
    // show.
    let small = stations.iter().all(|station| {
        let pose = KukaPose::from_rigid(&station.base_from_flange);
        [pose.a_deg, pose.b_deg, pose.c_deg].iter().all(|angle| angle.abs() < 3.15)
    });
    if small && seen_deg > 10.0 && said_deg < seen_deg / 4.0 {
        return Err(CalibError::Radians { seen_deg });
    }
    let spread = adjust::second_axis_deg(&said).min(adjust::second_axis_deg(&seen));
    if spread < MIN_ROTATION_SPREAD_DEG {
        return Err(CalibError::TooLittleRotation {
            about_second_axis_deg: spread,
            needed_deg: MIN_ROTATION_SPREAD_DEG,
        });
    }
    Ok(())
}

/// Returns the limit of [`adjust::outlier_statistic`]; a station with a larger value is an outlier.
fn outlier_limit<A: Arrangement>(adjusted: &MountAdjustment<A>, stations: usize) -> f64 {
    6.0 * f_quantile(6.0, adjusted.redundancy, 1.0 - FALSE_ALARM_PROBABILITY / stations as f64)
}

fn board_centre_in_camera<C: Frame>(board: &Board, poses: &[BoardPose<C>], used: &[bool]) -> Point<C> {
    let seen: Vec<_> = poses
        .iter()
        .zip(used)
        .filter(|(_, used)| **used)
        .map(|(pose, _)| (pose.camera_from_board * board.centre()).mm.coords)
        .collect();
    Point::new((seen.iter().sum::<nalgebra::Vector3<f64>>() / seen.len().max(1) as f64).into())
}

struct StationSet<'a, C: Frame> {
    camera: &'a PinholeCamera,
    stations: &'a [Station<C>],
    poses: &'a [BoardPose<C>],
}

impl<C: Frame> StationSet<'_, C> {
    /// Adjusts the stations that agree. Repeats this until the test of each station against the result no longer
    /// changes the selection.
    fn reject_outliers<A: Arrangement<From = C>>(
        &self,
        start: (Rigid<A::To, C>, Rigid<A::Holder, BoardFrame>),
        mut used: Vec<bool>,
    ) -> Result<(MountAdjustment<A>, Vec<bool>), CalibError> {
        let mut from = start;
        let mut last = None;
        for _ in 0..MAX_ROUNDS {
            let chosen: Vec<&Station<C>> =
                self.stations.iter().zip(&used).filter(|(_, used)| **used).map(|(station, _)| station).collect();
            if chosen.len() < MIN_STATIONS.max(self.stations.len().div_ceil(2)) {
                let given = self.stations.len();
                let first_reason = Some(
                    "each of the other pictures differs from the common result by more than their scatter; take \
                     more poses"
                        .to_owned(),
                );
                return Err(CalibError::TooFewPictures {
                    found: chosen.len(),
                    given,
                    needed: MIN_STATIONS.max(given.div_ceil(2)),
                    first_reason,
                });
            }
            let adjusted = adjust::adjust::<A>(self.camera, &chosen, (&from.0, &from.1), None)?;
            let limit = outlier_limit(&adjusted, self.stations.len());
            let next: Vec<bool> = (0..self.stations.len())
                .map(|index| self.outlier_statistic(&adjusted, index, used[index]) <= limit)
                .collect();
            from = (adjusted.to_from_camera, adjusted.holder_from_board);
            if next == used {
                return Ok((adjusted, used));
            }
            last = Some(adjusted);
            used = next;
        }
        // Two stations at the limit may alternate: the last result is used. Each of the two is then either used or
        // reported.
        last.map(|adjusted| (adjusted, used)).ok_or(CalibError::NotSettled { what: "the selection of poses" })
    }

    /// Determines the size of the squares from the stations that agree. If it differs from the stated size, correct
    /// stations may have been excluded for this reason: the stations are then selected again with squares of the
    /// measured size.
    fn determine_square_size<A: Arrangement<From = C>>(
        &self,
        adjusted: &MountAdjustment<A>,
        used: &[bool],
    ) -> Option<SquareSize<A>> {
        let chosen = |used: &[bool]| -> Vec<&Station<C>> {
            self.stations.iter().zip(used).filter(|(_, used)| **used).map(|(station, _)| station).collect()
        };
        let first = square::measure(self.camera, &chosen(used), adjusted, LengthFactor::Square)?;
        if !first.contradicts_stated() || used.iter().all(|used| *used) {
            return Some(first);
        }
        let stations: Vec<Station<C>> =
            self.stations.iter().map(|station| square::scale_station(station, first.ratio)).collect();
        let poses: Option<Vec<BoardPose<C>>> =
            stations.iter().map(|station| board_pose(self.camera, &station.observation).ok()).collect();
        let poses = poses?;
        let start = (first.adjustment.to_from_camera, first.adjustment.holder_from_board);
        let all = StationSet { camera: self.camera, stations: &stations, poses: &poses };
        let Ok((_, used)) = all.reject_outliers::<A>(start, vec![true; stations.len()]) else { return Some(first) };
        square::measure(self.camera, &chosen(&used), &first.adjustment, LengthFactor::Square).or(Some(first))
    }

    /// Returns the outlier statistic of a station, compared with the adjustment without it.
    fn outlier_statistic<A: Arrangement<From = C>>(
        &self,
        adjusted: &MountAdjustment<A>,
        index: usize,
        used: bool,
    ) -> f64 {
        let (station, seen) = (&self.stations[index], &self.poses[index].camera_from_board);
        let without = if used { self.leave_out(adjusted, index) } else { Some(adjusted.clone()) };
        without.map_or(0.0, |without| adjust::outlier_statistic(self.camera, &without, station, seen))
    }

    /// Returns the adjustment without one used station, to first order; `None` if the other stations do not determine
    /// it.
    fn leave_out<A: Arrangement<From = C>>(
        &self,
        adjusted: &MountAdjustment<A>,
        index: usize,
    ) -> Option<MountAdjustment<A>> {
        let all = adjust::inverse(&adjusted.covariance)?;
        let (gone, pull) = adjust::information(self.camera, adjusted, &self.stations[index])?;
        let covariance = adjust::inverse(&(all - gone))?;
        Some(adjusted.perturbed(&-(covariance * pull), covariance))
    }

    /// Returns each used pose with its deviation: the motion of the flange between the reported pose and the pose that
    /// the picture shows.
    fn deviations<A: Arrangement<From = C>>(
        &self,
        adjusted: &MountAdjustment<A>,
        used: &[bool],
    ) -> Vec<(Rigid<Base, Flange>, Twist)> {
        let deviation = |(station, pose): (&Station<C>, &BoardPose<C>)| {
            let needed = adjust::needed_flange(adjusted, &pose.camera_from_board);
            (station.base_from_flange, log((station.base_from_flange.inverse() * needed).isometry()))
        };
        let chosen = self.stations.iter().zip(self.poses).zip(used).filter(|(_, used)| **used);
        chosen.map(|(one, _)| deviation(one)).collect()
    }

    fn leave_one_out<A: Arrangement<From = C>>(
        &self,
        adjusted: &MountAdjustment<A>,
        used: &[bool],
        at: Point<C>,
    ) -> (f64, String) {
        let shift = |index: usize| {
            self.leave_out(adjusted, index)
                .map_or(f64::INFINITY, |without| without.to_from_camera.distance_at_mm(adjusted.to_from_camera, at))
        };
        let all = (0..used.len()).filter(|&index| used[index]);
        let shifts = all.map(|index| (shift(index), self.stations[index].name.clone()));
        shifts.fold((0.0, String::new()), |worst, next| if next.0 > worst.0 { next } else { worst })
    }

    fn residuals<A: Arrangement<From = C>>(
        &self,
        adjusted: &MountAdjustment<A>,
        board: &Board,
        used: &[bool],
    ) -> Vec<Residual> {
        let residual = |((station, pose), used): ((&Station<C>, &BoardPose<C>), &bool)| {
            let moved = A::to_from_holder(&station.base_from_flange);
            let said = adjusted.to_from_camera.inverse() * moved * adjusted.holder_from_board;
            let seen = pose.camera_from_board;
            let mm = said.distance_at_mm(seen, board.centre());
            let deg = (said.inverse() * seen).rotation_angle().0;
            Residual {
                name: station.name.clone(),
                distance_mm: mm,
                angle_deg: deg,
                used: *used,
                corners_rms: pose.rms,
            }
        };
        self.stations.iter().zip(self.poses).zip(used).map(residual).collect()
    }
}

/// A recommended next pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suggestion {
    /// The pose to which the flange must move.
    pub base_from_flange: KukaPose,
    /// The predicted uncertainty after this pose, mm.
    pub uncertainty_mm: f64,
}

const TILT_DEG: f64 = 25.0;
const NEARER_FACTOR: f64 = 0.8;
/// Maximum tilt of the board, degrees: at a larger tilt its corners are detected poorly.
const MAX_TILT_DEG: f64 = 50.0;

/// Returns the next pose; `None` if no candidate reduces the uncertainty.
pub fn suggest_next_pose<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    stations: &[Station<A::From>],
    found: &HandEye<A>,
) -> Option<Suggestion> {
    let known = adjust::inverse(&found.adjustment.covariance)?;
    let used = stations.iter().zip(&found.residuals).filter(|(_, residual)| residual.used);
    let mut best: Option<Suggestion> = None;
    for (station, _) in used {
        for change in changes() {
            let moved = A::to_from_holder(&station.base_from_flange);
            let seen: Rigid<A::From, panelprep_base::geometry::Board> =
                found.adjustment.to_from_camera.inverse() * moved * found.adjustment.holder_from_board;
            let camera_from_board = rotated_pose(&seen, board, &change);
            let base_from_flange = adjust::needed_flange(&found.adjustment, &camera_from_board);
            let Some(candidate) = simulate_station::<A>(camera, board, base_from_flange, &camera_from_board) else {
                continue;
            };
            let Some((gain, _)) = adjust::information(camera, &found.adjustment, &candidate) else { continue };
            let Some(covariance) = adjust::inverse(&(known + gain)) else { continue };
            let spread = covariance_at(&found.adjustment.to_from_camera, &covariance, found.stated_point)
                * found.correlated_pose_count;
            let uncertainty_mm = radius_95(&spread, found.redundancy());
            if best.is_none_or(|best| uncertainty_mm < best.uncertainty_mm) {
                best =
                    Some(Suggestion { base_from_flange: KukaPose::from_rigid(&base_from_flange), uncertainty_mm });
            }
        }
    }
    best.filter(|best| best.uncertainty_mm < found.uncertainty_mm)
}

/// A rotation about the centre of the board, and a factor for its distance.
struct PoseChange {
    turn: UnitQuaternion<f64>,
    factor: f64,
}

fn changes() -> Vec<PoseChange> {
    let axes = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    let turn = |axis: &Vector3<f64>| UnitQuaternion::from_scaled_axis(axis * Degrees(TILT_DEG).to_rad());
    [NEARER_FACTOR, 1.0, 1.0 / NEARER_FACTOR]
        .into_iter()
        .flat_map(|factor| axes.iter().map(move |axis| PoseChange { turn: turn(axis), factor }).collect::<Vec<_>>())
        .collect()
}

fn rotated_pose<C: panelprep_base::geometry::Frame>(
    camera_from_board: &Rigid<C, panelprep_base::geometry::Board>,
    board: &Board,
    change: &PoseChange,
) -> Rigid<C, panelprep_base::geometry::Board> {
    let middle = board.centre().mm.coords;
    let about = Translation3::from(middle) * change.turn * Translation3::from(-middle);
    let place = (*camera_from_board * board.centre()).mm.coords;
    let shift = Translation3::from(place * (change.factor - 1.0));
    let moved: Isometry3<f64> = shift * camera_from_board.isometry() * about;
    Rigid::from_isometry_unchecked(moved)
}

/// Returns the station that a picture would give; `None` if the board leaves the picture or is tilted too far.
fn simulate_station<A: Arrangement>(
    camera: &PinholeCamera,
    board: &Board,
    base_from_flange: Rigid<Base, Flange>,
    camera_from_board: &Rigid<A::From, panelprep_base::geometry::Board>,
) -> Option<Station<A::From>> {
    let facing = (camera_from_board.rotation() * Vector3::z()).z;
    if facing < Degrees(MAX_TILT_DEG).to_rad().cos() {
        return None;
    }
    let corners: Option<Vec<_>> = board
        .corners()
        .into_iter()
        .map(|corner| Some((corner, camera.project_inside(*camera_from_board * corner)?)))
        .collect();
    Some(Station {
        name: "the next pose".to_owned(),
        base_from_flange,
        observation: BoardObservation::Pixels(corners?),
    })
}
