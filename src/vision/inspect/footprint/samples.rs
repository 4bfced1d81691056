//! The region's taught pixels, each with its grid, its position and its surface.

use nalgebra::Point2;
use panelprep_base::geometry::{Mask, Panel, Pixel, Point, polygon};
use panelprep_cell::panel::TaughtPanel;

/// Neighbours up to this distance, px, determine a pixel's surface: far enough to average the scanner's noise, near
/// enough for the panel's curvature.
const AREA_REACH_PX: usize = 3;

/// A taught pixel of the region, before projection.
pub struct Sample {
    pub grid: usize,
    /// Index of the pixel in the taught picture, row by row.
    pub taught: usize,
    pub point: Option<Point<Panel>>,
    pub area_mm2: Option<f64>,
    pub masked: bool,
    /// Whether the pixel was sanded after the dry picture was taken.
    pub sanded: bool,
}

/// The region's taught pixels. A pixel without a point of its own, a drop-out, gets the surface through its
/// neighbours.
pub fn region_samples(taught: &TaughtPanel, masked_px: &[[[f64; 2]; 4]], sanded: Option<&Mask>) -> Vec<Sample> {
    let masks: Vec<Vec<Pixel>> =
        masked_px.iter().map(|corners| corners.iter().map(|&[u, v]| Pixel::at(u, v)).collect()).collect();
    let corners =
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(s, t)| taught.region.pixel(Point2::new(s, t)));
    let columns = pixel_range(corners.map(|corner| corner.u), taught.mask.width);
    let rows = pixel_range(corners.map(|corner| corner.v), taught.mask.height);
    let sample = |(column, row): (usize, usize)| {
        let pixel = Pixel::at(column as f64, row as f64);
        let id = taught.region.grid_at(pixel)?;
        let grid = (id.row - 1) * taught.region.columns + id.column - 1;
        let own = taught.scan.point(column, row).filter(|_| taught.mask.contains(column, row));
        let area_mm2 = own
            .filter(|_| has_valid_neighbours(&taught.mask, column, row))
            .and_then(|_| taught.scan.smoothed_pixel_area_mm2(column, row, AREA_REACH_PX));
        let masked = masks.iter().any(|mask| polygon::contains(mask, pixel));
        let sanded = sanded.is_some_and(|sanded| sanded.contains(column, row));
        let (taught_px, point) = (row * taught.mask.width + column, own.or_else(|| taught.surface_point_at(pixel)));
        Some(Sample { grid, taught: taught_px, point, area_mm2, masked, sanded })
    };
    rows.flat_map(|row| columns.clone().map(move |column| (column, row))).filter_map(sample).collect()
}

/// Checks whether the neighbours that determine a pixel's surface are on the panel. Points behind the edge or
/// behind a hole are far away.
fn has_valid_neighbours(mask: &Mask, column: usize, row: usize) -> bool {
    let reach = AREA_REACH_PX as isize;
    [(-reach, 0), (reach, 0), (0, -reach), (0, reach)].into_iter().all(|(right, down)| {
        let (column, row) = (column.checked_add_signed(right), row.checked_add_signed(down));
        column
            .zip(row)
            .is_some_and(|(column, row)| column < mask.width && row < mask.height && mask.contains(column, row))
    })
}

/// Returns the whole pixels from the smallest to the largest of these values, limited to the picture's length.
fn pixel_range(ends: [f64; 4], length: usize) -> std::ops::Range<usize> {
    let low = ends.into_iter().fold(f64::INFINITY, f64::min).max(0.0) as usize;
    let high = ends.into_iter().fold(0.0, f64::max) as usize + 1;
    low..high.min(length)
}

/// Returns the mean surface of a pixel of each grid, for pixels beside a missing point.
pub fn mean_areas(samples: &[Sample], grids: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0usize); grids];
    for sample in samples {
        if let Some(area_mm2) = sample.area_mm2 {
            sums[sample.grid].0 += area_mm2;
            sums[sample.grid].1 += 1;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1) as f64).collect()
}
