//! One row of tiles while it is judged: the light on its cells, and where glints make a dry appearance unreliable.

use super::judging::{BlockObservation, Past, Rule, judge, stirred};
use super::kernel::{self, BLOCK_PX, Block, CELL_PX, CELLS, NEW};
use super::light::Light;
use std::ops::Range;

/// A cell with fewer bright pixels, of the half of them that are looked at, holds noise.
const MIN_CORE_PX: u16 = 3;
/// Every nth row is examined: a core is larger than that.
const CORE_EVERY: usize = 2;

/// A row of tiles.
pub struct Band<'a> {
    /// Blocks of each of its rows.
    pub columns: usize,
    pub light: &'a [Block],
    /// The picture before.
    pub before: &'a [Block],
    pub dry: &'a [Block],
    pub kept: &'a mut [Block],
    pub past: &'a mut [Past],
    /// Of each row the blocks with pixels of the region.
    pub inside: &'a [Range<usize>],
}

impl Band<'_> {
    /// Judges its pixels, those of the index-th row of tiles; those that broke now come back, as indices of the band.
    /// Before the film is watched nothing is doubtful.
    pub fn judge(&mut self, lamp: &Light, index: usize, rule: Rule, watching: bool) -> Vec<usize> {
        let columns = self.columns;
        let gains = lamp.blocks_q12(index);
        let ceilings = lamp.ceilings_q12(&gains);
        // Rows of a cell share one row of gains.
        let cells = |at: usize| at / columns / CELL_PX * columns + at % columns;
        let mut found = Vec::new();
        for (row, inside) in self.inside.iter().enumerate() {
            let part = row * columns + inside.start..row * columns + inside.end;
            let gain_q12 = &gains[row / CELL_PX * columns..][inside.clone()];
            let given = [&self.light[part.clone()], &self.dry[part.clone()], &self.kept[part.clone()], gain_q12];
            stirred(part.start, given, rule.film_q16, &mut found);
        }
        let mut cores = vec![[0; CELLS]; gains.len()];
        for &at in found.iter().filter(|&at| watching && (at / columns).is_multiple_of(CORE_EVERY)) {
            let hidden =
                kernel::hidden_in_cells(&self.light[at], &self.dry[at], &self.kept[at], &ceilings[cells(at)]);
            cores[cells(at)].iter_mut().zip(hidden).for_each(|(core, hidden)| *core += hidden);
        }
        let doubtful = around(cores.as_flattened(), columns * CELLS);
        let (doubtful, _) = doubtful.as_chunks::<CELLS>();
        let mut broke = Vec::new();
        for at in found {
            let seen = BlockObservation {
                light: &self.light[at],
                before: &self.before[at],
                dry: &self.dry[at],
                gain_q12: &gains[cells(at)],
                ceiling_q12: &ceilings[cells(at)],
                doubtful: &std::array::from_fn(|i| u16::from(doubtful[cells(at)][i / CELL_PX])),
            };
            if judge(seen, &mut self.kept[at], &mut self.past[at], rule) {
                let new = (0..BLOCK_PX).filter(|&i| self.kept[at][i] & NEW > 0);
                broke.extend(new.map(|i| at * BLOCK_PX + i));
            }
        }
        broke
    }
}

/// Cells, in rows of this length, that hold a glint's core or have a neighbour which does.
fn around(cores: &[u16], cells: usize) -> Vec<bool> {
    let mut near = vec![false; cores.len()];
    for at in (0..cores.len()).filter(|&at| cores[at] >= MIN_CORE_PX) {
        let (row, cell) = (at / cells, at % cells);
        for row in row.saturating_sub(1)..(row + 2).min(cores.len() / cells) {
            near[row * cells + cell.saturating_sub(1)..row * cells + (cell + 2).min(cells)].fill(true);
        }
    }
    near
}
