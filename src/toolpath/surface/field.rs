//! A number at each position of some grids, such as a depth, ready to be drawn.

use panelprep_cell::panel::GridId;

/// One grid, sample by sample, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct GridField {
    /// The grid.
    pub id: GridId,
    /// Samples along u.
    pub columns: usize,
    /// The value at each sample; `None` if there is no panel.
    pub values: Vec<Option<f32>>,
}

/// Some grids of a region.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Grid by grid.
    pub grids: Vec<GridField>,
    /// Length of the region along u and along v, through its middle, mm.
    pub sides_mm: [f64; 2],
}
