//! The normal equations of the fit, the smoothing that the noise requires, and the factorisation that solves them.
//!
//! With weights w_q and basis functions N_n = N_i(u) N_j(v) of the control points c_n,
//!     (A + λ P) c = b,   A_nm = Σ_q w_q N_n N_m,   b_n = Σ_q w_q N_n P_q,                              (1)
//! with P the sum of squared second differences of adjacent control points over their Greville abscissae, along u and
//! along v: zero for a plane net. λ is the value with the smallest unbiased estimate of the risk for noise σ,
//!     R(λ) = Σ_q w_q |S(u_q, v_q) − P_q|² + 2 σ² tr (A + λ P)⁻¹ A,                                      (2)
//! searched in decades. The noise acts only along the rays; therefore the trace counts once for the three coordinates.
//! Source of (2): Craven & Wahba, Numer. Math. 31, 1979, for a known σ.
//!
//! The matrix is a symmetric positive definite band matrix; nalgebra has no Cholesky factorisation for band matrices. A
//! = L Lᵀ preserves the band: for half-width b the cost is n b² instead of n³/3. Row i contains its columns i − b … i.
//! Only the band of the inverse Z is needed, for traces; it follows from Lᵀ Z = L⁻¹, column by column from the last:
//!     Z_ij = (δ_ij / L_jj − Σ_{k>j} L_kj Z_ki) / L_jj,   i ≥ j.                                         (3)
//! Source of (3): Erisman & Tinney, Comm. ACM 18(3), 1975.

use super::samples::{Sample, Samples};
use nalgebra::Vector3;
use panelprep_base::geometry::basis::{DEGREE, KnotVector, SpanFunctions};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Number of control points that influence a span, along one parameter.
const SIDE: usize = DEGREE + 1;
/// Number of control points that influence a pair of spans.
const CONTROLS_PER_SPAN_PAIR: usize = SIDE * SIDE;
/// Number of pairs of basis functions of one span along one parameter, (0, 0), (1, 0), (1, 1), (2, 0) …
const FUNCTION_PAIRS: usize = SIDE * (SIDE + 1) / 2;
/// Range of the decades of λ, relative to the mean diagonal elements of A and P. Also with the smallest value, control
/// points that are not influenced by any scan point are determined.
const SMOOTHING_DECADES: std::ops::RangeInclusive<i32> = -8..=2;
/// Minimum pivot as a fraction of its diagonal element; a smaller pivot is a rounding error, and the matrix is
/// singular.
const MIN_PIVOT_RATIO: f64 = 1e-12;

/// The contribution of one pair of spans to the equations. With N_n = N_a(u) N_b(v), the sums of N_n N_m are the sums
/// of the products of a pair along u with a pair along v.
struct Block {
    pairs: [[f64; FUNCTION_PAIRS]; FUNCTION_PAIRS],
    rhs: [Vector3<f64>; CONTROLS_PER_SPAN_PAIR],
    square: f64,
}

/// A, b and Σ w |P|² of Eq. 1; points are measured from `centre`.
pub(super) struct SurfaceEquations {
    matrix: BandMatrix,
    rhs: Vec<Vector3<f64>>,
    square: f64,
    centre: Vector3<f64>,
    roughness: BandMatrix,
}

/// The computed control points, and their smoothing.
pub(super) struct Solution {
    pub controls: Vec<Vector3<f64>>,
    /// The smoothing λ, relative to the data.
    pub smoothing: f64,
}

impl SurfaceEquations {
    /// Computes the sums over all samples, each with its weight.
    pub fn from_samples(samples: &Samples, weights: &[Vec<f64>], centre: Vector3<f64>) -> Self {
        let band = |(samples_of_band, weights): (&Vec<Sample>, &Vec<f64>)| {
            let mut blocks: BTreeMap<u32, Block> = BTreeMap::new();
            let mut rest = weights.as_slice();
            for run in samples_of_band.chunk_by(|a, b| a.cell == b.cell) {
                let (weights, after) = rest.split_at(run.len());
                rest = after;
                let [span_u, span_v] = samples.spans(run[0].cell as usize);
                let functions = [&samples.functions[0][span_u], &samples.functions[1][span_v]];
                blocks.entry(run[0].cell).or_insert_with(Block::zero).add(run, weights, functions, centre);
            }
            blocks
        };
        let bands: Vec<BTreeMap<u32, Block>> = samples.bands.par_iter().zip(weights).map(band).collect();
        let [knots_u, knots_v] = &samples.knots;
        let (spans_v, stride) = (knots_v.spans(), knots_v.controls());
        let size = knots_u.controls() * stride;
        let mut equations = SurfaceEquations {
            matrix: BandMatrix::zero(size, DEGREE * (stride + 1)),
            rhs: vec![Vector3::zeros(); size],
            square: 0.0,
            centre,
            roughness: roughness_matrix(&samples.knots),
        };
        for (cell, block) in bands.iter().flatten() {
            let cell = *cell as usize;
            let control = |n: usize| (cell / spans_v + n / SIDE) * stride + cell % spans_v + n % SIDE;
            equations.square += block.square;
            for n in 0..CONTROLS_PER_SPAN_PAIR {
                equations.rhs[control(n)] += block.rhs[n];
                for m in 0..=n {
                    equations.matrix.add(control(n), control(m), block.basis_products(n, m));
                }
            }
        }
        equations
    }

    /// Returns the solution with the smallest smoothing. On failure, returns the row that is not determined.
    pub fn solve_with_least_smoothing(&self) -> Result<Solution, usize> {
        Ok(self.solve(*SMOOTHING_DECADES.start(), 0.0)?.0)
    }

    /// Returns the solution with the smoothing that noise of `noise_mm` requires. On failure, returns the row that is
    /// not determined.
    pub fn solve_smoothed(&self, noise_mm: f64) -> Result<Solution, usize> {
        let mut best = self.solve(*SMOOTHING_DECADES.start(), noise_mm)?;
        for decade in SMOOTHING_DECADES.skip(1) {
            let next = self.solve(decade, noise_mm)?;
            // The risk has only one minimum, so the search ends when it increases.
            if next.1 > best.1 {
                break;
            }
            best = next;
        }
        Ok(best.0)
    }

    // Returns the solution for one λ with its risk, Eq. 2.
    fn solve(&self, decade: i32, noise_mm: f64) -> Result<(Solution, f64), usize> {
        let smoothing = 10.0_f64.powi(decade);
        let factor = smoothing * self.matrix.trace() / self.roughness.trace();
        let factored = self.matrix.add_scaled(&self.roughness, factor).factorise()?;
        let controls = factored.solve(self.rhs.clone());
        let images = self.matrix.times(&controls);
        let crossed = |others: &[Vector3<f64>]| controls.iter().zip(others).map(|(c, o)| c.dot(o)).sum::<f64>();
        let misfit = self.square - 2.0 * crossed(&self.rhs) + crossed(&images);
        let freedom = if noise_mm > 0.0 { factored.trace_inverse_times(&self.matrix) } else { 0.0 };
        let controls = controls.into_iter().map(|control| control + self.centre).collect();
        Ok((Solution { controls, smoothing }, misfit + 2.0 * noise_mm * noise_mm * freedom))
    }
}

impl Block {
    fn zero() -> Self {
        Block {
            pairs: [[0.0; FUNCTION_PAIRS]; FUNCTION_PAIRS],
            rhs: [Vector3::zeros(); CONTROLS_PER_SPAN_PAIR],
            square: 0.0,
        }
    }

    fn add(&mut self, run: &[Sample], weights: &[f64], [on_u, on_v]: [&SpanFunctions; 2], centre: Vector3<f64>) {
        let (on_u, on_v) = (columns(on_u), columns(on_v));
        for (sample, weight) in run.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
            let (u, v) = (values(&on_u, sample.local[0]), values(&on_v, sample.local[1]));
            let pairs_v = basis_pairs(&v);
            for (sums, pair_u) in self.pairs.iter_mut().zip(basis_pairs(&u)) {
                let weighted = weight * pair_u;
                for (sum, pair_v) in sums.iter_mut().zip(&pairs_v) {
                    *sum += weighted * pair_v;
                }
            }
            let mm = sample.mm - centre;
            for (n, sum) in self.rhs.iter_mut().enumerate() {
                *sum += mm * (weight * u[n / SIDE] * v[n % SIDE]);
            }
            self.square += weight * mm.norm_squared();
        }
    }

    /// Returns the sum Σ w N_n N_m.
    fn basis_products(&self, n: usize, m: usize) -> f64 {
        let pair = |a: usize, b: usize| a.max(b) * (a.max(b) + 1) / 2 + a.min(b);
        self.pairs[pair(n / SIDE, m / SIDE)][pair(n % SIDE, m % SIDE)]
    }
}

/// Returns the coefficients ordered by powers: element [k][r] is the coefficient of t^k in N_r.
fn columns(functions: &SpanFunctions) -> [[f64; SIDE]; SIDE] {
    std::array::from_fn(|k| std::array::from_fn(|r| functions.coefficients[r][k]))
}

#[inline]
fn values(columns: &[[f64; SIDE]; SIDE], t: f64) -> [f64; SIDE] {
    std::array::from_fn(|r| ((columns[3][r] * t + columns[2][r]) * t + columns[1][r]) * t + columns[0][r])
}

#[inline]
fn basis_pairs(values: &[f64; SIDE]) -> [f64; FUNCTION_PAIRS] {
    let mut pairs = [0.0; FUNCTION_PAIRS];
    let mut next = 0;
    for a in 0..SIDE {
        for b in 0..=a {
            pairs[next] = values[a] * values[b];
            next += 1;
        }
    }
    pairs
}

/// Returns the matrix P of Eq. 1.
fn roughness_matrix(knots: &[KnotVector; 2]) -> BandMatrix {
    let stride = knots[1].controls();
    let size = knots[0].controls() * stride;
    let mut matrix = BandMatrix::zero(size, DEGREE * (stride + 1));
    let [along_u, along_v] = [0, 1].map(|axis| second_differences(&knots[axis]));
    let mut add = |controls: [usize; 3], weights: [f64; 3]| {
        for n in 0..3 {
            for m in 0..=n {
                matrix.add(controls[n], controls[m], weights[n] * weights[m]);
            }
        }
    };
    for (i, weights) in along_u.iter().enumerate() {
        for j in 0..stride {
            add([0, 1, 2].map(|k| (i + k) * stride + j), *weights);
        }
    }
    for i in 0..knots[0].controls() {
        for (j, weights) in along_v.iter().enumerate() {
            add([0, 1, 2].map(|k| i * stride + j + k), *weights);
        }
    }
    matrix
}

/// Returns the weights of three successive control points in a second difference, for spans of length 1.
fn second_differences(knots: &KnotVector) -> Vec<[f64; 3]> {
    let domain = knots.domain();
    let span = (domain.end() - domain.start()) / knots.spans() as f64;
    let difference = |at: &[f64]| {
        let (before, after) = ((at[1] - at[0]) / span, (at[2] - at[1]) / span);
        [1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after]
    };
    knots.greville_abscissa().windows(3).map(difference).collect()
}

/// A symmetric band matrix, stored as its lower half.
#[derive(Debug, Clone)]
struct BandMatrix {
    size: usize,
    half_width: usize,
    // The element A_ij at index i · (b + 1) + b − i + j.
    lower: Vec<f64>,
}

impl BandMatrix {
    /// Creates a matrix of zeros with this size and half-width of the band.
    pub fn zero(size: usize, half_width: usize) -> Self {
        BandMatrix { size, half_width, lower: vec![0.0; size * (half_width + 1)] }
    }

    /// Adds a value to an element in the lower half of the band.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let index = self.index(row, column);
        self.lower[index] += value;
    }

    /// Returns the sum of this matrix and a multiple of another matrix of the same shape.
    pub fn add_scaled(&self, other: &BandMatrix, factor: f64) -> BandMatrix {
        let lower = self.lower.iter().zip(&other.lower).map(|(mine, its)| mine + factor * its).collect();
        BandMatrix { lower, ..*self }
    }

    /// Returns the sum of the diagonal elements.
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

    /// Factorises the matrix. On failure, returns the row at which the matrix is found to be singular.
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
            } else if rest > MIN_PIVOT_RATIO * diagonal {
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

/// The factor L of A = L Lᵀ.
#[derive(Debug, Clone)]
struct CholeskyFactor {
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

    /// Returns tr(A⁻¹ B) for a matrix B with the band of A.
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

    /// Expected value, calculated by hand: [[4, 2], [2, 5]] x = (8, 9) has x = (11/8, 5/4).
    #[test]
    fn a_system_of_two_equations_is_solved() {
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
