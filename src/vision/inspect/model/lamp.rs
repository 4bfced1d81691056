//! Measures the light of each picture in each colour channel, on the surroundings of the panel.
//!
//! The surroundings reflect diffusely, and little of them becomes wet. The light of a channel is therefore the median
//! ratio of present brightness to dry brightness. Lamps on AC mains tint the pictures if the exposure is not a multiple
//! of half of the mains period. The tint differs for each channel: the phosphors of an LED react slowly, its diode does
//! not. Since each channel is evaluated separately, this beat is compensated like any other change of the light.
//!
//! Surroundings that became wet are darker, as if the lamp were darker: a change below the plausible range is not
//! attributed to the lamp. If the light varies so strongly ([`Flicker`]), it is unknown whether the lamp or water made
//! the surroundings darker. Water makes nothing brighter: if the surroundings are brighter than with any lamp that
//! drifts, or saturate, the exposure or gain of the camera has changed. A moving shadow darkens the sample points one
//! after another, and never all of them. If the lamp changes, most sample points change from one picture to the next,
//! and as many sample points agree on the light as before.
//!
//! Light that flickers increases and decreases from picture to picture. Water that wets the surroundings changes their
//! brightness slowly, in one direction, or once. With the light g of a channel in picture k and its change Δₖ = ln gₖ −
//! ln gₖ₋₁, a swing is
//!     sₖ = min(|Δₖ|, |Δₖ₋₁|)  if Δₖ Δₖ₋₁ < 0,                                                                          (1)
//! and a lamp flickers if at least 25 % of the pictures, and at least [`MIN_SWINGS`] of them, have a swing of
//! [`MIN_SWING`] or more.

use super::noise::SensorNoise;
use crate::inspect::footprint::Window;
use panelprep_base::geometry::{ColorPicture, median};

/// Width of the margin around the window, as a fraction of the window's size. The margin contains the rim of the panel
/// and the sprayed area, so no sample point lies in it.
const RELATIVE_MARGIN_WIDTH: f64 = 0.06;
/// Approximate maximum number of sample points.
const MAX_SAMPLE_POINT_COUNT: usize = 1_500;
const MIN_SAMPLE_POINT_COUNT: usize = 60;
/// Range of grey levels of a usable sample point in the dry picture.
const USABLE_DRY_LEVELS: std::ops::RangeInclusive<u8> = 16..=235;
/// Range of the gains of a lamp while a panel is tested; below this range, the surroundings became wet.
const PLAUSIBLE_GAINS: std::ops::Range<f64> = 0.77..1.3;
/// Minimum level of a sample point that may be overexposed, so that its brightness is only a lower bound.
const MIN_SATURATED_LEVEL: u8 = 250;
/// Maximum difference between the ratio of a sample point and the median ratio, for the sample point to agree with the
/// light.
const MAX_RATIO_DEVIATION: f64 = 0.08;
/// Minimum fraction of the sample points around the panel that must agree on the light.
const MIN_AGREEING_FRACTION: f64 = 0.5;
/// If the light changed by more than [`MAX_RATIO_DEVIATION`]: minimum fraction of the previously agreeing sample points
/// that must still agree. With fewer, a shadow lies on most of the sample points.
const MIN_KEPT_AGREEMENT: f64 = 0.9;

/// The sample points on the surroundings of the panel, from the dry picture.
#[derive(Debug, Clone, Default)]
pub struct LampObserver {
    reference_places: Vec<(usize, [f64; 3])>,
    flicker: Flicker,
    /// The last accepted light, and the value of [`LampObserver::followed`] at that time.
    accepted: Option<(LampGain, f64)>,
    /// Product of the picture-to-picture changes of the light at most sample points; mean of the channels.
    followed: f64,
    /// For each sample point, the levels of its square in the last picture, in the light of the dry picture.
    last: Vec<[f64; 3]>,
    sensor: [SensorNoise; 2],
}

/// The measured light of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LampGain {
    /// Gain of each channel, relative to the dry picture.
    pub gains: [f64; 3],
    /// Fraction of the sample points that agree on the light; 0 if there are too few sample points, or if no lamp can
    /// have this light.
    pub agreeing_share: f64,
    /// Mean swing of a flickering lamp, percent, if the sample points agree on a light that no lamp can have; otherwise
    /// 0.
    pub flicker_percent: f64,
    /// Mean gain, if the sample points agree that it is larger than the drift of any lamp.
    pub brighter_gain: Option<f64>,
}

impl LampGain {
    const UNKNOWN: LampGain =
        LampGain { gains: [1.0; 3], agreeing_share: 0.0, flicker_percent: 0.0, brighter_gain: None };

    /// Returns the mean gain of the channels.
    pub fn mean(&self) -> f64 {
        self.gains.iter().sum::<f64>() / 3.0
    }

    /// Returns whether a shadow on most of the sample points causes this light; `brighter` is the factor by which most
    /// of them became brighter since the previous light.
    fn is_shadow_onset(&self, before: &LampGain, brighter: f64) -> bool {
        let is_change = is_near_gain(self.mean(), brighter * before.mean())
            && self.agreeing_share >= MIN_KEPT_AGREEMENT * before.agreeing_share;
        !is_near_gain(self.mean(), before.mean()) && !is_change
    }

    /// Returns the gain of each channel, if enough sample points agree.
    pub fn agreed_gains(&self) -> Option<[f64; 3]> {
        (self.agreeing_share >= MIN_AGREEING_FRACTION).then_some(self.gains)
    }
}

impl LampObserver {
    /// Selects the sample points on the surroundings of this window in a dry picture.
    pub fn observe_surroundings(window: &Window, dry: &ColorPicture) -> Self {
        let margin = |length: usize| (RELATIVE_MARGIN_WIDTH * length as f64).ceil() as usize;
        let (across, down) = (margin(window.width), margin(window.height));
        let columns = window.left.saturating_sub(across)..window.left + window.width + across;
        let rows = window.top.saturating_sub(down)..window.top + window.height + down;
        let inside = window.width * window.height;
        let step = (((dry.width * dry.height).saturating_sub(inside) as f64 / MAX_SAMPLE_POINT_COUNT as f64).sqrt()
            as usize)
            .max(1);
        let mut places = Vec::new();
        for row in (step / 2..dry.height).step_by(step) {
            for column in (step / 2..dry.width).step_by(step) {
                let index = row * dry.width + column;
                let rgb = dry.rgb[index];
                let is_away = !(rows.contains(&row) && columns.contains(&column));
                if is_away && rgb.iter().all(|level| USABLE_DRY_LEVELS.contains(level)) {
                    places.push((index, rgb.map(f64::from)));
                }
            }
        }
        LampObserver { reference_places: places, ..LampObserver::default() }
    }

    /// Adds the brightness of the surroundings in the next dry picture.
    pub fn add_surroundings(&mut self, window: &Window, dry: &ColorPicture) {
        self.measure(dry);
        let sensor = std::mem::take(&mut self.sensor);
        *self = LampObserver {
            flicker: self.flicker.referenced_to_last(),
            sensor,
            ..LampObserver::observe_surroundings(window, dry)
        };
    }

    /// Measures the light of the next picture.
    pub fn measure(&mut self, picture: &ColorPicture) -> LampGain {
        if self.reference_places.len() < MIN_SAMPLE_POINT_COUNT {
            return LampGain::UNKNOWN;
        }
        let ratio = |now: u8, dry: f64| (f64::from(now) + 0.01) / dry;
        let is_saturated = |index: usize| picture.rgb[index].iter().any(|level| *level >= MIN_SATURATED_LEVEL);
        let (saturated, usable): (Vec<_>, Vec<_>) =
            self.reference_places.iter().partition(|(index, _)| is_saturated(*index));
        // A saturated sample point gives only a lower bound. If most sample points are saturated, the bound may still
        // prove that the light is too strong for compensation.
        if usable.len() < MIN_SAMPLE_POINT_COUNT.max(saturated.len()) {
            let mut lowest_gains: Vec<f64> =
                saturated.iter().map(|(index, dry)| ratio(picture.rgb[*index][1], dry[1])).collect();
            let lowest_gains =
                median(&mut lowest_gains).filter(|lowest_gains| *lowest_gains >= PLAUSIBLE_GAINS.end);
            return LampGain { brighter_gain: lowest_gains, ..LampGain::UNKNOWN };
        }
        let mut ratios = [0, 1, 2].map(|i| -> Vec<f64> {
            usable.iter().map(|(index, dry)| ratio(picture.rgb[*index][i], dry[i])).collect()
        });
        let gains = ratios.each_mut().map(|ratios| majority_ratio(ratios));
        let near = ratios
            .iter()
            .zip(gains)
            .map(|(ratios, gain)| ratios.iter().filter(|ratio| is_near_gain(**ratio, gain)).count());
        let agree = near.sum::<usize>() as f64 / (3 * usable.len()) as f64;
        self.add_noise(picture, gains);
        let flicker_percent = self.flicker.mean_swing_percent(gains);
        // Below this range water has wetted the surroundings, so that they do not measure the light.
        if gains.iter().all(|gain| PLAUSIBLE_GAINS.contains(gain)) {
            let lit = LampGain { gains, agreeing_share: agree, flicker_percent: 0.0, brighter_gain: None };
            let is_shadow =
                |(before, followed): (LampGain, f64)| lit.is_shadow_onset(&before, self.followed / followed);
            // With a shadow on the surroundings alone, the film would appear too bright, as a break does.
            if self.accepted.is_some_and(is_shadow) {
                return LampGain { gains, ..LampGain::UNKNOWN };
            }
            if lit.agreed_gains().is_some() {
                self.accepted = Some((lit, self.followed));
            }
            return lit;
        }
        if agree < MIN_AGREEING_FRACTION {
            return LampGain { gains, ..LampGain::UNKNOWN };
        }
        let lit = LampGain { gains, flicker_percent, ..LampGain::UNKNOWN };
        LampGain { brighter_gain: Some(lit.mean()).filter(|mean| *mean >= PLAUSIBLE_GAINS.end), ..lit }
    }
}

impl LampObserver {
    /// Returns the sensor's noise in the means of squares of [`LampObserver::SIDE_PX`]: for one channel, and for the
    /// mean of all three. Neither value can be calculated from the noise of a pixel, because neighbouring pixels and
    /// the channels of a colour picture are correlated.
    pub fn sensor(&self) -> [&SensorNoise; 2] {
        self.sensor.each_ref()
    }

    /// Side of the squares in which noise is measured, px.
    pub const SIDE_PX: usize = 4;

    fn add_noise(&mut self, picture: &ColorPicture, gains: [f64; 3]) {
        let side = LampObserver::SIDE_PX;
        // A saturated pixel shows no noise, so this sample point gives no information.
        let now = |(index, _): &(usize, [f64; 3])| -> [f64; 3] {
            let left = (index % picture.width).min(picture.width.saturating_sub(side));
            let top = (index / picture.width).min(picture.height.saturating_sub(side));
            let mut sums = [0.0; 3];
            for row in top..(top + side).min(picture.height) {
                for rgb in &picture.rgb[row * picture.width + left..][..side.min(picture.width)] {
                    let level = |i: usize| if rgb[i] >= MIN_SATURATED_LEVEL { f64::NAN } else { f64::from(rgb[i]) };
                    (0..3).for_each(|i| sums[i] += level(i));
                }
            }
            std::array::from_fn(|i| sums[i] / gains[i] / (side * side) as f64)
        };
        let mut now: Vec<[f64; 3]> = self.reference_places.iter().map(now).collect();
        let mut followed = gains;
        if self.last.len() == now.len() {
            // The squares determine the common change more exactly than single pixels.
            for i in 0..3 {
                let shares = self.last.iter().zip(&now).map(|(before, now)| now[i] / before[i]);
                let mut shares: Vec<f64> = shares.filter(|share| share.is_finite()).collect();
                let common = median(&mut shares).unwrap_or(1.0);
                now.iter_mut().for_each(|now| now[i] /= common);
                followed[i] *= common;
            }
            let mean = |rgb: &[f64; 3]| rgb.iter().sum::<f64>() / 3.0;
            for (before, now) in self.last.iter().zip(&now) {
                (0..3).for_each(|i| self.sensor[0].add(before[i], now[i]));
                self.sensor[1].add(mean(before), mean(now));
            }
        }
        self.followed = followed.iter().sum::<f64>() / 3.0;
        self.last = now;
    }
}

/// Returns the ratio of the majority: the median of the ratios near the overall median, calculated twice. The ratios of
/// sample points that became wet are thereby excluded.
fn majority_ratio(ratios: &mut [f64]) -> f64 {
    let first = median(ratios).unwrap_or(1.0).clamp(0.25, 4.0);
    (0..2).fold(first, |gain, _| {
        let mut near: Vec<f64> = ratios.iter().copied().filter(|ratio| is_near_gain(*ratio, gain)).collect();
        median(&mut near).unwrap_or(gain)
    })
}

fn is_near_gain(ratio: f64, gain: f64) -> bool {
    (ratio / gain - 1.0).abs() < MAX_RATIO_DEVIATION
}

/// Minimum change of a flickering lamp from picture to picture and back. A flickering lamp has at least `MIN_SWINGS` of
/// these swings.
const MIN_SWING: f64 = 0.02;
const MIN_SWINGS: u32 = 3;

/// Detects flicker: the changes of the light of each channel from picture to picture.
#[derive(Debug, Clone, Copy, Default)]
pub struct Flicker {
    pictures: u32,
    channels: [LightChange; 3],
}

/// For one channel, the light of the last picture and its change, both as logarithms, and the swings so far.
#[derive(Debug, Clone, Copy, Default)]
struct LightChange {
    last: f64,
    change: f64,
    count: u32,
    sum: f64,
}

impl Flicker {
    /// Returns the mean swing up to and including this picture, percent, of the channel with the largest swing; 0 if
    /// the light does not flicker.
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

    /// Changes the reference of the light to the last picture; the swings so far are kept.
    pub fn referenced_to_last(mut self) -> Self {
        self.channels.iter_mut().for_each(|swings| swings.last = 0.0);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values, calculated by hand: red is 10 % brighter, blue 10 % darker. The wet area has no effect: it
    /// consists of the window and less than half of its surroundings.
    #[test]
    fn a_tint_is_measured_around_the_panel() {
        let window = Window { left: 40, top: 30, width: 80, height: 60 };
        let mut lamp = LampObserver::observe_surroundings(&window, &ColorPicture::uniform(160, 120, [100; 3]));
        let mut now = ColorPicture::uniform(160, 120, [110, 100, 90]);
        for row in 0..120 {
            let wet = if row < 20 { 0..160 } else { 40..120 };
            now.rgb[row * 160..][wet].fill([30; 3]);
        }
        let lit = lamp.measure(&now);
        assert!(lit.gains.iter().zip([1.1, 1.0, 0.9]).all(|(found, real)| (found - real).abs() < 1e-3), "{lit:?}");
        assert!(lit.agreeing_share > 0.5 && lit.agreeing_share < 0.9, "{lit:?}");
        let wet = lamp.measure(&ColorPicture::uniform(160, 120, [60; 3]));
        assert_eq!(wet.agreeing_share, 0.0, "all around became wet: no lamp");
        let whole = Window { left: 0, top: 0, width: 160, height: 120 };
        let none =
            LampObserver::observe_surroundings(&whole, &ColorPicture::uniform(160, 120, [100; 3])).measure(&now);
        assert_eq!(none, LampGain::UNKNOWN, "nothing lies around the panel");
    }

    /// Expected values, calculated by hand: of 40 rows, 35 and a margin of 3 belong to the window. The remaining two
    /// rows of 25 px have fewer than 60 sample points; two rows of 35 px are enough.
    #[test]
    fn too_few_sample_points_give_no_light() {
        let light = |width: usize| {
            let window = Window { left: 0, top: 5, width, height: 35 };
            let mut lamp = LampObserver::observe_surroundings(&window, &ColorPicture::uniform(width, 40, [100; 3]));
            lamp.measure(&ColorPicture::uniform(width, 40, [90; 3])).agreed_gains()
        };
        assert!(light(25).is_none() && light(35).is_some(), "{:?} {:?}", light(25), light(35));
    }

    /// Expected values, calculated by hand: surroundings of 100 levels that become 180 are 1.8 times as bright.
    /// Surroundings of 190 levels saturate, so they are at least 1.34 times as bright.
    #[test]
    fn a_changed_exposure_is_neither_lamp_nor_water() {
        let window = Window { left: 40, top: 30, width: 80, height: 60 };
        for (dry, now, least) in [(100, 180, 1.79), (190, 255, 1.33)] {
            let mut lamp = LampObserver::observe_surroundings(&window, &ColorPicture::uniform(160, 120, [dry; 3]));
            let lit = lamp.measure(&ColorPicture::uniform(160, 120, [now; 3]));
            assert!(lit.agreed_gains().is_none() && lit.brighter_gain.is_some_and(|gain| gain >= least), "{lit:?}");
        }
    }

    /// Expected values, calculated by hand: of five sample points two became wet; the others are 3 % darker, equally
    /// bright, and 3 % brighter. The median of all is 0.97, the median of the ratios near it is 1, and three of five
    /// sample points agree with it.
    #[test]
    fn wet_sample_points_are_excluded_from_the_light() {
        let window = Window { left: 0, top: 40, width: 100, height: 20 };
        let mut lamp = LampObserver::observe_surroundings(&window, &ColorPicture::uniform(100, 100, [100; 3]));
        let mut now = ColorPicture::uniform(100, 100, [60; 3]);
        let shown = [60, 60, 60, 60, 97, 97, 100, 100, 103, 103].map(|level| [level; 3]);
        now.rgb.chunks_mut(10).for_each(|places| places.copy_from_slice(&shown));
        let lit = lamp.measure(&now);
        assert!(lit.gains.iter().all(|gain| (gain - 1.0).abs() < 1e-3), "{lit:?}");
        assert!((lit.agreeing_share - 0.6).abs() < 1e-9, "{lit:?}");
    }

    /// A shadow that removes 20 % of the light from six of ten rows is not accepted as the light of the lamp; a change
    /// by 20 % in all rows is accepted. The earlier light is accepted again when most rows show it.
    #[test]
    fn a_shadow_on_most_of_the_surroundings_is_not_the_lamp() {
        let window = Window { left: 0, top: 0, width: 160, height: 20 };
        let mut lamp = LampObserver::observe_surroundings(&window, &ColorPicture::uniform(160, 120, [100; 3]));
        let mut shown = |shadowed_rows: usize| {
            let mut now = ColorPicture::uniform(160, 120, [100; 3]);
            now.rgb[(120 - shadowed_rows) * 160..].fill([80; 3]);
            lamp.measure(&now).agreed_gains().map(|gains| (100.0 * gains[1]).round())
        };
        assert_eq!([0, 58, 40, 120, 0].map(&mut shown), [Some(100.0), None, Some(100.0), Some(80.0), Some(100.0)]);
        // A shadow that moves slowly over the sample points darkens only few of them from one picture to the next.
        let crept: Vec<Option<f64>> = (0..=20).map(|tenth| shown(58 * tenth / 20)).collect();
        assert!(crept.iter().all(|gain| gain.is_none_or(|gain| gain == 100.0)), "{crept:?}");
        assert!(crept[20].is_none() && crept[..14].iter().all(Option::is_some), "{crept:?}");
    }

    /// Expected value, calculated by hand: five pictures that change from 200 to 140 levels and back have three swings.
    #[test]
    fn a_flickering_lamp_is_distinguished_from_surroundings_that_become_wet() {
        let window = Window { left: 40, top: 30, width: 80, height: 60 };
        let shown = |levels: [u8; 5]| {
            let mut lamp = LampObserver::observe_surroundings(&window, &ColorPicture::uniform(160, 120, [200; 3]));
            levels.map(|level| lamp.measure(&ColorPicture::uniform(160, 120, [level; 3])))[4]
        };
        for wet in [[180, 160, 150, 142, 140], [100, 130, 130, 130, 130], [140, 142, 140, 142, 140]] {
            let lit = shown(wet);
            assert_eq!((lit.agreeing_share, lit.flicker_percent), (0.0, 0.0), "{wet:?}");
        }
        let flickers = shown([140, 200, 140, 200, 140]).flicker_percent;
        assert!((flickers - 100.0 * (200.0_f64 / 140.0).ln()).abs() < 0.1, "{flickers}");
        assert_eq!(shown([140, 200, 140, 200, 190]).flicker_percent, 0.0, "light that a lamp may have");
    }

    /// Expected values, calculated by hand: changes of +5, −3, +4 and −6 % (as logarithms) are swings of 3, 3 and 4 %.
    /// Fewer than three swings are not reported as flicker.
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

    /// Expected value, calculated by hand: three swings in sixteen pictures are less than 25 % of the pictures.
    #[test]
    fn swings_in_less_than_a_quarter_of_the_pictures_are_not_flicker() {
        let mut flicker = Flicker::default();
        let swings = [1.1, 1.0, 1.1, 1.0].map(|gain| flicker.mean_swing_percent([gain; 3]));
        assert!(swings[3] > 9.0, "{swings:?}");
        let later: Vec<f64> = (0..12).map(|_| flicker.mean_swing_percent([1.0; 3])).collect();
        assert_eq!(later[11], 0.0, "{later:?}");
    }
}
