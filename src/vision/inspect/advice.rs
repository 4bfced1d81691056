//! Recommends settings for light and thresholds from a clip (thesis 4.2), by how well each colour channel distinguishes
//! wet from dry. For the film method the module also states the contrast in every grid, and the longest time for which
//! a place appeared dry and then wet again.
//!
//! Over the region, let d be the mean dry brightness, w the mean wet brightness and σ the noise of one picture, each
//! for one channel:
//!     contrast-to-noise = (d − w) / σ,       weight ∝ (d − w) / σ².                                      (1)
//! These weights give the least noise for a given contrast (a matched filter). The thesis's threshold is halfway
//! between the dry and the wet brightness of the best channel. The thesis's HSV range encloses the values of dry
//! pixels.
//!
//! The film method evaluates the brightness v, a weighted sum of the channels. A pixel has the mean brightness d in the
//! dry pictures and w in the first wet pictures. In a picture with s times the light of the first wet pictures, the
//! pixel appears dry if
//!     (d + w) / 2 < v / s < d + (d - w) / 2;                                                             (2)
//! a brighter pixel is a reflection. A place that appears dry and within a few seconds wet again was a glint, a drop or
//! a flicker: `persist_s` must be longer than this event. A place that stays dry for longer has broken, and is not
//! evaluated here.

use super::error::InspectError;
use super::gate::MIN_CHANGE_TO_NOISE;
use super::score::{Score, score};
use super::thesis;
use panelprep_base::geometry::statistics::{QuantileRank, quantile};
use panelprep_base::geometry::{ColorPicture, Mask, median};
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe;
use std::collections::BTreeMap;

/// Measured values of one colour channel over the region.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Channel {
    /// Mean brightness of the dry panel, grey levels.
    pub dry: f64,
    /// Mean brightness under a complete film, grey levels.
    pub wet: f64,
    /// Standard deviation of the noise of one picture, grey levels.
    pub noise: f64,
    /// Recommended weight of the channel by (1), 0…1.
    pub weight: f64,
}

impl Channel {
    /// Returns the change of brightness by the film, as a multiple of the noise.
    pub fn contrast_to_noise(&self) -> f64 {
        (self.dry - self.wet) / self.noise.max(0.1)
    }
}

/// Recommended settings for this panel in this light.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    /// The channels red, green and blue, with weights from 0 to 1.
    pub channels: [Channel; 3],
    /// Uniformity of the light: mean brightness of the darkest 5 % and of the brightest 5 % of the dry region, each
    /// relative to the mean brightness of the region.
    pub evenness: [f64; 2],
    /// Fraction of the dry region that is overexposed.
    pub overexposed: f64,
    /// Threshold for the thesis's method, at the recipe's gain.
    pub threshold: usize,
    /// Minimum and maximum of hue, saturation and value of the dry pixels, with a margin.
    pub hsv: [[usize; 3]; 2],
}

/// Accumulates statistics of a region's pixels, picture by picture; only sums are stored.
#[derive(Debug)]
pub struct Sampler {
    region: Vec<usize>,
    dry: Vec<[u32; 3]>,
    dry_pictures: u32,
    wet: Vec<[u32; 3]>,
    wet_pictures: u32,
    before: Option<Vec<[u8; 3]>>,
    /// For each channel, the sum of the squared differences between successive pictures.
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
        self.add_noise(picture);
    }

    /// Adds a picture of the panel under a complete film.
    pub fn add_wet(&mut self, picture: &ColorPicture) {
        add(&mut self.wet, &self.region, picture);
        if self.wet_pictures == 0 {
            self.before = None;
        }
        self.wet_pictures += 1;
        self.add_noise(picture);
    }

    fn add_noise(&mut self, picture: &ColorPicture) {
        let now: Vec<[u8; 3]> = self.region.iter().map(|&index| picture.rgb[index]).collect();
        if let Some(before) = self.before.replace(now) {
            let now = self.before.iter().flatten();
            for (a, b) in before.iter().zip(now) {
                // The differences are clipped. A median would be more robust, but glints are rare enough for clipping.
                let differs = |i: usize| (f64::from(a[i]) - f64::from(b[i])).clamp(-12.0, 12.0);
                (0..3).for_each(|i| self.squares[i] += differs(i).powi(2));
                self.differences += 1.0;
            }
        }
    }

    /// Returns the mean dry brightness for each pixel index of the picture, with channel weights that are scaled to a
    /// sum of 1.
    fn dry_means(&self, weights: [f64; 3]) -> BTreeMap<usize, f64> {
        channel_means(&self.region, &self.dry, self.dry_pictures, weights)
    }

    /// Returns the mean brightness under a complete film for each pixel index of the picture, with channel weights that
    /// are scaled to a sum of 1.
    fn wet_means(&self, weights: [f64; 3]) -> BTreeMap<usize, f64> {
        channel_means(&self.region, &self.wet, self.wet_pictures, weights)
    }

    /// Returns the noise of one picture for each channel, grey levels.
    pub(super) fn noise_levels(&self) -> [f64; 3] {
        // The variance of a difference of two pictures is twice the variance of one picture.
        self.squares.map(|square| (square / self.differences.max(1.0) / 2.0).sqrt())
    }

    /// Returns the recommended settings; `None` without a dry picture, without a wet picture or without a pixel in the
    /// region.
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
        let mut part = |share: f64| {
            let level = quantile(&mut brightness, share, QuantileRank::Lower)?;
            Some(level / whole.max(f64::MIN_POSITIVE))
        };
        Some(Advice {
            evenness: [part(0.05)?, part(0.95)?],
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

/// Returns the range from the 1st to the 99th percentile of hue, saturation and value, extended on both sides by 10 %
/// of the component's full scale.
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

/// Finds the threshold at which the result of the thesis's pipeline agrees best with the true mask. The pipeline
/// compares the reference picture with the last picture. Returns the threshold and its score; the other settings of the
/// pipeline stay as they are.
///
/// # Errors
/// If the pictures and the mask differ in size, or OpenCV refuses a picture.
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

/// Maximum duration of a flash, s. A place that appears dry for longer and then wet again was a break over which the
/// film closed.
const MAX_FLASH_S: f64 = 4.0;
/// Minimum number of pixels of a flash: a break with fewer pixels would not be detected reliably.
const MIN_FLASH_PX: usize = 12;

/// The contrast between dry panel and film in one grid, in the brightness that the film method uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridContrast {
    /// Name of the grid.
    pub id: GridId,
    /// Mean brightness of the dry grid, grey levels.
    pub dry: f64,
    /// Mean brightness of the grid under a complete film, grey levels.
    pub wet: f64,
    /// The change of brightness by the film, as a multiple of the noise of a pixel.
    pub contrast_to_noise: f64,
    /// The dry brightness of the grid, relative to the dry brightness of the whole region.
    pub light: f64,
    /// The channel with the largest contrast-to-noise ratio: 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// The contrast-to-noise ratio of `channel`; negative if the film is brighter than the dry panel.
    pub channel_to_noise: f64,
    /// Percentage of the grid in which the film changes every channel by less than [`MIN_CHANGE_TO_NOISE`] times the
    /// noise of the channel: a break would not be visible there.
    pub faint_percent: f64,
}

impl GridContrast {
    /// Returns the larger of two contrast-to-noise ratios: the ratio with the recipe's channel weights, and the
    /// absolute ratio of the best single channel.
    pub fn best_contrast_to_noise(&self) -> f64 {
        self.contrast_to_noise.max(self.channel_to_noise.abs())
    }
}

/// Detects flashes, places that appear dry for a moment, from the pictures of a clip one by one.
#[derive(Debug)]
pub struct FlashDetector {
    pixels: Vec<usize>,
    weights: [f64; 3],
    dry: Vec<f64>,
    wet: Vec<f64>,
    /// For each pixel, the time at which the pixel began to appear dry, s; `None` if the pixel appears wet.
    since_s: Vec<Option<f64>>,
    longest_s: Vec<f64>,
    is_first: bool,
}

/// Returns the brightness of a pixel: the sum of its channels, weighted with weights whose sum is 1.
fn brightness([r, g, b]: [u8; 3], weights: [f64; 3]) -> f64 {
    f64::from(r) * weights[0] + f64::from(g) * weights[1] + f64::from(b) * weights[2]
}

fn channel_shares(settings: &recipe::Inspect) -> [f64; 3] {
    let weights = settings.channel_weights();
    weights.map(|weight| weight / weights.iter().sum::<f64>())
}

impl Sampler {
    /// Calculates the contrast in each grid from the given pixel indices; a grid without a pixel is omitted.
    pub fn grid_contrasts(&self, settings: &recipe::Inspect, grids: &[(GridId, Vec<usize>)]) -> Vec<GridContrast> {
        let weights = channel_shares(settings);
        let (dry, wet) = (self.dry_means(weights), self.wet_means(weights));
        let of_channel = |channel: usize| {
            let mut one = [0.0; 3];
            one[channel] = 1.0;
            (self.dry_means(one), self.wet_means(one))
        };
        let channels = [0, 1, 2].map(of_channel);
        let levels = self.noise_levels().map(|noise| noise.max(0.1));
        let squares = self.noise_levels().into_iter().zip(weights).map(|(noise, weight)| (noise * weight).powi(2));
        let noise = squares.sum::<f64>().sqrt().max(0.1);
        let whole = dry.values().sum::<f64>() / dry.len().max(1) as f64;
        let grid = |(id, pixels): &(GridId, Vec<usize>)| {
            let seen: Vec<(f64, f64)> =
                pixels.iter().filter_map(|index| Some((*dry.get(index)?, *wet.get(index)?))).collect();
            let count = seen.len() as f64;
            let (dry, wet) = seen.iter().fold((0.0, 0.0), |sum, it| (sum.0 + it.0 / count, sum.1 + it.1 / count));
            let (contrast_to_noise, light) = ((dry - wet) / noise, dry / whole.max(f64::MIN_POSITIVE));
            let changes: Vec<[f64; 3]> = pixels
                .iter()
                .filter(|index| channels[0].0.contains_key(index))
                .map(|index| [0, 1, 2].map(|i| channels[i].0[index] - channels[i].1[index]))
                .collect();
            let to_noise =
                [0, 1, 2].map(|i| changes.iter().map(|change| change[i]).sum::<f64>() / count / levels[i]);
            let channel = (1..3).fold(0, |best, i| if to_noise[i].abs() > to_noise[best].abs() { i } else { best });
            let faint = |change: &&[f64; 3]| {
                change.iter().zip(levels).all(|(change, noise)| change.abs() < MIN_CHANGE_TO_NOISE * noise)
            };
            let faint_percent = 100.0 * changes.iter().filter(faint).count() as f64 / count;
            let channel_to_noise = to_noise[channel];
            let grid = GridContrast {
                id: *id,
                dry,
                wet,
                contrast_to_noise,
                light,
                channel,
                channel_to_noise,
                faint_percent,
            };
            (!seen.is_empty()).then_some(grid)
        };
        grids.iter().filter_map(grid).collect()
    }

    /// Creates a detector for places that appear dry for a moment. The pixels of `broken`, which are known to break,
    /// are excluded.
    pub fn flash_detector(&self, settings: &recipe::Inspect, broken: Option<&Mask>) -> FlashDetector {
        let weights = channel_shares(settings);
        let (dry, wet) = (self.dry_means(weights), self.wet_means(weights));
        // A pixel without contrast contains no information.
        let tells = |index: &&usize| {
            dry[*index] > wet[*index] + 1.0 && !broken.is_some_and(|broken| broken.inside[**index])
        };
        let pixels: Vec<usize> = dry.keys().filter(tells).copied().collect();
        FlashDetector {
            dry: pixels.iter().map(|index| dry[index]).collect(),
            wet: pixels.iter().map(|index| wet[index]).collect(),
            since_s: vec![None; pixels.len()],
            longest_s: vec![0.0; pixels.len()],
            pixels,
            weights,
            is_first: true,
        }
    }
}

impl FlashDetector {
    /// Evaluates the next wet picture, captured at `time_s`.
    pub fn push(&mut self, picture: &ColorPicture, time_s: f64) {
        let now: Vec<f64> = self.pixels.iter().map(|&index| brightness(picture.rgb[index], self.weights)).collect();
        let light = median(&mut now.iter().zip(&self.wet).map(|(now, wet)| now / wet.max(1.0)).collect::<Vec<_>>())
            .unwrap_or(f64::NAN);
        for (index, now) in now.iter().enumerate() {
            let half = (self.dry[index] - self.wet[index]) / 2.0;
            let is_dry = (now / light - self.dry[index]).abs() < half; // (2)
            match (is_dry, self.since_s[index]) {
                // A pixel that appears dry from the first picture never became wet, or became wet late.
                (true, None) => self.since_s[index] = Some(if self.is_first { f64::NEG_INFINITY } else { time_s }),
                (false, Some(since_s)) => {
                    let lasted_s = time_s - since_s;
                    if lasted_s <= MAX_FLASH_S {
                        self.longest_s[index] = self.longest_s[index].max(lasted_s);
                    }
                    self.since_s[index] = None;
                }
                _ => {}
            }
        }
        self.is_first = false;
    }

    /// Returns the longest time, s, for which a place of at least the size of a break appeared dry before it appeared
    /// wet again; 0 if there was no such place.
    pub fn longest_s(mut self) -> f64 {
        if self.longest_s.len() < MIN_FLASH_PX {
            return 0.0;
        }
        self.longest_s.sort_by(|a, b| b.total_cmp(a));
        self.longest_s[MIN_FLASH_PX - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::inspect_table;
    use super::*;

    /// Expected values, calculated by hand: dry (100, 80, 60), wet (90, 50, 30) and noise ±2 in each channel give the
    /// contrasts 10, 30, 30 and the weights ⅓, 1, 1. With a gain of 4 the threshold is 4·30/2 = 60.
    #[test]
    fn channels_are_weighted_by_their_contrast() {
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
        // Successive pictures differ by 4 levels at every pixel: σ = 4/√2.
        assert!((advice.channels[2].noise - 8.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!((advice.threshold, advice.overexposed), (60, 0.0));
        assert!(Sampler::new(&region).advice(&inspect_table("")).is_none());
    }

    #[test]
    fn the_best_threshold_separates_broken_and_wet_places() {
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

    const WHOLE: usize = 20 * 20;

    fn sampler() -> Sampler {
        let mut sampler = Sampler::new(&Mask { width: 20, height: 20, inside: vec![true; WHOLE] });
        // The light on the left half is twice as strong as on the right half.
        let lit = |level: u8| {
            let mut picture = ColorPicture::uniform(20, 20, [level; 3]);
            (0..WHOLE).filter(|i| i % 20 < 10).for_each(|i| picture.rgb[i] = [2 * level; 3]);
            picture
        };
        (0..2).for_each(|odd| sampler.add_dry(&lit(50 + odd)));
        (0..2).for_each(|odd| sampler.add_wet(&lit(30 + odd)));
        sampler
    }

    /// Expected values, calculated by hand: dry 101 and 50.5, wet 61 and 30.5; the mean of both halves is 75.75. From
    /// picture to picture the halves change by 2 and 1 levels: the mean square is 2.5. The variance of one picture is
    /// half of 2.5, and the variance of the mean of three equal channels is a third of that half.
    #[test]
    fn each_grid_has_its_own_contrast() {
        let half = |right: bool| (0..WHOLE).filter(|i| (i % 20 >= 10) == right).collect::<Vec<_>>();
        let id = |column: usize| GridId { row: 1, column };
        let found = sampler().grid_contrasts(&inspect_table(""), &[(id(1), half(false)), (id(2), half(true))]);
        let noise = (2.5_f64 / 2.0 / 3.0).sqrt();
        for (found, (dry, wet)) in found.iter().zip([(101.0, 61.0), (50.5, 30.5)]) {
            assert!((found.dry - dry).abs() < 1e-9 && (found.wet - wet).abs() < 1e-9, "{found:?}");
            assert!((found.contrast_to_noise - (dry - wet) / noise).abs() < 1e-9, "{found:?}");
            assert!((found.light - dry / 75.75).abs() < 1e-9, "{found:?}");
            assert_eq!(
                (found.faint_percent, found.best_contrast_to_noise()),
                (0.0, found.contrast_to_noise),
                "{found:?}"
            );
        }
        assert_eq!(found.len(), 2);
    }

    /// Expected values, calculated by hand for five pictures per second: 20 pixels appear dry in 3 pictures, 0.6 s. Of
    /// these pixels, 5 appear dry for 1 s, which are fewer than a break has. Another 40 pixels appear dry from 2 s to
    /// the end, so they are a break. The light increases by 20 % during the clip.
    #[test]
    fn a_flash_is_distinguished_from_a_break() {
        let settings = inspect_table("");
        let found = |broken: Option<&Mask>, closes_s: f64| {
            let mut flashes = sampler().flash_detector(&settings, broken);
            for frame in 0..60 {
                let time_s = f64::from(frame) / 5.0;
                let mut picture = ColorPicture::uniform(20, 20, [0; 3]);
                for (i, pixel) in picture.rgb.iter_mut().enumerate() {
                    let flashes = (i < 20 && (5..8).contains(&frame)) || (i < 5 && (20..25).contains(&frame));
                    let is_broken = (100..140).contains(&i) && (2.0..closes_s).contains(&time_s);
                    let level = if flashes || is_broken { 50.0 } else { 30.5 } * (1.0 + time_s / 60.0);
                    *pixel = [(if i % 20 < 10 { 2.0 * level } else { level }) as u8; 3];
                }
                flashes.push(&picture, time_s);
            }
            flashes.longest_s()
        };
        assert!((found(None, 99.0) - 0.6).abs() < 1e-9, "{}", found(None, 99.0));
        assert!((found(None, 6.5) - 0.6).abs() < 1e-9, "a film that closed after 4.5 s is no flash");
        assert!((found(None, 3.0) - 1.0).abs() < 1e-9, "one that closed after a second is");
        let mut broken = Mask::all_outside(20, 20);
        (100..140).for_each(|i| broken.inside[i] = true);
        assert!((found(Some(&broken), 3.0) - 0.6).abs() < 1e-9, "unless it is known to have broken");
    }

    /// Expected values, calculated by hand: on the left, the film reflects a red object and is 20 levels brighter in
    /// red than the dry panel. On the right, the film differs from the dry panel by only 4 levels. With a noise of ±1
    /// level in each channel, σ = 2/√2.
    #[test]
    fn a_brighter_film_and_a_film_without_contrast_are_reported_by_grid() {
        let mut sampler = Sampler::new(&Mask { width: 20, height: 20, inside: vec![true; WHOLE] });
        let halves = |left: [u8; 3], right: [u8; 3]| {
            let rgb = (0..WHOLE).map(|i| if i % 20 < 10 { left } else { right }).collect();
            ColorPicture { width: 20, height: 20, rgb }
        };
        for odd in [0, 2] {
            sampler.add_dry(&halves([60 + odd; 3], [60 + odd; 3]));
        }
        for odd in [0, 2] {
            sampler.add_wet(&halves([80 + odd, 62 + odd, 60 + odd], [64 + odd; 3]));
        }
        let half = |right: bool| (0..WHOLE).filter(|i| (i % 20 >= 10) == right).collect::<Vec<_>>();
        let id = |column: usize| GridId { row: 1, column };
        let found = sampler.grid_contrasts(&inspect_table(""), &[(id(1), half(false)), (id(2), half(true))]);
        assert_eq!((found[0].channel, found[0].faint_percent), (0, 0.0), "{found:?}");
        assert!((found[0].channel_to_noise + 20.0 / 2.0_f64.sqrt()).abs() < 1e-9, "{found:?}");
        assert!(found[1].faint_percent == 100.0 && found[1].channel_to_noise < 0.0, "{found:?}");
    }
}
