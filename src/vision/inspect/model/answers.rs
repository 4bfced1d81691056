//! The results of the model: the state of each pixel of the window.

use super::classify::{REFLECTION_TIME_S, TICKS_PER_SECOND};
use super::kernel::{
    BLOCK_PX, BROKE_FLAG, EVER_WET_FLAG, INSIDE_FLAG, LEVEL, LOOK_MASK, NO_DRY_FLAG, OPEN_FLAG, STEPPED_FLAG,
};
use super::{Model, Shimmer};
use panelprep_base::geometry::median;

/// A pixel counts as not seen if it showed neither film nor a bare place for more than this fraction of the
/// observation time. The same is true if it showed neither for longer than [`REFLECTION_TIME_S`] at the end.
const MAX_UNSEEN_SHARE: f64 = 0.5;
/// A film that changes a place by less than this many times the noise cannot be distinguished from a break.
pub const MIN_CONTRAST_TO_NOISE: f64 = 4.0;
/// A film that is brighter than this multiple of the place's dry look is brighter than any bare place, whatever light
/// was measured.
const MAX_BARE_TO_DRY_RATIO: f32 = 1.15;
/// Every nth pixel is used to determine the fraction of the dry look that remains under the film.
const FILM_PIXEL_STRIDE: usize = 7;
/// With fewer pixels than this the fraction that remains under the film is not determined.
const MIN_FILM_PIXELS: usize = 100;

impl Model {
    /// Returns the block of a pixel of the window, and the index of the pixel in this block.
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

    /// Returns how long a place must look bare to count as broken, s.
    pub fn persist_s(&self) -> f32 {
        self.terms.persist_s as f32
    }

    /// Returns the longest time between two pictures that were judged, s.
    pub fn longest_step_s(&self) -> f32 {
        self.times_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f32::max)
    }

    /// Returns the clip's noise, grey levels.
    pub fn noise_levels(&self) -> f64 {
        self.noise.levels()
    }

    /// Returns the median of this value over the region's pixels that have a dry reference, were seen wet and did not
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

    /// Returns the look of a pixel's film, levels.
    pub fn film_look_levels(&self, index: usize) -> f64 {
        self.wet_levels(index)
    }

    /// Returns the shimmer that was measured on the places without a dry reference; `None` if there are no such places.
    pub fn measured_shimmer(&self) -> Option<&Shimmer> {
        self.shimmer.as_ref()
    }

    /// Returns the variance of the sensor's noise in a site of the shimmer, for a film with this look, levels²; `None`
    /// if the noise was not measured.
    pub fn site_variance(&self, index: usize, look_levels: f64) -> Option<f64> {
        let (block, _) = self.block_position(index);
        let view = self.views.chosen[self.views.tile_of(block)];
        let [of_channel, of_mean] = self.lamp.sensor().map(|sensor| sensor.variance(look_levels));
        Some(self.views.variance(view, of_channel?, of_mean?))
    }

    /// Measures the fraction of the dry look that remains under the film, from the wet looks.
    pub(super) fn measured_film(&self) -> Option<f64> {
        self.median(|index| self.wet_levels(index) / self.dry_levels(index).max(1.0))
    }

    /// Returns the fraction of the dry look that remains under the film; `None` if the clip did not determine it.
    pub fn film(&self) -> Option<f64> {
        self.film_transmission
    }

    /// Returns the median change of brightness that the film causes over the region, grey levels.
    pub fn change_levels(&self) -> Option<f64> {
        self.median(|index| (self.wet_levels(index) - self.dry_levels(index)).abs())
    }

    /// Returns a pixel's dry brightness, in an arbitrary unit.
    pub fn dry_brightness(&self, index: usize) -> f64 {
        self.dry_levels(index)
    }

    /// Returns whether a pixel of the window is evaluated.
    pub fn is_evaluated(&self, index: usize) -> bool {
        self.state(index) & INSIDE_FLAG > 0
    }

    /// Returns whether a pixel is judged only by its wet look.
    pub fn has_no_dry_brightness(&self, index: usize) -> bool {
        self.state(index) & NO_DRY_FLAG > 0
    }

    /// Returns whether the state of the pixel is known: it showed film or a bare place for at least half of the time,
    /// also near the end, and did not change to a look that is neither. It also must not have kept a look between film
    /// and bare until the end, for as long as a bare place must be seen, since such a film may break next.
    pub fn was_observed(&self, index: usize) -> bool {
        let (block, at) = self.block_position(index);
        let (past, state) = (&self.past[block], self.state(index));
        let Some(last_s) = self.times_s.last().copied().map(f64::from) else { return false };
        let unseen_s = f64::from(past.unseen_time[at]) / TICKS_PER_SECOND;
        let seen_s = f64::from(self.times_s[usize::from(past.last_seen_at[at])]);
        // A block that was skipped because its pixels were calm has shown its film.
        let is_calm = state & super::kernel::BUSY_FLAG == 0;
        state & INSIDE_FLAG > 0
            && state & (EVER_WET_FLAG | BROKE_FLAG) > 0
            && state & STEPPED_FLAG == 0
            && !self.ends_between_film_and_bare(index)
            && unseen_s <= MAX_UNSEEN_SHARE * last_s
            && (is_calm || last_s - seen_s <= REFLECTION_TIME_S)
    }

    /// Returns whether the pixel ends with a steady look between film and bare that lasted as long as a bare place must
    /// be seen to count as broken.
    fn ends_between_film_and_bare(&self, index: usize) -> bool {
        let (block, at) = self.block_position(index);
        let past = &self.past[block];
        let [.., before_s, last_s] = *self.times_s else { return false };
        // A steady look counts as one step longer than its pictures, like a bare look.
        let away_s = f64::from(past.away_time[at]) / TICKS_PER_SECOND + f64::from(last_s - before_s);
        // A block that is not busy shows film in the last picture, but the times of its pixels do not contain this
        // picture.
        let is_busy = self.state(index) & super::kernel::BUSY_FLAG > 0;
        let shows_neither = is_busy && usize::from(past.last_seen_at[at]) + 1 < self.times_s.len();
        shows_neither && past.away_time[at] > 0 && away_s >= self.terms.persist_s
    }

    /// Returns whether the pixel was seen wet in a picture.
    pub fn ever_wet(&self, index: usize) -> bool {
        self.state(index) & EVER_WET_FLAG > 0
    }

    /// Returns whether the pixel's film is open now.
    pub fn is_open_now(&self, index: usize) -> bool {
        self.state(index) & OPEN_FLAG > 0
    }

    /// Returns how long the pixel's film was open, if the film broke and closed again, s.
    pub fn open_time_s(&self, index: usize) -> Option<f32> {
        let (block, at) = self.block_position(index);
        let (past, time_s) = (&self.past[block], |picture: u16| self.times_s[usize::from(picture)]);
        (self.state(index) & (BROKE_FLAG | OPEN_FLAG) == BROKE_FLAG)
            .then(|| time_s(past.closed_at[at]) - time_s(past.bare_since[at]))
    }

    /// Returns the reference brightness for the pixel's ratios, levels: its dry look, or its film's look if it has no
    /// dry look.
    fn reference_levels(&self, index: usize) -> f64 {
        let levels =
            if self.has_no_dry_brightness(index) { self.wet_levels(index) } else { self.dry_levels(index) };
        levels.max(1.0)
    }

    /// Returns the mean brightness of a pixel while it looked bare, relative to its dry look; for a place without a
    /// dry look, relative to its film's look.
    pub fn bare_brightness_ratio(&self, index: usize) -> f32 {
        let (block, at) = self.block_position(index);
        let off_levels = f64::from(self.past[block].bare_difference[at] as i16) / f64::from(LEVEL);
        (1.0 + off_levels / self.reference_levels(index)) as f32
    }

    /// Returns the brightness of a pixel while it looked bare, and in the last picture, grey levels, both in the light
    /// of the wet look.
    pub fn levels(&self, index: usize) -> [f32; 2] {
        let (block, at) = self.block_position(index);
        let gain = self.light.tile_light(self.views.tile_of(block));
        let now = f64::from(self.current[block][at] & LOOK_MASK) / f64::from(LEVEL) / gain;
        [self.bare_brightness_ratio(index) * self.reference_levels(index) as f32, now as f32]
    }

    /// Returns the brightness of the pixel's film, relative to the same reference as [`Model::bare_brightness_ratio`].
    pub fn film_brightness_ratio(&self, index: usize) -> f32 {
        (self.wet_levels(index) / self.reference_levels(index)) as f32
    }

    /// Returns the standard deviation of [`Model::bare_brightness_ratio`], relative to the same reference. It contains
    /// the noise of the mean bare brightness and that of the reference.
    pub fn bare_ratio_noise(&self, index: usize) -> f32 {
        let of_whole = match self.has_no_dry_brightness(index) {
            true => self.wet_variance,
            false => 1.0 / f64::from(self.dry_pictures.max(1)),
        };
        let share = f64::from(self.bare_brightness_ratio(index));
        let variance = self.bare_variance + share * share * of_whole;
        (self.noise_levels() * variance.sqrt() / self.reference_levels(index)) as f32
    }

    /// Returns the range of the fraction of the dry look that remains under the film, without the lowest and the
    /// highest twentieth of the pixels whose film is known; `None` if there are too few of them.
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

    /// Returns the minimum fraction of its dry look to which a broken place returns.
    pub fn min_damp_ratio(&self) -> f64 {
        self.terms.damp
    }

    /// Returns the ratio of contrast to noise at a pixel. The contrast is the difference between the film and the
    /// dampest break that is accepted.
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

    /// Returns whether film and a bare place differ enough at the pixel to be distinguished.
    pub fn has_contrast(&self, index: usize) -> bool {
        self.contrast_to_noise(index) >= MIN_CONTRAST_TO_NOISE
    }

    /// Returns whether the pixel's film is brighter than any bare place at this pixel.
    pub fn is_film_brighter(&self, index: usize) -> bool {
        !self.has_no_dry_brightness(index)
            && self.is_evaluated(index)
            && self.film_brightness_ratio(index) > MAX_BARE_TO_DRY_RATIO
    }

    /// Returns the time at which the pixel's film broke, s; `None` if it did not break.
    pub fn broke_s(&self, index: usize) -> Option<f32> {
        (self.state(index) & BROKE_FLAG > 0).then(|| self.since_s(index))
    }

    /// Returns the time since which a pixel that did not break has looked bare, s.
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
