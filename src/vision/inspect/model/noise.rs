//! The clip's own noise: the difference of a film's pixel from picture to picture.
//!
//! The difference of two pictures has √2 times the standard deviation σ of one picture. Moving water makes some of
//! the differences larger, so only the lower third of their distribution counts. In a normal distribution 30 % of
//! the absolute differences are below 0.385 √2 σ.

use super::kernel::{Block, INSIDE, LEVEL, LOOK_MASK, NO_DRY_FLAG, OVEREXPOSED};

/// The quantile of the differences that is evaluated, and its value for σ = 1.
const SHARE: f64 = 0.3;
const AT_SHARE: f64 = 0.385;
/// Differences are counted in classes of 1/16 level; the second constant is the number of classes.
const CLASSES_PER_LEVEL: u16 = LEVEL / 16;
const CLASSES: usize = 512;
/// Noise below that of rounding to whole levels is not a measurement, levels. The second constant is the noise that
/// is assumed before the first measurement.
const MIN_LEVELS: f64 = 0.35;
const ASSUMED_LEVELS: f64 = 1.5;
/// Every nth row is looked at. The second constant is the number of differences that is sufficient.
pub(super) const ROW_STRIDE: usize = 4;
const MIN_DIFFERENCES: u64 = 200;

/// The histogram of the differences so far.
#[derive(Debug, Clone)]
pub struct Noise {
    classes: Vec<u64>,
}

impl Noise {
    pub fn new() -> Self {
        Noise { classes: vec![0; CLASSES] }
    }

    /// Adds the pixels of a row in two consecutive pictures; `brighter` is the ratio of the second picture's light to
    /// the first's.
    pub fn add(&mut self, look: &[Block], before: &[Block], state: &[Block], brighter: f64) {
        for ((look, before), state) in look.iter().zip(before).zip(state) {
            for ((look, before), state) in look.iter().zip(before).zip(state) {
                let counts = state & (INSIDE | NO_DRY_FLAG) != 0 && (look | before) & OVEREXPOSED == 0;
                if counts && state & INSIDE > 0 {
                    let was = (f64::from(before & LOOK_MASK) * brighter) as u16;
                    let class = usize::from((look & LOOK_MASK).abs_diff(was) / CLASSES_PER_LEVEL);
                    self.classes[class.min(CLASSES - 1)] += 1;
                }
            }
        }
    }

    /// Returns σ in grey levels.
    pub fn levels(&self) -> f64 {
        let all: u64 = self.classes.iter().sum();
        if all < MIN_DIFFERENCES {
            return ASSUMED_LEVELS;
        }
        let wanted = SHARE * all as f64;
        let mut below = 0.0;
        for (class, count) in self.classes.iter().enumerate() {
            let next = below + *count as f64;
            if next >= wanted {
                let within = (wanted - below) / (*count as f64).max(1.0);
                let level = (class as f64 + within) * f64::from(CLASSES_PER_LEVEL) / f64::from(LEVEL);
                return (level / AT_SHARE / std::f64::consts::SQRT_2).max(MIN_LEVELS);
            }
            below = next;
        }
        MIN_LEVELS
    }
}

#[cfg(test)]
mod tests {
    use super::super::kernel::BLOCK_PX;
    use super::*;

    /// Sums of twelve uniform numbers are nearly normal: for σ = 2 levels, 2 are found. If a quarter of the pixels
    /// moves by 20, 30 % of all pixels are 40 % of the others, which lie below 0.524 √2 σ. By hand, 2 · 0.524/0.385
    /// = 2.72 are found.
    #[test]
    fn noise_is_found_beside_what_moves() {
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
                noise.add(&[a], &[b], &[[INSIDE; BLOCK_PX]], 1.0);
            }
            let found = noise.levels();
            let most = if moving > 0 { 2.8 } else { 2.1 };
            assert!(found > 1.9 && found < most, "{moving}: {found}");
        }
    }

    #[test]
    fn a_few_pixels_give_no_information() {
        assert_eq!(Noise::new().levels(), ASSUMED_LEVELS);
    }
}
