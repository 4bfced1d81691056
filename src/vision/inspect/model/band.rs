//! Judges one row of tiles.

use super::classify::{
    BlockHistory, BlockObservation, BlockRow, BlockState, ClassifyParameters, disturbed_blocks, judge,
};
use super::kernel::{BLOCK_PX, Block, CELL_PX, NEW_BREAK_FLAG};
use super::light::TileLight;
use std::ops::Range;

/// A row of tiles.
pub struct TileRow<'a> {
    /// The number of blocks in each row of the band.
    pub columns: usize,
    pub current: &'a [Block],
    /// The picture before.
    pub previous: &'a [Block],
    pub dry: &'a [Block],
    pub state: &'a mut [Block],
    pub wet: &'a mut [Block],
    pub past: &'a mut [BlockHistory],
    /// For each row, the blocks with pixels of the region.
    pub inside: &'a [Range<usize>],
}

impl TileRow<'_> {
    /// Judges the pixels of the band; `index` is the number of its row of tiles. Returns the pixels that broke now, as
    /// indices of the band.
    pub fn judge(&mut self, light: &TileLight, index: usize, rule: &ClassifyParameters) -> Vec<usize> {
        let columns = self.columns;
        let gains = light.blocks_q12(index);
        let bare = light.bare_light_q12(&gains);
        // The rows of a cell share one row of gains.
        let cells = |at: usize| at / columns / CELL_PX * columns + at % columns;
        let mut found = Vec::new();
        for (row, inside) in self.inside.iter().enumerate() {
            let part = row * columns + inside.start..row * columns + inside.end;
            let lights = row / CELL_PX * columns + inside.start..row / CELL_PX * columns + inside.end;
            let blocks = BlockRow {
                current: &self.current[part.clone()],
                dry: &self.dry[part.clone()],
                state: &self.state[part.clone()],
                wet: &self.wet[part.clone()],
                gain_q12: &gains[lights.clone()],
                light_q12: &bare[lights],
            };
            disturbed_blocks(part.start, blocks, rule, &mut found);
        }
        let mut broke = Vec::new();
        for at in found {
            let observed = BlockObservation {
                current: &self.current[at],
                previous: &self.previous[at],
                dry: &self.dry[at],
                gain_q12: &gains[cells(at)],
                light_q12: &bare[cells(at)],
            };
            let known = BlockState { state: &mut self.state[at], wet: &mut self.wet[at], past: &mut self.past[at] };
            if judge(observed, known, rule) {
                let new = (0..BLOCK_PX).filter(|&i| self.state[at][i] & NEW_BREAK_FLAG > 0);
                broke.extend(new.map(|i| at * BLOCK_PX + i));
            }
        }
        broke
    }
}
