//! The region divided into cells of about the same side, row by row.

use super::derivatives::Parameter;
use panelprep_base::geometry::RasterSize;

/// The cells of a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellRaster {
    /// Number of cells along u and v.
    pub size: RasterSize,
    /// The shorter side of a cell, mm.
    pub side_mm: f64,
}

impl CellRaster {
    /// Divides a region with these sides into cells of about this side, mm.
    pub fn new(sides_mm: [f64; 2], cell_mm: f64) -> Self {
        let [width, height] = sides_mm.map(|mm| ((mm / cell_mm).round() as usize).max(1));
        let side_mm = (sides_mm[0] / width as f64).min(sides_mm[1] / height as f64);
        CellRaster { size: RasterSize { width, height }, side_mm }
    }

    /// The number of cells.
    pub fn count(&self) -> usize {
        self.size.width * self.size.height
    }

    /// Returns the cell that contains a place of the unit square.
    pub fn index(&self, [u, v]: [f64; 2]) -> usize {
        let along = |share: f64, count: usize| ((share * count as f64) as usize).min(count - 1);
        along(v, self.size.height) * self.size.width + along(u, self.size.width)
    }

    /// Returns the middle of a cell.
    pub fn middle(&self, index: usize) -> Parameter {
        let along = |cell: usize, count: usize| (cell as f64 + 0.5) / count as f64;
        let RasterSize { width, height } = self.size;
        Parameter { u: along(index % width, width), v: along(index / width, height) }
    }
}
