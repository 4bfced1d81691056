//! Bounded least squares with a sparse matrix, by coordinate descent.
//!
//! Minimises
//!     Σᵢ (Σⱼ aᵢⱼ xⱼ − yᵢ)² + μ Σⱼ hⱼ (xⱼ − ½ (xⱼ₋₁ + xⱼ₊₁))²,   low ≤ x ≤ high, with hⱼ = Σᵢ aᵢⱼ².
//! Each step sets one x to the minimum along its axis, clipped to its bounds: the sum never increases, and reaches its
//! minimum because it is convex. The second term keeps neighbours similar if the first term does not determine them.
//! Source: Tseng, J. Optim. Theory Appl. 109, 2001.

/// A sparse matrix, stored by columns.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<f32>,
}

impl Columns {
    /// Appends a column: the rows with non-zero entries, each with its value.
    pub fn push(&mut self, column: impl IntoIterator<Item = (u32, f32)>) {
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        for (row, value) in column {
            self.rows.push(row);
            self.values.push(value);
        }
        self.starts.push(self.rows.len());
    }

    /// Returns the number of columns.
    pub fn count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    fn column(&self, index: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[index]..self.starts[index + 1];
        let rows = self.rows[range.clone()].iter().map(|row| *row as usize);
        rows.zip(self.values[range].iter().map(|value| f64::from(*value)))
    }

    /// Returns A x, over this number of rows.
    pub fn times(&self, x: &[f64], rows: usize) -> Vec<f64> {
        let mut sums = vec![0.0; rows];
        for (index, x) in x.iter().enumerate().take(self.count()) {
            self.column(index).for_each(|(row, value)| sums[row] += value * x);
        }
        sums
    }
}

/// Target of the descent.
#[derive(Debug, Clone, Copy)]
pub struct DescentTarget<'a> {
    /// The target vector y.
    pub target: &'a [f64],
    /// Lowest and highest x.
    pub bounds: &'a [[f64; 2]],
    /// Weight of the smoothing, μ.
    pub smoothing_weight: f64,
    /// Number of iterations over all unknowns.
    pub rounds: usize,
}

/// Returns the x that minimises the sum, beginning with a start within the bounds.
pub fn minimise_bounded(columns: &Columns, mut x: Vec<f64>, sought: &DescentTarget<'_>) -> Vec<f64> {
    let count = columns.count().min(x.len()).min(sought.bounds.len());
    let mut over = columns.times(&x, sought.target.len());
    over.iter_mut().zip(sought.target).for_each(|(sum, wanted)| *sum -= wanted);
    let squares: Vec<f64> =
        (0..count).map(|index| columns.column(index).map(|(_, value)| value * value).sum()).collect();
    for _ in 0..sought.rounds {
        for index in 0..count {
            let square = squares[index];
            // A move that removes nothing on the treated area has no best feed; it keeps its start.
            if square <= 0.0 {
                continue;
            }
            let slope: f64 = columns.column(index).map(|(row, value)| value * over[row]).sum();
            let beside = [index.checked_sub(1), Some(index + 1).filter(|next| *next < count)];
            let beside: Vec<f64> = beside.into_iter().flatten().map(|other| x[other]).collect();
            let mean = beside.iter().sum::<f64>() / beside.len().max(1) as f64;
            let pull = if beside.is_empty() { 0.0 } else { sought.smoothing_weight };
            let [low, high] = sought.bounds[index];
            // The pull is in units of the column's own square, so that μ means the same for a move that removes much
            // and one that removes little.
            let best = x[index] - (slope + pull * square * (x[index] - mean)) / (square * (1.0 + pull));
            // Clamped in each step: for a convex problem the descent then ends at the best feeds within the limits, not
            // at clamped best feeds.
            let step = best.clamp(low, high) - x[index];
            if step != 0.0 {
                x[index] += step;
                columns.column(index).for_each(|(row, value)| over[row] += value * step);
            }
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sought<'a>(wanted: &'a [f64], bounds: &'a [[f64; 2]]) -> DescentTarget<'a> {
        DescentTarget { target: wanted, bounds, smoothing_weight: 0.0, rounds: 200 }
    }

    /// Calculated by hand: x₀ + x₁ = 3 and x₁ = 2 are satisfied by (1, 2); with x₁ ≤ 1 the best x₀ is 2.
    #[test]
    fn two_unknowns_and_a_bound() {
        let mut columns = Columns::default();
        columns.push([(0, 1.0)]);
        columns.push([(0, 1.0), (1, 1.0)]);
        let x = minimise_bounded(&columns, vec![0.0, 0.0], &sought(&[3.0, 2.0], &[[0.0, 9.0]; 2]));
        assert!((x[0] - 1.0).abs() < 1e-6 && (x[1] - 2.0).abs() < 1e-6, "{x:?}");
        let x = minimise_bounded(&columns, vec![0.0, 0.0], &sought(&[3.0, 2.0], &[[0.0, 9.0], [0.0, 1.0]]));
        assert!((x[0] - 2.0).abs() < 1e-6 && x[1] == 1.0, "{x:?}");
        assert_eq!(columns.times(&[1.0, 2.0], 2), [3.0, 2.0]);
    }

    proptest! {
        /// At the end, no change of a single unknown gives a smaller sum, and all unknowns are within their bounds.
        #[test]
        fn no_step_makes_it_better(
            values in prop::collection::vec(0.0..1.0f32, 24), wanted in prop::collection::vec(0.0..3.0f64, 6),
        ) {
            let mut columns = Columns::default();
            for column in values.chunks(6) {
                columns.push(column.iter().enumerate().map(|(row, value)| (row as u32, *value)));
            }
            let bounds = [[0.2, 1.0]; 4];
            let x = minimise_bounded(&columns, vec![0.5; 4], &DescentTarget { rounds: 2_000, ..sought(&wanted, &bounds) });
            let sum = |x: &[f64]| {
                let found = columns.times(x, 6);
                found.iter().zip(&wanted).map(|(found, wanted)| (found - wanted).powi(2)).sum::<f64>()
            };
            for index in 0..4 {
                prop_assert!((0.2..=1.0).contains(&x[index]));
                for step in [-1e-3, 1e-3] {
                    let mut other = x.clone();
                    other[index] = (other[index] + step).clamp(0.2, 1.0);
                    prop_assert!(sum(&other) > sum(&x) - 1e-9);
                }
            }
        }
    }
}
