//! Advice from a clip about the film method's settings: contrast in every grid, and how long places look dry for a
//! moment.
//!
//! In the brightness v that the method sees, the channels by their weights, a pixel has the mean d in the dry
//! pictures and w in the first wet ones. In a picture with s times the light of the first wet ones the pixel looks
//! dry if
//!     (d + w) / 2 < v / s < d + (d - w) / 2;                                                             (1)
//! a brighter pixel is a reflection, and the method recognises it by that. A place that looks dry and then wet
//! again within a few seconds was a glint, a drop or a flicker: `persist_s` must be longer. A place that stays dry
//! longer has broken, and does not count here.

use super::advice::Sampler;
use super::gate::MIN_CHANGE_TO_NOISE;
use panelprep_base::geometry::{ColorPicture, Mask, median};
use panelprep_cell::panel::GridId;
use panelprep_cell::recipe;

/// If a place looked dry for longer than this and then wet again, the film has closed, s.
const MAX_FLASH_S: f64 = 4.0;
/// Number of pixels that are more than noise: a break with fewer pixels would not be found reliably.
const MIN_FLASH_PX: usize = 12;

/// The contrast of one grid, in the brightness that the method uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridContrast {
    /// The grid.
    pub id: GridId,
    /// Mean brightness when dry, grey levels.
    pub dry: f64,
    /// Mean brightness under a complete film.
    pub wet: f64,
    /// The change by the film, in multiples of the noise of a pixel.
    pub contrast_to_noise: f64,
    /// The grid's dry brightness relative to that of the whole region.
    pub light: f64,
    /// The channel with the largest change by the film relative to the noise: 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// The contrast in that channel as a multiple of its noise; negative if the film is brighter than the dry panel.
    pub channel_to_noise: f64,
    /// The share of the grid, percent, in which the film changes no channel by [`MIN_CHANGE_TO_NOISE`] times its
    /// noise: a break would not show there.
    pub faint_percent: f64,
}

impl GridContrast {
    /// The larger of two contrasts between film and dry: with the recipe's weights, or the absolute value in the best
    /// single channel.
    pub fn best_contrast_to_noise(&self) -> f64 {
        self.contrast_to_noise.max(self.channel_to_noise.abs())
    }
}

/// Evaluates the clip's pictures, one by one, for flashes.
#[derive(Debug)]
pub struct FlashDetector {
    pixels: Vec<usize>,
    weights: [f64; 3],
    dry: Vec<f64>,
    wet: Vec<f64>,
    /// The time at which the pixel began to look dry, s; `None` if it looks wet.
    since_s: Vec<Option<f64>>,
    longest_s: Vec<f64>,
    is_first: bool,
}

/// Calculates the brightness of a pixel with channel weights whose sum is 1.
fn brightness([r, g, b]: [u8; 3], weights: [f64; 3]) -> f64 {
    f64::from(r) * weights[0] + f64::from(g) * weights[1] + f64::from(b) * weights[2]
}

fn channel_shares(settings: &recipe::Inspect) -> [f64; 3] {
    let weights = settings.channel_weights();
    weights.map(|weight| weight / weights.iter().sum::<f64>())
}

impl Sampler {
    /// Calculates the contrast in each grid from its given pixels of the picture; grids without a pixel are left
    /// out.
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

    /// Begins the search for places that look dry for a moment; the pixels of `broken`, which are known to break,
    /// are excluded.
    pub fn flash_detector(&self, settings: &recipe::Inspect, broken: Option<&Mask>) -> FlashDetector {
        let weights = channel_shares(settings);
        let (dry, wet) = (self.dry_means(weights), self.wet_means(weights));
        // A pixel without contrast carries no information.
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
    /// Evaluates the next wet picture.
    pub fn push(&mut self, picture: &ColorPicture, time_s: f64) {
        let now: Vec<f64> = self.pixels.iter().map(|&index| brightness(picture.rgb[index], self.weights)).collect();
        let light = median(&mut now.iter().zip(&self.wet).map(|(now, wet)| now / wet.max(1.0)).collect::<Vec<_>>())
            .unwrap_or(f64::NAN);
        for (index, now) in now.iter().enumerate() {
            let half = (self.dry[index] - self.wet[index]) / 2.0;
            let is_dry = (now / light - self.dry[index]).abs() < half; // (1)
            match (is_dry, self.since_s[index]) {
                // A pixel that looks dry from the beginning never became wet, or became wet late.
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

    /// The time for which places of the size of a break looked dry before they looked wet again, s; 0 if none did.
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

    const WHOLE: usize = 20 * 20;

    fn sampler() -> Sampler {
        let mut sampler = Sampler::new(&Mask { width: 20, height: 20, inside: vec![true; WHOLE] });
        // The light on the left half is twice as strong.
        let lit = |level: u8| {
            let mut picture = ColorPicture::uniform(20, 20, [level; 3]);
            (0..WHOLE).filter(|i| i % 20 < 10).for_each(|i| picture.rgb[i] = [2 * level; 3]);
            picture
        };
        (0..2).for_each(|odd| sampler.add_dry(&lit(50 + odd)));
        (0..2).for_each(|odd| sampler.add_wet(&lit(30 + odd)));
        sampler
    }

    /// By hand: dry 101 and 50.5, wet 61 and 30.5; the mean of the halves is 75.75. From picture to picture the
    /// halves differ by 2 and 1 levels: the mean square is 2.5. One picture has half of that, and the mean of three
    /// equal channels a third.
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

    /// Calculated by hand, five pictures a second: 20 pixels look dry in 3 pictures, 0.6 s. 5 of them look dry for
    /// 1 s, less than a break; 40 from 2 s to the end, a break. The light increases by a fifth meanwhile.
    #[test]
    fn a_moment_s_dryness_is_distinguished_from_a_break() {
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

    /// Calculated by hand: on the left, a film that mirrors something red is brighter than the dry panel, by 20
    /// levels in red. On the right, the film differs by only 4 levels. Noise of ±1 level in each channel: σ = 2/√2.
    #[test]
    fn a_film_that_is_brighter_or_alike_is_reported_by_grid() {
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
