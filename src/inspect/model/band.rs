//! One row of tiles while it is judged: the light on its cells, and where glints make a dry look doubtful.

use super::judging::{Line, OverTime, Rule, judge};
use super::kernel::{self, NEW};
use super::light::{CELL_PX, Light, TILE_PX};

/// A cell with fewer bright pixels, of the half of them that are looked at, holds noise.
const MIN_CORE_PX: u16 = 3;

/// A row of tiles.
pub struct Band<'a> {
    pub light: &'a [u16],
    pub before: &'a [u16],
    pub dry: &'a [u16],
    pub over_time: OverTime<'a>,
}

impl Band<'_> {
    /// Judges its pixels, the band-th of rows `stride` long; `broke` is told those that broke now. Before the film is
    /// watched nothing is doubtful.
    pub fn judge(
        &mut self,
        light: &Light,
        (band, stride): (usize, usize),
        rule: Rule,
        watching: bool,
        mut broke: impl FnMut(usize),
    ) {
        let cells = stride / CELL_PX;
        let mut gains = vec![0_u16; cells];
        let mut gain_q12 = vec![0_u16; stride * TILE_PX / CELL_PX];
        for (cell_row, gain_q12) in gain_q12.chunks_exact_mut(stride).enumerate() {
            light.row_q12(band * (TILE_PX / CELL_PX) + cell_row, &mut gains);
            gain_q12.as_chunks_mut::<CELL_PX>().0.iter_mut().zip(&gains).for_each(|(cell, gain)| cell.fill(*gain));
        }
        let mut doubtful = vec![0_u16; stride];
        let glints = if watching { self.glint_cells(&gain_q12, stride) } else { Vec::new() };
        for row in 0..TILE_PX {
            if row % CELL_PX == 0 && watching {
                mark_around(&glints, (row / CELL_PX, cells), &mut doubtful);
            }
            let part = row * stride..(row + 1) * stride;
            let OverTime { kept, since, until, off, unseen } = &mut self.over_time;
            let mut line = Line {
                light: &self.light[part.clone()],
                before: &self.before[part.clone()],
                dry: &self.dry[part.clone()],
                gain_q12: &gain_q12[row / CELL_PX * stride..][..stride],
                doubtful: &doubtful,
                over_time: OverTime {
                    kept: &mut kept[part.clone()],
                    since: &mut since[part.clone()],
                    until: &mut until[part.clone()],
                    off: &mut off[part.clone()],
                    unseen: &mut unseen[part.clone()],
                },
            };
            if judge(&mut line, rule) {
                let new = kept[part.clone()].iter().enumerate().filter(|(_, kept)| **kept & NEW > 0);
                new.for_each(|(column, _)| broke(part.start + column));
            }
        }
    }

    /// The cells of this row of tiles that hold a glint's core.
    fn glint_cells(&self, gain_q12: &[u16], stride: usize) -> Vec<bool> {
        let mut found = Vec::with_capacity(stride / CELL_PX * TILE_PX / CELL_PX);
        let mut columns = vec![0_u16; stride];
        for (cell_row, gain_q12) in gain_q12.chunks_exact(stride).enumerate() {
            columns.fill(0);
            // One row in two: a core is larger than that.
            for row in (0..CELL_PX).step_by(2) {
                let part = (cell_row * CELL_PX + row) * stride..(cell_row * CELL_PX + row + 1) * stride;
                let (light, dry) = (&self.light[part.clone()], &self.dry[part.clone()]);
                kernel::count_hidden(light, dry, &self.over_time.kept[part], gain_q12, &mut columns);
            }
            let cells = columns.as_chunks::<CELL_PX>().0.iter();
            found.extend(cells.map(|cell| cell.iter().sum::<u16>() >= MIN_CORE_PX));
        }
        found
    }
}

/// Marks one row of cells where it or a neighbour holds a glint's core.
fn mark_around(glints: &[bool], (row, cells): (usize, usize), doubtful: &mut [u16]) {
    let rows = glints.len() / cells;
    let at = |row: usize, cell: usize| glints[row * cells + cell];
    for (cell, mark) in doubtful.as_chunks_mut::<CELL_PX>().0.iter_mut().enumerate() {
        let near = row.saturating_sub(1)..(row + 2).min(rows);
        let columns = cell.saturating_sub(1)..(cell + 2).min(cells);
        mark.fill(u16::from(near.into_iter().any(|row| columns.clone().any(|cell| at(row, cell)))));
    }
}
