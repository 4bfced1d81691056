//! The normal equations of the fit, and the smoothing that the noise requires.
//!
//! With weights w_q and basis functions N_n = N_i(u) N_j(v) of the control points c_n,
//!     (A + λ P) c = b,   A_nm = Σ_q w_q N_n N_m,   b_n = Σ_q w_q N_n P_q,                              (1)
//! P the sum of squared second differences of neighbouring control points over their Greville abscissae, along u
//! and along v: zero for a flat net. λ is the one with the least unbiased estimate of the risk for noise σ,
//!     R(λ) = Σ_q w_q |S(u_q, v_q) − P_q|² + 2 σ² tr (A + λ P)⁻¹ A,                                      (2)
//! searched in decades. The noise lies along the rays alone, hence one trace for three coordinates. Source of (2):
//! Craven & Wahba, Numer. Math. 31, 1979, for a known σ.

use super::banded::BandMatrix;
use super::samples::{Sample, Samples};
use nalgebra::Vector3;
use panelprep_base::geometry::basis::{DEGREE, KnotVector, SpanFunctions};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Control points that influence a span, along one parameter.
const SIDE: usize = DEGREE + 1;
/// Control points that influence a pair of spans.
const LOCAL: usize = SIDE * SIDE;
/// Pairs of functions of one span along one parameter, (0, 0), (1, 0), (1, 1), (2, 0) …
const PAIRS: usize = SIDE * (SIDE + 1) / 2;
/// Decades of λ, relative to the mean diagonal elements of A and P. The smallest value still determines control
/// points that no point of the scan influences.
const DECADES: std::ops::RangeInclusive<i32> = -8..=2;

/// The contribution of one pair of spans. With N_n = N_a(u) N_b(v), the sums of N_n N_m are the sums of the
/// products of a pair along u with a pair along v.
struct Block {
    pairs: [[f64; PAIRS]; PAIRS],
    rhs: [Vector3<f64>; LOCAL],
    square: f64,
}

/// A, b and Σ w |P|², points measured from `centre`.
pub(super) struct SurfaceEquations {
    matrix: BandMatrix,
    rhs: Vec<Vector3<f64>>,
    square: f64,
    centre: Vector3<f64>,
    roughness: BandMatrix,
}

/// Control points with the smoothing with which they were computed.
pub(super) struct Solution {
    pub controls: Vec<Vector3<f64>>,
    /// λ, relative.
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
            for n in 0..LOCAL {
                equations.rhs[control(n)] += block.rhs[n];
                for m in 0..=n {
                    equations.matrix.add(control(n), control(m), block.basis_products(n, m));
                }
            }
        }
        equations
    }

    /// Returns the solution with the least smoothing; on failure the row that is not determined.
    pub fn solve_plain(&self) -> Result<Solution, usize> {
        Ok(self.solve(*DECADES.start(), 0.0)?.0)
    }

    /// The solution with the smoothing that noise of `noise_mm` requires.
    pub fn solve_smoothed(&self, noise_mm: f64) -> Result<Solution, usize> {
        let mut best = self.solve(*DECADES.start(), noise_mm)?;
        for decade in DECADES.skip(1) {
            let next = self.solve(decade, noise_mm)?;
            // The risk has only one minimum.
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
        Block { pairs: [[0.0; PAIRS]; PAIRS], rhs: [Vector3::zeros(); LOCAL], square: 0.0 }
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

    /// Σ w N_n N_m.
    fn basis_products(&self, n: usize, m: usize) -> f64 {
        let pair = |a: usize, b: usize| a.max(b) * (a.max(b) + 1) / 2 + a.min(b);
        self.pairs[pair(n / SIDE, m / SIDE)][pair(n % SIDE, m % SIDE)]
    }
}

/// Returns coefficients power by power: [k][r] is that of t^k in N_r.
fn columns(functions: &SpanFunctions) -> [[f64; SIDE]; SIDE] {
    std::array::from_fn(|k| std::array::from_fn(|r| functions.coefficients[r][k]))
}

#[inline]
fn values(columns: &[[f64; SIDE]; SIDE], t: f64) -> [f64; SIDE] {
    std::array::from_fn(|r| ((columns[3][r] * t + columns[2][r]) * t + columns[1][r]) * t + columns[0][r])
}

#[inline]
fn basis_pairs(values: &[f64; SIDE]) -> [f64; PAIRS] {
    let mut pairs = [0.0; PAIRS];
    let mut next = 0;
    for a in 0..SIDE {
        for b in 0..=a {
            pairs[next] = values[a] * values[b];
            next += 1;
        }
    }
    pairs
}

/// P of Eq. 1.
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

/// Returns the weights of three neighbouring control points in a second difference, for spans of length 1.
fn second_differences(knots: &KnotVector) -> Vec<[f64; 3]> {
    let domain = knots.domain();
    let span = (domain.end() - domain.start()) / knots.spans() as f64;
    let difference = |at: &[f64]| {
        let (before, after) = ((at[1] - at[0]) / span, (at[2] - at[1]) / span);
        [1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after]
    };
    knots.greville_abscissa().windows(3).map(difference).collect()
}
