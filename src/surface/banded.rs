//! Cholesky's factorisation of a symmetric positive definite band matrix, which nalgebra does not have.
//!
//! A = L Lᵀ keeps the band: for half-width b it costs n b² instead of n³/3. Row i holds its columns i − b … i.

use nalgebra::Vector3;

/// A pivot below this share of its diagonal element is rounding: the matrix is singular.
const SINGULAR: f64 = 1e-12;

/// The lower half of a symmetric band matrix.
#[derive(Debug, Clone)]
pub struct BandMatrix {
    size: usize,
    half_width: usize,
    // A_ij at i · (b + 1) + b − i + j
    lower: Vec<f64>,
}

impl BandMatrix {
    /// All zero.
    pub fn zeros(size: usize, half_width: usize) -> Self {
        BandMatrix { size, half_width, lower: vec![0.0; size * (half_width + 1)] }
    }

    /// Adds to the element at `row` and `column`, which lies in the lower half of the band.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let index = self.index(row, column);
        self.lower[index] += value;
    }

    /// Solves A x = b; the row at which A proves singular otherwise.
    pub fn solve(mut self, mut right: Vec<Vector3<f64>>) -> Result<Vec<Vector3<f64>>, usize> {
        for row in 0..self.size {
            self.factor(row)?;
        }
        for row in 0..self.size {
            for column in self.first(row)..row {
                let known = right[column];
                right[row] -= known * self.lower[self.index(row, column)];
            }
            right[row] /= self.lower[self.index(row, row)];
        }
        for row in (0..self.size).rev() {
            right[row] /= self.lower[self.index(row, row)];
            for column in self.first(row)..row {
                let known = right[row];
                right[column] -= known * self.lower[self.index(row, column)];
            }
        }
        Ok(right)
    }

    // One row of L from the rows above it.
    fn factor(&mut self, row: usize) -> Result<(), usize> {
        let diagonal = self.lower[self.index(row, row)];
        for column in self.first(row)..=row {
            let from = self.first(row).max(self.first(column));
            let (mine, above) = (self.index(row, from), self.index(column, from));
            let count = column - from;
            let product: f64 = (0..count).map(|k| self.lower[mine + k] * self.lower[above + k]).sum();
            let rest = self.lower[mine + count] - product;
            self.lower[mine + count] = if column < row {
                rest / self.lower[above + count]
            } else if rest > SINGULAR * diagonal {
                rest.sqrt()
            } else {
                return Err(row);
            };
        }
        Ok(())
    }

    fn first(&self, row: usize) -> usize {
        row.saturating_sub(self.half_width)
    }

    fn index(&self, row: usize, column: usize) -> usize {
        row * (self.half_width + 1) + self.half_width + column - row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// By hand: [[4, 2], [2, 5]] x = (8, 9) has x = (11/8, 5/4).
    #[test]
    fn two_by_two() {
        let mut matrix = BandMatrix::zeros(2, 1);
        for (row, column, value) in [(0, 0, 4.0), (1, 0, 2.0), (1, 1, 5.0)] {
            matrix.add(row, column, value);
        }
        let solved = matrix.solve(vec![Vector3::repeat(8.0), Vector3::repeat(9.0)]).expect("definite");
        assert!((solved[0].x - 1.375).abs() < 1e-14 && (solved[1].y - 1.25).abs() < 1e-14);
    }

    #[test]
    fn a_row_without_information_is_named() {
        let mut matrix = BandMatrix::zeros(3, 1);
        for (row, column, value) in [(0, 0, 1.0), (1, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0)] {
            matrix.add(row, column, value);
        }
        assert_eq!(matrix.solve(vec![Vector3::zeros(); 3]), Err(1));
    }

    proptest! {
        #[test]
        fn the_solution_satisfies_the_equations(
            band in prop::collection::vec(-1.0..1.0f64, 60), right in prop::collection::vec(-9.0..9.0f64, 15),
        ) {
            let dense = |i: usize, j: usize| match i.abs_diff(j) {
                0 => 8.0 + band[i * 4],
                gap @ 1..=3 => band[i.max(j) * 4 + gap],
                _ => 0.0,
            };
            let mut matrix = BandMatrix::zeros(15, 3);
            for (row, column) in (0..15usize).flat_map(|i| (i.saturating_sub(3)..=i).map(move |j| (i, j))) {
                matrix.add(row, column, dense(row, column));
            }
            let solved = matrix.solve(right.iter().map(|r| Vector3::repeat(*r)).collect()).expect("dominant");
            for (row, expected) in right.iter().enumerate() {
                let found: f64 = (0..15).map(|column| dense(row, column) * solved[column].x).sum();
                prop_assert!((found - expected).abs() < 1e-10);
            }
        }
    }
}
