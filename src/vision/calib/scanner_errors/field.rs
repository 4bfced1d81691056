//! The smooth errors of a 3D camera: the error that is the same in each scan, the tilt of planes, and the error that
//! differs from scan to scan.
//!
//! **The error that is the same in each scan** is a smooth field of depth errors, estimated together with the bow of
//! the board. In mm along the ray, a block of scan i reads −z²·q = −z²(a_i + b_i x + c_i y) + (z/z₀)² B(x, y)·c +
//! z·|m_i|·h(u, v). Here q = 1/z, each scan has its own plane, c are the coefficients of the field
//! (`geometry::DepthField`), and h = k₁u² + k₂uv + k₃v² is the height of the board. m_i = (b_i, c_i, a_i) is the normal
//! of the plane divided by its distance. Planes are projected out scan by scan, so that a scan adds a small symmetric
//! matrix. Second differences of c are weighted by λ, and the bow by the usual flatness of boards.
//!
//! **The tilt** is the depth error that maps planes to other planes, determined from the distances between printed
//! corners. A depth error that is linear over the directions, c = a + b x + c y, leaves flat boards flat, and makes
//! distances on them longer where it is larger. With the scale sᵢ of the distances in each scan, and its derivative
//! with respect to each coefficient, the linear fit is
//!     sᵢ = s + a ∂s/∂a + b ∂s/∂b + c ∂s/∂c,                                                                    (1)
//! Only b and c are a correction: only the depths of the boards distinguish s and a, which act as a scale.
//!
//! **The smooth error from scan to scan** has a standard deviation σ and a correlation length L. Both are estimated
//! from its mean squares in blocks and in parts of the board. Residuals r = M e are the remainder of the errors e after
//! a plane. For errors with the covariance σ² K, K = exp(−h² π / L²) over the distances h on the board, the expected
//! mean squares of blocks and of means over k × k parts (A) are
//!     E |r|² = σ² tr(M K),   E |r̄|² = σ² tr(M' A K Aᵀ),                                                    (2)
//! each with its own plane removed. The ratio of the two increases with L. The result is the L with the observed ratio;
//! σ follows from it. A mean over an area much larger than L² has the variance σ² L² / area, as if each square of the
//! side L had one independent error. A likelihood was tried in place of (2). It depends on the finest detail, where the
//! form of K differs from that of the camera's errors: L was wrong by a factor of three.

use super::plane_view;
use super::plane_view::{Block, PlaneView, Projection};
use nalgebra::{DMatrix, DVector};
use panelprep_base::geometry::statistics::{NORMAL_ONE_SIDED_95, NORMAL_TWO_SIDED_95, rms};
use panelprep_base::geometry::{
    DepthField, FIELD_COLUMNS, FIELD_ROWS, FIELD_SIZE, FieldRectangle, REFERENCE_DEPTH_MM,
};
use rayon::prelude::*;

/// Weights λ of the roughness that are tried.
pub(super) const ROUGHNESS_WEIGHTS: [f64; 7] = [0.01, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4];
const BOW_TERMS: usize = 3;
/// Standard deviation of a calibration board from a plane over half of its diagonal, mm.
const BOARD_BOW_STD_MM: f64 = 0.15;
const UNKNOWNS: usize = FIELD_SIZE + BOW_TERMS;
/// A small weight of the field's size: if two fields explain the data equally well, the solution is the smaller one.
const RIDGE_WEIGHT: f64 = 1e-6;
/// Standard deviation of the depth of a block, mm; the weight of the bow refers to it.
const BLOCK_STD_MM: f64 = 0.05;

/// A scan from which its plane was removed by a projection.
pub(super) struct ProjectedScan {
    design: DMatrix<f64>,
    measured_mm: DVector<f64>,
    information: DMatrix<f64>,
    rhs: DVector<f64>,
}

/// The coefficients of the field and of the bow.
pub(super) struct FieldSolution {
    pub coefficients_mm: [f64; FIELD_SIZE],
    pub bow_mm: f64,
    parameters: DVector<f64>,
}

/// The prediction of left-out scans.
pub(super) struct LeftOutPrediction {
    pub rms_mm: f64,
    /// For each scan, the residual in each block, mm.
    pub residuals_mm: Vec<Vec<f64>>,
}

impl ProjectedScan {
    /// Creates the projected scan; `None` if the blocks determine no plane.
    pub fn from_view(view: &PlaneView, over: &FieldRectangle) -> Option<ProjectedScan> {
        let count = view.blocks.len();
        let own = plane_view::fit_plane(view.blocks.iter().map(|block| (block.direction, block.per_depth)))?;
        let mut design = DMatrix::zeros(count, UNKNOWNS);
        let mut read_mm = DMatrix::zeros(count, 1);
        for (index, block) in view.blocks.iter().enumerate() {
            let z_mm = 1.0 / block.per_depth;
            read_mm[index] = -z_mm;
            let scale = (z_mm / REFERENCE_DEPTH_MM).powi(2);
            for (column, weight) in over.weights(block.direction) {
                design[(index, column)] = scale * weight;
            }
            let [u, v] = block.position_mm.map(|mm| mm / view.half_diagonal_mm);
            for (k, height) in [u * u, u * v, v * v].into_iter().enumerate() {
                design[(index, FIELD_SIZE + k)] = z_mm * own.norm() * height;
            }
        }
        let planes = Projection::orthogonal_to(plane_view::depths(&view.blocks));
        let (read_mm, design) = (planes.residual_of(&read_mm).column(0).into_owned(), planes.residual_of(&design));
        let (information, right) = (design.transpose() * &design, design.transpose() * &read_mm);
        Some(ProjectedScan { design, measured_mm: read_mm, information, rhs: right })
    }

    fn residuals_mm(&self, solved: Option<&FieldSolution>) -> Vec<f64> {
        match solved {
            Some(solved) => (&self.measured_mm - &self.design * &solved.parameters).iter().copied().collect(),
            None => self.measured_mm.iter().copied().collect(),
        }
    }
}

/// Returns the field and the bow by least squares over the scans, with this weight of the field's roughness.
pub(super) fn solve<'a>(fits: impl IntoIterator<Item = &'a ProjectedScan>, lambda: f64) -> Option<FieldSolution> {
    let mut information = smoothness_penalty(lambda);
    let mut right = DVector::zeros(UNKNOWNS);
    for fit in fits {
        information += &fit.information;
        right += &fit.rhs;
    }
    let all = information.cholesky()?.solve(&right);
    let coefficients_mm = std::array::from_fn(|k| all[k]);
    let [a, b, c] = [0, 1, 2].map(|k| all[FIELD_SIZE + k]);
    // The maximum height of a quadratic form in u and v on the unit circle.
    let bow_mm = ((a + c) / 2.0).abs() + ((a - c) / 2.0).hypot(b / 2.0);
    Some(FieldSolution { coefficients_mm, bow_mm, parameters: all })
}

/// Predicts each scan from the others; with `None`, no field is used.
pub(super) fn cross_validate(fits: &[ProjectedScan], lambda: Option<f64>) -> Option<LeftOutPrediction> {
    let residuals_mm: Vec<Vec<f64>> = match lambda {
        None => fits.iter().map(|fit| fit.residuals_mm(None)).collect(),
        Some(lambda) => (0..fits.len())
            .map(|out| {
                let others = fits.iter().enumerate().filter(|(index, _)| *index != out).map(|(_, fit)| fit);
                Some(fits[out].residuals_mm(Some(&solve(others, lambda)?)))
            })
            .collect::<Option<_>>()?,
    };
    Some(LeftOutPrediction { rms_mm: rms(residuals_mm.iter().flatten().copied()), residuals_mm })
}

/// Returns the maximum value of the field at these directions, without its linear part over them, mm.
pub(super) fn max_amplitude_mm(field: &DepthField, directions: impl Iterator<Item = [f64; 2]>) -> f64 {
    let all: Vec<([f64; 2], f64)> = directions.map(|at| (at, field.at_mm(at))).collect();
    let linear = plane_view::fit_plane(all.iter().copied()).unwrap_or_default();
    all.iter().map(|(at, mm)| (mm - plane_view::value_at(&linear, *at)).abs()).fold(0.0, f64::max)
}

fn smoothness_penalty(lambda: f64) -> DMatrix<f64> {
    let mut penalty = DMatrix::from_diagonal_element(UNKNOWNS, UNKNOWNS, RIDGE_WEIGHT);
    let mut add = |indices: [usize; 3]| {
        for (i, a) in indices.iter().zip([1.0, -2.0, 1.0]) {
            for (j, b) in indices.iter().zip([1.0, -2.0, 1.0]) {
                penalty[(*i, *j)] += lambda * a * b;
            }
        }
    };
    for row in 0..FIELD_ROWS {
        for column in 0..FIELD_COLUMNS {
            let at = row * FIELD_COLUMNS + column;
            if column + 2 < FIELD_COLUMNS {
                add([at, at + 1, at + 2]);
            }
            if row + 2 < FIELD_ROWS {
                add([at, at + FIELD_COLUMNS, at + 2 * FIELD_COLUMNS]);
            }
        }
    }
    for k in FIELD_SIZE..UNKNOWNS {
        penalty[(k, k)] += (BLOCK_STD_MM / BOARD_BOW_STD_MM).powi(2);
    }
    penalty
}

/// Maximum ratio of the rms of predicted scales of left-out scans with a slope to that without; with a larger ratio the
/// slope is not used.
const MAX_RMS_RATIO: f64 = 0.8;
/// Number of terms of (1).
const TERMS: usize = 4;

/// The slope and the scatter of the scales of all scans.
pub(super) struct ScaleTilt {
    /// b and c of (1), mm at the reference depth; `None` if they do not predict left-out scans.
    pub slope_mm: Option<[f64; 2]>,
    /// Standard deviation of the scales after (1), or after its first two terms if there is no slope, percent.
    pub residual_percent: f64,
    /// Degrees of freedom: the number of scans minus the number of terms.
    pub degrees_of_freedom: usize,
}

impl ScaleTilt {
    /// Returns the standard deviation of the scales, percent, after this known variance, squared percent, is
    /// subtracted. Zero if the remainder may be due to chance.
    pub fn excess_std_percent(&self, known: f64) -> f64 {
        let left = self.residual_percent.powi(2);
        let by_chance = known * (1.0 + NORMAL_ONE_SIDED_95 * (2.0 / self.degrees_of_freedom as f64).sqrt());
        if left <= by_chance { 0.0 } else { (left - known).max(0.0).sqrt() }
    }
}

/// Fits (1) to the scales of the scans.
pub(super) fn estimate_tilt(views: &[PlaneView], field: Option<&DepthField>) -> Option<ScaleTilt> {
    let scales = DVector::from_iterator(views.len(), views.iter().map(|view| view.scale_percent(field)));
    let term = |row: usize, column: usize| match column {
        0 => 100.0,
        1 => views[row].scale_change_percent(|_| 1.0),
        2 => views[row].scale_change_percent(|[x, _]| x),
        _ => views[row].scale_change_percent(|[_, y]| y),
    };
    let terms = DMatrix::from_fn(views.len(), TERMS, term);
    let all = LeftOutFit::fit(&terms, &scales)?;
    let scale_alone = LeftOutFit::fit(&terms.columns(0, 2).into_owned(), &scales)?;
    let is_worth_it = all.prediction_residual <= MAX_RMS_RATIO * scale_alone.prediction_residual;
    Some(ScaleTilt {
        slope_mm: is_worth_it.then(|| [all.parameters[2], all.parameters[3]]),
        residual_percent: if is_worth_it { all.residual } else { scale_alone.residual },
        degrees_of_freedom: if is_worth_it { all.degrees_of_freedom } else { scale_alone.degrees_of_freedom },
    })
}

/// A linear fit, with the residuals of its own data and of left-out data.
struct LeftOutFit {
    parameters: DVector<f64>,
    residual: f64,
    prediction_residual: f64,
    degrees_of_freedom: usize,
}

impl LeftOutFit {
    fn fit(terms: &DMatrix<f64>, values: &DVector<f64>) -> Option<LeftOutFit> {
        let inverse = (terms.transpose() * terms).try_inverse()?;
        let solved = &inverse * terms.transpose() * values;
        let residuals = values - terms * &solved;
        let hat = terms * inverse * terms.transpose();
        let foretold: Vec<f64> =
            residuals.iter().enumerate().map(|(row, residual)| residual / (1.0 - hat[(row, row)])).collect();
        let free = values.len().checked_sub(terms.ncols()).filter(|free| *free > 0)?;
        let left = (residuals.norm_squared() / free as f64).sqrt();
        Some(LeftOutFit {
            residual: left,
            prediction_residual: rms(foretold),
            degrees_of_freedom: free,
            parameters: solved,
        })
    }
}

/// Values of the correlation length L that are tried, mm.
const CORRELATION_LENGTHS_MM: [f64; 15] =
    [12.0, 16.0, 21.0, 27.0, 35.0, 45.0, 55.0, 67.0, 80.0, 97.0, 120.0, 150.0, 190.0, 240.0, 320.0];
/// Number of parts along each side of the board.
const PARTS_PER_SIDE: usize = 4;
/// Minimum number of blocks in a part, as a fraction of the usual number.
const MIN_FILLED_FRACTION: f64 = 0.5;

/// The estimated smooth error and its correlation length.
pub(super) struct CorrelationLength {
    pub deviation_mm: f64,
    pub correlation_mm: f64,
    pub interval_mm: [f64; 2],
}

/// The blocks and parts of one scan.
struct BlockPartition {
    /// Projections that remove the planes of the blocks and of the parts.
    planes: [Projection; 2],
    /// The matrix that computes the means over the parts from the blocks.
    averaging: DMatrix<f64>,
    distances_2: DMatrix<f64>,
    observed: [f64; 2],
}

/// Estimates L and σ of (2); `None` if too little of the boards has points.
pub(super) fn estimate_smooth_error(views: &[PlaneView], residuals_mm: &[Vec<f64>]) -> Option<CorrelationLength> {
    let cuts: Vec<BlockPartition> =
        views.iter().zip(residuals_mm).filter_map(|(view, mm)| BlockPartition::new(&view.blocks, mm)).collect();
    let observed = cuts.iter().fold([0.0; 2], |sum, cut| [sum[0] + cut.observed[0], sum[1] + cut.observed[1]]);
    let longest_mm = views.iter().map(|view| 2.0 * view.half_diagonal_mm).fold(0.0, f64::max);
    let tried: Vec<(f64, [f64; 2])> = CORRELATION_LENGTHS_MM
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

/// Returns the L at which this ratio is expected, and the expected mean square of the blocks there. If the ratio is
/// outside of the range, the first or the last L is returned.
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
                (((block.position_mm[axis] - least) / reach * PARTS_PER_SIDE as f64) as usize)
                    .min(PARTS_PER_SIDE - 1)
            };
            at(1) * PARTS_PER_SIDE + at(0)
        };
        let usual = blocks.len() as f64 / (PARTS_PER_SIDE * PARTS_PER_SIDE) as f64;
        let members: Vec<Vec<usize>> = (0..PARTS_PER_SIDE * PARTS_PER_SIDE)
            .map(|index| (0..blocks.len()).filter(|&block| part(&blocks[block]) == index).collect::<Vec<_>>())
            .filter(|members| members.len() as f64 >= MIN_FILLED_FRACTION * usual)
            .collect();
        if members.len() < 6 {
            return None;
        }
        let mut means = DMatrix::zeros(members.len(), blocks.len());
        for (row, members) in members.iter().enumerate() {
            members.iter().for_each(|&block| means[(row, block)] = 1.0 / members.len() as f64);
        }
        let depths = plane_view::depths(blocks);
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

    /// Returns the expected values of (2) for σ = 1: of blocks, and of means over parts.
    fn expected(&self, length_mm: f64) -> [f64; 2] {
        let reach_2 = length_mm * length_mm / std::f64::consts::PI;
        let covariance = self.distances_2.map(|distance_2| (-distance_2 / reach_2).exp());
        let of_parts = &self.averaging * &covariance * self.averaging.transpose();
        [self.planes[0].projected_trace(&covariance), self.planes[1].projected_trace(&of_parts)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: a scatter of 0.05 % with an uncertainty of 0.03 % exceeds the uncertainty
    /// by √(0.0025 − 0.0009) % = 0.04 %. With 8 scans more than terms, chance causes up to √(1 + 1.645 · 0.5) = 1.35
    /// times the uncertainty, 0.0405 %.
    #[test]
    fn scatter_due_to_chance_is_no_excess() {
        let tilt =
            |left_percent| ScaleTilt { slope_mm: None, residual_percent: left_percent, degrees_of_freedom: 8 };
        let known = 0.03_f64.powi(2);
        assert!((tilt(0.05).excess_std_percent(known) - 0.04).abs() < 1e-12);
        assert_eq!(tilt(0.04).excess_std_percent(known), 0.0);
        assert!(tilt(0.041).excess_std_percent(known) > 0.02);
    }
}
