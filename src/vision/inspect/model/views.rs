//! The channel, or the mean of the channels, in which each tile of the region is evaluated.
//!
//! If water darkens or mirrors one channel more than the others, that channel distinguishes film from a bare place
//! best, relative to its noise. The first wet picture decides for each tile; a tile without a dry look of its own uses
//! the mean.

use super::kernel::{BLOCK_PX, LEVEL};
use super::light::TILE_PX;

/// A larger difference gives no more information, levels.
const MAX_LEVELS: f64 = 40.0;
/// A single channel is chosen only if it is better than the mean by this factor, because each tile decides from a few
/// hundred noisy pixels.
const MIN_CHANNEL_GAIN: f64 = 1.1;

/// The weights of the channels in each view that may be chosen, and the ratio of its noise to the noise of one
/// channel.
#[derive(Debug, Clone)]
pub struct Views {
    weights: Vec<([f64; 3], f64)>,
    columns: usize,
    /// The view that each tile uses.
    pub chosen: Vec<usize>,
}

impl Views {
    /// Creates the views: first the mean with the recipe's weights, then each channel that counts in this mean.
    pub fn new(channel_weights: [f64; 3], columns: usize, tiles: usize) -> Self {
        let sum: f64 = channel_weights.iter().sum();
        let mean = channel_weights.map(|weight| weight / sum);
        let surer = |weights: [f64; 3]| 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
        let one = |i: usize| std::array::from_fn(|channel| f64::from(u8::from(channel == i)));
        let channels = (0..3).filter(|&i| mean[i] > 0.0).map(|i| (one(i), 1.0));
        let weights = std::iter::once((mean, surer(mean))).chain(channels).collect();
        Views { weights, columns, chosen: vec![0; tiles] }
    }

    /// Chooses the view of each tile from the change from dry to wet in some of the region's pixels. `changes`
    /// contains each pixel's block and its change in each channel.
    pub fn choose(&mut self, changes: impl Iterator<Item = (usize, [f64; 3])>) {
        let mut said = vec![vec![0.0_f64; self.weights.len()]; self.chosen.len()];
        for (block, change) in changes {
            for (said, (weights, surer)) in said[self.tile_of(block)].iter_mut().zip(&self.weights) {
                let change: f64 = (0..3).map(|i| weights[i] * change[i]).sum();
                *said += surer * change.abs().min(MAX_LEVELS);
            }
        }
        for (chosen, said) in self.chosen.iter_mut().zip(said) {
            let best = (0..said.len()).fold(0, |best, view| if said[view] > said[best] { view } else { best });
            *chosen = if said[best] > MIN_CHANNEL_GAIN * said[0] { best } else { 0 };
        }
    }

    /// Returns the tile of a block.
    pub fn tile_of(&self, block: usize) -> usize {
        block / self.columns / TILE_PX * self.columns + block % self.columns
    }

    /// Returns the number of views.
    pub fn count(&self) -> usize {
        self.weights.len()
    }

    /// Returns the variance of a view's noise, from the variance of one channel and that of the mean of all three
    /// with equal weights.
    pub fn variance(&self, view: usize, of_channel: f64, of_mean: f64) -> f64 {
        let squares = self.weights[view].0.iter().map(|weight| weight * weight).sum::<f64>();
        if squares > 0.99 { of_channel } else { of_mean * 3.0 * squares }
    }

    /// Returns the weights of a view in light that is brighter by these gains; with these weights, the look is the
    /// same as in the dry picture's light.
    pub fn weights(&self, view: usize, gains: [f64; 3]) -> [u16; 3] {
        std::array::from_fn(|i| (self.weights[view].0[i] / gains[i] * f64::from(LEVEL)).round() as u16)
    }
}

/// Returns the number of columns of tiles, and of blocks, in this many pixels.
pub fn columns(width: usize) -> usize {
    width.div_ceil(BLOCK_PX)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: the mean of three equal channels has 1/√3 of the noise. A change of 30 in only one channel is 10 in
    /// the mean, 17 relative to the mean's noise: the tile uses the channel. A change of 20 in each channel is 20
    /// in the mean, 35 relative to its noise.
    #[test]
    fn a_tile_looks_at_what_changes_most_against_its_noise() {
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
