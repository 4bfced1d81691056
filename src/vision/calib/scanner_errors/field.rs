//! The error that is the same in each scan: a smooth field of depth errors, with the board's own bow beside it.
//!
//! In mm along the ray, a block of scan i reads −z²·q = −z²(a_i + b_i x + c_i y) + (z/z₀)² B(x, y)·c + z·|m_i|·h(u,
//! v). Here q = 1/z, each scan has a plane of its own, c are the field's coefficients (`geometry::DepthField`), and h
//! = k₁u² + k₂uv + k₃v² is the board's height. m_i = (b_i, c_i, a_i) is the plane's normal divided by its distance.
//! Planes are projected out scan by scan, so that a scan adds a small symmetric matrix. Second differences of c are
//! weighted by λ, and the bow by the usual flatness of boards.

use super::plane::{self, Projection};
use super::plane_view::PlaneView;
use nalgebra::{DMatrix, DVector};
use panelprep_base::geometry::{
    DepthField, FIELD_COLUMNS, FIELD_ROWS, FIELD_SIZE, FieldRectangle, REFERENCE_DEPTH_MM,
};

/// Weights of the roughness that are tried.
pub(super) const LAMBDAS: [f64; 7] = [0.01, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4];
const BOW: usize = 3;
/// Standard deviation of a calibration board from a plane over half of its diagonal, mm.
const BOARD_BOW_MM: f64 = 0.15;
const SIZE: usize = FIELD_SIZE + BOW;
/// A small weight of the field's size: if two fields explain the same data, the smaller one is selected.
const RIDGE_WEIGHT: f64 = 1e-6;
/// Standard deviation of a block to which the bow's weight refers, mm.
const BLOCK_MM: f64 = 0.05;

/// A scan after its plane was removed by projection.
pub(super) struct ProjectedScan {
    design: DMatrix<f64>,
    measured_mm: DVector<f64>,
    information: DMatrix<f64>,
    rhs: DVector<f64>,
}

/// The field and the bow.
pub(super) struct FieldSolution {
    pub coefficients_mm: [f64; FIELD_SIZE],
    pub bow_mm: f64,
    parameters: DVector<f64>,
}

/// The prediction of scans that were left out.
pub(super) struct LeftOutPrediction {
    pub rms_mm: f64,
    /// The residual in each block of each scan, mm.
    pub residuals_mm: Vec<Vec<f64>>,
}

impl ProjectedScan {
    /// Returns `None` if the blocks determine no plane.
    pub fn from_view(view: &PlaneView, over: &FieldRectangle) -> Option<ProjectedScan> {
        let count = view.blocks.len();
        let own = plane::fit(view.blocks.iter().map(|block| (block.direction, block.per_depth)))?;
        let mut design = DMatrix::zeros(count, SIZE);
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
        let planes = Projection::orthogonal_to(plane::depths(&view.blocks));
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

/// Returns the field that fits the scans best, with this weight of the field's roughness.
pub(super) fn solve<'a>(fits: impl IntoIterator<Item = &'a ProjectedScan>, lambda: f64) -> Option<FieldSolution> {
    let mut information = smoothness_penalty(lambda);
    let mut right = DVector::zeros(SIZE);
    for fit in fits {
        information += &fit.information;
        right += &fit.rhs;
    }
    let all = information.cholesky()?.solve(&right);
    let coefficients_mm = std::array::from_fn(|k| all[k]);
    let [a, b, c] = [0, 1, 2].map(|k| all[FIELD_SIZE + k]);
    // The largest height on the unit circle of a quadratic form in u and v.
    let bow_mm = ((a + c) / 2.0).abs() + ((a - c) / 2.0).hypot(b / 2.0);
    Some(FieldSolution { coefficients_mm, bow_mm, parameters: all })
}

/// Predicts each scan from the others; without a weight, no field is used.
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
    let all: Vec<f64> = residuals_mm.iter().flatten().copied().collect();
    Some(LeftOutPrediction { rms_mm: rms(&all), residuals_mm })
}

pub(super) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// Returns the field's largest value at these directions, without its linear part over them, mm.
pub(super) fn max_amplitude_mm(field: &DepthField, directions: impl Iterator<Item = [f64; 2]>) -> f64 {
    let all: Vec<([f64; 2], f64)> = directions.map(|at| (at, field.at_mm(at))).collect();
    let linear = plane::fit(all.iter().copied()).unwrap_or_default();
    all.iter().map(|(at, mm)| (mm - plane::value_at(&linear, *at)).abs()).fold(0.0, f64::max)
}

fn smoothness_penalty(lambda: f64) -> DMatrix<f64> {
    let mut penalty = DMatrix::from_diagonal_element(SIZE, SIZE, RIDGE_WEIGHT);
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
    for k in FIELD_SIZE..SIZE {
        penalty[(k, k)] += (BLOCK_MM / BOARD_BOW_MM).powi(2);
    }
    penalty
}
