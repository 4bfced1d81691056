//! One row of tiles while it is judged: the light on its cells, and where glints make a dry look doubtful.

use super::kernel::{self, Line, NEW, Rule};
use super::light::{CELL_PX, Light, TILE_PX};

/// A cell with fewer bright pixels, of the half of them that are looked at, holds noise.
const MIN_CORE_PX: u32 = 3;

/// A row of tiles.
pub struct Band<'a> {
    pub brightness: &'a [u16],
    pub before: &'a [u16],
    pub dry: &'a [u16],
    pub state: &'a mut [u8],
    pub run: &'a mut [u8],
    pub since_s: &'a mut [f32],
    pub until_s: &'a mut [f32],
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
        let (mut gains, mut gain_q12) = (vec![0_u16; cells], vec![0_u16; stride]);
        let mut doubtful = vec![0_u8; stride];
        let glints = if watching { self.glint_cells(light, (band, stride)) } else { Vec::new() };
        for row in 0..TILE_PX {
            if row % CELL_PX == 0 {
                light.row_q12(band * (TILE_PX / CELL_PX) + row / CELL_PX, &mut gains);
                for (cell, gain) in gain_q12.chunks_exact_mut(CELL_PX).zip(&gains) {
                    cell.fill(*gain);
                }
                if watching {
                    mark_around(&glints, (row / CELL_PX, cells), &mut doubtful);
                }
            }
            let part = row * stride..(row + 1) * stride;
            let mut line = Line {
                light: &self.brightness[part.clone()],
                before: &self.before[part.clone()],
                dry: &self.dry[part.clone()],
                gain_q12: &gain_q12,
                doubtful: &doubtful,
                state: &mut self.state[part.clone()],
                run: &mut self.run[part.clone()],
                since_s: &mut self.since_s[part.clone()],
                until_s: &mut self.until_s[part.clone()],
            };
            if kernel::judge(&mut line, rule) {
                let new = self.state[part.clone()].iter().enumerate().filter(|(_, state)| **state & NEW > 0);
                new.for_each(|(column, _)| broke(part.start + column));
            }
        }
    }

    /// The cells of this row of tiles that hold a glint's core.
    fn glint_cells(&self, light: &Light, (band, stride): (usize, usize)) -> Vec<bool> {
        let cells = stride / CELL_PX;
        let mut gains = vec![0_u16; cells];
        let mut found = Vec::with_capacity(cells * TILE_PX / CELL_PX);
        for cell_row in 0..TILE_PX / CELL_PX {
            light.row_q12(band * (TILE_PX / CELL_PX) + cell_row, &mut gains);
            let top = cell_row * CELL_PX * stride;
            for (cell, gain) in gains.iter().enumerate() {
                // One row in two: a core is larger than that.
                let hidden: u32 = (0..CELL_PX)
                    .step_by(2)
                    .map(|row| {
                        let part = top + row * stride + cell * CELL_PX..top + row * stride + (cell + 1) * CELL_PX;
                        let (light, dry) = (&self.brightness[part.clone()], &self.dry[part.clone()]);
                        kernel::hidden(light, dry, &self.state[part], u32::from(*gain))
                    })
                    .sum();
                found.push(hidden >= MIN_CORE_PX);
            }
        }
        found
    }
}

/// Marks one row of cells where it or a neighbour holds a glint's core.
fn mark_around(glints: &[bool], (row, cells): (usize, usize), doubtful: &mut [u8]) {
    let rows = glints.len() / cells;
    let at = |row: usize, cell: usize| glints[row * cells + cell];
    for (cell, mark) in doubtful.chunks_exact_mut(CELL_PX).enumerate() {
        let near = row.saturating_sub(1)..(row + 2).min(rows);
        let columns = cell.saturating_sub(1)..(cell + 2).min(cells);
        mark.fill(u8::from(near.into_iter().any(|row| columns.clone().any(|cell| at(row, cell)))));
    }
}
