//! The surface of the taught panel, block by block of its grid: a point, a normal and an area for each.

use super::grid::Grid;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use panelprep_base::geometry::Pixel;
use rayon::prelude::*;

/// Half the width of the neighbourhood that determines a normal, blocks.
const NORMAL_REACH: usize = 2;
/// Maximum distance of the blocks to which the surface at an edge is fitted, blocks. The next constants are the number
/// of blocks needed, and the maximum distance of the nearest block.
const MAX_FIT_DISTANCE_BLOCKS: isize = 7;
const MIN_BESIDE: usize = 25;
const MAX_BESIDE: f64 = 4.0;

#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// The point in the camera's frame.
    pub point: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub area_mm2: f64,
}

/// The surface block by block.
pub(super) struct Surface {
    pub samples: Vec<Sample>,
    /// Index of each block's sample.
    of_block: Vec<Option<u32>>,
}

impl Surface {
    pub fn from_grid(grid: &Grid) -> Surface {
        let count = grid.columns * grid.rows;
        let points: Vec<Option<Vector3<f64>>> = (0..count)
            .into_par_iter()
            .with_min_len(2_048)
            .map(|index| grid.point(index % grid.columns, index / grid.columns))
            .collect();
        let sampled: Vec<Option<Sample>> = (0..count)
            .into_par_iter()
            .with_min_len(2_048)
            .map(|index| points[index].and_then(|point| tangent(grid, &points, index, point)))
            .collect();
        let mut surface = Surface { samples: Vec::new(), of_block: vec![None; count] };
        for (index, sample) in sampled.into_iter().enumerate() {
            if let Some(sample) = sample {
                surface.of_block[index] = Some(surface.samples.len() as u32);
                surface.samples.push(sample);
            }
        }
        surface
    }

    /// Returns depth and normal of the surface at a place beside the measured blocks. The inverse depth is
    /// extrapolated as a second-order polynomial, because planes alone would deviate from a bent surface to one side.
    pub fn extrapolate(&self, grid: &Grid, pixel: Pixel) -> Option<(f64, Vector3<f64>)> {
        let [x, y] = grid.block_position(pixel);
        let (column, row) = (x.round() as isize, y.round() as isize);
        let (mut squares, mut sums) = (Matrix6::zeros(), Vector6::zeros());
        let (mut nearest, mut count) = ((f64::INFINITY, 0), 0usize);
        for j in row - MAX_FIT_DISTANCE_BLOCKS..=row + MAX_FIT_DISTANCE_BLOCKS {
            for i in column - MAX_FIT_DISTANCE_BLOCKS..=column + MAX_FIT_DISTANCE_BLOCKS {
                let (dx, dy) = (i as f64 - x, j as f64 - y);
                let away = dx.hypot(dy);
                let inside = i >= 0 && j >= 0 && (i as usize) < grid.columns && (j as usize) < grid.rows;
                if !inside || away > MAX_FIT_DISTANCE_BLOCKS as f64 {
                    continue;
                }
                let Some(sample) = self.of_block[j as usize * grid.columns + i as usize] else { continue };
                if away < nearest.0 {
                    nearest = (away, sample);
                }
                let terms = Vector6::new(1.0, dx, dy, dx * dx, dx * dy, dy * dy);
                squares += terms * terms.transpose();
                sums += terms / self.samples[sample as usize].point.z;
                count += 1;
            }
        }
        if count < MIN_BESIDE || nearest.0 > MAX_BESIDE {
            return None;
        }
        let depth_mm = 1.0 / (squares.try_inverse()? * sums)[0];
        (depth_mm.is_finite() && depth_mm > 0.0).then(|| (depth_mm, self.samples[nearest.1 as usize].normal))
    }
}

/// Fits the plane through a block's neighbours: least squares of the points over columns and rows.
fn tangent(grid: &Grid, points: &[Option<Vector3<f64>>], index: usize, middle: Vector3<f64>) -> Option<Sample> {
    let (column, row) = (index % grid.columns, index / grid.columns);
    let mut squares = Matrix3::zeros();
    let mut sums = [Vector3::zeros(); 3];
    for j in row.saturating_sub(NORMAL_REACH)..=(row + NORMAL_REACH).min(grid.rows - 1) {
        for i in column.saturating_sub(NORMAL_REACH)..=(column + NORMAL_REACH).min(grid.columns - 1) {
            let Some(point) = points[j * grid.columns + i] else { continue };
            let far = (i as f64 - column as f64).hypot(j as f64 - row as f64).max(1.0);
            if !grid.are_joined(middle.z, middle.z + (point.z - middle.z) / far) {
                continue;
            }
            let terms = Vector3::new(1.0, i as f64 - column as f64, j as f64 - row as f64);
            squares += terms * terms.transpose();
            for axis in 0..3 {
                sums[axis] += terms * (point[axis] - middle[axis]);
            }
        }
    }
    if squares[(0, 0)] < 8.0 {
        return None;
    }
    let inverse = squares.try_inverse()?;
    let fitted = sums.map(|sum| inverse * sum);
    let along = |term: usize| Vector3::new(fitted[0][term], fitted[1][term], fitted[2][term]);
    let across = along(1).cross(&along(2));
    let normal = across.try_normalize(1e-9)?;
    let normal = if normal.dot(&middle) > 0.0 { -normal } else { normal };
    Some(Sample { point: middle, normal, area_mm2: across.norm() })
}
