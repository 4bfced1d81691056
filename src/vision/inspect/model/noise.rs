//! The noise of the clip (the difference of a pixel of the film from picture to picture), and the noise of the sensor
//! as a function of brightness.
//!
//! The difference of two pictures has √2 times the standard deviation σ of one picture. Moving water makes some of the
//! differences larger, so only the lower third of their distribution is evaluated. In a normal distribution 30 % of the
//! absolute differences are below 0.385 √2 σ.
//!
//! The noise of the sensor is measured at points without moving water. Its variance increases with the light: σ² = a +
//! b s (EMVA 1288). Differences of two pictures have twice this variance. Points at which the light changed between the
//! two pictures have far larger differences and are excluded.

use super::kernel::{BRIGHTNESS_MASK, Block, INSIDE_FLAG, LEVEL, NO_DRY_FLAG, OVEREXPOSED_FLAG};

/// Quantile of the absolute differences that is evaluated; `NOISE_QUANTILE_VALUE` is its theoretical value, as a
/// multiple of √2 σ.
const NOISE_QUANTILE: f64 = 0.3;
const NOISE_QUANTILE_VALUE: f64 = 0.385;
/// Bin width of the histogram of the differences, 1/16 grey level in units of [`LEVEL`]; `DIFFERENCE_BIN_COUNT` is the
/// number of bins.
const DIFFERENCE_BIN_WIDTH: u16 = LEVEL / 16;
const DIFFERENCE_BIN_COUNT: usize = 512;
/// Lower limit of the noise, grey levels: rounding to whole levels alone causes this noise. `ASSUMED_NOISE_LEVELS` is
/// the noise that is assumed before the first measurement.
const MIN_NOISE_LEVELS: f64 = 0.35;
const ASSUMED_NOISE_LEVELS: f64 = 1.5;
/// Interval between the evaluated rows. `MIN_DIFFERENCES` is the minimum number of differences for a result.
pub(super) const ROW_STRIDE: usize = 4;
const MIN_DIFFERENCES: u64 = 200;

/// Histogram of the differences between successive pictures.
#[derive(Debug, Clone)]
pub struct Noise {
    classes: Vec<u64>,
}

impl Noise {
    pub fn new() -> Self {
        Noise { classes: vec![0; DIFFERENCE_BIN_COUNT] }
    }

    /// Adds the pixels of a row in two consecutive pictures; `brighter` is the ratio of the second picture's light to
    /// the first's.
    pub fn add(&mut self, look: &[Block], before: &[Block], state: &[Block], brighter: f64) {
        for ((look, before), state) in look.iter().zip(before).zip(state) {
            for ((look, before), state) in look.iter().zip(before).zip(state) {
                let counts = state & (INSIDE_FLAG | NO_DRY_FLAG) != 0 && (look | before) & OVEREXPOSED_FLAG == 0;
                if counts && state & INSIDE_FLAG > 0 {
                    let was = (f64::from(before & BRIGHTNESS_MASK) * brighter) as u16;
                    let class = usize::from((look & BRIGHTNESS_MASK).abs_diff(was) / DIFFERENCE_BIN_WIDTH);
                    self.classes[class.min(DIFFERENCE_BIN_COUNT - 1)] += 1;
                }
            }
        }
    }

    /// Returns the noise σ, grey levels.
    pub fn levels(&self) -> f64 {
        let all: u64 = self.classes.iter().sum();
        if all < MIN_DIFFERENCES {
            return ASSUMED_NOISE_LEVELS;
        }
        let wanted = NOISE_QUANTILE * all as f64;
        let mut below = 0.0;
        for (class, count) in self.classes.iter().enumerate() {
            let next = below + *count as f64;
            if next >= wanted {
                let within = (wanted - below) / (*count as f64).max(1.0);
                let level = (class as f64 + within) * f64::from(DIFFERENCE_BIN_WIDTH) / f64::from(LEVEL);
                return (level / NOISE_QUANTILE_VALUE / std::f64::consts::SQRT_2).max(MIN_NOISE_LEVELS);
            }
            below = next;
        }
        MIN_NOISE_LEVELS
    }
}

/// Maximum difference that is evaluated, grey levels: in a mean of many pixels a larger difference is not noise.
const MAX_DIFFERENCE_LEVELS: f64 = 3.0;
/// Bin width of the brightness histogram, grey levels; a bin with too few samples gives no result.
const BRIGHTNESS_BIN_WIDTH_LEVELS: f64 = 16.0;
const BRIGHTNESS_BIN_COUNT: usize = 16;
const MIN_DIFFERENCES_PER_BIN: f64 = 100.0;

/// Minimum variance, levels²: rounding causes a variance of 1/12 in each of 4 × 4 pixels and three channels.
const MIN_VARIANCE: f64 = 1.0 / 12.0 / 48.0;

/// Statistics of the differences so far: for each brightness bin the number of differences, and the sums of their
/// squares and of the brightness.
#[derive(Debug, Clone, Default)]
pub struct SensorNoise {
    classes: [[f64; 3]; BRIGHTNESS_BIN_COUNT],
}

impl SensorNoise {
    /// Adds the brightness of a sample point in two pictures, both in the same light.
    pub fn add(&mut self, before: f64, now: f64) {
        let difference = now - before;
        if difference.abs() < MAX_DIFFERENCE_LEVELS {
            let class = ((before / BRIGHTNESS_BIN_WIDTH_LEVELS) as usize).min(BRIGHTNESS_BIN_COUNT - 1);
            let [count, squares, levels] = &mut self.classes[class];
            *count += 1.0;
            *squares += difference * difference;
            *levels += before;
        }
    }

    /// Returns the variance of the noise at a brightness, levels²; `None` if there are too few differences.
    pub fn variance(&self, levels: f64) -> Option<f64> {
        let known: Vec<(f64, f64, f64)> = (self.classes.iter())
            .filter(|[count, ..]| *count >= MIN_DIFFERENCES_PER_BIN)
            .map(|[count, squares, levels]| (*count, levels / count, squares / count / 2.0))
            .collect();
        let weight: f64 = known.iter().map(|(count, ..)| count).sum();
        if known.is_empty() {
            return None;
        }
        let mean =
            |value: &dyn Fn(&(f64, f64, f64)) -> f64| known.iter().map(|it| it.0 * value(it)).sum::<f64>() / weight;
        let (level, variance) = (mean(&|it| it.1), mean(&|it| it.2));
        let (spread, shared) = (mean(&|it| (it.1 - level).powi(2)), mean(&|it| (it.1 - level) * (it.2 - variance)));
        // Noise does not decrease with more light, and is at least the rounding error of the mean of 48 numbers.
        let slope = if spread > 1.0 { (shared / spread).max(0.0) } else { 0.0 };
        let at = |levels: f64| (variance + slope * (levels - level)).max(MIN_VARIANCE);
        // Outside of the observed range the slope is uncertain. With a and b ≥ 0 the variance is at least proportional
        // to s below this range, and at most proportional to s above it. The larger value is used, so that noise is
        // never treated as water.
        let nearest =
            known.iter().map(|it| it.1).min_by(|a, b| (a - levels).abs().total_cmp(&(b - levels).abs()))?;
        let seen = known.iter().fold([f64::INFINITY, 0.0], |[low, high], it| [it.1.min(low), it.1.max(high)]);
        let is_beyond = levels < seen[0] || levels > seen[1];
        Some(if is_beyond { at(levels).max(at(nearest) * levels / nearest) } else { at(levels) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernel::BLOCK_PX;
    use super::*;

    /// Sums of twelve uniform random numbers are nearly normal: for σ = 2 levels, 2 are measured. If 25 % of the pixels
    /// change by 20 levels, 30 % of all pixels are 40 % of the other pixels, which lie below 0.524 √2 σ. The expected
    /// result, calculated by hand, is 2 · 0.524/0.385 = 2.72.
    #[test]
    fn noise_is_measured_beside_moving_water() {
        for moving in [0, 4] {
            let mut state: u32 = 7;
            let mut random = || {
                let sum: f64 = (0..12)
                    .map(|_| {
                        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        f64::from(state >> 8) / f64::from(1 << 24)
                    })
                    .sum();
                2.0 * (sum - 6.0)
            };
            let mut noise = Noise::new();
            for row in 0..200 {
                let mut block = |by: f64| -> Block {
                    std::array::from_fn(|i| {
                        let moves = if moving > 0 && i % moving == 0 { by } else { 0.0 };
                        ((60.0 + moves + random()) * f64::from(LEVEL)) as u16
                    })
                };
                let [a, b] = [block(0.0), block(if row % 2 == 0 { 20.0 } else { -20.0 })];
                noise.add(&[a], &[b], &[[INSIDE_FLAG; BLOCK_PX]], 1.0);
            }
            let found = noise.levels();
            let most = if moving > 0 { 2.8 } else { 2.1 };
            assert!(found > 1.9 && found < most, "{moving}: {found}");
        }
    }

    #[test]
    fn a_few_pixels_give_no_information() {
        assert_eq!(Noise::new().levels(), ASSUMED_NOISE_LEVELS);
    }

    /// Expected values, calculated by hand: differences of ±1 at 40 levels are a variance of 1/2, and ±2 at 100 levels
    /// a variance of 2. Between them, at 70 levels, the variance is 1.25. At 10 levels the line would give −0.25, so
    /// the result is a quarter of the variance at 40 levels. At 200 levels the line gives 4.5, which is more than twice
    /// the variance at 100 levels.
    #[test]
    fn noise_increases_with_the_light() {
        let mut noise = SensorNoise::default();
        assert_eq!(noise.variance(50.0), None);
        for i in 0..400 {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            noise.add(40.0, 40.0 + sign);
            noise.add(100.0, 100.0 + 2.0 * sign);
            noise.add(100.0, 150.0);
        }
        let at = |levels: f64| noise.variance(levels).expect("enough");
        assert!((at(40.0) - 0.5).abs() < 1e-9 && (at(100.0) - 2.0).abs() < 1e-9 && (at(70.0) - 1.25).abs() < 1e-9);
        assert!((at(10.0) - 0.125).abs() < 1e-9 && (at(200.0) - 4.5).abs() < 1e-9);
        let mut of_one = SensorNoise::default();
        (0..200).for_each(|i| of_one.add(50.0, if i % 2 == 0 { 51.0 } else { 49.0 }));
        assert!((of_one.variance(100.0).expect("enough") - 1.0).abs() < 1e-9, "of one brightness: in proportion");
    }
}
