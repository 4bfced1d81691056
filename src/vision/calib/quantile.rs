//! The 95 % radius of an error: quantiles for covariances that were estimated from few residuals, and from residuals
//! that are not independent.
//!
//! The errors of an arm that was not calibrated are similar in similar poses, so that several neighbouring poses have
//! the weight of one. `adjust` treats the deviation eᵢ of each pose as independent. If poses i and j at a distance d_ij
//! have errors with the correlation
//!     ρ_ij = (1 − ν) exp(−d_ij² / 2 L²) + ν [i = j],                                                        (1)
//! the n poses determine a mount only as well as n / m independent poses, with
//!     m = Σᵢⱼ ρ_ij / n,                                                                                      (2)
//! the design effect of correlated samples (Kish, Survey Sampling, 1965). L is the correlation length at which the
//! deviations have the largest likelihood; each of their six components has its own variance. L = 0 means that they are
//! independent; another length is used only if its likelihood is clearly larger.
//!
//! The correlation shows only what differs between the poses. An error that is the same for all of them, for example of
//! the zero of axis 1, moves the mount in the coordinates of the arm. This error does not matter for poses that are
//! commanded in these coordinates, and `calibrate touch` measures what remains.

use super::chain::Twist;
use nalgebra::{DMatrix, Matrix3};
use panelprep_base::geometry::statistics::f_quantile;
use panelprep_base::geometry::{Base, Flange, Rigid};

/// Returns the radius of the sphere that contains a normally distributed error with 95 % probability. The covariance,
/// mm², was estimated with `redundancy` degrees of freedom. The sum of three unequal squares is approximated by one χ²
/// with the same mean and variance (Satterthwaite, Biometrics Bulletin 2, 1946).
pub(super) fn radius_95(covariance_mm2: &Matrix3<f64>, redundancy: f64) -> f64 {
    let (trace, square_sum) = (covariance_mm2.trace(), (covariance_mm2 * covariance_mm2).trace());
    if trace <= 0.0 {
        return 0.0;
    }
    let degrees = trace * trace / square_sum;
    (trace * f_quantile(degrees, redundancy, 0.95)).sqrt()
}

/// Distance between poses that is equivalent to a rotation of one radian, mm: the errors of an arm change with its
/// axes, which rotate and move the flange.
const ROTATION_LEVER_MM: f64 = 300.0;
/// ν: fraction of the variance that is independent from pose to pose, because of repeatability and pictures.
const INDEPENDENT_VARIANCE_FRACTION: f64 = 0.1;
/// The correlation lengths L that are tried, mm.
const CORRELATION_LENGTHS_MM: [f64; 7] = [30.0, 60.0, 100.0, 150.0, 220.0, 320.0, 450.0];
/// Minimum increase of the log-likelihood for a correlation. With independent errors, about two of a hundred
/// calibrations reach it by chance; their uncertainty is then too large.
const MIN_LIKELIHOOD_GAIN: f64 = 2.0;
/// Minimum number of poses for the estimate of a correlation.
const MIN_POSES: usize = 6;

/// Returns m of (2), at least 1: the number of poses that have the weight of one independent pose. Each pose is given
/// with the deviation that its picture shows.
pub(super) fn correlated_pose_count(poses: &[(Rigid<Base, Flange>, Twist)]) -> f64 {
    let count = poses.len();
    if count < MIN_POSES {
        return 1.0;
    }
    let distances_mm = DMatrix::from_fn(count, count, |row, column| distance_mm(&poses[row].0, &poses[column].0));
    let deviations = DMatrix::from_fn(count, 6, |row, column| poses[row].1[column]);
    let independent = log_likelihood(&DMatrix::identity(count, count), &deviations);
    let correlated = CORRELATION_LENGTHS_MM.into_iter().filter_map(|length_mm| {
        let correlation = correlation(&distances_mm, length_mm);
        Some((log_likelihood(&correlation, &deviations)?, correlation.sum() / count as f64))
    });
    let best = correlated.max_by(|a, b| a.0.total_cmp(&b.0));
    match (independent, best) {
        (Some(independent), Some((likely, each))) if likely - independent > MIN_LIKELIHOOD_GAIN => each.max(1.0),
        _ => 1.0,
    }
}

fn distance_mm(one: &Rigid<Base, Flange>, other: &Rigid<Base, Flange>) -> f64 {
    one.origin()
        .distance_mm(other.origin())
        .hypot(ROTATION_LEVER_MM * (one.inverse() * *other).rotation_angle().to_rad())
}

/// Returns the correlation matrix (1) of poses at these distances, for a correlation length.
fn correlation(distances_mm: &DMatrix<f64>, length_mm: f64) -> DMatrix<f64> {
    let alike =
        distances_mm.map(|mm| (1.0 - INDEPENDENT_VARIANCE_FRACTION) * (-0.5 * (mm / length_mm).powi(2)).exp());
    alike + DMatrix::identity(distances_mm.nrows(), distances_mm.ncols()) * INDEPENDENT_VARIANCE_FRACTION
}

/// Returns the log-likelihood of all components, up to a constant. Each component has its most likely variance.
fn log_likelihood(correlation: &DMatrix<f64>, deviations: &DMatrix<f64>) -> Option<f64> {
    let (count, factor) = (correlation.nrows() as f64, correlation.clone().cholesky()?);
    let log_determinant = 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
    let component = |column: usize| {
        let values = deviations.column(column);
        let square_sum = values.dot(&factor.solve(&values)).max(f64::MIN_POSITIVE);
        -0.5 * (count * (square_sum / count).ln() + log_determinant)
    };
    Some((0..deviations.ncols()).map(component).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// From tables: the 95 % quantile of χ² with three degrees of freedom is 7.815; with only one dimension the value is
    /// 1.96.
    #[test]
    fn radii_agree_with_tables() {
        assert!((radius_95(&Matrix3::identity(), 1e5) - 7.815_f64.sqrt()).abs() < 0.003);
        let line = Matrix3::from_diagonal(&nalgebra::Vector3::new(4.0, 0.0, 0.0));
        assert!((radius_95(&line, 1e5) - 2.0 * 1.96).abs() < 0.01);
        assert_eq!(radius_95(&Matrix3::zeros(), 10.0), 0.0);
    }

    fn normal(random: &mut Pcg64) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    fn pose(place: Vector3<f64>) -> Rigid<Base, Flange> {
        Rigid::from_isometry_unchecked(Isometry3::new(place, Vector3::zeros()))
    }

    /// Fifteen poses in a cube of 400 mm with independent errors: in about 2 % of 300 sets, a correlation is found by
    /// chance.
    #[test]
    fn independent_errors_show_no_correlation() {
        let mut random = Pcg64::seed_from_u64(1);
        let mut one_set = || {
            let one = |random: &mut Pcg64| {
                let place = Vector3::from_fn(|_, _| 400.0 * random.random::<f64>());
                (pose(place), Twist::from_fn(|_, _| normal(random)))
            };
            let poses: Vec<_> = (0..15).map(|_| one(&mut random)).collect();
            correlated_pose_count(&poses) > 1.0
        };
        let found = (0..300).filter(|_| one_set()).count();
        assert!(found <= 12, "{found} of 300");
    }

    /// Five groups of three poses, 10 mm apart in a group and 1500 mm between groups, with one error for each group:
    /// nearly three poses have the weight of one, because each pose also has an independent part.
    #[test]
    fn a_group_of_similar_poses_has_the_weight_of_one() {
        let mut random = Pcg64::seed_from_u64(2);
        let mut poses = Vec::new();
        for group in 0..5 {
            let common = Twist::from_fn(|_, _| normal(&mut random));
            for index in 0..3 {
                let place = Vector3::new(1_500.0 * f64::from(group), 10.0 * f64::from(index), 0.0);
                poses.push((pose(place), common + Twist::from_fn(|_, _| 0.3 * normal(&mut random))));
            }
        }
        let each = correlated_pose_count(&poses);
        assert!((2.5..3.1).contains(&each), "{each}");
        // Too few poses show no correlation.
        assert_eq!(correlated_pose_count(&poses[..5]), 1.0);
    }

    /// Expected value, calculated by hand for two poses at a distance L: ρ = 0.9 · e^(−½) = 0.545 88 and det = 1 − ρ² =
    /// 0.702 01. The deviations (1, 1) have the weighted sum of squares 2 / (1 + ρ) = 1.293 76, so one component has
    /// the log-likelihood −½ (2 ln 0.646 88 + ln 0.702 01) = 0.612 49.
    #[test]
    fn the_likelihood_is_that_of_a_normal_distribution() {
        let distances = DMatrix::from_row_slice(2, 2, &[0.0, 100.0, 100.0, 0.0]);
        let matrix = correlation(&distances, 100.0);
        assert!((matrix[(0, 1)] - 0.545_88).abs() < 1e-5 && (matrix[(0, 0)] - 1.0).abs() < 1e-12, "{matrix}");
        let found = log_likelihood(&matrix, &DMatrix::from_element(2, 1, 1.0)).expect("regular");
        assert!((found - 0.612_49).abs() < 1e-4, "{found}");
    }
}
