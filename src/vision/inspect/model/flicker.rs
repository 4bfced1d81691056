//! Detects light that goes up and down from picture to picture.
//!
//! Water that wets the surroundings changes their brightness slowly, in one direction, or once; a lamp that beats
//! with the mains changes it up and down. With the light g of a channel in picture k and its change Δₖ = ln gₖ − ln
//! gₖ₋₁, a swing is
//!     sₖ = min(|Δₖ|, |Δₖ₋₁|)  if Δₖ Δₖ₋₁ < 0,                                                                          (1)
//! and a lamp flickers if a quarter of the pictures has a swing of [`MIN_SWING`] or more.

/// A lamp that flickers changes by at least `MIN_SWING` from picture to picture and back, and does so at least
/// `MIN_SWINGS` times.
const MIN_SWING: f64 = 0.02;
const MIN_SWINGS: u32 = 3;

/// The changes of the light of each channel from picture to picture.
#[derive(Debug, Clone, Copy, Default)]
pub struct Flicker {
    pictures: u32,
    channels: [LightChange; 3],
}

/// The light of the last picture and its change, both as logarithms, and the swings so far.
#[derive(Debug, Clone, Copy, Default)]
struct LightChange {
    last: f64,
    change: f64,
    count: u32,
    sum: f64,
}

impl Flicker {
    /// The mean swing with this picture's light, in the channel in which it is largest, percent; 0 if the light
    /// does not flicker.
    pub fn mean_swing_percent(&mut self, gains: [f64; 3]) -> f64 {
        self.pictures += 1;
        for (swings, gain) in self.channels.iter_mut().zip(gains) {
            let change = gain.ln() - swings.last;
            let swing = if change * swings.change < 0.0 { change.abs().min(swings.change.abs()) } else { 0.0 };
            swings.count += u32::from(swing >= MIN_SWING);
            swings.sum += if swing >= MIN_SWING { swing } else { 0.0 };
            (swings.last, swings.change) = (gain.ln(), change);
        }
        let flickers = |swings: &&LightChange| swings.count >= MIN_SWINGS.max(self.pictures / 4);
        let means = self.channels.iter().filter(flickers).map(|swings| swings.sum / f64::from(swings.count));
        100.0 * means.fold(0.0, f64::max)
    }

    /// The same flicker for light that is measured against the last picture from now on.
    pub fn referenced_to_last(mut self) -> Self {
        self.channels.iter_mut().for_each(|swings| swings.last = 0.0);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: up by 5 %, down by 3, up by 4 and down by 6, as logarithms, are swings of 3, 3 and 4 %; fewer than
    /// three swings do not count.
    #[test]
    fn a_swing_is_the_smaller_of_two_changes() {
        let mut flicker = Flicker::default();
        let percents =
            [0.05, 0.02, 0.06, 0.0].map(|level: f64| flicker.mean_swing_percent([level.exp(), 1.0, 1.0]));
        assert_eq!(percents[..3], [0.0; 3]);
        assert!((percents[3] - (3.0 + 3.0 + 4.0) / 3.0).abs() < 1e-9, "{percents:?}");
        let mut light = Flicker::default().referenced_to_last();
        let falls = [0.9, 0.8, 0.7, 0.6].map(|gain| light.mean_swing_percent([gain; 3]));
        assert_eq!(falls, [0.0; 4]);
    }

    /// By hand: three swings in sixteen pictures are less than a quarter.
    #[test]
    fn what_swung_once_does_not_flicker() {
        let mut flicker = Flicker::default();
        let swings = [1.1, 1.0, 1.1, 1.0].map(|gain| flicker.mean_swing_percent([gain; 3]));
        assert!(swings[3] > 9.0, "{swings:?}");
        let later: Vec<f64> = (0..12).map(|_| flicker.mean_swing_percent([1.0; 3])).collect();
        assert_eq!(later[11], 0.0, "{later:?}");
    }
}
