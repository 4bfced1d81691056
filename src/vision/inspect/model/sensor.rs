//! The sensor's noise by brightness, measured at places without moving water.
//!
//! The variance of a sensor's noise grows with the light: σ² = a + b s (EMVA 1288). Differences of two pictures have
//! twice this variance. Places at which the light changed between the two pictures have far larger differences and do
//! not count.

/// Larger differences are not noise of a mean of many pixels, levels.
const MAX_LEVELS: f64 = 3.0;
/// Brightness is counted in classes of this width, levels; a class with too few differences gives no result.
const CLASS_LEVELS: f64 = 16.0;
const CLASSES: usize = 16;
const MIN_COUNT: f64 = 100.0;

/// The smallest variance: rounding leaves 1/12 in each of 4 × 4 pixels and three channels.
const MIN_VARIANCE: f64 = 1.0 / 12.0 / 48.0;

/// The statistics of the differences so far: for each class the number, and the sums of the squares and of the
/// brightness.
#[derive(Debug, Clone, Default)]
pub struct SensorNoise {
    classes: [[f64; 3]; CLASSES],
}

impl SensorNoise {
    /// Adds the brightness of a place in two pictures, both in the same light.
    pub fn add(&mut self, before: f64, now: f64) {
        let difference = now - before;
        if difference.abs() < MAX_LEVELS {
            let class = ((before / CLASS_LEVELS) as usize).min(CLASSES - 1);
            let [count, squares, levels] = &mut self.classes[class];
            *count += 1.0;
            *squares += difference * difference;
            *levels += before;
        }
    }

    /// Returns the variance of the noise at a brightness, levels²; `None` if there are too few differences.
    pub fn variance(&self, levels: f64) -> Option<f64> {
        let known: Vec<(f64, f64, f64)> = (self.classes.iter())
            .filter(|[count, ..]| *count >= MIN_COUNT)
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
        // Noise does not decrease with more light, and is never less than the rounding error of the mean of 48
        // numbers.
        let slope = if spread > 1.0 { (shared / spread).max(0.0) } else { 0.0 };
        let at = |levels: f64| (variance + slope * (levels - level)).max(MIN_VARIANCE);
        // Outside of the observed range the slope is not certain. With a and b ≥ 0 the variance is at least
        // proportional to s below that range, and at most proportional above it. The larger value is used, so that
        // noise never counts as water.
        let nearest =
            known.iter().map(|it| it.1).min_by(|a, b| (a - levels).abs().total_cmp(&(b - levels).abs()))?;
        let seen = known.iter().fold([f64::INFINITY, 0.0], |[low, high], it| [it.1.min(low), it.1.max(high)]);
        let is_beyond = levels < seen[0] || levels > seen[1];
        Some(if is_beyond { at(levels).max(at(nearest) * levels / nearest) } else { at(levels) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: differences of ±1 at 40 levels are a variance of 1/2, and ±2 at 100 levels a variance of 2. Between
    /// them, at 70, the variance is 1.25. At 10 levels the line would give −0.25; the result is a quarter of the
    /// variance at 40. At 200 the line gives 4.5, and twice the variance at 100 is less.
    #[test]
    fn noise_grows_with_the_light() {
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
