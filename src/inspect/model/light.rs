//! The light over the region in one picture, against the dry picture: smooth in the picture, free in time.
//!
//! Each tile of 32 × 32 px says by which factor it is brighter than its pixels' states let expect. Pixels that just
//! became wet or dry are far from that factor (a film takes a third or more) and have no part in it: neither has a
//! glint. A tile's factor is then a mean over its neighbours, bounded from above by little more than the region's median:
//! a shadow darkens a part, nothing brightens a part alone. So a break that fills a tile is not taken for light.
//!
//! A film that removes more in one part than in another looks like a shadow there, and a film that removes more as time passes looks
//! like a lamp that fades. A place that breaks then is brighter than dry in that light. So the light has a ceiling, the median or
//! what lies around the panel, and only what is brighter than dry under the ceiling is a glint.

use super::kernel::{BLOCK_PX, Block, CELL_PX, CELLS, Sum};

/// A tile's side, px.
pub const TILE_PX: usize = BLOCK_PX;
/// No light is brighter, 1/4096; a picture in which it were could not be judged by.
const MOST_Q12: f64 = 16_383.0;

/// Of a tile this share at least must be near what is expected.
const MIN_SHARE: f64 = 0.25;
/// How much brighter or darker than the region's median a tile may be.
const LOCALLY: [f64; 2] = [0.55, 1.08];

/// The panel's light against that of its surroundings, where both nearly agree.
const AGREES: std::ops::RangeInclusive<f64> = 0.95..=1.05;

/// The light of one picture.
#[derive(Debug, Clone)]
pub struct Light {
    columns: usize,
    /// Of each tile, row by row; 1 is the dry picture's.
    tiles: Vec<f64>,
    /// The region's median.
    pub global: f64,
    /// The brightest light that any place may have: what is dry is as bright as that at most.
    pub ceiling: f64,
    /// The share of the region that contributed to it.
    pub share: f64,
    /// Of each tile that says anything by how much it is brighter than the region's median.
    pub beyond: Vec<Option<f64>>,
}

impl Light {
    /// The dry picture's own light on a lattice of tiles.
    pub fn even(columns: usize, rows: usize) -> Self {
        Light {
            columns,
            tiles: vec![1.0; columns * rows],
            global: 1.0,
            ceiling: 1.0,
            share: 1.0,
            beyond: vec![None; columns * rows],
        }
    }

    /// The light by the tiles' sums, each with its pixels in the region; beside what lies around the panel in so much light, where that
    /// is known.
    pub fn found(&self, sums: &[Sum], inside: &[u32], around: Option<f64>) -> Light {
        let known =
            |i: usize| f64::from(sums[i].pixels) >= MIN_SHARE * f64::from(inside[i]) && sums[i].expected > 0;
        let ratio = |i: usize| f64::from(sums[i].found) / f64::from(sums[i].expected);
        let mut ratios: Vec<(f64, u32)> =
            (0..sums.len()).filter(|&i| inside[i] > 0 && known(i)).map(|i| (ratio(i), inside[i])).collect();
        ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
        let global = weighted_median(&ratios).unwrap_or(self.global);
        let rows = self.tiles.len() / self.columns;
        // A shadow may lie on more than half of the region.
        let bounds = [LOCALLY[0] * global, (LOCALLY[1] * global).max(around.unwrap_or(0.0))];
        let neighbours = |i: usize| {
            let (column, row) = (i % self.columns, i / self.columns);
            let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
            (row.saturating_sub(1)..(row + 2).min(rows)).flat_map(move |r| columns.clone().map(move |c| (c, r)))
        };
        let smooth = |i: usize| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (column, row) in neighbours(i) {
                let tile = row * self.columns + column;
                if inside[tile] > 0 && known(tile) {
                    let expected = f64::from(sums[tile].expected);
                    sum += expected * ratio(tile).clamp(bounds[0], bounds[1]);
                    weight += expected;
                }
            }
            if weight > 0.0 { sum / weight } else { global }
        };
        let told: u64 = sums.iter().map(|sum| u64::from(sum.pixels)).sum();
        let all: u64 = inside.iter().copied().map(u64::from).sum();
        let light = Light {
            columns: self.columns,
            tiles: (0..sums.len()).map(smooth).collect(),
            global,
            ceiling: global,
            share: told as f64 / all.max(1) as f64,
            beyond: (0..sums.len()).map(|i| (inside[i] > 0 && known(i)).then(|| ratio(i) / global)).collect(),
        };
        light.beside(around)
    }

    /// The same light everywhere.
    pub fn flat(&self, global: f64) -> Light {
        Light { tiles: vec![global; self.tiles.len()], global, ceiling: global, ..self.clone() }
    }

    /// Where what lies around the panel is in brighter light than this, the panel may be so, too. Where both nearly agree it knows the
    /// light better: the panel's median takes a film that leaves a little more for a little more light.
    fn beside(self, around: Option<f64>) -> Light {
        let Some(around) = around else { return self };
        let share = self.global / around;
        let share = if AGREES.contains(&share) { share } else { 1.0 };
        let beyond = self.beyond.iter().map(|beyond| beyond.map(|beyond| share * beyond)).collect();
        Light { ceiling: self.ceiling.max(around), beyond, ..self }
    }

    /// The light on the blocks of one row of tiles, 1/4096, each row of cells once: it goes from tile centre to tile centre.
    pub fn blocks_q12(&self, row: usize) -> Vec<Block> {
        let (rows, columns) = (self.tiles.len() / self.columns, self.columns);
        let mut blocks = vec![[0; BLOCK_PX]; CELLS * columns];
        for (cell_row, blocks) in blocks.chunks_exact_mut(columns).enumerate() {
            let (above, below, down) = between(row * CELLS + cell_row, rows);
            for (cell, px) in blocks.as_flattened_mut().as_chunks_mut::<CELL_PX>().0.iter_mut().enumerate() {
                let (left, right, across) = between(cell, columns);
                let at = |row: usize| {
                    let (a, b) = (self.tiles[row * columns + left], self.tiles[row * columns + right]);
                    a + across * (b - a)
                };
                px.fill(q12(at(above) + down * (at(below) - at(above))));
            }
        }
        blocks
    }

    /// The brightest light that there may be where it is as in `gains`, 1/4096.
    pub fn ceilings_q12(&self, gains: &[Block]) -> Vec<Block> {
        let ceiling = q12(self.ceiling);
        gains.iter().map(|block| block.map(|gain| gain.max(ceiling))).collect()
    }
}

/// Between which two of so many tiles' centres a cell's centre lies, and how far on the way.
fn between(cell: usize, tiles: usize) -> (usize, usize, f64) {
    let at = ((cell as f64 + 0.5) / CELLS as f64 - 0.5).clamp(0.0, tiles as f64 - 1.0);
    let first = (at as usize).min(tiles.saturating_sub(2));
    (first, (first + 1).min(tiles - 1), at - first as f64)
}

/// A gain in 1/4096.
pub fn q12(gain: f64) -> u16 {
    (gain * 4096.0).clamp(0.0, MOST_Q12) as u16
}

fn weighted_median(sorted: &[(f64, u32)]) -> Option<f64> {
    let half: u64 = sorted.iter().map(|(_, weight)| u64::from(*weight)).sum::<u64>() / 2;
    let mut sum = 0;
    sorted
        .iter()
        .find(|(_, weight)| {
            sum += u64::from(*weight);
            sum > half
        })
        .map(|(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(found: u32) -> Sum {
        Sum { found, expected: 1_000, pixels: 100 }
    }

    /// By hand: of nine tiles eight have a tenth more light; the ninth, 1.3 as bright, counts for 1.08 · 1.1 at most.
    #[test]
    fn a_part_may_be_darker_and_not_brighter() {
        let mut sums = vec![sum(1_100); 9];
        sums[4] = sum(1_300);
        let light = Light::even(3, 3).found(&sums, &[100; 9], None);
        assert!((light.global - 1.1).abs() < 1e-12);
        assert!((light.tiles[4] - (8.0 * 1.1 + 1.188) / 9.0).abs() < 1e-9, "{}", light.tiles[4]);
        sums[4] = sum(800);
        let light = Light::even(3, 3).found(&sums, &[100; 9], None);
        assert!((light.tiles[4] - (8.0 * 1.1 + 0.8) / 9.0).abs() < 1e-9);
    }

    /// By hand: a tile that is 1.21/1.1 times as bright as the median; where the lamp is known to be 1.06 as bright it is 1.21/1.06.
    #[test]
    fn a_tile_that_is_brighter_is_so_against_the_lamp() {
        let mut sums = vec![sum(1_100); 9];
        sums[4] = sum(1_210);
        for (around, expected) in [(None, 1.1), (Some(1.06), 1.21 / 1.06), (Some(0.9), 1.1)] {
            let light = Light::even(3, 3).found(&sums, &[100; 9], around);
            assert!((light.beyond[4].expect("it says something") - expected).abs() < 1e-9, "{around:?} {light:?}");
        }
    }

    /// By hand: of 4 × 5 tiles the upper two rows lie in full light and the others in a shadow of 0.7. A corner has full light where the
    /// lamp is known to be as it was, and else 1.08 · 0.7.
    #[test]
    fn a_shadow_may_lie_on_more_than_half() {
        let mut sums = vec![sum(700); 20];
        (0..8).for_each(|i| sums[i] = sum(1_000));
        let corner = |around| Light::even(4, 5).found(&sums, &[100; 20], around).tiles[0];
        assert!((corner(Some(1.0)) - 1.0).abs() < 1e-9 && (corner(None) - 0.756).abs() < 1e-9);
    }

    #[test]
    fn a_tile_that_tells_nothing_takes_its_neighbours_light() {
        let mut sums = vec![sum(900); 9];
        sums[4] = Sum { pixels: 20, ..sum(1_600) };
        let light = Light::even(3, 3).found(&sums, &[100; 9], None);
        assert!((light.tiles[4] - 0.9).abs() < 1e-12 && (light.share - 820.0 / 900.0).abs() < 1e-12);
        let nothing = light.found(&[Sum::default(); 9], &[100; 9], None);
        assert!((nothing.global - 0.9).abs() < 1e-12, "the light of before");
    }

    /// By hand: the first cell's centre lies before the first tile's; the cells between two tiles' centres go from one to the other.
    #[test]
    fn light_goes_smoothly_from_tile_to_tile() {
        let light = Light { tiles: vec![1.0, 2.0], ..Light::even(2, 1) };
        let blocks = light.blocks_q12(0);
        let cells = blocks[..2].as_flattened().iter().step_by(CELL_PX).map(|gain| gain / 64);
        assert_eq!(cells.collect::<Vec<u16>>(), [64, 64, 72, 88, 104, 120, 128, 128]);
    }
}
