//! The results of the film model: the state of each pixel of the window.

use super::classify::{REFLECTION_TIME_S, TICKS_PER_SECOND};
use super::kernel::{
    BLOCK_PX, BRIGHTNESS_MASK, BROKE_FLAG, EVER_WET_FLAG, INSIDE_FLAG, LEVEL, NO_DRY_FLAG, OPEN_FLAG, STEPPED_FLAG,
};
use super::{Model, TemporalNoise};
use panelprep_base::geometry::median;

/// Maximum fraction of the observation time for which a pixel may show neither film nor a bare surface; with a larger
/// fraction the pixel is treated as not seen. The same is true if the pixel showed neither for longer than
/// [`REFLECTION_TIME_S`] at the end.
const MAX_UNSEEN_FRACTION: f64 = 0.5;
/// Minimum change of brightness by the film, as a multiple of the noise, for a break to be distinguishable from the
/// film.
pub const MIN_CONTRAST_TO_NOISE: f64 = 4.0;
/// A film whose brightness is more than this multiple of the dry brightness is brighter than any bare surface, whatever
/// light was measured.
const MAX_BARE_TO_DRY_RATIO: f32 = 1.15;
/// Every n-th pixel is used to estimate the ratio of film brightness to dry brightness.
const FILM_PIXEL_STRIDE: usize = 7;
/// Minimum number of pixels for an estimate of the ratio of film brightness to dry brightness.
const MIN_FILM_PIXELS: usize = 100;

impl Model {
    /// Returns the block that contains a pixel of the window, and the index of the pixel in this block.
    pub(super) fn block_position(&self, index: usize) -> (usize, usize) {
        let (row, column) = (index / self.window.width, index % self.window.width);
        (row * self.columns + column / BLOCK_PX, column % BLOCK_PX)
    }

    fn state(&self, index: usize) -> u16 {
        let (block, at) = self.block_position(index);
        self.state[block][at]
    }

    fn dry_levels(&self, index: usize) -> f64 {
        let (block, at) = self.block_position(index);
        f64::from(self.dry[block][at]) / f64::from(LEVEL)
    }

    fn wet_levels(&self, index: usize) -> f64 {
        let (block, at) = self.block_position(index);
        f64::from(self.wet[block][at]) / f64::from(LEVEL)
    }

    /// Returns the minimum time for which a broken pixel appears bare, s.
    pub fn persist_s(&self) -> f32 {
        self.terms.persist_s as f32
    }

    /// Returns the longest time between two pictures that were judged, s.
    pub fn longest_step_s(&self) -> f32 {
        self.times_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f32::max)
    }

    /// Returns the noise of the clip, grey levels.
    pub fn noise_levels(&self) -> f64 {
        self.noise.levels()
    }

    /// Returns the median of a value over the pixels of the region that have a dry reference, were seen wet and did not
    /// break.
    fn median(&self, of: impl Fn(usize) -> f64) -> Option<f64> {
        let counts = |index: &usize| {
            self.state(*index) & (INSIDE_FLAG | NO_DRY_FLAG | EVER_WET_FLAG | BROKE_FLAG)
                == INSIDE_FLAG | EVER_WET_FLAG
        };
        let all = (0..self.window.width * self.window.height).step_by(FILM_PIXEL_STRIDE).filter(counts);
        let mut values: Vec<f64> = all.map(of).collect();
        median(&mut values)
    }

    /// Returns the brightness of the film at a pixel, grey levels.
    pub fn film_brightness_levels(&self, index: usize) -> f64 {
        self.wet_levels(index)
    }

    /// Returns the temporal noise that was measured at the sample points without a dry reference; `None` if there are
    /// none.
    pub fn measured_temporal_noise(&self) -> Option<&TemporalNoise> {
        self.shimmer.as_ref()
    }

    /// Returns the variance of the sensor's noise at a sample point of the temporal noise, for a film of this
    /// brightness, levels²; `None` if the noise was not measured.
    pub fn sample_point_variance(&self, index: usize, look_levels: f64) -> Option<f64> {
        let (block, _) = self.block_position(index);
        let view = self.views.chosen[self.views.tile_of(block)];
        let [of_channel, of_mean] = self.lamp.sensor().map(|sensor| sensor.variance(look_levels));
        Some(self.views.variance(view, of_channel?, of_mean?))
    }

    /// Estimates the ratio of film brightness to dry brightness from the learnt brightness of the film.
    pub(super) fn measured_film(&self) -> Option<f64> {
        self.median(|index| self.wet_levels(index) / self.dry_levels(index).max(1.0))
    }

    /// Returns the ratio of film brightness to dry brightness; `None` if the clip did not determine it.
    pub fn film(&self) -> Option<f64> {
        self.film_transmission
    }

    /// Returns the median change of brightness by the film over the region, grey levels.
    pub fn change_levels(&self) -> Option<f64> {
        self.median(|index| (self.wet_levels(index) - self.dry_levels(index)).abs())
    }

    /// Returns the dry brightness of a pixel, in an arbitrary unit.
    pub fn dry_brightness(&self, index: usize) -> f64 {
        self.dry_levels(index)
    }

    /// Returns whether a pixel of the window is evaluated.
    pub fn is_evaluated(&self, index: usize) -> bool {
        self.state(index) & INSIDE_FLAG > 0
    }

    /// Returns whether a pixel has no dry reference and is judged only by the brightness of its film.
    pub fn has_no_dry_brightness(&self, index: usize) -> bool {
        self.state(index) & NO_DRY_FLAG > 0
    }

    /// Returns whether the state of the pixel is known. The pixel must have shown film or a bare surface for at least
    /// half of the time, also near the end, and its brightness must not have stepped to a value that is neither film
    /// nor bare. Its brightness also must not have stayed between film and bare until the end for [`Model::persist_s`],
    /// since this film may break next.
    pub fn was_observed(&self, index: usize) -> bool {
        let (block, at) = self.block_position(index);
        let (past, state) = (&self.past[block], self.state(index));
        let Some(last_s) = self.times_s.last().copied().map(f64::from) else { return false };
        let unseen_s = f64::from(past.unseen_time[at]) / TICKS_PER_SECOND;
        let seen_s = f64::from(self.times_s[usize::from(past.last_seen_at[at])]);
        // A block that was skipped, because its pixels were calm, showed film.
        let is_calm = state & super::kernel::BUSY_FLAG == 0;
        state & INSIDE_FLAG > 0
            && state & (EVER_WET_FLAG | BROKE_FLAG) > 0
            && state & STEPPED_FLAG == 0
            && !self.ends_between_film_and_bare(index)
            && unseen_s <= MAX_UNSEEN_FRACTION * last_s
            && (is_calm || last_s - seen_s <= REFLECTION_TIME_S)
    }

    /// Returns whether the pixel's brightness at the end is steady between film and bare, and has been so for at least
    /// the time for which a broken pixel must appear bare.
    fn ends_between_film_and_bare(&self, index: usize) -> bool {
        let (block, at) = self.block_position(index);
        let past = &self.past[block];
        let [.., before_s, last_s] = *self.times_s else { return false };
        // A steady brightness lasts one step longer than its pictures show, as for a bare pixel.
        let away_s = f64::from(past.away_time[at]) / TICKS_PER_SECOND + f64::from(last_s - before_s);
        // A block that is not busy shows film in the last picture, but the times of its pixels do not include this
        // picture.
        let is_busy = self.state(index) & super::kernel::BUSY_FLAG > 0;
        let shows_neither = is_busy && usize::from(past.last_seen_at[at]) + 1 < self.times_s.len();
        shows_neither && past.away_time[at] > 0 && away_s >= self.terms.persist_s
    }

    /// Returns whether the pixel was seen wet in a picture.
    pub fn ever_wet(&self, index: usize) -> bool {
        self.state(index) & EVER_WET_FLAG > 0
    }

    /// Returns whether the film is open at the pixel now.
    pub fn is_open_now(&self, index: usize) -> bool {
        self.state(index) & OPEN_FLAG > 0
    }

    /// Returns the time for which the film was open at the pixel, if the film broke and closed again, s.
    pub fn open_time_s(&self, index: usize) -> Option<f32> {
        let (block, at) = self.block_position(index);
        let (past, time_s) = (&self.past[block], |picture: u16| self.times_s[usize::from(picture)]);
        (self.state(index) & (BROKE_FLAG | OPEN_FLAG) == BROKE_FLAG)
            .then(|| time_s(past.closed_at[at]) - time_s(past.bare_since[at]))
    }

    /// Returns the reference of the pixel's brightness ratios, grey levels: its dry brightness, or the brightness of
    /// its film if there is no dry reference.
    fn reference_levels(&self, index: usize) -> f64 {
        let levels =
            if self.has_no_dry_brightness(index) { self.wet_levels(index) } else { self.dry_levels(index) };
        levels.max(1.0)
    }

    /// Returns the mean brightness of a pixel while it appeared bare, relative to its dry brightness; for a pixel
    /// without a dry reference, relative to the brightness of its film.
    pub fn bare_brightness_ratio(&self, index: usize) -> f32 {
        let (block, at) = self.block_position(index);
        let off_levels = f64::from(self.past[block].bare_difference[at] as i16) / f64::from(LEVEL);
        (1.0 + off_levels / self.reference_levels(index)) as f32
    }

    /// Returns the mean brightness of a pixel while it appeared bare, and its brightness in the last picture. Both are
    /// in grey levels, in the light in which the film brightness was learnt.
    pub fn levels(&self, index: usize) -> [f32; 2] {
        let (block, at) = self.block_position(index);
        let gain = self.light.tile_light(self.views.tile_of(block));
        let now = f64::from(self.current[block][at] & BRIGHTNESS_MASK) / f64::from(LEVEL) / gain;
        [self.bare_brightness_ratio(index) * self.reference_levels(index) as f32, now as f32]
    }

    /// Returns the brightness of the film at a pixel, relative to the same reference as
    /// [`Model::bare_brightness_ratio`].
    pub fn film_brightness_ratio(&self, index: usize) -> f32 {
        (self.wet_levels(index) / self.reference_levels(index)) as f32
    }

    /// Returns the standard deviation of [`Model::bare_brightness_ratio`]: the noise of the mean bare brightness and of
    /// the reference.
    pub fn bare_ratio_noise(&self, index: usize) -> f32 {
        let of_whole = match self.has_no_dry_brightness(index) {
            true => self.wet_variance,
            false => 1.0 / f64::from(self.dry_pictures.max(1)),
        };
        let share = f64::from(self.bare_brightness_ratio(index));
        let variance = self.bare_variance + share * share * of_whole;
        (self.noise_levels() * variance.sqrt() / self.reference_levels(index)) as f32
    }

    /// Returns the range from the 5th to the 95th percentile of the ratio of film brightness to dry brightness, over
    /// the pixels with a known film; `None` if there are too few of them.
    pub fn film_range(&self) -> Option<[f64; 2]> {
        let counts = |index: &usize| {
            self.state(*index) & (INSIDE_FLAG | NO_DRY_FLAG | EVER_WET_FLAG | BROKE_FLAG)
                == INSIDE_FLAG | EVER_WET_FLAG
        };
        let all = (0..self.window.width * self.window.height).step_by(FILM_PIXEL_STRIDE).filter(counts);
        let mut shares: Vec<f64> = all.map(|index| f64::from(self.film_brightness_ratio(index))).collect();
        shares.sort_by(f64::total_cmp);
        let part = shares.len() / 20;
        (shares.len() >= MIN_FILM_PIXELS).then(|| [shares[part], shares[shares.len() - 1 - part]])
    }

    /// Returns the minimum brightness of a broken pixel, as a fraction of its dry brightness.
    pub fn min_damp_ratio(&self) -> f64 {
        self.terms.damp
    }

    /// Returns the contrast-to-noise ratio at a pixel. The contrast is the brightness difference between the film and
    /// the darkest break that is accepted.
    pub fn contrast_to_noise(&self, index: usize) -> f64 {
        let wet = self.wet_levels(index);
        let (least, most) = if self.has_no_dry_brightness(index) {
            let dry = wet / self.film_transmission.unwrap_or(super::ASSUMED_FILM_TRANSMISSION);
            (self.terms.damp * dry, dry)
        } else {
            let dry = self.dry_levels(index);
            (self.terms.damp * dry, dry)
        };
        let gap = if wet < least { least - wet } else { wet - most };
        gap / self.noise.levels()
    }

    /// Returns whether film and bare surface can be distinguished at the pixel.
    pub fn has_contrast(&self, index: usize) -> bool {
        self.contrast_to_noise(index) >= MIN_CONTRAST_TO_NOISE
    }

    /// Returns whether the film at the pixel is brighter than any bare surface.
    pub fn is_film_brighter(&self, index: usize) -> bool {
        !self.has_no_dry_brightness(index)
            && self.is_evaluated(index)
            && self.film_brightness_ratio(index) > MAX_BARE_TO_DRY_RATIO
    }

    /// Returns the time at which the film broke at the pixel, s; `None` if it did not break.
    pub fn broke_s(&self, index: usize) -> Option<f32> {
        (self.state(index) & BROKE_FLAG > 0).then(|| self.since_s(index))
    }

    /// Returns the time since which an unbroken pixel has appeared bare, s.
    pub fn bare_since_s(&self, index: usize) -> Option<f32> {
        let (block, at) = self.block_position(index);
        let looks_bare =
            self.state(index) & (BROKE_FLAG | INSIDE_FLAG) == INSIDE_FLAG && self.past[block].bare_time[at] > 0;
        looks_bare.then(|| self.since_s(index))
    }

    fn since_s(&self, index: usize) -> f32 {
        let (block, at) = self.block_position(index);
        self.times_s[usize::from(self.past[block].bare_since[at])]
    }
}
