//! The 95 % radius of an error: quantiles for covariances that were estimated from few residuals.

use nalgebra::Matrix3;
use statrs::distribution::{ContinuousCDF, FisherSnedecor, StudentsT};

/// Returns the limit below which an F-distributed number with these degrees of freedom lies with this probability.
///
/// Degrees below 1 count as 1: with so little redundancy any statement is a guess, and this is the widest one.
pub(super) fn f_quantile(numerator: f64, denominator: f64, probability: f64) -> f64 {
    FisherSnedecor::new(numerator.max(1.0), denominator.clamp(1.0, 1e5))
        .map_or(f64::INFINITY, |f| f.inverse_cdf(probability))
}

/// Returns the limit below which a number with Student's distribution lies with this probability. Redundancies
/// below 1 count as 1, as in `f_quantile`.
pub fn student_quantile(redundancy: f64, probability: f64) -> f64 {
    StudentsT::new(0.0, 1.0, redundancy.clamp(1.0, 1e5)).map_or(f64::INFINITY, |t| t.inverse_cdf(probability))
}

/// Returns the number of standard errors to each side that contains 95 %, for this redundancy.
pub fn student_95(redundancy: f64) -> f64 {
    student_quantile(redundancy, 0.975)
}

/// Returns the radius of the sphere that contains a normally distributed error with 95 % probability. The
/// covariance, mm², was estimated with `redundancy` degrees of freedom. The sum of three unequal squares is
/// approximated by one χ² of the same mean and variance (Satterthwaite, Biometrics Bulletin 2, 1946).
pub(super) fn radius_95(covariance_mm2: &Matrix3<f64>, redundancy: f64) -> f64 {
    let (trace, square_sum) = (covariance_mm2.trace(), (covariance_mm2 * covariance_mm2).trace());
    if trace <= 0.0 {
        return 0.0;
    }
    let degrees = trace * trace / square_sum;
    (trace * f_quantile(degrees, redundancy, 0.95)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From tables: χ²₃ at 95 % is 7.815; F(3, 12) is 3.49; with only one dimension the value is 1.96.
    #[test]
    fn radii_from_tables() {
        assert!((radius_95(&Matrix3::identity(), 1e5) - 7.815_f64.sqrt()).abs() < 0.003);
        assert!((f_quantile(3.0, 12.0, 0.95) - 3.490).abs() < 0.002);
        assert!((student_95(10.0) - 2.228).abs() < 1e-3 && (student_95(1.0) - 12.706).abs() < 1e-3);
        let line = Matrix3::from_diagonal(&nalgebra::Vector3::new(4.0, 0.0, 0.0));
        assert!((radius_95(&line, 1e5) - 2.0 * 1.96).abs() < 0.01);
        assert_eq!(radius_95(&Matrix3::zeros(), 10.0), 0.0);
    }
}
