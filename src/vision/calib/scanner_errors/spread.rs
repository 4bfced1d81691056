//! Estimates the size of a scan's smooth error and the length over which it is correlated, from its mean squares in
//! blocks and in parts of the board.
//!
//! Residuals r = M e are the remainder of the errors e after a plane. For errors with the covariance σ² K, K = exp(−h²
//! π / L²) over the distances h on the board, the mean squares of blocks and of means over k × k parts (A) are
//! expected to be
//!     E |r|² = σ² tr(M K),   E |r̄|² = σ² tr(M' A K Aᵀ),                                                    (1)
//! each with its own plane removed. The ratio of the two rises with L. The L with the observed ratio is the result,
//! and then σ follows. A mean over an area much larger than L² has the variance σ² L² / area, as if each square of the
//! side L had one error of its own. A likelihood was tried in place of (1). It depends on the finest detail, and there
//! a form of K that is not the camera's made L wrong by a factor of three.

use super::block::Block;
use super::plane::{self, Projection};
use super::plane_view::PlaneView;
use nalgebra::DMatrix;
use panelprep_base::geometry::statistics::NORMAL_TWO_SIDED_95;
use rayon::prelude::*;

/// The values of L that are tried, mm.
const LENGTHS_MM: [f64; 15] =
    [12.0, 16.0, 21.0, 27.0, 35.0, 45.0, 55.0, 67.0, 80.0, 97.0, 120.0, 150.0, 190.0, 240.0, 320.0];
/// Number of parts along each side.
const PARTS: usize = 4;
/// Minimum number of blocks in a part, as a share of the usual number.
const MIN_FILLED_SHARE: f64 = 0.5;

/// The estimated error and its correlation length.
pub(super) struct CorrelationLength {
    pub deviation_mm: f64,
    pub correlation_mm: f64,
    pub interval_mm: [f64; 2],
}

/// One scan's blocks and parts.
struct BlockPartition {
    /// Projections that remove the planes of the blocks and of the parts.
    planes: [Projection; 2],
    /// The matrix that computes the means over the parts from the blocks.
    averaging: DMatrix<f64>,
    distances_2: DMatrix<f64>,
    observed: [f64; 2],
}

/// Estimates L and σ of (1); `None` if too little of the boards has points.
pub(super) fn estimate(views: &[PlaneView], residuals_mm: &[Vec<f64>]) -> Option<CorrelationLength> {
    let cuts: Vec<BlockPartition> =
        views.iter().zip(residuals_mm).filter_map(|(view, mm)| BlockPartition::new(&view.blocks, mm)).collect();
    let observed = cuts.iter().fold([0.0; 2], |sum, cut| [sum[0] + cut.observed[0], sum[1] + cut.observed[1]]);
    let longest_mm = views.iter().map(|view| 2.0 * view.half_diagonal_mm).fold(0.0, f64::max);
    let tried: Vec<(f64, [f64; 2])> = LENGTHS_MM
        .par_iter()
        .filter(|length_mm| **length_mm <= longest_mm)
        .map(|&length_mm| {
            let of = |sum: [f64; 2], one: [f64; 2]| [sum[0] + one[0], sum[1] + one[1]];
            (length_mm, cuts.iter().map(|cut| cut.expected(length_mm)).fold([0.0; 2], of))
        })
        .collect();
    let ratio = observed[1] / observed[0];
    let free: f64 = cuts.iter().map(|cut| cut.averaging.nrows() as f64 - 3.0).sum();
    // The sum of squares of the parts has the scatter of χ².
    let share = NORMAL_TWO_SIDED_95 * (2.0 / free).sqrt();
    let [(correlation_mm, expected), (low_mm, _), (high_mm, _)] =
        [ratio, ratio * (1.0 - share).max(0.0), ratio * (1.0 + share)]
            .map(|ratio| solve_correlation_length(&tried, ratio));
    let deviation_mm = (observed[0] / expected).sqrt();
    let spread = CorrelationLength { deviation_mm, correlation_mm, interval_mm: [low_mm, high_mm] };
    deviation_mm.is_finite().then_some(spread)
}

/// Returns the L at which this ratio is expected, and the expected value of the blocks there; the first or last L
/// if the ratio is beyond all.
fn solve_correlation_length(tried: &[(f64, [f64; 2])], ratio: f64) -> (f64, f64) {
    let of = |[blocks, parts]: [f64; 2]| parts / blocks;
    let above = tried.iter().position(|one| of(one.1) >= ratio).unwrap_or(tried.len());
    let beside = |index: usize| tried.get(index).map(|one| (one.0, one.1));
    match (above.checked_sub(1).and_then(beside), beside(above)) {
        (Some((low_mm, low)), Some((high_mm, high))) => {
            let share = (ratio - of(low)) / (of(high) - of(low));
            (low_mm + share * (high_mm - low_mm), low[0] + share * (high[0] - low[0]))
        }
        (Some((mm, expected)), None) | (None, Some((mm, expected))) => (mm, expected[0]),
        (None, None) => (f64::NAN, f64::NAN),
    }
}

impl BlockPartition {
    fn new(blocks: &[Block], residuals_mm: &[f64]) -> Option<BlockPartition> {
        let reach = |axis: usize| {
            let places = blocks.iter().map(|block| block.position_mm[axis]);
            let least = places.clone().fold(f64::INFINITY, f64::min);
            (least, places.fold(f64::NEG_INFINITY, f64::max) - least)
        };
        let reaches = [reach(0), reach(1)];
        let part = |block: &Block| {
            let at = |axis: usize| {
                let (least, reach) = reaches[axis];
                (((block.position_mm[axis] - least) / reach * PARTS as f64) as usize).min(PARTS - 1)
            };
            at(1) * PARTS + at(0)
        };
        let usual = blocks.len() as f64 / (PARTS * PARTS) as f64;
        let members: Vec<Vec<usize>> = (0..PARTS * PARTS)
            .map(|index| (0..blocks.len()).filter(|&block| part(&blocks[block]) == index).collect::<Vec<_>>())
            .filter(|members| members.len() as f64 >= MIN_FILLED_SHARE * usual)
            .collect();
        if members.len() < 6 {
            return None;
        }
        let mut means = DMatrix::zeros(members.len(), blocks.len());
        for (row, members) in members.iter().enumerate() {
            members.iter().for_each(|&block| means[(row, block)] = 1.0 / members.len() as f64);
        }
        let depths = plane::depths(blocks);
        let planes = [Projection::orthogonal_to(depths.clone()), Projection::orthogonal_to(&means * depths)];
        let distances_2 = DMatrix::from_fn(blocks.len(), blocks.len(), |i, j| {
            let ([ax, ay], [bx, by]) = (blocks[i].position_mm, blocks[j].position_mm);
            (ax - bx).powi(2) + (ay - by).powi(2)
        });
        let residuals = DMatrix::from_column_slice(blocks.len(), 1, residuals_mm);
        let observed = [
            planes[0].residual_of(&residuals).norm_squared(),
            planes[1].residual_of(&(&means * residuals)).norm_squared(),
        ];
        Some(BlockPartition { planes, averaging: means, distances_2, observed })
    }

    /// Returns both traces of (1).
    fn expected(&self, length_mm: f64) -> [f64; 2] {
        let reach_2 = length_mm * length_mm / std::f64::consts::PI;
        let covariance = self.distances_2.map(|distance_2| (-distance_2 / reach_2).exp());
        let of_parts = &self.averaging * &covariance * self.averaging.transpose();
        [self.planes[0].projected_trace(&covariance), self.planes[1].projected_trace(&of_parts)]
    }
}
