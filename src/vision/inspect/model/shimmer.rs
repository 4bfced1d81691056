//! Detects moving water at places without a dry reference, from their temporal noise.
//!
//! A film is never completely static: it runs off, carries waves and becomes thinner. Let s be the present brightness
//! of a pixel and w the brightness of its film. A sample point is a square of 4 × 4 px. Let x₁, x₂, x₃ be the means of
//! s/w over a sample point in three consecutive spans of one second, with n₁, n₂, n₃ pictures. Let σ be the noise of
//! the sensor in a sample point, measured beside the panel, where no water moves ([`super::noise`]). Then
//!     z = (x₁ − 2 x₂ + x₃) / ((σ/w) √(1/n₁ + 4/n₂ + 1/n₃)).                                                     (1)
//! Over static sample points, z has the variance 1. The part that neighbouring sample points have in common comes from
//! the light and is subtracted. The second differences cancel the change of a place that dries steadily. A shadow or a
//! glint that passes a static place affects few second differences, a film affects most of them.

use super::kernel::{BLOCK_PX, BRIGHTNESS_MASK, Block, INSIDE_FLAG, NO_DRY_FLAG, OVEREXPOSED_FLAG};
use super::lamp::LampObserver;
use rayon::prelude::*;

/// Side of the square of a sample point, px: water moves on a scale of millimetres, and the mean of a square has less
/// noise than a pixel.
const SAMPLE_POINT_SIDE_PX: usize = LampObserver::SIDE_PX;
/// Number of spans. A span begins with a picture and contains the pictures of the following `SPAN_S`, s: one second
/// minus the rounding of timestamps. With less than one picture per second, each picture is a span.
const SPAN_COUNT: usize = 24;
const SPAN_S: f64 = 0.99;
/// Minimum fraction of the pixels and pictures of a sample point that must be seen in a span, for its mean to be used.
const MIN_SPAN_FRACTION: f32 = 0.9;
/// Number of second differences between the spans.
pub const DIFFERENCE_COUNT: usize = SPAN_COUNT - 2;
/// The temporal noise at the sample points of a lattice.
#[derive(Debug, Clone)]
pub struct TemporalNoise {
    columns: usize,
    /// Index of the present span, time at which it began, and number of pictures in each span.
    span: usize,
    began_s: f64,
    pictures: [u32; SPAN_COUNT],
    /// For each sample point, the sum of s/w over its pixels and the pictures of the present span, and the number of
    /// summands.
    sums: Vec<[f32; 2]>,
    /// For each sample point, the means of s/w in the finished spans; NaN if too little was seen.
    means: Vec<[f32; SPAN_COUNT]>,
}

/// The brightness and the states of all blocks in one picture.
pub struct TemporalNoiseInput<'a> {
    pub current: &'a [Block],
    pub wet: &'a [Block],
    pub state: &'a [Block],
    pub since_wet_s: f64,
}

impl TemporalNoise {
    /// Side of the square of a sample point, px.
    pub const SIDE_PX: usize = SAMPLE_POINT_SIDE_PX;

    /// Creates the lattice for this number of blocks, of which `columns` are in a row.
    pub fn new(columns: usize, blocks: usize) -> Self {
        let sites = blocks * BLOCK_PX / (SAMPLE_POINT_SIDE_PX * SAMPLE_POINT_SIDE_PX);
        TemporalNoise {
            columns,
            span: 0,
            began_s: f64::NEG_INFINITY,
            pictures: [0; SPAN_COUNT],
            sums: vec![[0.0; 2]; sites],
            means: vec![[f32::NAN; SPAN_COUNT]; sites],
        }
    }

    /// Adds a picture; pictures after the last span are ignored.
    pub fn add(&mut self, picture: &TemporalNoiseInput<'_>) {
        if picture.since_wet_s - self.began_s >= SPAN_S {
            if self.began_s.is_finite() {
                self.close();
                self.span += 1;
            }
            self.began_s = picture.since_wet_s;
        }
        if self.span >= SPAN_COUNT {
            return;
        }
        self.pictures[self.span] += 1;
        let columns = self.columns;
        let of_row = self.columns();
        self.sums.par_chunks_mut(of_row).enumerate().for_each(|(line, sums)| {
            for row in SAMPLE_POINT_SIDE_PX * line..SAMPLE_POINT_SIDE_PX * (line + 1) {
                let blocks = row * columns..(row + 1) * columns;
                let looks = picture.current[blocks.clone()].iter().zip(&picture.wet[blocks.clone()]);
                let blocks = looks.zip(&picture.state[blocks]);
                for (((look, wet), state), sums) in blocks.zip(sums.chunks_mut(BLOCK_PX / SAMPLE_POINT_SIDE_PX)) {
                    add_row(look, wet, state, sums);
                }
            }
        });
    }

    /// Ends the present span and stores its means.
    fn close(&mut self) {
        let Some(pictures) = self.pictures.get(self.span).copied() else { return };
        for (sums, means) in self.sums.iter_mut().zip(&mut self.means) {
            let [sum, count] = *sums;
            // With fewer values the noise of the mean would be larger than assumed.
            if count > 0.0
                && count
                    >= MIN_SPAN_FRACTION * (SAMPLE_POINT_SIDE_PX * SAMPLE_POINT_SIDE_PX) as f32 * pictures as f32
            {
                means[self.span] = sum / count;
            }
            *sums = [0.0; 2];
        }
    }

    /// Ends the observation: ends the present span, and ignores further pictures.
    pub fn end(&mut self) {
        self.close();
        self.span = SPAN_COUNT;
    }

    /// Returns the number of sample points in a row of the lattice.
    pub fn columns(&self) -> usize {
        self.columns * BLOCK_PX / SAMPLE_POINT_SIDE_PX
    }

    /// Returns the number of sample points.
    pub fn len(&self) -> usize {
        self.sums.len()
    }

    /// Returns the row and the column of a sample point in the window, px.
    pub fn sample_point_position(&self, at: usize) -> (usize, usize) {
        (at / self.columns() * SAMPLE_POINT_SIDE_PX, at % self.columns() * SAMPLE_POINT_SIDE_PX)
    }

    /// Returns the sample points around a pixel of the window.
    pub fn nearby_sample_points(&self, row: usize, column: usize) -> impl Iterator<Item = usize> + '_ {
        let (row, column) = (row / SAMPLE_POINT_SIDE_PX, column / SAMPLE_POINT_SIDE_PX);
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns());
        (row.saturating_sub(1)..row + 2)
            .flat_map(move |row| columns.clone().map(move |column| row * self.columns() + column))
    }

    /// Returns z of a sample point for each second difference; `noise` is σ/w of the sample point in one picture. NaN
    /// if too little was seen.
    pub fn difference_statistics(&self, site: usize, noise: f64) -> [f32; DIFFERENCE_COUNT] {
        let x = &self.means[site];
        std::array::from_fn(|k| {
            let part = |k: usize| 1.0 / self.pictures[k].max(1) as f32;
            (x[k] - 2.0 * x[k + 1] + x[k + 2]) / (noise as f32 * (part(k) + 4.0 * part(k + 1) + part(k + 2)).sqrt())
        })
    }
}

/// Adds each pixel in a row of a block to the sums of its sample point.
fn add_row(look: &Block, wet: &Block, state: &Block, sums: &mut [[f32; 2]]) {
    let mut shares = [[0.0_f32; 2]; BLOCK_PX];
    for i in 0..BLOCK_PX {
        let counts =
            state[i] & (INSIDE_FLAG | NO_DRY_FLAG) == INSIDE_FLAG | NO_DRY_FLAG && look[i] & OVEREXPOSED_FLAG == 0;
        let own = f32::from(u8::from(counts && wet[i] > 0));
        shares[i] = [own * f32::from(look[i] & BRIGHTNESS_MASK) / f32::from(wet[i].max(1)), own];
    }
    for (sums, shares) in sums.iter_mut().zip(shares.chunks(SAMPLE_POINT_SIDE_PX)) {
        for share in shares {
            *sums = [sums[0] + share[0], sums[1] + share[1]];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernel::LEVEL;
    use super::*;

    /// Expected values, calculated by hand: a place of 60 levels that becomes 0.1 levels brighter in each span of 1 s
    /// has no temporal noise. A place that is 1 level brighter in every second span has second differences of 2 levels.
    /// With a noise of 1 level and 10 pictures per span, z is 2 / √((1 + 4 + 1)/10) = 2.58.
    #[test]
    fn moving_water_has_temporal_noise_and_a_drying_place_has_none() {
        const ROWS: usize = 32;
        let wet = [[60 * LEVEL; BLOCK_PX]; ROWS];
        let state = [[INSIDE_FLAG | NO_DRY_FLAG; BLOCK_PX]; ROWS];
        let mut shimmer = TemporalNoise::new(1, ROWS);
        for picture in 0..240_usize {
            let span = (picture / 10) as f64;
            let look: Vec<Block> = (0..ROWS)
                .map(|row| {
                    let own = if row < 16 { 0.1 * span } else { span % 2.0 };
                    [(f64::from(LEVEL) * (60.0 + own)) as u16; BLOCK_PX]
                })
                .collect();
            let since_wet_s = 0.1 * picture as f64 + 0.05;
            shimmer.add(&TemporalNoiseInput { current: &look, wet: &wet, state: &state, since_wet_s });
        }
        shimmer.end();
        let at = |row: usize| {
            shimmer.difference_statistics(row / SAMPLE_POINT_SIDE_PX * shimmer.columns() + 5, 1.0 / 60.0)
        };
        assert!(at(10).iter().all(|shown| shown.abs() < 0.05), "{:?}", at(10));
        assert!(at(20).iter().all(|shown| (shown.abs() - 2.58).abs() < 0.05), "{:?}", at(20));
        assert_eq!(shimmer.sample_point_position(5 * 8 + 5), (20, 20));
    }
}
