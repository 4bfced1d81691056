//! The median, statistical constants that all modules share, and the meaning of "95 %" for errors on a panel.
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

/// Limit of an error in one direction, in standard deviations, with a probability of 95 %.
pub const NORMAL_TWO_SIDED_95: f64 = 1.96;
/// Limit of the largest error over a panel, in standard deviations of the panel's worst point. The probability is 95 %
/// according to the localization's covariance, and 94 % according to (1).
pub const PANEL_MAX_95: f64 = 2.35;
/// Ratio of the standard deviation of normal noise to the median of its absolute values.
pub const SIGMA_OF_MEDIAN: f64 = 1.4826;
/// Tukey's constant, in standard deviations: the fit has 95 % of the efficiency of ordinary least squares for normal
/// noise (Beaton & Tukey, Technometrics 16, 1974).
pub const TUKEY_CONSTANT: f64 = 4.685;

/// Returns Tukey's weight, 0…1, of a residual in standard deviations.
pub fn tukey_weight(deviation_in_sigma: f64) -> f64 {
    let inner = 1.0 - (deviation_in_sigma / TUKEY_CONSTANT).powi(2);
    if inner > 0.0 { inner * inner } else { 0.0 }
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
pub fn median_in_place(values: &mut [f64]) -> Option<f64> {
    let is_odd = values.len() % 2 == 1;
    let middle = values.len() / 2;
    let high = median(values)?;
    let low = values[..middle].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some(if is_odd { high } else { (low + high) / 2.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ContinuousCDF, Normal};

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

    #[test]
    fn the_median_of_an_even_count_is_the_mean_of_two() {
        assert_eq!(median_in_place(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median_in_place(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(median_in_place(&mut []), None);
    }
}
