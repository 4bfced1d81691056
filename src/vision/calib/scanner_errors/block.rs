//! A part of the board in a scan, reduced to one value.

/// A block of the board's points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// The block's direction, (X/Z, Y/Z).
    pub direction: [f64; 2],
    /// The block's position on the board, from the board's middle, mm.
    pub position_mm: [f64; 2],
    /// 1/z, 1/mm.
    pub per_depth: f64,
}
