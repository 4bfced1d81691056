//! How large the smooth error of a scan is, and over what length it is alike.
//!
//! The residuals r of a scan's blocks, whose plane X was taken out, have the covariance σ² V with V = exp(−h²/ℓ²) + τ² I over the distances h
//! on the board. The restricted likelihood of all scans i with n_i blocks,
//!     −2 log L = Σ (log|V_i| + log|X_iᵀ V_i⁻¹ X_i|) + Σ(n_i − 3) · log(Σ rᵀP_i r),   P = V⁻¹ − V⁻¹X(XᵀV⁻¹X)⁻¹XᵀV⁻¹,        (1)
//! is searched over a grid of ℓ and τ (Patterson and Thompson, Biometrika 58, 1971): the plane hides a part of what is as long as the
//! board, which the plain scatter of r does not know. A mean over an area much larger than ℓ² has the variance σ² πℓ² / area, as if each square
//! of the side L = √π ℓ had one error of its own; that L is what is told.

use super::plane_view::PlaneView;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// L that are tried, mm.
const LENGTHS_MM: [f64; 14] =
    [15.0, 20.0, 26.0, 33.0, 42.0, 52.0, 65.0, 80.0, 100.0, 125.0, 160.0, 200.0, 250.0, 320.0];
/// τ² that are tried.
const WHITE_SHARES: [f64; 5] = [0.002, 0.02, 0.1, 0.4, 2.0];
/// Half the fall of −2 log L that bounds 95 % of one parameter.
const DROP: f64 = 3.84;

/// What was found.
pub(super) struct Spread {
    pub deviation_mm: f64,
    pub correlation_mm: f64,
    pub between_mm: [f64; 2],
    pub is_at_end: bool,
}

/// The best of the grid; `None` where no covariance can be factored.
pub(super) fn estimate(views: &[PlaneView], residuals_mm: &[Vec<f64>]) -> Option<Spread> {
    let longest_mm = views.iter().map(|view| 2.0 * view.half_diagonal_mm).fold(0.0, f64::max);
    let grid: Vec<(usize, f64)> = (0..LENGTHS_MM.len())
        .filter(|&index| LENGTHS_MM[index] <= longest_mm)
        .flat_map(|index| WHITE_SHARES.map(|white| (index, white)))
        .collect();
    let tried: Vec<(usize, f64, f64)> = grid
        .par_iter()
        .filter_map(|&(index, white)| {
            let (deviance, variance) = deviance(views, residuals_mm, (LENGTHS_MM[index], white))?;
            Some((index, deviance, variance))
        })
        .collect();
    let best = *tried.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let within = |one: &&(usize, f64, f64)| one.1 <= best.1 + DROP;
    let indices = || tried.iter().filter(within).map(|one| one.0);
    let (low, high) = (indices().min()?, indices().max()?);
    let last = grid.iter().map(|one| one.0).max()?;
    Some(Spread {
        deviation_mm: best.2.sqrt(),
        correlation_mm: LENGTHS_MM[best.0],
        between_mm: [LENGTHS_MM[low], LENGTHS_MM[high]],
        is_at_end: best.0 == last,
    })
}

/// (1), and σ².
fn deviance(views: &[PlaneView], residuals_mm: &[Vec<f64>], (length_mm, white): (f64, f64)) -> Option<(f64, f64)> {
    let reach2 = length_mm * length_mm / std::f64::consts::PI;
    let (mut logs, mut squares, mut free) = (0.0, 0.0, 0.0);
    for (view, residuals) in views.iter().zip(residuals_mm) {
        let count = view.blocks.len();
        let covariance = DMatrix::from_fn(count, count, |i, j| {
            let ([ax, ay], [bx, by]) = (view.blocks[i].place_mm, view.blocks[j].place_mm);
            let alike = (-((ax - bx).powi(2) + (ay - by).powi(2)) / reach2).exp();
            alike + if i == j { white } else { 0.0 }
        });
        let factor = covariance.cholesky()?;
        let plane = DMatrix::from_fn(count, 3, |row, column| {
            let block = &view.blocks[row];
            [1.0, block.direction[0], block.direction[1]][column] / block.per_depth.powi(2)
        });
        let residuals = DVector::from_column_slice(residuals);
        let (of_plane, of_residuals) = (factor.solve(&plane), factor.solve(&residuals));
        let inner = (plane.transpose() * &of_plane).cholesky()?;
        let along = plane.transpose() * &of_residuals;
        squares += residuals.dot(&of_residuals) - along.dot(&inner.solve(&along));
        let log = |l: &DMatrix<f64>| 2.0 * l.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        logs += log(factor.l_dirty()) + log(inner.l_dirty());
        free += count as f64 - 3.0;
    }
    let variance = squares / free;
    variance.is_finite().then(|| (logs + free * variance.ln(), variance))
}
