//! The size of the board's squares, determined from the motions of the robot, which are metric.
//!
//! A board with squares that differ from the stated size appears farther away or nearer than it is, and the mount
//! absorbs the difference. Its residuals stay small and its stated uncertainty too. If the size is an additional
//! unknown s of (1) in `adjust`,
//!     p = X⁻¹ · Mᵢ(eᵢ) · Y · (1 + s) q,                                                                        (1)
//! the data determine it. The method is Gauss–Newton: one step for s with mount, board and every eᵢ eliminated, then
//! the adjustment again with squares of the new size, until s no longer changes. A lens of covariance C adds to the
//! uncertainty, as in `adjust`: a wrong focal length has nearly the same effect as squares of another size. The focal
//! length is tested in the same way. Motions towards the camera determine the focal length; the ratio of the size of
//! the board to motions across the view determines the squares.

use super::adjust;
use super::adjust::{MountAdjustment, prior_weights, scaled_inverse};
use super::chain::{Arrangement, BoardObservation, Chain, LengthFactor, Station};
use nalgebra::{Isometry3, SMatrix, SVector};
use panelprep_base::geometry::statistics::student_quantile;
use panelprep_base::geometry::{Board, Frame, PinholeCamera, Point};
use panelprep_cell::cell::LensCovariance;

const MAX_STEPS: usize = 8;
/// Maximum relative change of the size in the last iteration.
const CONVERGENCE_TOLERANCE: f64 = 1e-7;
/// Probability that a calibration judges a correct size to be wrong.
const FALSE_ALARM_PROBABILITY: f64 = 1e-3;

/// The size of the squares, or the focal length, determined from the motions of the robot.
#[derive(Debug, Clone)]
pub struct SquareSize<A: Arrangement> {
    /// The measured size divided by the stated size; 1 if both agree.
    pub ratio: f64,
    factor: LengthFactor,
    /// Standard deviation of the ratio, including the contribution of the lens.
    pub deviation: f64,
    /// Degrees of freedom with which `deviation` was estimated.
    pub redundancy: f64,
    /// Mount and board with this size.
    pub adjustment: MountAdjustment<A>,
}

impl<A: Arrangement> SquareSize<A> {
    /// Returns the half width of the 95 % confidence interval of the ratio.
    pub fn ratio_95(&self) -> f64 {
        student_quantile(self.redundancy, 0.975) * self.deviation
    }

    /// Returns the distance by which a point in front of the camera moves if this size replaces the stated size, mm.
    pub(super) fn moves_mm(&self, stated: &MountAdjustment<A>, at: Point<A::From>) -> f64 {
        stated.to_from_camera.distance_at_mm(self.adjustment.to_from_camera, at)
    }

    /// Adds the uncertainty of a lens with this covariance.
    pub(super) fn with_lens_uncertainty(
        self,
        camera: &PinholeCamera,
        stations: &[&Station<A::From>],
        lens: &LensCovariance,
    ) -> Option<Self> {
        let (camera, now) = apply_factor(camera, stations, self.ratio, self.factor);
        let step = step(&camera, &now, &self.adjustment, (self.factor, Some(lens)))?;
        Some(SquareSize { deviation: step.deviation * self.ratio, ..self })
    }

    /// Returns whether the data contradict the stated size.
    pub fn contradicts_stated(&self) -> bool {
        let allowed = student_quantile(self.redundancy, 1.0 - FALSE_ALARM_PROBABILITY / 2.0) * self.deviation;
        let off = (self.ratio - 1.0).abs();
        off.is_nan() || allowed.is_nan() || off > allowed
    }
}

/// Returns the station for squares of another size.
pub(super) fn scale_station<C: Frame>(station: &Station<C>, ratio: f64) -> Station<C> {
    let at = |q: &Point<Board>| Point::new(q.mm * ratio);
    let seen = match &station.observation {
        BoardObservation::Pixels(corners) => {
            BoardObservation::Pixels(corners.iter().map(|(q, pixel)| (at(q), *pixel)).collect())
        }
        BoardObservation::Points(corners) => {
            BoardObservation::Points(corners.iter().map(|(q, point)| (at(q), *point)).collect())
        }
    };
    Station { observation: seen, ..station.clone() }
}

/// Returns the camera and the stations with this factor.
fn apply_factor<C: Frame>(
    camera: &PinholeCamera,
    stations: &[&Station<C>],
    ratio: f64,
    of: LengthFactor,
) -> (PinholeCamera, Vec<Station<C>>) {
    match of {
        LengthFactor::Square => (*camera, stations.iter().map(|station| scale_station(station, ratio)).collect()),
        LengthFactor::Focal => {
            let camera = PinholeCamera { fx_px: ratio * camera.fx_px, fy_px: ratio * camera.fy_px, ..*camera };
            (camera, stations.iter().map(|station| (*station).clone()).collect())
        }
    }
}

/// Determines the size from these stations, starting from their adjustment; `None` if they do not determine it.
pub(super) fn measure<A: Arrangement>(
    camera: &PinholeCamera,
    stations: &[&Station<A::From>],
    start: &MountAdjustment<A>,
    of: LengthFactor,
) -> Option<SquareSize<A>> {
    let (mut ratio, mut adjusted) = (1.0, start.clone());
    for _ in 0..MAX_STEPS {
        let (lens, now) = apply_factor(camera, stations, ratio, of);
        let step = step(&lens, &now, &adjusted, (of, None))?;
        // The step is made in the logarithm, so that the size cannot become negative. It is limited, so that even a
        // size that is wrong by a factor of three does not make the adjustment diverge.
        let grown = step.share.clamp(-0.3, 0.3).exp();
        ratio *= grown;
        let (lens, now) = apply_factor(camera, stations, ratio, of);
        let chosen: Vec<&Station<A::From>> = now.iter().collect();
        let from = (&adjusted.to_from_camera, &adjusted.holder_from_board);
        adjusted = adjust::adjust::<A>(&lens, &chosen, from, None).ok()?;
        if (grown - 1.0).abs() < CONVERGENCE_TOLERANCE.max(0.01 * step.deviation) {
            let redundancy = (adjusted.redundancy - 1.0).max(1.0);
            return Some(SquareSize {
                ratio,
                factor: of,
                deviation: step.deviation * ratio,
                redundancy,
                adjustment: adjusted,
            });
        }
    }
    None
}

struct Step {
    share: f64,
    deviation: f64,
}

/// Computes one step of the size, to first order, with the other unknowns eliminated.
fn step<A: Arrangement>(
    camera: &PinholeCamera,
    stations: &[Station<A::From>],
    adjusted: &MountAdjustment<A>,
    (of, lens): (LengthFactor, Option<&LensCovariance>),
) -> Option<Step> {
    let (mount, board) = (adjusted.to_from_camera.isometry(), adjusted.holder_from_board.isometry());
    let (mut normal, mut pull) = (SMatrix::<f64, 13, 13>::zeros(), SVector::<f64, 13>::zeros());
    let mut of_lens = SMatrix::<f64, 13, 9>::zeros();
    for station in stations {
        let chain = Chain::new::<A>(mount, board, &station.base_from_flange, &Isometry3::identity());
        let (gram, size) =
            (chain.gram(camera, &station.observation)?, chain.factor_gram(camera, &station.observation, of)?);
        let lens_cross = chain.lens_cross(camera, &station.observation)?;
        let inverse = (gram.flange() + prior_weights(&adjusted.noise)).cholesky()?.inverse();
        // The cross terms of mount, board and size with the deviation of the flange.
        let mut cross = SMatrix::<f64, 13, 6>::zeros();
        cross.fixed_rows_mut::<12>(0).copy_from(&gram.cross());
        cross.row_mut(12).copy_from(&size.cross_terms.fixed_rows::<6>(12).transpose());
        let mut own = SMatrix::<f64, 13, 13>::zeros();
        own.fixed_view_mut::<12, 12>(0, 0).copy_from(&gram.mount_and_board());
        own.fixed_view_mut::<12, 1>(0, 12).copy_from(&size.cross_terms.fixed_rows::<12>(0));
        own.fixed_view_mut::<1, 12>(12, 0).copy_from(&size.cross_terms.fixed_rows::<12>(0).transpose());
        own[(12, 12)] = size.square;
        let mut gradient = SVector::<f64, 13>::zeros();
        gradient.fixed_rows_mut::<12>(0).copy_from(&gram.gradient.fixed_rows::<12>(0));
        gradient[12] = size.pull;
        let mut by_lens = SMatrix::<f64, 13, 9>::zeros();
        by_lens.fixed_rows_mut::<12>(0).copy_from(&lens_cross.fixed_rows::<12>(0));
        by_lens.row_mut(12).copy_from(&size.lens);
        normal += own - cross * inverse * cross.transpose();
        pull += gradient - cross * inverse * gram.gradient.fixed_rows::<6>(12);
        of_lens += by_lens - cross * inverse * lens_cross.fixed_rows::<6>(12);
    }
    let inverse = scaled_inverse(&normal)?;
    let of_noise = inverse[(12, 12)] * adjusted.noise.corner.powi(2);
    let of_lens = lens.map_or(0.0, |lens| {
        if of == LengthFactor::Focal {
            // A factor of the focal length is itself an error of the lens: only the variance that the lens file states
            // is used.
            return lens[(0, 0)].max(lens[(1, 1)]) / camera.fx_px.powi(2);
        }
        let moved = inverse.row(12) * of_lens;
        (moved * lens * moved.transpose())[(0, 0)]
    });
    let share = (inverse * pull)[12];
    (share.is_finite() && of_noise > 0.0).then(|| Step { share, deviation: (of_noise + of_lens).sqrt() })
}
