//! Advice from a clip about light and thresholds (thesis 4.2): how well each channel distinguishes wet from dry.
//!
//! Over the region, with the mean dry picture d, a wet one w and the noise σ of one picture, all by channel,
//!     contrast-to-noise = (d − w) / σ,       weight ∝ (d − w) / σ²,                                      (1)
//! the weights that give the least noise for a given contrast (a matched filter). The thesis's threshold lies
//! half-way between dry and wet of the best channel; its HSV range surrounds the values of dry pixels.

use super::InspectError;
use super::score::{Score, score};
use super::thesis;
use panelprep_base::geometry::{ColorPicture, Mask};
use panelprep_cell::recipe;
use std::collections::BTreeMap;

/// One channel of the region.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Channel {
    /// Mean brightness when dry.
    pub dry: f64,
    /// Mean brightness under a complete film.
    pub wet: f64,
    /// Noise of one picture, levels.
    pub noise: f64,
    /// (1).
    pub weight: f64,
}

impl Channel {
    /// Returns the change that the film causes, in multiples of the noise.
    pub fn contrast_to_noise(&self) -> f64 {
        (self.dry - self.wet) / self.noise.max(0.1)
    }
}

/// Settings that suit this panel in this light.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// Red, green, blue; weights from 0 to 1.
    pub channels: [Channel; 3],
    /// The darkest and the brightest twentieth of the dry region relative to its mean: a measure of the evenness of
    /// the light.
    pub evenness: [f64; 2],
    /// Share of the dry region that is overexposed.
    pub overexposed: f64,
    /// The thesis's threshold for the recipe's gain.
    pub threshold: usize,
    /// The range of hue, saturation and value of dry pixels, widened.
    pub hsv: [[usize; 3]; 2],
}

/// Collects the pixels of a region, picture by picture; stores only sums.
#[derive(Debug)]
pub struct Sampler {
    region: Vec<usize>,
    dry: Vec<[u32; 3]>,
    dry_pictures: u32,
    wet: Vec<[u32; 3]>,
    wet_pictures: u32,
    before: Option<Vec<[u8; 3]>>,
    /// Sum of squared differences of successive pictures, and number of differences.
    squares: [f64; 3],
    differences: f64,
}

impl Sampler {
    /// Creates a sampler for the pixels of this region.
    pub fn new(region: &Mask) -> Self {
        let region: Vec<usize> = (0..region.inside.len()).filter(|&index| region.inside[index]).collect();
        let none = vec![[0; 3]; region.len()];
        Sampler {
            dry: none.clone(),
            wet: none,
            region,
            dry_pictures: 0,
            wet_pictures: 0,
            before: None,
            squares: [0.0; 3],
            differences: 0.0,
        }
    }

    /// Adds a picture of the dry panel.
    pub fn add_dry(&mut self, picture: &ColorPicture) {
        add(&mut self.dry, &self.region, picture);
        self.dry_pictures += 1;
        self.noise(picture);
    }

    /// Adds a picture of the panel under a complete film.
    pub fn add_wet(&mut self, picture: &ColorPicture) {
        add(&mut self.wet, &self.region, picture);
        if self.wet_pictures == 0 {
            self.before = None;
        }
        self.wet_pictures += 1;
        self.noise(picture);
    }

    fn noise(&mut self, picture: &ColorPicture) {
        let now: Vec<[u8; 3]> = self.region.iter().map(|&index| picture.rgb[index]).collect();
        if let Some(before) = self.before.replace(now) {
            let now = self.before.iter().flatten();
            for (a, b) in before.iter().zip(now) {
                // Clipped differences: twice the median would be more robust, but glints are rare enough that a limit
                // is sufficient.
                let differs = |i: usize| (f64::from(a[i]) - f64::from(b[i])).clamp(-12.0, 12.0);
                (0..3).for_each(|i| self.squares[i] += differs(i).powi(2));
                self.differences += 1.0;
            }
        }
    }

    /// Returns the mean dry brightness by pixel of the picture, with channel weights whose sum is 1.
    pub(super) fn dry_means(&self, weights: [f64; 3]) -> BTreeMap<usize, f64> {
        channel_means(&self.region, &self.dry, self.dry_pictures, weights)
    }

    /// Returns the mean brightness under a complete film by pixel of the picture, with channel weights whose sum is
    /// 1.
    pub(super) fn wet_means(&self, weights: [f64; 3]) -> BTreeMap<usize, f64> {
        channel_means(&self.region, &self.wet, self.wet_pictures, weights)
    }

    /// Noise of one picture by channel, grey levels.
    pub(super) fn noise_levels(&self) -> [f64; 3] {
        // The difference of two pictures has twice the variance of one.
        self.squares.map(|square| (square / self.differences.max(1.0) / 2.0).sqrt())
    }

    /// Returns the settings that suit the panel; `None` without a dry and a wet picture, or without a pixel.
    pub fn advice(&self, settings: &recipe::Inspect) -> Option<Advice> {
        if self.dry_pictures == 0 || self.wet_pictures == 0 || self.region.is_empty() {
            return None;
        }
        let count = self.region.len() as f64;
        let mean = |sums: &[[u32; 3]], pictures: u32, i: usize| {
            sums.iter().map(|sum| f64::from(sum[i])).sum::<f64>() / count / f64::from(pictures)
        };
        let noise = self.noise_levels();
        let mut channels: [Channel; 3] = std::array::from_fn(|i| Channel {
            dry: mean(&self.dry, self.dry_pictures, i),
            wet: mean(&self.wet, self.wet_pictures, i),
            noise: noise[i],
            weight: 0.0,
        });
        let raw = channels.map(|channel| ((channel.dry - channel.wet) / channel.noise.max(0.1).powi(2)).max(0.0));
        let heaviest = raw.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        (0..3).for_each(|i| channels[i].weight = (100.0 * raw[i] / heaviest).round() / 100.0);
        let change = channels.iter().map(|channel| channel.dry - channel.wet).fold(0.0, f64::max);
        let dry: Vec<[u8; 3]> =
            self.dry.iter().map(|sum| sum.map(|sum| (sum / self.dry_pictures).min(255) as u8)).collect();
        let mut brightness: Vec<f64> = dry.iter().map(|rgb| rgb.iter().copied().map(f64::from).sum()).collect();
        let whole = brightness.iter().sum::<f64>() / count;
        brightness.sort_by(f64::total_cmp);
        let part = |share: f64| brightness[((count - 1.0) * share) as usize] / whole.max(f64::MIN_POSITIVE);
        Some(Advice {
            evenness: [part(0.05), part(0.95)],
            overexposed: dry.iter().filter(|rgb| rgb.iter().any(|&value| value >= 250)).count() as f64 / count,
            threshold: ((settings.gain() * change / 2.0 + settings.bias()).round() as usize).clamp(1, 255),
            hsv: hsv_range(&dry).ok()?,
            channels,
        })
    }
}

fn channel_means(region: &[usize], sums: &[[u32; 3]], pictures: u32, weights: [f64; 3]) -> BTreeMap<usize, f64> {
    let count = f64::from(pictures.max(1));
    let mean = |sum: &[u32; 3]| (0..3).map(|i| weights[i] * f64::from(sum[i]) / count).sum();
    region.iter().copied().zip(sums.iter().map(mean)).collect()
}

fn add(sums: &mut [[u32; 3]], region: &[usize], picture: &ColorPicture) {
    for (sum, &index) in sums.iter_mut().zip(region) {
        (0..3).for_each(|i| sum[i] += u32::from(picture.rgb[index][i]));
    }
}

/// Returns the range from the first to the ninety-ninth percentile of each component, widened by a tenth of the
/// scale on both sides.
fn hsv_range(dry: &[[u8; 3]]) -> Result<[[usize; 3]; 2], InspectError> {
    let picture = ColorPicture { width: dry.len(), height: 1, rgb: dry.to_vec() };
    let hsv = thesis::to_hsv(&picture)?;
    let mut range = [[0; 3]; 2];
    for i in 0..3 {
        let mut values: Vec<u8> = hsv.iter().map(|hsv| hsv[i]).collect();
        values.sort_unstable();
        let (most, wider) = if i == 0 { (179, 18) } else { (255, 26) };
        let at = |share: usize| usize::from(values[(values.len() - 1) * share / 100]);
        range[0][i] = at(1).saturating_sub(wider);
        range[1][i] = (at(99) + wider).min(most);
    }
    Ok(range)
}

/// Finds the threshold with which the thesis's pipeline agrees best with the truth, from the reference and the last
/// picture, and the score of this threshold. The other settings of the pipeline are not changed.
///
/// # Errors
/// If sizes differ, or OpenCV refuses a picture.
pub fn best_threshold(
    settings: &recipe::Inspect,
    [reference, last]: [&ColorPicture; 2],
    truth: &Mask,
    region: &Mask,
) -> Result<(usize, Score), InspectError> {
    let levels = thesis::levels(settings, reference, last)?;
    let mut best: Option<(usize, Score)> = None;
    for threshold in (4..=252).step_by(4) {
        let inside = levels.iter().map(|level| usize::from(*level) >= threshold).collect();
        let found = score(&Mask { width: truth.width, height: truth.height, inside }, truth, region)?;
        if best.is_none_or(|(_, score)| found.iou > score.iou) {
            best = Some((threshold, found));
        }
    }
    best.ok_or(InspectError::NoWetPicture)
}

#[cfg(test)]
mod tests {
    use super::super::tests::inspect_table;
    use super::*;

    /// Calculated by hand: dry (100, 80, 60), wet (90, 50, 30), noise ±2 in all: contrasts 10, 30, 30, weights ⅓,
    /// 1, 1. With a gain of 4 the threshold is 4·30/2 = 60.
    #[test]
    fn channels_are_weighed_by_their_contrast() {
        let region = Mask { width: 10, height: 10, inside: vec![true; 100] };
        let mut sampler = Sampler::new(&region);
        let noisy = |rgb: [u8; 3], odd: usize| {
            let mut picture = ColorPicture::uniform(10, 10, rgb);
            picture.rgb.iter_mut().skip(odd).step_by(2).for_each(|pixel| *pixel = pixel.map(|gray| gray + 4));
            picture
        };
        (0..4).for_each(|i| sampler.add_dry(&noisy([98, 78, 58], i % 2)));
        (0..4).for_each(|i| sampler.add_wet(&noisy([88, 48, 28], i % 2)));
        let advice = sampler.advice(&inspect_table("gain = 4")).expect("dry and wet");
        assert_eq!(advice.channels.map(|channel| channel.weight), [0.33, 1.0, 1.0]);
        assert!((advice.channels[0].dry - 100.0).abs() < 1e-9 && (advice.channels[1].wet - 50.0).abs() < 1e-9);
        // Successive pictures differ by 4 everywhere: σ = 4/√2.
        assert!((advice.channels[2].noise - 8.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!((advice.threshold, advice.overexposed), (60, 0.0));
        assert!(Sampler::new(&region).advice(&inspect_table("")).is_none());
    }

    #[test]
    fn the_best_threshold_parts_what_is_true() {
        let reference = ColorPicture::uniform(20, 20, [50; 3]);
        let (mut last, mut truth) = (reference.clone(), Mask::all_outside(20, 20));
        for index in (0..400).filter(|i| i % 20 >= 12) {
            last.rgb[index] = [80; 3];
            truth.inside[index] = true;
        }
        let region = Mask { inside: vec![true; 400], ..truth.clone() };
        let settings = inspect_table("gain = 2\nmedian_px = 3\nmedian_passes = 1");
        let (threshold, found) = best_threshold(&settings, [&reference, &last], &truth, &region).expect("one size");
        assert_eq!((threshold, found.iou), (4, 1.0), "any from 4 to 60 parts them");
    }
}
