//! Medians, quantiles, means and statistical constants that all modules share, and the meaning of "95 %" for errors on
//! a panel.
//!
//! An error in one direction lies within 1.96 standard deviations with a probability of 95 %. The largest error over
//! the whole panel exceeds this limit more often. A plane-to-plane error consists of a shift v along the normal and two
//! tilts, which move the panel's edges by t₁ and t₂. At the four corners the error is v ± t₁ ± t₂, at most |v| + |t₁| +
//! |t₂|. Uniform noise over a rectangle gives
//!     var v = s², var t₁ = var t₂ = 3 s²,   σ at a corner = √7 s,                                                     (1)
//! and (|v| + |t₁| + |t₂|) / (√7 s) is below 2.35 with a probability of 94 %. The result is the same for rectangles of
//! other proportions, since t₁ and t₂ are displacements at the edges. The three degrees of freedom in the plane
//! increase σ but hardly the largest error. For all six degrees of freedom, a Monte Carlo simulation with the
//! localization's covariance gives 95 % at 2.34 on panels of 250 × 180 to 600 × 400 mm. A single degree of freedom
//! would give 1.96.

use statrs::distribution::{ContinuousCDF, FisherSnedecor, StudentsT};

/// An error in one direction lies within this number of standard deviations with a probability of 95 %.
pub const NORMAL_TWO_SIDED_95: f64 = 1.96;
/// 95 % of a normal distribution lie below this number of standard deviations above its mean.
pub const NORMAL_ONE_SIDED_95: f64 = 1.645;
/// Half of a normal distribution lies within this number of standard deviations from its mean.
pub const NORMAL_HALF: f64 = 0.674;
/// The largest error over a panel lies within this number of standard deviations of its worst point. The probability is
/// 95 % according to the localization's covariance, and 94 % according to (1).
pub const PANEL_MAX_95: f64 = 2.35;
/// Ratio of the standard deviation of normal noise to the median of its absolute values.
pub const SIGMA_OF_MEDIAN: f64 = 1.4826;
/// Tukey's constant, in standard deviations: the fit has 95 % of the efficiency of ordinary least squares for normal
/// noise (Beaton & Tukey, Technometrics 16, 1974).
pub const TUKEY_CONSTANT: f64 = 4.685;

/// Returns Tukey's weight, 0…1, of a residual in standard deviations.
pub fn tukey_weight(deviation_in_sigma: f64) -> f64 {
    tukey_weight_within(deviation_in_sigma / TUKEY_CONSTANT)
}

/// Returns Tukey's weight, 0…1, of a deviation that is given as a share of the one from which on the weight is 0.
pub fn tukey_weight_within(share: f64) -> f64 {
    let inner = 1.0 - share.powi(2);
    if inner > 0.0 { inner * inner } else { 0.0 }
}

/// Returns the mean of these values; `None` if there are no values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Returns the square root of the mean square of these values; 0 if there are no values.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    mean(values.into_iter().map(|value| value * value)).map_or(0.0, f64::sqrt)
}

/// A number with a total order.
pub trait TotalOrder: Copy {
    /// Compares by the total order of IEEE 754, in which NaN is the largest value.
    fn order(&self, other: &Self) -> std::cmp::Ordering;
}

impl TotalOrder for f64 {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for std::time::Duration {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        self.cmp(other)
    }
}

impl TotalOrder for f32 {
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        self.total_cmp(other)
    }
}

/// Returns the median of these values, which are reordered; for an even count the larger of the two in the middle.
/// `None` if there are no values.
pub fn median<T: TotalOrder>(values: &mut [T]) -> Option<T> {
    let middle = values.len() / 2;
    (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, T::order).1)
}

/// Returns the median of these values, which are reordered; for an even count the mean of the two in the middle. `None`
/// if there are no values.
pub fn interpolated_median(values: &mut [f64]) -> Option<f64> {
    let is_odd = values.len() % 2 == 1;
    let middle = values.len() / 2;
    let high = median(values)?;
    let low = values[..middle].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some(if is_odd { high } else { (low + high) / 2.0 })
}

/// The rule by which the quantile for a share q is one of n sorted values, which are numbered from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QuantileRank {
    /// The value nearest to q (n − 1).
    Nearest,
    /// The last value up to q (n − 1).
    Lower,
    /// The value with the whole number of q n, at most the last one.
    Floor,
    /// The first value up to which at least the share q of the values lies.
    Covering,
}

/// Returns the quantile of these values, which are reordered, for this share, 0…1. `None` if there are no values.
pub fn quantile<T: TotalOrder>(values: &mut [T], share: f64, rank: QuantileRank) -> Option<T> {
    let count = values.len();
    let last = count.checked_sub(1)?;
    let index = match rank {
        QuantileRank::Nearest => (last as f64 * share).round() as usize,
        QuantileRank::Lower => (last as f64 * share) as usize,
        QuantileRank::Floor => (count as f64 * share) as usize,
        QuantileRank::Covering => ((count as f64 * share).ceil() as usize).saturating_sub(1),
    };
    Some(*values.select_nth_unstable_by(index.min(last), T::order).1)
}

/// Returns the quantile of the F distribution with these degrees of freedom at this probability.
///
/// Degrees below 1 count as 1: with so little redundancy any statement is a guess, and this is the widest one.
pub fn f_quantile(numerator: f64, denominator: f64, probability: f64) -> f64 {
    FisherSnedecor::new(numerator.max(1.0), denominator.clamp(1.0, 1e5))
        .map_or(f64::INFINITY, |f| f.inverse_cdf(probability))
}

/// Returns the quantile of Student's distribution at this probability. Redundancies below 1 count as 1, as in
/// `f_quantile`.
pub fn student_quantile(redundancy: f64, probability: f64) -> f64 {
    StudentsT::new(0.0, 1.0, redundancy.clamp(1.0, 1e5)).map_or(f64::INFINITY, |t| t.inverse_cdf(probability))
}

/// Returns the half width of the 95 % interval in standard errors, for this redundancy.
pub fn student_95(redundancy: f64) -> f64 {
    student_quantile(redundancy, 0.975)
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::Normal;

    /// Evaluates equation (1) of the module documentation numerically: the sum over 80³ equally probable triples (v,
    /// t₁, t₂) gives the probability.
    #[test]
    fn the_largest_corner_error_lies_within_the_factor() {
        let normal = Normal::new(0.0, 1.0).expect("a distribution");
        let one: Vec<f64> = (0..80).map(|k| normal.inverse_cdf(0.5 + (f64::from(k) + 0.5) / 160.0)).collect();
        let limit = PANEL_MAX_95 * 7.0_f64.sqrt();
        let mut within = 0_u32;
        for v in &one {
            for first in &one {
                within +=
                    one.iter().filter(|second| v + 3.0_f64.sqrt() * (first + *second) <= limit).count() as u32;
            }
        }
        let share = f64::from(within) / 80.0_f64.powi(3);
        assert!((0.93..0.96).contains(&share), "{share}");
    }

    #[test]
    fn the_median_is_the_middle_value_or_the_larger_of_two() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0_f32, 1.0, 3.0, 2.0]), Some(3.0));
        assert_eq!(median::<f64>(&mut []), None);
    }

    /// Calculated by hand; the four rules differ for 2 and for 10 values.
    #[test]
    fn quantiles_follow_their_rule() {
        let of = |count: u32, share: f64| {
            let rules = [QuantileRank::Nearest, QuantileRank::Lower, QuantileRank::Floor, QuantileRank::Covering];
            rules.map(|rank| quantile(&mut (0..count).rev().map(f64::from).collect::<Vec<_>>(), share, rank))
        };
        assert_eq!(of(10, 0.95), [9.0, 8.0, 9.0, 9.0].map(Some));
        assert_eq!(of(10, 0.5), [5.0, 4.0, 5.0, 4.0].map(Some));
        assert_eq!(of(2, 0.3), [0.0; 4].map(Some));
        assert_eq!(of(2, 0.6), [1.0, 0.0, 1.0, 1.0].map(Some));
        assert_eq!([of(3, 0.0), of(3, 1.0)], [[0.0; 4].map(Some), [2.0; 4].map(Some)]);
        assert_eq!(of(0, 0.5), [None; 4]);
    }

    /// From tables: the 95 % quantile of F(3, 12) is 3.49.
    #[test]
    fn quantiles_of_distributions_agree_with_tables() {
        assert!((f_quantile(3.0, 12.0, 0.95) - 3.490).abs() < 0.002);
        assert!((student_95(10.0) - 2.228).abs() < 1e-3 && (student_95(1.0) - 12.706).abs() < 1e-3);
    }

    #[test]
    fn means_of_values() {
        assert_eq!((mean([1.0, 2.0, 6.0]), mean([])), (Some(3.0), None));
        assert_eq!((rms([3.0, -4.0, 0.0, 0.0]), rms([])), (2.5, 0.0));
    }

    #[test]
    fn the_median_of_an_even_count_is_the_mean_of_two() {
        assert_eq!(interpolated_median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(interpolated_median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(interpolated_median(&mut []), None);
    }
}
