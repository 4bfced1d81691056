//! The uniformity of the times under the disc: their 5 % and 95 % quantiles over the treated area.

/// Fractions of the treated area for the quantiles of the times.
const SHARES: [f64; 2] = [0.05, 0.95];

/// Numbers in ascending order, each with the area to which it applies.
#[derive(Debug, Clone, PartialEq)]
pub struct AreaWeighted(Vec<(f64, f64)>);

impl AreaWeighted {
    /// Sorts numbers with their areas.
    pub fn from_values(numbers: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut sorted: Vec<(f64, f64)> = numbers.collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        AreaWeighted(sorted)
    }

    /// The quantile of the numbers for this share of the area; `None` if there is no number.
    pub fn quantile_by_area(&self, share: f64) -> Option<f64> {
        let mut left = share * self.0.iter().map(|(_, area)| area).sum::<f64>();
        let found = self.0.iter().find(|(_, area)| {
            left -= area;
            left <= 0.0
        });
        // A rounding remainder is assigned to the largest number.
        found.or(self.0.last()).map(|(number, _)| *number)
    }
}

/// The 5 % and 95 % quantiles of the time under the disc over the treated area. The treated area is the area that the
/// disc reaches; the coverage reports the remaining area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DwellSpread {
    /// The 5 % quantile of the time under the disc, s.
    pub low_s: f64,
    /// The 95 % quantile of the time under the disc, s.
    pub high_s: f64,
}

impl DwellSpread {
    /// Computed from times in s, each with its area; `None` if nothing was under the disc.
    pub fn from_times(times: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let treated = AreaWeighted::from_values(times.filter(|(time_s, _)| *time_s > 0.0));
        let [low_s, high_s] = SHARES.map(|share| treated.quantile_by_area(share));
        Some(DwellSpread { low_s: low_s?, high_s: high_s? })
    }

    /// Returns the long time divided by the short time.
    pub fn ratio(&self) -> f64 {
        self.high_s / self.low_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: of 100 points of 1 mm² with 0.01 to 1.00 s the fifth has 0.05 s and the 95th 0.95 s. A
    /// point that the disc did not reach is not treated, and a point of twice the area counts twice.
    #[test]
    fn five_and_ninety_five_percent_of_the_area() {
        let even = |n: usize| (n as f64 / 100.0, 1.0);
        let spread = DwellSpread::from_times((0..=100).map(even)).expect("treated");
        assert!((spread.low_s - 0.05).abs() < 1e-12 && (spread.high_s - 0.95).abs() < 1e-12, "{spread:?}");
        assert!((spread.ratio() - 19.0).abs() < 1e-9);
        let doubled = DwellSpread::from_times([(1.0, 2.0), (2.0, 17.0), (5.0, 1.0)].into_iter()).expect("treated");
        assert_eq!((doubled.low_s, doubled.high_s), (1.0, 2.0));
        assert_eq!(DwellSpread::from_times([(0.0, 1.0)].into_iter()), None);
    }
}
