//! Cholesky's factorisation of a symmetric positive definite band matrix, which nalgebra does not have.
//!
//! A = L Lᵀ preserves the band: for half-width b the cost is n b² instead of n³/3. Row i contains its columns i − b
//! … i. Only the band of the inverse Z is needed, for traces; it follows from Lᵀ Z = L⁻¹, column by column from the
//! last:
//!     Z_ij = (δ_ij / L_jj − Σ_{k>j} L_kj Z_ki) / L_jj,   i ≥ j.
//! Source of the second equation: Erisman & Tinney, Comm. ACM 18(3), 1975.

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
    /// Creates a matrix of zeros.
    pub fn zero(size: usize, half_width: usize) -> Self {
        BandMatrix { size, half_width, lower: vec![0.0; size * (half_width + 1)] }
    }

    /// Adds to the element at `row` and `column`, which lies in the lower half of the band.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let index = self.index(row, column);
        self.lower[index] += value;
    }

    /// Returns the sum of this matrix and a multiple of another matrix of the same shape.
    pub fn add_scaled(&self, other: &BandMatrix, factor: f64) -> BandMatrix {
        let lower = self.lower.iter().zip(&other.lower).map(|(mine, its)| mine + factor * its).collect();
        BandMatrix { lower, ..*self }
    }

    /// Sum of the diagonal.
    pub fn trace(&self) -> f64 {
        (0..self.size).map(|row| self.lower[self.index(row, row)]).sum()
    }

    /// Returns the product A x.
    pub fn times(&self, x: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut product = vec![Vector3::zeros(); self.size];
        for row in 0..self.size {
            for column in self.first_column(row)..row {
                let element = self.lower[self.index(row, column)];
                product[row] += x[column] * element;
                product[column] += x[row] * element;
            }
            product[row] += x[row] * self.lower[self.index(row, row)];
        }
        product
    }

    /// Factorises the matrix; on failure returns the row at which A is found to be singular.
    pub fn factorise(mut self) -> Result<CholeskyFactor, usize> {
        for row in 0..self.size {
            self.factor_row(row)?;
        }
        Ok(CholeskyFactor { matrix: self })
    }

    // Computes one row of L from the rows above it.
    fn factor_row(&mut self, row: usize) -> Result<(), usize> {
        let diagonal = self.lower[self.index(row, row)];
        for column in self.first_column(row)..=row {
            let from = self.first_column(row).max(self.first_column(column));
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

    fn first_column(&self, row: usize) -> usize {
        row.saturating_sub(self.half_width)
    }

    fn index(&self, row: usize, column: usize) -> usize {
        row * (self.half_width + 1) + self.half_width + column - row
    }
}

/// L of A = L Lᵀ.
#[derive(Debug, Clone)]
pub struct CholeskyFactor {
    matrix: BandMatrix,
}

impl CholeskyFactor {
    /// Solves A x = b.
    pub fn solve(&self, mut right: Vec<Vector3<f64>>) -> Vec<Vector3<f64>> {
        let l = &self.matrix;
        for row in 0..l.size {
            for column in l.first_column(row)..row {
                let known = right[column];
                right[row] -= known * l.lower[l.index(row, column)];
            }
            right[row] /= l.lower[l.index(row, row)];
        }
        for row in (0..l.size).rev() {
            right[row] /= l.lower[l.index(row, row)];
            for column in l.first_column(row)..row {
                let known = right[row];
                right[column] -= known * l.lower[l.index(row, column)];
            }
        }
        right
    }

    /// tr(A⁻¹ B) for a B of A's shape.
    pub fn trace_inverse_times(&self, other: &BandMatrix) -> f64 {
        let l = &self.matrix;
        let mut inverse = BandMatrix::zero(l.size, l.half_width);
        let mut trace = 0.0;
        for column in (0..l.size).rev() {
            let pivot = l.lower[l.index(column, column)];
            let last = (column + l.half_width).min(l.size - 1);
            for row in (column..=last).rev() {
                let product: f64 = (column + 1..=last)
                    .map(|k| l.lower[l.index(k, column)] * inverse.lower[l.index(k.max(row), k.min(row))])
                    .sum();
                let unit = if row == column { 1.0 / pivot } else { 0.0 };
                let element = (unit - product) / pivot;
                inverse.add(row, column, element);
                let twice = if row == column { 1.0 } else { 2.0 };
                trace += twice * element * other.lower[l.index(row, column)];
            }
        }
        trace
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Calculated by hand: [[4, 2], [2, 5]] x = (8, 9) has x = (11/8, 5/4).
    #[test]
    fn two_by_two() {
        let mut matrix = BandMatrix::zero(2, 1);
        for (row, column, value) in [(0, 0, 4.0), (1, 0, 2.0), (1, 1, 5.0)] {
            matrix.add(row, column, value);
        }
        let solved = matrix.factorise().expect("definite").solve(vec![Vector3::repeat(8.0), Vector3::repeat(9.0)]);
        assert!((solved[0].x - 1.375).abs() < 1e-14 && (solved[1].y - 1.25).abs() < 1e-14);
    }

    #[test]
    fn a_row_without_information_is_named() {
        let mut matrix = BandMatrix::zero(3, 1);
        for (row, column, value) in [(0, 0, 1.0), (1, 0, 1.0), (1, 1, 1.0), (2, 2, 1.0)] {
            matrix.add(row, column, value);
        }
        assert_eq!(matrix.factorise().err(), Some(1));
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
            let mut matrix = BandMatrix::zero(15, 3);
            for (row, column) in (0..15usize).flat_map(|i| (i.saturating_sub(3)..=i).map(move |j| (i, j))) {
                matrix.add(row, column, dense(row, column));
            }
            let right: Vec<_> = right.into_iter().map(Vector3::repeat).collect();
            let factor = matrix.clone().factorise().expect("dominant");
            let solved = factor.solve(right.clone());
            for (row, expected) in right.iter().enumerate() {
                let found: f64 = (0..15).map(|column| dense(row, column) * solved[column].x).sum();
                prop_assert!((found - expected.x).abs() < 1e-10);
            }
            for (found, expected) in matrix.times(&solved).iter().zip(&right) {
                prop_assert!((found - expected).norm() < 1e-10);
            }
            // tr(A⁻¹ A) is the size, tr(A⁻¹ I) the trace of the dense inverse.
            prop_assert!((factor.trace_inverse_times(&matrix) - 15.0).abs() < 1e-10);
            let mut one = BandMatrix::zero(15, 3);
            (0..15).for_each(|i| one.add(i, i, 1.0));
            let whole = nalgebra::DMatrix::from_fn(15, 15, |i, j| dense(i.max(j), i.min(j)));
            let trace = whole.try_inverse().expect("dominant").trace();
            prop_assert!((factor.trace_inverse_times(&one) - trace).abs() < 1e-10);
        }
    }
}
