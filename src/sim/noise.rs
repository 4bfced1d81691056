//! Random numbers of the simulated cell. Each purpose and index has its own stream, so that a new use of random numbers
//! changes no other stream.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// The purpose of a stream of random numbers. Add new purposes only at the end, because their order affects every
/// rendered picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RandomPurpose {
    Shape,
    Placement,
    Calibration,
    Spots,
    Scan,
    ScanRow,
    Pixels,
    FlangePose,
    FlangePicture,
    Film,
    Runoff,
    BoardPose,
    BoardPicture,
    BoardCorners,
    BoardScan,
    Touch,
    Trial,
    Light,
    Glints,
    Drops,
    Grease,
    Arm,
    Sanding,
    Condition,
}

/// The seed from which all random numbers of a cell are derived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Seed(pub u64);

impl Seed {
    /// Creates the random number generator of this purpose and index.
    pub fn stream(self, purpose: RandomPurpose, index: u64) -> Pcg64 {
        Pcg64::seed_from_u64(mix_seed(mix_seed(mix_seed(self.0) ^ purpose as u64) ^ index))
    }

    /// Creates the seed of this purpose and index, from which further seeds can be derived.
    pub fn child(self, purpose: RandomPurpose, index: u64) -> Seed {
        Seed(self.stream(purpose, index).random())
    }

    /// Computes an index from numbers that identify a shot, such as its pose.
    pub fn index_of(numbers: &[f64]) -> u64 {
        numbers.iter().fold(0, |index, number| mix_seed(index ^ number.to_bits()))
    }
}

/// Mixes a seed with SplitMix64's finaliser (Steele, Lea & Flood, OOPSLA 2014), so that similar seeds give independent
/// streams.
fn mix_seed(state: u64) -> u64 {
    let z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Draws two independent standard normal numbers (Box–Muller).
pub(super) fn normal_pair(random: &mut Pcg64) -> [f64; 2] {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * random.random::<f64>()).sin_cos();
    [radius * cos, radius * sin]
}

/// A stream of standard normal numbers, which uses both numbers of each pair.
pub(super) struct NormalStream {
    random: Pcg64,
    spare: Option<f64>,
}

impl NormalStream {
    pub fn new(random: Pcg64) -> Self {
        NormalStream { random, spare: None }
    }

    pub fn next(&mut self) -> f64 {
        self.spare.take().unwrap_or_else(|| {
            let [first, second] = normal_pair(&mut self.random);
            self.spare = Some(second);
            first
        })
    }

    /// Draws a number that is uniformly distributed from 0 to 1.
    pub fn next_uniform(&mut self) -> f64 {
        self.random.random()
    }
}

/// Value noise: normal random numbers at the nodes of a square lattice, interpolated with smoothstep between the nodes.
///
/// With weights w = 3x² − 2x³ the mean of w² + (1 − w)² over a cell is 26/35 for each axis. Overall, the noise
/// therefore has 26/35 = 0.743 of the standard deviation at the nodes.
#[derive(Debug, Clone)]
pub(super) struct ValueNoise {
    spacing_mm: f64,
    corner_mm: [f64; 2],
    columns: usize,
    nodes: Vec<f64>,
}

impl ValueNoise {
    /// Creates noise of 1 rms at the nodes over the square −`half_width_mm`…`half_width_mm`, with a random phase.
    pub fn new(random: Pcg64, spacing_mm: f64, half_width_mm: f64) -> Self {
        let mut normal = NormalStream::new(random);
        let corner_mm = [0, 1].map(|_| -half_width_mm - spacing_mm * normal.next_uniform());
        let columns = (2.0 * half_width_mm / spacing_mm).ceil() as usize + 3;
        ValueNoise {
            spacing_mm,
            corner_mm,
            columns,
            nodes: (0..columns * columns).map(|_| normal.next()).collect(),
        }
    }

    /// Returns the noise at a point of the sheet. Beyond the lattice, the values at its border continue.
    pub fn value_at(&self, [s_mm, t_mm]: [f64; 2]) -> f64 {
        let (i, across) = self.cell(s_mm - self.corner_mm[0]);
        let (j, up) = self.cell(t_mm - self.corner_mm[1]);
        let node = |di: usize, dj: usize| self.nodes[(j + dj) * self.columns + i + di];
        let low = node(0, 0) + across * (node(1, 0) - node(0, 0));
        let high = node(0, 1) + across * (node(1, 1) - node(0, 1));
        low + up * (high - low)
    }

    fn cell(&self, along_mm: f64) -> (usize, f64) {
        let position = (along_mm / self.spacing_mm).clamp(0.0, (self.columns - 2) as f64);
        let index = (position as usize).min(self.columns - 2);
        (index, smoothstep(position - index as f64))
    }
}

/// Computes 3x² − 2x³ for x from 0 to 1; the result is constant outside.
pub(super) fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Number of steps per grey level in the renderer's integer colours.
pub(super) const STEPS_PER_GRAY_LEVEL: f32 = 128.0;

/// Standard deviation of the pixel noise of both cameras, grey levels.
pub(super) const PIXEL_NOISE_GRAY: f64 = 2.0;

const TABLE_LENGTH: usize = 1 << 18;

/// A table of pixel noise: each row of each picture starts at its own position in the table.
#[derive(Debug, Clone)]
pub(super) struct PixelNoise {
    table: Vec<i16>,
}

impl PixelNoise {
    pub fn new(seed: Seed) -> Self {
        let mut normal = NormalStream::new(seed.stream(RandomPurpose::Pixels, 0));
        let level = PIXEL_NOISE_GRAY * f64::from(STEPS_PER_GRAY_LEVEL);
        PixelNoise { table: (0..TABLE_LENGTH).map(|_| (normal.next() * level).round() as i16).collect() }
    }

    /// Returns the noise of one row of a picture, three values per pixel.
    pub fn row(&self, picture: Seed, row: usize, width: usize) -> &[i16] {
        let last = TABLE_LENGTH - 3 * width;
        let start = picture.stream(RandomPurpose::Pixels, row as u64).random_range(0..=last);
        &self.table[start..start + 3 * width]
    }
}

/// Returns a colour in 1/128 grey levels, plus its noise, as an 8-bit value.
#[inline]
pub(super) fn to_byte(color: u16, noise: i16) -> u8 {
    ((i32::from(color) + i32::from(noise) + 64) >> 7).clamp(0, 255) as u8
}

/// Returns a pixel's colour, plus its part of the row's noise, as 8-bit values.
pub(super) fn to_bytes(color: [u16; 3], row_noise: &[i16], column: usize) -> [u8; 3] {
    std::array::from_fn(|channel| to_byte(color[channel], row_noise[3 * column + channel]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rms(numbers: &[f64]) -> f64 {
        (numbers.iter().map(|n| n * n).sum::<f64>() / numbers.len() as f64).sqrt()
    }

    /// Expected value, calculated by hand: the rms over a cell is 26/35 of the rms at the nodes; 0.06 mm becomes 0.0446
    /// mm.
    #[test]
    fn value_noise_has_26_35_of_the_rms_at_its_nodes() {
        let samples: Vec<f64> = (0..400)
            .flat_map(|index| {
                let noise = ValueNoise::new(Seed(7).stream(RandomPurpose::Scan, index), 60.0, 200.0);
                (0..400).map(move |i| {
                    noise.value_at([f64::from(i % 20) * 18.0 - 180.0, f64::from(i / 20) * 18.0 - 180.0])
                })
            })
            .collect();
        let share = rms(&samples);
        assert!((share - 26.0 / 35.0).abs() < 0.015, "{share}");
    }

    #[test]
    fn pixel_noise_is_two_gray_levels() {
        let noise = PixelNoise::new(Seed(1));
        let samples: Vec<f64> =
            noise.row(Seed(2), 5, 20_000).iter().map(|&n| f64::from(n) / f64::from(STEPS_PER_GRAY_LEVEL)).collect();
        assert!((rms(&samples) - PIXEL_NOISE_GRAY).abs() < 0.03, "{}", rms(&samples));
        assert_ne!(noise.row(Seed(2), 5, 10), noise.row(Seed(2), 6, 10));
        assert_ne!(noise.row(Seed(2), 5, 10), noise.row(Seed(3), 5, 10));
    }

    /// Expected values, calculated by hand: 70 + 2.5 = 72.5 is rounded to 73; values are limited to the range of a
    /// byte.
    #[test]
    fn values_are_rounded_and_limited_to_a_byte() {
        assert_eq!(to_byte(70 * 128, 320), 73);
        assert_eq!(to_byte(70 * 128, 319), 72);
        assert_eq!((to_byte(255 * 128, 900), to_byte(0, -900)), (255, 0));
    }
}
