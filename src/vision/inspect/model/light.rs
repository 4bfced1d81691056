//! The light over the region in one picture, relative to the light in which the film brightness was learnt: smooth over
//! the picture, without a constraint over time.
//!
//! For each tile of 32 × 32 px, the ratio of present film brightness to learnt film brightness is calculated. Pixels
//! that just became wet or bare differ strongly from this ratio (a film removes a third or more of the brightness).
//! These pixels and glints are excluded. The ratio is then averaged over the neighbouring tiles and limited to a range:
//! a shadow may darken a part of the region, but nothing brightens a part alone. A break that fills a tile is therefore
//! not mistaken for light.
//!
//! If the surroundings of the panel show the light of the lamp, its change is compensated in the brightness before
//! ([`super::lamp`]). A remaining decrease of light is a shadow, and a remaining increase is a film that becomes
//! thinner: on a bare surface the light is never more than the lamp's.
//!
//! Tiles and blocks without a pixel of the region are skipped. Each tile is evaluated in one channel, or in the mean of
//! the channels. If water darkens one channel more than the others, or reflects more in it, this channel has the best
//! contrast-to-noise ratio between film and bare surface. The view of each tile is selected in the first wet picture; a
//! tile without a dry reference uses the mean.

use super::kernel::{BLOCK_PX, Block, CELL_PX, CELLS_PER_BLOCK, INSIDE_FLAG, LEVEL, Sum};
use std::ops::Range;

/// Side of a tile, px.
pub const TILE_PX: usize = BLOCK_PX;
/// Maximum light, 1/4096; a picture with more light cannot be judged.
const MAX_LIGHT_Q12: f64 = 16_383.0;

/// Minimum fraction of a tile's pixels with about the expected brightness; with fewer, the light of the neighbouring
/// tiles is used.
const MIN_NEAR_FRACTION: f64 = 0.25;
/// Permitted range of the light on a tile, relative to the median of the region.
const LOCAL_LIGHT_RANGE: [f64; 2] = [0.55, 1.08];

/// The light on the region in one picture.
#[derive(Debug, Clone)]
pub struct TileLight {
    columns: usize,
    /// Light on each tile, row by row, relative to the light in which the film brightness was learnt.
    tiles: Vec<f64>,
    /// Median of the light over the region.
    pub region_median: f64,
    /// Whether the drift of the lamp is excluded from the measured light.
    is_lamp_excluded: bool,
}

impl TileLight {
    /// Returns a light of 1 (as in the first wet picture) for a lattice of tiles.
    pub fn uniform(columns: usize, rows: usize) -> Self {
        TileLight { columns, tiles: vec![1.0; columns * rows], region_median: 1.0, is_lamp_excluded: false }
    }

    /// Returns the light of the first wet picture, the reference light of the film brightness.
    pub fn for_first_wet_picture(&self, without_lamp: bool) -> TileLight {
        TileLight {
            tiles: vec![1.0; self.tiles.len()],
            region_median: 1.0,
            is_lamp_excluded: without_lamp,
            ..*self
        }
    }

    /// Returns whether the drift of the lamp is excluded from the measured light.
    pub fn is_lamp_excluded(&self) -> bool {
        self.is_lamp_excluded
    }

    /// Returns the light on a tile, relative to the first wet picture.
    pub fn tile_light(&self, tile: usize) -> f64 {
        self.tiles[tile].max(f64::MIN_POSITIVE)
    }

    /// Calculates the light from the sums of the tiles; `inside` is the number of pixels of each tile in the region.
    pub fn updated(&self, sums: &[Sum], inside: &[u32], without_lamp: bool) -> TileLight {
        let known = |i: usize| {
            f64::from(sums[i].pixels) >= MIN_NEAR_FRACTION * f64::from(inside[i]) && sums[i].expected > 0
        };
        let ratio = |i: usize| f64::from(sums[i].found) / f64::from(sums[i].expected);
        let mut ratios: Vec<(f64, u32)> =
            (0..sums.len()).filter(|&i| inside[i] > 0 && known(i)).map(|i| (ratio(i), inside[i])).collect();
        ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
        let last = if without_lamp == self.is_lamp_excluded { self.region_median } else { 1.0 };
        let median = weighted_median(&ratios).unwrap_or(last);
        // If the film broke everywhere, the region is brighter than under any film that becomes thinner, so this gain
        // is not the light of the lamp.
        let global = if without_lamp { median.clamp(LOCAL_LIGHT_RANGE[0], LOCAL_LIGHT_RANGE[1]) } else { median };
        let rows = self.tiles.len() / self.columns;
        let bounds = LOCAL_LIGHT_RANGE.map(|bound| if without_lamp { bound } else { bound * global });
        let neighbours = |i: usize| {
            let (column, row) = (i % self.columns, i / self.columns);
            let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
            (row.saturating_sub(1)..(row + 2).min(rows)).flat_map(move |r| columns.clone().map(move |c| (c, r)))
        };
        let smooth = |i: usize| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (column, row) in neighbours(i) {
                let tile = row * self.columns + column;
                // A tile that is mostly broken has no film on which the light can be measured, so the light of its
                // neighbours is used.
                if inside[tile] > 0 && known(tile) {
                    let expected = f64::from(sums[tile].expected);
                    sum += expected * ratio(tile).clamp(bounds[0], bounds[1]);
                    weight += expected;
                }
            }
            if weight > 0.0 { sum / weight } else { global }
        };
        TileLight {
            columns: self.columns,
            tiles: (0..sums.len()).map(smooth).collect(),
            region_median: global,
            is_lamp_excluded: without_lamp,
        }
    }

    /// Returns the light on the blocks of one row of tiles, 1/4096, once for each row of cells. The light is
    /// interpolated between the centres of the tiles.
    pub fn blocks_q12(&self, row: usize) -> Vec<Block> {
        let (rows, columns) = (self.tiles.len() / self.columns, self.columns);
        let mut blocks = vec![[0; BLOCK_PX]; CELLS_PER_BLOCK * columns];
        for (cell_row, blocks) in blocks.chunks_exact_mut(columns).enumerate() {
            let (above, below, down) = neighbouring_tiles(row * CELLS_PER_BLOCK + cell_row, rows);
            for (cell, px) in blocks.as_flattened_mut().as_chunks_mut::<CELL_PX>().0.iter_mut().enumerate() {
                let (left, right, across) = neighbouring_tiles(cell, columns);
                let at = |row: usize| {
                    let (a, b) = (self.tiles[row * columns + left], self.tiles[row * columns + right]);
                    a + across * (b - a)
                };
                px.fill(to_q12(at(above) + down * (at(below) - at(above))));
            }
        }
        blocks
    }

    /// Returns the light on a bare surface, 1/4096, from the gains of the film beside it. If the drift of the lamp is
    /// excluded, the result is at most the light of the lamp.
    pub fn bare_light_q12(&self, gains: &[Block]) -> Vec<Block> {
        if !self.is_lamp_excluded {
            return gains.to_vec();
        }
        let lamp = to_q12(1.0);
        gains.iter().map(|block| block.map(|gain| gain.min(lamp))).collect()
    }
}

/// Returns the two of `tiles` neighbouring tiles between whose centres the centre of a cell lies, and the position of
/// the cell's centre between them, 0…1.
fn neighbouring_tiles(cell: usize, tiles: usize) -> (usize, usize, f64) {
    let at = ((cell as f64 + 0.5) / CELLS_PER_BLOCK as f64 - 0.5).clamp(0.0, tiles as f64 - 1.0);
    let first = (at as usize).min(tiles.saturating_sub(2));
    (first, (first + 1).min(tiles - 1), at - first as f64)
}

/// Converts a gain to units of 1/4096.
pub fn to_q12(gain: f64) -> u16 {
    (gain * 4096.0).clamp(0.0, MAX_LIGHT_Q12) as u16
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

/// Upper limit of the change of a pixel, levels: a larger change is clipped, because it gives no more information.
const CHANGE_CLIP_LEVELS: f64 = 40.0;
/// Minimum ratio of the contrast-to-noise ratio of a single channel to that of the mean, for the channel to be
/// selected. Each tile decides from a few hundred noisy pixels.
const MIN_CHANNEL_ADVANTAGE: f64 = 1.1;

/// The views: for each view the weights of the channels, and the noise of one channel divided by the noise of the view.
#[derive(Debug, Clone)]
pub struct Views {
    weights: Vec<([f64; 3], f64)>,
    columns: usize,
    /// For each tile, the index of the selected view.
    pub chosen: Vec<usize>,
}

impl Views {
    /// Creates the views: first the mean with the recipe's weights, then each channel with a weight above zero.
    pub fn new(channel_weights: [f64; 3], columns: usize, tiles: usize) -> Self {
        let sum: f64 = channel_weights.iter().sum();
        let mean = channel_weights.map(|weight| weight / sum);
        let contrast_gain =
            |weights: [f64; 3]| 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
        let one = |i: usize| std::array::from_fn(|channel| f64::from(u8::from(channel == i)));
        let channels = (0..3).filter(|&i| mean[i] > 0.0).map(|i| (one(i), 1.0));
        let weights = std::iter::once((mean, contrast_gain(mean))).chain(channels).collect();
        Views { weights, columns, chosen: vec![0; tiles] }
    }

    /// Selects the view of each tile from the change from dry to wet at some pixels of the region. `changes` contains
    /// for each pixel its block, and its change in each channel.
    pub fn choose(&mut self, changes: impl Iterator<Item = (usize, [f64; 3])>) {
        let mut evidence = vec![vec![0.0_f64; self.weights.len()]; self.chosen.len()];
        for (block, change) in changes {
            for (evidence, (weights, contrast_gain)) in evidence[self.tile_of(block)].iter_mut().zip(&self.weights)
            {
                let change: f64 = (0..3).map(|i| weights[i] * change[i]).sum();
                *evidence += contrast_gain * change.abs().min(CHANGE_CLIP_LEVELS);
            }
        }
        for (chosen, evidence) in self.chosen.iter_mut().zip(evidence) {
            let best =
                (0..evidence.len()).fold(0, |best, view| if evidence[view] > evidence[best] { view } else { best });
            *chosen = if evidence[best] > MIN_CHANNEL_ADVANTAGE * evidence[0] { best } else { 0 };
        }
    }

    /// Returns the index of the tile that contains a block.
    pub fn tile_of(&self, block: usize) -> usize {
        block / self.columns / TILE_PX * self.columns + block % self.columns
    }

    /// Returns the number of views.
    pub fn count(&self) -> usize {
        self.weights.len()
    }

    /// Returns the variance of the noise of a view, from the variance of one channel and the variance of the mean of
    /// all three channels with equal weights.
    pub fn variance(&self, view: usize, of_channel: f64, of_mean: f64) -> f64 {
        let squares = self.weights[view].0.iter().map(|weight| weight * weight).sum::<f64>();
        if squares > 0.99 { of_channel } else { of_mean * 3.0 * squares }
    }

    /// Returns the weights of a view in light with these gains relative to the dry picture. With these weights, the
    /// brightness is the same as in the light of the dry picture.
    pub fn weights(&self, view: usize, gains: [f64; 3]) -> [u16; 3] {
        std::array::from_fn(|i| (self.weights[view].0[i] / gains[i] * f64::from(LEVEL)).round() as u16)
    }
}

/// Returns the number of columns of tiles, equal to the number of columns of blocks, for a width in pixels.
pub fn columns(width: usize) -> usize {
    width.div_ceil(BLOCK_PX)
}

/// Intervals between the rows from which the light (`LIGHT_ROW_STRIDE`) and the overexposed fraction
/// (`EXPOSED_ROW_STRIDE`) are estimated; thousands of pixels remain.
pub(super) const LIGHT_ROW_STRIDE: usize = 2;
pub(super) const EXPOSED_ROW_STRIDE: usize = 4;

/// The pixels of the region in the tiles and blocks of a window.
#[derive(Debug)]
pub struct Region {
    /// For each tile, the number of its pixels in the rows from which the light is estimated.
    pub inside: Vec<u32>,
    /// For each row, the range from the first to the last block that contains a pixel of the region.
    pub rows: Vec<Range<usize>>,
    /// Number of pixels of the region in the rows from which the overexposed fraction is estimated.
    pub exposed_of: u32,
}

impl Region {
    /// Determines the region from the states of the blocks, with `columns` blocks in a row.
    pub fn from_blocks(kept: &[Block], columns: usize) -> Self {
        let count = |block: &Block| block.iter().filter(|state| **state & INSIDE_FLAG > 0).count() as u32;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(found: u32) -> Sum {
        Sum { found, expected: 1_000, pixels: 100 }
    }

    /// Expected values, calculated by hand: eight of nine tiles have 10 % more light; the ninth is 1.3 times as bright
    /// and has a gain of at most 1.08 · 1.1.
    #[test]
    fn a_tile_may_be_darker_but_not_brighter_than_the_others() {
        let mut sums = vec![sum(1_100); 9];
        sums[4] = sum(1_300);
        let light = TileLight::uniform(3, 3).updated(&sums, &[100; 9], false);
        assert!((light.region_median - 1.1).abs() < 1e-12);
        assert!((light.tiles[4] - (8.0 * 1.1 + 1.188) / 9.0).abs() < 1e-9, "{}", light.tiles[4]);
        sums[4] = sum(800);
        let light = TileLight::uniform(3, 3).updated(&sums, &[100; 9], false);
        assert!((light.tiles[4] - (8.0 * 1.1 + 0.8) / 9.0).abs() < 1e-9);
    }

    /// Expected values, calculated by hand for a known lamp: if a film becomes 1.3 times as bright, its gain is limited
    /// to 1.08, and a bare surface has the light of the lamp. In a shadow of 0.8 both gains are 0.8.
    #[test]
    fn with_a_known_lamp_a_brighter_film_is_not_light() {
        let of = |found: u32| TileLight::uniform(3, 3).updated(&[sum(found); 9], &[100; 9], true);
        let light = of(1_300);
        assert!((light.region_median - 1.08).abs() < 1e-12 && (light.tiles[4] - 1.08).abs() < 1e-12);
        assert_eq!(light.bare_light_q12(&light.blocks_q12(1))[0][0], 4096);
        let shadow = of(800);
        let gains = shadow.blocks_q12(1);
        assert_eq!((gains[0][0], shadow.bare_light_q12(&gains)[0][0]), (3276, 3276));
    }

    #[test]
    fn a_tile_without_film_gets_the_light_of_its_neighbours() {
        let mut sums = vec![sum(900); 9];
        sums[4] = Sum { pixels: 20, ..sum(1_600) };
        let light = TileLight::uniform(3, 3).updated(&sums, &[100; 9], false);
        assert!((light.tiles[4] - 0.9).abs() < 1e-12);
        let nothing = light.updated(&[Sum::default(); 9], &[100; 9], false);
        assert!((nothing.region_median - 0.9).abs() < 1e-12, "the light of before");
    }

    /// Expected values, calculated by hand: the centre of the first cell lies before the centre of the first tile. The
    /// cells between the centres of two tiles are interpolated.
    #[test]
    fn light_is_interpolated_between_tiles() {
        let light = TileLight { tiles: vec![1.0, 2.0], ..TileLight::uniform(2, 1) };
        let blocks = light.blocks_q12(0);
        let cells = blocks[..2].as_flattened().iter().step_by(CELL_PX).map(|gain| gain / 64);
        assert_eq!(cells.collect::<Vec<u16>>(), [64, 64, 72, 88, 104, 120, 128, 128]);
    }

    /// Expected values, calculated by hand: the mean of three equal channels has 1/√3 of the noise. A change of 30 in
    /// only one channel is 10 in the mean, which is 17 relative to the noise of the mean: the tile uses the channel. A
    /// change of 20 in each channel is 20 in the mean, which is 35 relative to the noise.
    #[test]
    fn a_tile_uses_the_view_with_the_best_contrast_to_noise() {
        let chosen = |change: [f64; 3], weights: [f64; 3]| {
            let mut views = Views::new(weights, 1, 1);
            views.choose((0..100).map(|row| (row % 32, change)));
            views.weights(views.chosen[0], [1.0; 3])
        };
        assert_eq!(chosen([0.0, 0.0, -30.0], [1.0; 3]), [0, 0, 64]);
        assert_eq!(chosen([20.0; 3], [1.0; 3]), [21, 21, 21]);
        assert_eq!(chosen([0.0, 0.0, 30.0], [0.5, 0.5, 0.0]), [32, 32, 0], "a channel that the recipe leaves out");
        assert_eq!(Views::new([1.0; 3], 1, 1).weights(1, [2.0, 1.0, 1.0]), [32, 0, 0]);
    }
}
