//! From the dry panel to the first fully wet picture: each pixel's dry brightness, and what a film leaves of it.

use super::judging::Rule;
use super::kernel::{HIDDEN, INSIDE, LEVEL, OPEN, RUN};
use super::region::Region;
use super::wetting::{FILM_ASSUMED, FILM_BINS};
use super::{Model, WIDE_Q10};
use crate::geometry::ColorPicture;

/// Ratios to the dry brightness between which a pixel may be wet …
const WET_RATIOS: [f64; 2] = [0.2, 0.88];
/// … and those of what is dry.
const DRY_RATIOS: [f64; 2] = [0.93, 1.07];
/// The share of the region that must be wet in a picture for τ to be estimated from it; the weight of a picture in which this share is still dry.
const MIN_SHARE_READ: f64 = 0.05;
const WEIGHT_WITH_DRY: f64 = 4.0;
/// The most frequent ratio is determined from means over this number of classes to both sides.
const PEAK_BINS: usize = 5;
/// A darker pixel carries no information, levels.
const MIN_DRY_LEVELS: u16 = 4;
/// Before the film is watched the light is estimated by pixels within these bounds of the prediction from the picture before, 1/1024.
const NARROW_Q10: [f64; 2] = [0.87 * 1024.0, 1.15 * 1024.0];
/// The share of the region that must contribute to the light; otherwise that of the picture before is kept.
const MIN_SHARE_TOLD: f64 = 0.05;

impl Model {
    /// A picture of the dry panel; several are averaged.
    pub fn dry(&mut self, picture: &ColorPicture) {
        self.read(picture, WIDE_Q10);
        self.wetting.dry_pictures += 1;
        for (sum, light) in self.wetting.dry_sum.iter_mut().zip(self.brightness.as_flattened()) {
            *sum += u32::from(light & !HIDDEN);
        }
        for (dry, sum) in self.dry.as_flattened_mut().iter_mut().zip(&self.wetting.dry_sum) {
            *dry = (sum / self.wetting.dry_pictures) as u16;
        }
        for (kept, light) in self.kept.as_flattened_mut().iter_mut().zip(self.brightness.as_flattened()) {
            // An overexposed or black place carries no information: it is not seen.
            if light & HIDDEN > 0 || *light < MIN_DRY_LEVELS * LEVEL {
                *kept = 0;
            }
        }
        self.region = Region::of(&self.kept, self.columns);
        let window = self.window;
        let rows = (window.top..window.top + window.height).map(|row| row * picture.width + window.left);
        self.dry_rgb.clear();
        rows.for_each(|first| self.dry_rgb.extend_from_slice(&picture.rgb[first..first + window.width]));
        self.lamp.and_around(&window, picture);
    }

    /// Whether a dry picture was taken.
    pub fn has_dry(&self) -> bool {
        self.wetting.dry_pictures > 0
    }

    /// A picture under the spray: what is wet by now.
    pub fn spray(&mut self, picture: &ColorPicture) {
        if !self.has_dry() {
            return;
        }
        self.lamp.at(picture);
        self.read_and_settle(picture);
    }

    /// The first fully wet picture: without a dry one it is the best that is known.
    pub(super) fn begin(&mut self, picture: &ColorPicture) {
        if self.has_dry() {
            self.read_and_settle(picture);
        } else {
            self.read(picture, WIDE_Q10);
            let dry = |light: &u16| (f64::from(light & !HIDDEN) / FILM_ASSUMED).min(16_320.0) as u16;
            self.dry = self.brightness.iter().map(|block| block.each_ref().map(dry)).collect();
            self.kept.as_flattened_mut().iter_mut().for_each(|kept| *kept &= !OPEN);
        }
        self.watching = true;
    }

    /// The light by what hardly changed, what the film leaves by what did, and each pixel's state by both.
    fn read_and_settle(&mut self, picture: &ColorPicture) {
        let g = self.light.global;
        let (_, sums) = self.read(picture, NARROW_Q10.map(|bound| (bound * g).min(2_047.0) as u16));
        let found = self.light.found(&sums, &self.region.inside, None);
        self.light = self.light.flat(if found.share > MIN_SHARE_TOLD { found.global } else { g });
        if let Some(film) = self.film_left() {
            (self.wetting.film, self.wetting.film_known) = (film, true);
        }
        let rule = Rule { film_q16: self.film_q16(), persist: 1, before: 0, now: 0, brighter_q12: 4096, notes: 0 };
        // Whether it is steady plays no part yet.
        let before = std::mem::replace(&mut self.before, self.brightness.clone());
        self.judge(rule);
        self.before = before;
        self.kept.as_flattened_mut().iter_mut().for_each(|kept| *kept &= !RUN);
    }

    /// The ratio to the dry brightness that most of what is wet has; `None` where too little is. Pictures in which a part is
    /// still dry count for more: that part determines the light. So neither a shadow nor the spray's mist is taken for film.
    fn film_left(&mut self) -> Option<f64> {
        let (mut bins, mut dry_pixels, mut all) = (vec![0_u32; FILM_BINS], 0_u32, 0_u32);
        let [light, dry, kept] = [&self.brightness, &self.dry, &self.kept].map(|blocks| blocks.as_flattened());
        for ((&light, &dry), &kept) in light.iter().zip(dry).zip(kept) {
            all += u32::from(kept & INSIDE > 0);
            if kept & INSIDE > 0 && light & HIDDEN == 0 {
                let ratio = f64::from(light) / (self.light.global * f64::from(dry));
                if (WET_RATIOS[0]..WET_RATIOS[1]).contains(&ratio) {
                    bins[(ratio * FILM_BINS as f64) as usize] += 1;
                }
                dry_pixels += u32::from((DRY_RATIOS[0]..DRY_RATIOS[1]).contains(&ratio));
            }
        }
        let enough = |count: u32| f64::from(count) >= MIN_SHARE_READ * f64::from(all);
        if !enough(bins.iter().sum()) {
            return None;
        }
        let weight = if enough(dry_pixels) { WEIGHT_WITH_DRY } else { 1.0 };
        let sums = &mut self.wetting.film_bins;
        sums.iter_mut().zip(bins).for_each(|(sum, bin)| *sum += weight * f64::from(bin));
        let around = |bin: &usize| sums[bin - PEAK_BINS..=bin + PEAK_BINS].iter().sum::<f64>();
        let peak = (PEAK_BINS..FILM_BINS - PEAK_BINS).max_by(|a, b| around(a).total_cmp(&around(b)))?;
        // Between the bins: the peak's own mean.
        let part = || sums[peak - PEAK_BINS..=peak + PEAK_BINS].iter().zip(peak - PEAK_BINS..);
        let mean = part().map(|(count, bin)| count * (bin as f64 + 0.5)).sum::<f64>() / around(&peak);
        Some(mean / FILM_BINS as f64)
    }

    /// What the film leaves of the dry brightness, where the clip determined it.
    pub fn film(&self) -> Option<f64> {
        (self.wetting.film_known && self.mirror.is_none()).then_some(self.wetting.film)
    }
}
