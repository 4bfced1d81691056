//! Tiles and blocks that contain pixels of the region, so that the others can be skipped.

use super::kernel::{Block, INSIDE};
use super::light::TILE_PX;
use std::ops::Range;

/// Every nth row is used to estimate the light, and every nth the overexposed share: thousands of pixels remain.
pub(super) const LIGHT_ROW_STRIDE: usize = 2;
pub(super) const EXPOSED_ROW_STRIDE: usize = 4;

/// The region's pixels in the tiles and blocks of a window.
#[derive(Debug)]
pub struct Region {
    /// For each tile, the number of its pixels in the rows that are used for the light.
    pub inside: Vec<u32>,
    /// For each row, the blocks from the first to the last that contain a pixel of the region.
    pub rows: Vec<Range<usize>>,
    /// The number of the region's pixels in the rows that are used for the overexposed share.
    pub exposed_of: u32,
}

impl Region {
    /// Determines the region from the states of the blocks, with `columns` blocks in a row.
    pub fn from_blocks(kept: &[Block], columns: usize) -> Self {
        let count = |block: &Block| block.iter().filter(|state| **state & INSIDE > 0).count() as u32;
        let counts: Vec<u32> = kept.iter().map(count).collect();
        let row = |row: &[u32]| {
            let first = row.iter().position(|count| *count > 0);
            let last = row.iter().rposition(|count| *count > 0);
            first.zip(last).map_or(0..0, |(first, last)| first..last + 1)
        };
        let tile = |tile: usize| {
            let (row, column) = (tile / columns * TILE_PX, tile % columns);
            (row..row + TILE_PX).step_by(LIGHT_ROW_STRIDE).map(|row| counts[row * columns + column]).sum()
        };
        Region {
            inside: (0..counts.len() / TILE_PX).map(tile).collect(),
            rows: counts.chunks(columns).map(row).collect(),
            exposed_of: counts.chunks(columns).step_by(EXPOSED_ROW_STRIDE).flatten().sum(),
        }
    }
}
