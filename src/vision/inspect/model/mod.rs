//! The model of the film: for each pixel the brightness of its film and its dry reference, and for how long the pixel
//! has shown either of them.
//!
//! **A grid passes only on positive evidence of an unbroken film: each of its pixels was seen wet, and has the
//! brightness of its own film until the end of the observation. A pixel that is neither certainly film nor certainly
//! broken is treated as not seen, and no grid with such a pixel passes.** Every limit of this module is on the safe
//! side of this rule.
//!
//! Each pixel is compared with the brightness w of its own film, learnt from the first second of the film, and with its
//! own dry brightness d. A place that was sanded since the dry picture has no dry reference ([`classify`]). The film
//! may be darker or brighter than the dry panel, different for each place and channel ([`light`]). All limits are
//! multiples of the noise of the clip ([`noise`]). The light of the lamp is measured around the panel and compensated
//! in each picture ([`lamp`]). Shadows and a film that becomes thinner are measured on the film and compensated tile by
//! tile ([`light`]).
//!
//! The memory is fixed: about 28 bytes for each pixel of the window. The model contains no grids and no verdicts.

mod answers;
mod classify;
mod kernel;
mod lamp;
mod light;
mod noise;
mod shimmer;
#[cfg(test)]
mod tests;

use super::footprint::Window;
pub use classify::REFLECTION_TIME_S;
use classify::{BlockHistory, ClassifyParameters, TICKS_PER_SECOND, TileRow, has_dry_colour_ratio};
use kernel::{
    BLOCK_PX, BRIGHTNESS_MASK, BROKE_FLAG, Block, EVER_WET_FLAG, INSIDE_FLAG, LEVEL, NEW_BREAK_FLAG, NO_DRY_FLAG,
    OPEN_FLAG, OVEREXPOSED_FLAG, RowSelection, Sum,
};
use lamp::{LampGain, LampObserver};
use light::{EXPOSED_ROW_STRIDE, LIGHT_ROW_STRIDE, Region, TILE_PX, TileLight, Views};
use noise::Noise;
use panelprep_base::geometry::ColorPicture;
use rayon::prelude::*;
pub use shimmer::{DIFFERENCE_COUNT, TemporalNoise};

/// Minimum and maximum ratio of present to learnt film brightness of the pixels from which the light is estimated,
/// first pass, 1/1024.
const FIRST_PASS_RATIO_Q10: [u16; 2] = [512, 1331];
/// Minimum and maximum of this ratio in the second pass, relative to the mean of the first pass.
const SECOND_PASS_RATIO: [f64; 2] = [0.86, 1.16];
/// Interval between the rows from which the mean of the first pass is calculated; thousands of pixels remain.
const MEAN_ROW_STRIDE: usize = 4;
/// Minimum (`MIN_DRY_LEVELS`) and maximum (`MAX_DRY_LEVELS`) brightness of an evaluated pixel in the dry picture, grey
/// levels. A darker pixel shows no difference between wet and dry, and a brighter pixel may be overexposed.
const MIN_DRY_LEVELS: u8 = 4;
const MAX_DRY_LEVELS: u8 = 249;
/// Time over which the film brightness is learnt, s.
const LEARNING_TIME_S: f64 = 1.0;
/// Minimum difference of a sprayed, wet pixel from the range of bare brightness, as a fraction of the dry brightness.
const MIN_RELATIVE_SPRAYED_CHANGE: f64 = 0.1;
/// Maximum exponent for the film on a sanded place. The ratio of film to bare brightness there may differ from the
/// ratio on the panel: it is the panel's ratio raised to a power. The simulators draw the power from 0.85 to 1.25.
pub const MAX_FILM_POWER: f64 = 1.3;
/// Maximum ratio of brightness to film brightness that can be represented.
const MAX_BRIGHTNESS_RATIO: f64 = 3.9;
/// Ratio of film brightness to dry brightness that is assumed until the clip determines it.
pub const ASSUMED_FILM_TRANSMISSION: f64 = 0.62;

/// Maximum number of pictures; `MAX_FILM_S` is the maximum duration of a film, s.
pub const MAX_PICTURES: usize = u16::MAX as usize;
pub const MAX_FILM_S: f64 = 1_000.0;

/// The parameters for judging a film, from the recipe.
#[derive(Debug, Clone, Copy)]
pub struct FilmParameters {
    /// Weights of the channels red, green and blue.
    pub channel_weights: [f64; 3],
    /// Minimum time for which a broken pixel appears bare, s.
    pub persist_s: f64,
    /// Minimum brightness of a broken pixel, as a fraction of its dry brightness.
    pub damp: f64,
}

/// The film model of all pixels of a window.
#[derive(Debug)]
pub struct Model {
    window: Window,
    /// Number of blocks in a row, equal to the number of columns of tiles.
    columns: usize,
    terms: FilmParameters,
    views: Views,
    /// For each pixel, the mean of the dry pictures in each channel.
    dry_rgb: Vec<[u8; 3]>,
    dry_sum: Vec<[u16; 3]>,
    dry_pictures: u16,
    dry: Vec<Block>,
    wet: Vec<Block>,
    current: Vec<Block>,
    previous: Vec<Block>,
    state: Vec<Block>,
    past: Vec<BlockHistory>,
    region: Region,
    noise: Noise,
    /// Temporal noise at the pixels without a dry reference; `None` if there are no such pixels.
    shimmer: Option<TemporalNoise>,
    lamp: LampObserver,
    lit: LampGain,
    light: TileLight,
    /// Light of the last measured picture.
    next_light: Option<TileLight>,
    /// Ratio of film brightness to dry brightness: the median over the pixels of the region.
    film_transmission: Option<f64>,
    /// Maximum light so far, relative to the light of the first wet picture.
    brightest: f64,
    /// Times of the judged pictures, s; the first time is the beginning of the film.
    times_s: Vec<f32>,
    /// Whether the first wet picture has been processed.
    is_watching: bool,
    /// Variance of the learnt film brightness, and of the mean bare brightness, relative to the variance of one
    /// picture.
    wet_variance: f64,
    bare_variance: f64,
}

impl Model {
    /// Creates a model of the pixels of the window for which `inside` is true. The `sanded` pixels have no dry
    /// reference.
    pub fn new(window: Window, inside: &[bool], sanded: &[bool], terms: FilmParameters) -> Self {
        let columns = light::columns(window.width);
        let tile_rows = window.height.div_ceil(TILE_PX);
        let blocks = columns * tile_rows * TILE_PX;
        let mut state = vec![[0; BLOCK_PX]; blocks];
        for (index, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
            let without = if sanded.get(index).is_some_and(|sanded| *sanded) { NO_DRY_FLAG } else { 0 };
            state[index / window.width * columns + index % window.width / BLOCK_PX]
                [index % window.width % BLOCK_PX] = INSIDE_FLAG | without;
        }
        Model {
            window,
            columns,
            terms,
            views: Views::new(terms.channel_weights, columns, columns * tile_rows),
            dry_rgb: Vec::new(),
            dry_sum: vec![[0; 3]; window.width * window.height],
            dry_pictures: 0,
            dry: vec![[0; BLOCK_PX]; blocks],
            wet: vec![[0; BLOCK_PX]; blocks],
            current: vec![[0; BLOCK_PX]; blocks],
            previous: vec![[0; BLOCK_PX]; blocks],
            region: Region::from_blocks(&state, columns),
            state,
            past: vec![BlockHistory::EMPTY; blocks],
            noise: Noise::new(),
            shimmer: sanded.contains(&true).then(|| TemporalNoise::new(columns, blocks)),
            lamp: LampObserver::default(),
            lit: LampGain::default(),
            light: TileLight::uniform(columns, tile_rows),
            next_light: None,
            film_transmission: None,
            brightest: 1.0,
            times_s: vec![0.0],
            is_watching: false,
            wet_variance: 1.0,
            bare_variance: 1.0,
        }
    }

    /// Adds a picture of the dry panel; several pictures are averaged.
    pub fn add_dry(&mut self, picture: &ColorPicture) {
        let window = self.window;
        self.dry_pictures += 1;
        let rows = (window.top..window.top + window.height).map(|row| row * picture.width + window.left);
        let pixels = rows.flat_map(|first| &picture.rgb[first..first + window.width]);
        for (sum, pixel) in self.dry_sum.iter_mut().zip(pixels) {
            (0..3).for_each(|i| sum[i] = sum[i].saturating_add(u16::from(pixel[i])));
        }
        let count = self.dry_pictures;
        self.dry_rgb = self.dry_sum.iter().map(|sum| sum.map(|sum| ((sum + count / 2) / count) as u8)).collect();
        for index in 0..self.dry_rgb.len() {
            let (block, at) = self.block_position(index);
            let brightest = self.dry_rgb[index].into_iter().max().unwrap_or_default();
            // Too dark or overexposed pixels are equally bright wet and dry; they are removed from the region and
            // treated as not seen.
            let shows = (MIN_DRY_LEVELS..=MAX_DRY_LEVELS).contains(&brightest);
            if !shows && self.state[block][at] & NO_DRY_FLAG == 0 {
                self.state[block][at] = 0;
            }
        }
        self.region = Region::from_blocks(&self.state, self.columns);
        self.compute_dry_brightness();
        self.lamp.add_surroundings(&window, picture);
    }

    /// Calculates the dry brightness of each pixel in the view of its tile.
    fn compute_dry_brightness(&mut self) {
        let mut out = [0];
        for index in 0..self.dry_rgb.len() {
            let (block, at) = self.block_position(index);
            let weights = self.views.weights(self.views.chosen[self.views.tile_of(block)], [1.0; 3]);
            kernel::weighted_brightness(&self.dry_rgb[index..=index], weights, &mut out);
            self.dry[block][at] = out[0] & BRIGHTNESS_MASK;
        }
    }

    /// Returns whether a dry picture was captured.
    pub fn has_dry(&self) -> bool {
        self.dry_pictures > 0
    }

    /// Evaluates a picture under the spray and marks the pixels that are wet in it.
    pub fn spray(&mut self, picture: &ColorPicture) {
        if !self.has_dry() {
            return;
        }
        self.lit = self.lamp.measure(picture);
        self.read(picture);
        let damp = self.terms.damp;
        for ((look, dry), state) in self.current.iter().zip(&self.dry).zip(&mut self.state) {
            for i in 0..BLOCK_PX {
                let (s, d) = (f64::from(look[i] & BRIGHTNESS_MASK), f64::from(dry[i]));
                let is_wet = s < (damp - MIN_RELATIVE_SPRAYED_CHANGE) * d
                    || s > (1.0 + 2.0 * MIN_RELATIVE_SPRAYED_CHANGE) * d;
                state[i] |= if is_wet && look[i] & OVEREXPOSED_FLAG == 0 { EVER_WET_FLAG } else { 0 };
            }
        }
    }

    /// Calculates the brightness of each pixel of a picture, in the light of the dry picture if the lamp is known.
    /// Returns whether the picture is bit-identical to the previous one.
    fn read(&mut self, picture: &ColorPicture) -> bool {
        std::mem::swap(&mut self.current, &mut self.previous);
        let (window, columns, views) = (self.window, self.columns, &self.views);
        let gains = self.lit.agreed_gains().unwrap_or([1.0; 3]);
        let weights: Vec<[u16; 3]> = (0..views.count()).map(|view| views.weights(view, gains)).collect();
        let before = &self.previous;
        let tile_row = |(index, look): (usize, &mut [Block])| {
            let first = index * TILE_PX;
            for (line, out) in look.chunks_mut(columns).take(window.height - first).enumerate() {
                let row = window.top + first + line;
                let pixels = &picture.rgb[row * picture.width + window.left..][..window.width];
                for (column, (pixels, out)) in pixels.chunks(BLOCK_PX).zip(out).enumerate() {
                    kernel::weighted_brightness(pixels, weights[views.chosen[index * columns + column]], out);
                }
            }
            *look == before[first * columns..][..look.len()]
        };
        let same: Vec<bool> = self.current.par_chunks_mut(columns * TILE_PX).enumerate().map(tile_row).collect();
        same.into_iter().all(|same| same)
    }

    /// Measures a picture of the wet panel without judging it.
    pub fn measure_wet(&mut self, picture: &ColorPicture) -> PictureMeasurement {
        self.lit = self.lamp.measure(picture);
        let is_first = !self.is_watching;
        let frozen = if is_first {
            self.begin_wet(picture);
            false
        } else {
            self.read(picture)
        };
        let is_known = self.lit.agreed_gains().is_some();
        let light = self.light.updated(&self.tile_sums(), &self.region.inside, is_known);
        let lamp = self.lit.agreed_gains().map(|_| self.lit.mean());
        let measured = PictureMeasurement {
            light: self.lit.brighter_gain.or(lamp).unwrap_or(light.region_median),
            is_lamp_known: is_known,
            overexposed: self.overexposed_fraction(),
            frozen,
            film_transmission: self.film_transmission.unwrap_or(ASSUMED_FILM_TRANSMISSION),
            flicker_percent: self.lit.flicker_percent,
        };
        self.next_light = Some(light);
        measured
    }

    /// Processes the first wet picture: selects the view of each tile, and sets the first film brightness.
    fn begin_wet(&mut self, picture: &ColorPicture) {
        let gains = self.lit.agreed_gains().unwrap_or([1.0; 3]);
        let window = self.window;
        if self.has_dry() {
            let change = |index: usize| {
                let (block, at) = self.block_position(index);
                let (row, column) = (index / window.width, index % window.width);
                let now = picture.rgb[(window.top + row) * picture.width + window.left + column];
                let dry = self.dry_rgb[index];
                let change = std::array::from_fn(|i| f64::from(now[i]) / gains[i] - f64::from(dry[i]));
                (self.state[block][at] & (INSIDE_FLAG | NO_DRY_FLAG) == INSIDE_FLAG).then_some((block, change))
            };
            let changes: Vec<(usize, [f64; 3])> = (0..self.dry_rgb.len()).step_by(3).filter_map(change).collect();
            // The views are selected with the first film and then fixed: with another channel in each picture the
            // brightness values could not be compared.
            self.views.choose(changes.into_iter());
            self.compute_dry_brightness();
        }
        self.read(picture);
        // The first picture is also used as its own previous picture.
        self.previous.clone_from(&self.current);
        self.wet = self.current.iter().map(|look| look.map(|look| look & BRIGHTNESS_MASK)).collect();
        for state in self.state.as_flattened_mut() {
            // Without a dry reference a single picture does not show whether a pixel is wet. The module `sanded`
            // requires evidence of moving water at the end.
            *state |= if *state & NO_DRY_FLAG > 0 { EVER_WET_FLAG } else { 0 };
        }
        self.light = self.light.for_first_wet_picture(self.lit.agreed_gains().is_some());
        self.is_watching = true;
    }

    /// Returns the fraction of the region that is overexposed.
    fn overexposed_fraction(&self) -> f64 {
        let rows = self.region.rows.iter().enumerate().step_by(EXPOSED_ROW_STRIDE);
        let found: u32 = rows
            .map(|(row, inside)| {
                let part = row * self.columns + inside.start..row * self.columns + inside.end;
                kernel::count_overexposed(&self.current[part.clone()], &self.state[part])
            })
            .sum();
        f64::from(found) / f64::from(self.region.exposed_of.max(1))
    }

    /// Judges the last measured picture. Returns the pixels that broke in this picture, as indices of the window.
    pub fn judge_last(&mut self, picture: &ColorPicture, since_wet_s: f64) -> Vec<usize> {
        // Times and counts are 16-bit numbers; beyond these limits they would overflow, and a late break would get an
        // early time.
        let too_many = self.times_s.len() >= MAX_PICTURES || since_wet_s > MAX_FILM_S;
        let Some(light) = self.next_light.take().filter(|_| !too_many) else { return Vec::new() };
        let brighter = light.region_median / self.light.region_median.max(f64::MIN_POSITIVE);
        self.add_noise(brighter);
        self.light = light;
        self.add_temporal_noise(since_wet_s);
        let before = self.times_s.last().copied().unwrap_or_default();
        self.times_s.push(since_wet_s as f32);
        // Light that is estimated from the film may be too bright because of a reflection, and would raise the limit
        // for all following pictures.
        if !self.light.is_lamp_excluded() {
            self.brightest = self.brightest.max(self.light.region_median);
        }
        if self.film_transmission.is_none() {
            self.film_transmission = self.measured_film();
        }
        let ticks = |time_s: f64| (time_s * TICKS_PER_SECOND).round() as u16;
        let now = self.times_s.len() as u16 - 1;
        let step = ticks(since_wet_s) - ticks(f64::from(before));
        let rule = ClassifyParameters {
            damp_q16: to_q16(self.terms.damp),
            away_q16: to_q16(self.away_threshold()),
            bright_q12: light::to_q12(self.brightest_break()),
            noise: (self.noise.levels() * f64::from(LEVEL)).round() as u16,
            // A pixel that appears bare in consecutive pictures was bare for one step longer on average: half a step
            // before the first and half a step after the last picture.
            persist: ticks(self.terms.persist_s).saturating_sub(step).max(1),
            step,
            ticks: ticks(since_wet_s),
            previous: now - 1,
            now,
            brighter_q12: light::to_q12(brighter),
            mean: (TICKS_PER_SECOND / f64::from(step.max(1))).log2().round().clamp(1.0, 6.0) as u32,
            // The film brightness is learnt only in the first second: if it followed the film for longer, it would also
            // follow a break that opens slowly.
            learn: (since_wet_s <= LEARNING_TIME_S).then_some(if now <= 2 { 1 } else { 2 }),
        };
        if let Some(power) = rule.learn {
            let part = 0.5_f64.powi(power as i32);
            self.wet_variance = (1.0 - part).powi(2) * self.wet_variance + part * part;
        }
        let part = 0.5_f64.powi(rule.mean as i32);
        self.bare_variance = part / (2.0 - part);
        let broke = self.judge(&rule);
        let (broke, mirrors): (Vec<usize>, Vec<usize>) =
            broke.into_iter().partition(|&index| self.has_dry_colour(picture, index));
        mirrors.into_iter().for_each(|index| self.cancel_break(index));
        broke
    }

    /// Returns half of the change that the darkest accepted break causes in a film, as a fraction of the film
    /// brightness.
    pub fn away_threshold(&self) -> f64 {
        // A shadow on the first picture must not be treated as film; therefore the film is evaluated in the brightest
        // light so far. The change by a break is then underestimated rather than overestimated.
        let film = self.film_transmission.unwrap_or(ASSUMED_FILM_TRANSMISSION);
        let film = if film < 1.0 { (film * self.brightest).min(1.0) } else { film };
        ((self.terms.damp / film - 1.0).abs() / 2.0).min(0.5)
    }

    /// Returns the maximum brightness of a pixel without a dry reference after its film has opened, as a ratio to its
    /// film brightness.
    pub fn brightest_break(&self) -> f64 {
        let film = self.film_transmission.unwrap_or(ASSUMED_FILM_TRANSMISSION).min(1.0);
        (film.powf(-MAX_FILM_POWER) * 1.125).min(MAX_BRIGHTNESS_RATIO)
    }

    fn add_temporal_noise(&mut self, since_wet_s: f64) {
        let Some(shimmer) = self.shimmer.as_mut() else { return };
        shimmer.add(&shimmer::TemporalNoiseInput {
            current: &self.current,
            wet: &self.wet,
            state: &self.state,
            since_wet_s,
        });
    }

    /// Ends the observation; no further pictures are accepted.
    pub fn end(&mut self) {
        self.shimmer.iter_mut().for_each(TemporalNoise::end);
    }

    fn add_noise(&mut self, brighter: f64) {
        for (row, inside) in self.region.rows.iter().enumerate().step_by(noise::ROW_STRIDE) {
            let part = row * self.columns + inside.start..row * self.columns + inside.end;
            let (look, before, state) =
                (&self.current[part.clone()], &self.previous[part.clone()], &self.state[part]);
            self.noise.add(look, before, state, brighter);
        }
    }

    /// Returns whether a pixel of the window has the colour of the dry panel; true for a pixel without a dry reference,
    /// which has no colour for the comparison.
    fn has_dry_colour(&self, picture: &ColorPicture, index: usize) -> bool {
        let (block, at) = self.block_position(index);
        if self.state[block][at] & NO_DRY_FLAG > 0 {
            return true;
        }
        let (row, column) = (index / self.window.width, index % self.window.width);
        let now = picture.rgb[(self.window.top + row) * picture.width + self.window.left + column];
        let tint = self.lit.agreed_gains().unwrap_or([1.0; 3]);
        self.dry_rgb.get(index).is_none_or(|dry| has_dry_colour_ratio(now, *dry, tint))
    }

    /// Cancels a break, because the bare appearance is a reflection. The pixel is treated as unbroken, and as not seen
    /// while it appeared bare. Its counter is set to just below the required time, so that the pixel is checked again
    /// in the next picture.
    fn cancel_break(&mut self, index: usize) {
        let (block, at) = self.block_position(index);
        let past = &mut self.past[block];
        self.state[block][at] &= !(BROKE_FLAG | NEW_BREAK_FLAG | OPEN_FLAG);
        past.bare_time[at] = past.bare_time[at].saturating_sub(1);
        past.unseen_time[at] =
            past.unseen_time[at].saturating_add((self.terms.persist_s * TICKS_PER_SECOND) as u16);
        past.last_seen_at[at] = past.bare_since[at];
    }

    /// Returns the sums of each tile: first over a wide band of ratios, then over a narrower band around the mean
    /// ratio.
    fn tile_sums(&self) -> Vec<Sum> {
        let tile_rows: Vec<usize> = (0..self.state.len() / self.columns / TILE_PX).collect();
        let sums: Vec<Vec<Sum>> = tile_rows.par_iter().map(|row| self.tile_row_sums(*row)).collect();
        sums.concat()
    }

    /// Returns the sums of the tiles in one row of tiles.
    fn tile_row_sums(&self, tile_row: usize) -> Vec<Sum> {
        let stride = self.columns;
        let rows = tile_row * TILE_PX * stride..(tile_row + 1) * TILE_PX * stride;
        let (look, wet, state) = (&self.current[rows.clone()], &self.wet[rows.clone()], &self.state[rows]);
        let tile = |column: usize| {
            if self.region.inside[tile_row * stride + column] == 0 {
                return Sum::default();
            }
            let (look, wet, state) = (&look[column..], &wet[column..], &state[column..]);
            let add = |every, band_q10| {
                kernel::sum_tile(look, wet, state, RowSelection { stride, row_interval: every, band_q10 })
            };
            let first = add(MEAN_ROW_STRIDE, FIRST_PASS_RATIO_Q10);
            if first.expected == 0 {
                return first;
            }
            let mean = f64::from(first.found) / f64::from(first.expected) * 1024.0;
            add(LIGHT_ROW_STRIDE, SECOND_PASS_RATIO.map(|share| (share * mean) as u16))
        };
        (0..stride).map(tile).collect()
    }

    /// Judges every pixel, and returns the pixels that broke in this picture.
    fn judge(&mut self, rule: &ClassifyParameters) -> Vec<usize> {
        let (columns, width) = (self.columns, self.window.width);
        let light = &self.light;
        let size = columns * TILE_PX;
        let given =
            self.current.par_chunks(size).zip(self.previous.par_chunks(size)).zip(self.dry.par_chunks(size));
        let over_time = (self.state.par_chunks_mut(size).zip(self.wet.par_chunks_mut(size)))
            .zip(self.past.par_chunks_mut(size));
        let rows = given.zip(over_time).zip(self.region.rows.par_chunks(TILE_PX)).enumerate();
        let broke: Vec<Vec<usize>> = rows
            .map(|(index, ((((look, before), dry), ((state, wet), past)), inside))| {
                let mut band = TileRow { columns, current: look, previous: before, dry, state, wet, past, inside };
                let pixels = band.judge(light, index, rule).into_iter();
                let stride = columns * BLOCK_PX;
                pixels.map(|at| (index * TILE_PX + at / stride) * width + at % stride).collect()
            })
            .collect();
        broke.concat()
    }
}

/// Converts a fraction below 1 to units of 1/65536.
fn to_q16(share: f64) -> u16 {
    (share * 65_536.0).round().min(65_535.0) as u16
}

/// The measurements of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PictureMeasurement {
    /// Light relative to the dry picture: the light of the lamp if it is known, otherwise the median over the film of
    /// the region.
    pub light: f64,
    /// Whether `light` is the light of the lamp.
    pub is_lamp_known: bool,
    /// Fraction of the region that is overexposed.
    pub overexposed: f64,
    /// Whether the picture is bit-identical to the previous one: the camera sends one picture repeatedly.
    pub frozen: bool,
    /// τ, the ratio of film brightness to dry brightness, measured or assumed.
    pub film_transmission: f64,
    /// Flicker of the lamp, percent, if it is unknown whether the lamp or water changed the surroundings; otherwise 0.
    pub flicker_percent: f64,
}
