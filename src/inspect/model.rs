//! The default method: what each pixel looks like dry and wet, and for how long it has looked so.
//!
//! A film takes a part of the panel's brightness and keeps its pattern (it is multiplicative), light multiplies all of it
//! and is smooth, a glint adds to it and moves on. So with the dry picture d of a pixel, s = g τ d while its film holds
//! and s = g d when it has broken; τ, one number for the panel, is read from the clip where the panel becomes wet, and g
//! ([`super::light`]) from each picture, by the pixels whose state is known. What looks dry long enough has broken since
//! it first did ([`super::kernel`]).
//!
//! Memory is fixed: some 20 bytes for each pixel of the window. Does not know grids or verdicts.

use super::band::Band;
use super::footprint::Window;
use super::kernel::{self, BROKE, EVER_WET, HIDDEN, INSIDE, LEVEL, NEW, OPEN, Rule, Sum};
use super::light::{Light, TILE_PX};
use crate::geometry::ColorPicture;
use rayon::prelude::*;

/// What a film leaves of the dry brightness, until the clip tells.
const FILM_ASSUMED: f64 = 0.62;
/// Ratios to the dry brightness between which a pixel may be wet.
const WET_RATIOS: [f64; 2] = [0.2, 0.88];
/// Of the region this share must be wet in a picture for τ to be read from it.
const MIN_WET_SHARE: f64 = 0.05;
/// Darker than this a pixel tells nothing, levels.
const MIN_DRY_LEVELS: u16 = 4;
/// Before the film is watched the light is told by pixels this near to what the picture before lets expect, 1/1024.
const NARROW_Q10: [f64; 2] = [0.87 * 1024.0, 1.15 * 1024.0];
/// Of the film's light this is the most and the least, 1/1024 …
const WIDE_Q10: [u32; 2] = [512, 1331];
/// … and then what lies about the first mean.
const ABOUT: [f64; 2] = [0.86, 1.16];

/// What one picture says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Look {
    /// The light against the dry picture's; the region's median.
    pub light: f64,
    /// The share of the region whose light is as its state lets expect.
    pub told: f64,
    /// The share of the region that glints and overexposure hide.
    pub hidden: f64,
    /// Bit-equal to the picture before: the camera stands still.
    pub frozen: bool,
}

/// The pixels of a window over time.
#[derive(Debug)]
pub struct Model {
    window: Window,
    stride: usize,
    tile_rows: usize,
    weights: [u16; 3],
    persist: u8,
    dry_sum: Vec<u32>,
    dry_pictures: u32,
    dry: Vec<u16>,
    brightness: Vec<u16>,
    before: Vec<u16>,
    state: Vec<u8>,
    run: Vec<u8>,
    since_s: Vec<f32>,
    until_s: Vec<f32>,
    inside: Vec<u32>,
    light: Light,
    next_light: Option<Light>,
    film: f64,
    film_known: bool,
    watching: bool,
    /// The time of the last picture that was judged, s.
    followed_s: f64,
}

impl Model {
    /// A model of the window's pixels for which `inside` says so; `persist` pictures make a break.
    pub fn new(window: Window, inside: &[bool], channel_weights: [f64; 3], persist: u8) -> Self {
        let columns = window.width.div_ceil(TILE_PX);
        let tile_rows = window.height.div_ceil(TILE_PX);
        let (stride, pixels) = (columns * TILE_PX, columns * tile_rows * TILE_PX * TILE_PX);
        let mut state = vec![0; pixels];
        for (index, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
            state[index / window.width * stride + index % window.width] = INSIDE | OPEN;
        }
        let mut model = Model {
            window,
            stride,
            tile_rows,
            weights: whole_weights(channel_weights),
            persist,
            dry_sum: vec![0; pixels],
            dry_pictures: 0,
            dry: vec![0; pixels],
            brightness: vec![0; pixels],
            before: vec![0; pixels],
            state,
            run: vec![0; pixels],
            since_s: vec![0.0; pixels],
            until_s: vec![0.0; pixels],
            inside: Vec::new(),
            light: Light::even(columns, tile_rows),
            next_light: None,
            film: FILM_ASSUMED,
            film_known: false,
            watching: false,
            followed_s: 0.0,
        };
        model.count_inside();
        model
    }

    fn count_inside(&mut self) {
        let columns = self.stride / TILE_PX;
        let (state, stride) = (&self.state, self.stride);
        let count = |tile: usize| {
            let (left, top) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
            let row =
                |row: usize| state[row * stride + left..][..TILE_PX].iter().filter(|s| **s & INSIDE > 0).count();
            (top..top + TILE_PX).map(row).sum::<usize>() as u32
        };
        self.inside = (0..columns * self.tile_rows).map(count).collect();
    }

    fn read(&mut self, picture: &ColorPicture) -> bool {
        std::mem::swap(&mut self.brightness, &mut self.before);
        let (window, weights) = (self.window, self.weights);
        let rows = self
            .brightness
            .par_chunks_mut(self.stride * TILE_PX)
            .zip(self.before.par_chunks(self.stride * TILE_PX));
        let same: Vec<bool> = rows
            .enumerate()
            .map(|(band, (out, before))| {
                let lines = window.height.saturating_sub(band * TILE_PX).min(TILE_PX);
                for (line, out) in out.chunks_mut(self.stride).take(lines).enumerate() {
                    let row = window.top + band * TILE_PX + line;
                    let pixels = &picture.rgb[row * picture.width + window.left..][..window.width];
                    kernel::brightness(pixels, weights, &mut out[..window.width]);
                }
                out == before
            })
            .collect();
        same.into_iter().all(|same| same)
    }

    /// A picture of the dry panel; several are averaged.
    pub fn dry(&mut self, picture: &ColorPicture) {
        self.read(picture);
        self.dry_pictures += 1;
        for (sum, light) in self.dry_sum.iter_mut().zip(&self.brightness) {
            *sum += u32::from(light & !HIDDEN);
        }
        for (dry, sum) in self.dry.iter_mut().zip(&self.dry_sum) {
            *dry = (sum / self.dry_pictures) as u16;
        }
        for (state, light) in self.state.iter_mut().zip(&self.brightness) {
            // An overexposed or black place tells nothing: it is not seen.
            if light & HIDDEN > 0 || *light < MIN_DRY_LEVELS * LEVEL as u16 {
                *state = 0;
            }
        }
        self.count_inside();
    }

    /// Whether a dry picture was taken.
    pub fn has_dry(&self) -> bool {
        self.dry_pictures > 0
    }

    /// A picture under the spray: what is wet by now.
    pub fn spray(&mut self, picture: &ColorPicture) {
        if !self.has_dry() {
            return;
        }
        self.read(picture);
        self.settle_states();
    }

    /// The light by what hardly changed, what the film leaves by what did, and each pixel's state by both.
    fn settle_states(&mut self) {
        let g = self.light.global;
        let sums = self.sums(NARROW_Q10.map(|bound| (bound * g) as u32));
        let found = self.light.found(&sums, &self.inside);
        // Too few unchanged: the light of before holds.
        self.light = self.light.flat(if found.share > 0.05 { found.global } else { g });
        if let Some(film) = self.film_left() {
            (self.film, self.film_known) = (film, true);
        }
        let rule =
            Rule { film_q15: self.film_q15(), persist: 1, before_s: 0.0, now_s: 0.0, brighter_q12: 4096, notes: 0 };
        // Whether it is steady plays no part yet.
        let before = std::mem::replace(&mut self.before, self.brightness.clone());
        self.judge(rule);
        self.before = before;
        self.run.iter_mut().for_each(|run| *run = 0);
    }

    /// The median ratio to the dry brightness of what is wet; `None` where too little is.
    fn film_left(&self) -> Option<f64> {
        const BINS: usize = 256;
        let mut bins = [0_u32; BINS];
        let all: u32 = self.inside.iter().sum();
        for ((&light, &dry), &state) in self.brightness.iter().zip(&self.dry).zip(&self.state) {
            if state & INSIDE > 0 && light & HIDDEN == 0 {
                let ratio = f64::from(light) / (self.light.global * f64::from(dry));
                if (WET_RATIOS[0]..WET_RATIOS[1]).contains(&ratio) {
                    bins[(ratio * BINS as f64) as usize] += 1;
                }
            }
        }
        let count: u32 = bins.iter().sum();
        if f64::from(count) < MIN_WET_SHARE * f64::from(all) {
            return None;
        }
        let mut sum = 0;
        let bin = bins.iter().position(|bin| {
            sum += bin;
            sum * 2 >= count
        })?;
        Some((bin as f64 + 0.5) / BINS as f64)
    }

    /// Looks at a picture of the wet panel, and judges nothing yet.
    pub fn look(&mut self, picture: &ColorPicture) -> Look {
        let frozen = self.read(picture) && self.watching;
        if !self.watching {
            self.begin();
            // The first picture stands for the one before it.
            self.before.clone_from(&self.brightness);
        }
        let (light, hidden) = self.light_now();
        let look = Look { light: light.global, told: light.share, hidden, frozen };
        self.next_light = Some(light);
        look
    }

    /// Judges the picture that was looked at last. The pixels that broke now come back, as indices of the window.
    pub fn follow(&mut self, since_wet_s: f64) -> Vec<usize> {
        let Some(light) = self.next_light.take() else { return Vec::new() };
        let brighter = light.global / self.light.global.max(f64::MIN_POSITIVE);
        self.light = light;
        let rule = Rule {
            film_q15: self.film_q15(),
            persist: self.persist,
            before_s: self.followed_s as f32,
            now_s: since_wet_s as f32,
            brighter_q12: (brighter * 4096.0).round().clamp(0.0, 16_384.0) as u32,
            notes: BROKE | NEW,
        };
        self.followed_s = since_wet_s;
        self.judge(rule)
    }

    /// The first fully wet picture: without a dry one it is the best that is known.
    fn begin(&mut self) {
        if !self.has_dry() {
            let dry = |light: &u16| (f64::from(light & !HIDDEN) / FILM_ASSUMED).min(16_320.0) as u16;
            self.dry = self.brightness.iter().map(dry).collect();
            self.state.iter_mut().for_each(|state| *state &= !OPEN);
        } else {
            self.settle_states();
        }
        self.watching = true;
    }

    fn light_now(&self) -> (Light, f64) {
        let light = self.light.found(&self.sums(WIDE_Q10), &self.inside);
        let gain = (light.global * 4096.0) as u32;
        let rows = self.brightness.par_chunks(self.stride).zip(self.dry.par_chunks(self.stride));
        let hidden: u32 = rows
            .zip(self.state.par_chunks(self.stride))
            .with_min_len(TILE_PX)
            .map(|((light, dry), state)| kernel::hidden(light, dry, state, gain))
            .sum();
        let all: u32 = self.inside.iter().sum();
        (light, f64::from(hidden) / f64::from(all.max(1)))
    }

    /// Each tile's sums, first over a wide band, then about their mean.
    fn sums(&self, band_q10: [u32; 2]) -> Vec<Sum> {
        let (columns, film_q15) = (self.stride / TILE_PX, self.film_q15());
        let tile = |index: usize| {
            let at = index / columns * TILE_PX * self.stride + index % columns * TILE_PX;
            let add = |band_q10: [u32; 2]| {
                (0..TILE_PX).fold(Sum::default(), |sum, row| {
                    let part = at + row * self.stride..at + row * self.stride + TILE_PX;
                    let (light, dry) = (&self.brightness[part.clone()], &self.dry[part.clone()]);
                    let row = kernel::add_up(light, dry, &self.state[part], film_q15, band_q10);
                    Sum {
                        found: sum.found + row.found,
                        expected: sum.expected + row.expected,
                        pixels: sum.pixels + row.pixels,
                    }
                })
            };
            let first = add(band_q10);
            if first.expected == 0 {
                return first;
            }
            let mean = f64::from(first.found) / f64::from(first.expected) * 1024.0;
            add(ABOUT.map(|share| (share * mean) as u32))
        };
        (0..self.inside.len()).into_par_iter().with_min_len(columns).map(tile).collect()
    }

    fn film_q15(&self) -> u32 {
        (self.film * 32_768.0).round() as u32
    }

    /// Judges every pixel; those that broke now come back.
    fn judge(&mut self, rule: Rule) -> Vec<usize> {
        let (stride, window) = (self.stride, self.window);
        let band = stride * TILE_PX;
        let (light, watching) = (&self.light, self.watching);
        let given =
            self.brightness.par_chunks(band).zip(self.before.par_chunks(band)).zip(self.dry.par_chunks(band));
        let kept = self.state.par_chunks_mut(band).zip(self.run.par_chunks_mut(band));
        let times = self.since_s.par_chunks_mut(band).zip(self.until_s.par_chunks_mut(band));
        let rows = given.zip(kept).zip(times).enumerate();
        let broke: Vec<Vec<usize>> = rows
            .map(|(index, ((((brightness, before), dry), (state, run)), (since_s, until_s)))| {
                let mut band = Band { brightness, before, dry, state, run, since_s, until_s };
                let mut broke = Vec::new();
                band.judge(light, (index, stride), rule, watching, |at| {
                    let (row, column) = (index * TILE_PX + at / stride, at % stride);
                    broke.push(row * window.width + column);
                });
                broke
            })
            .collect();
        broke.concat()
    }

    /// What the film leaves of the dry brightness, where the clip told it.
    pub fn film(&self) -> Option<f64> {
        self.film_known.then_some(self.film)
    }

    /// How bright the region is when dry, grey levels.
    pub fn mean_dry_levels(&self) -> f64 {
        let inside = self.state.iter().zip(&self.dry).filter(|(state, _)| **state & INSIDE > 0);
        let (sum, count) = inside.fold((0_u64, 0_u64), |(sum, count), (_, dry)| (sum + u64::from(*dry), count + 1));
        sum as f64 / count.max(1) as f64 / f64::from(LEVEL)
    }

    fn at(&self, index: usize) -> usize {
        index / self.window.width * self.stride + index % self.window.width
    }

    /// Whether a pixel of the window was looked at.
    pub fn sees(&self, index: usize) -> bool {
        self.state[self.at(index)] & INSIDE > 0
    }

    /// Whether it was seen wet in a picture.
    pub fn ever_wet(&self, index: usize) -> bool {
        self.state[self.at(index)] & EVER_WET > 0
    }

    /// Whether its film is open now.
    pub fn is_open(&self, index: usize) -> bool {
        self.state[self.at(index)] & OPEN > 0
    }

    /// How long its film was open, where it broke and closed again, s.
    pub fn was_open_s(&self, index: usize) -> Option<f32> {
        let at = self.at(index);
        (self.state[at] & (BROKE | OPEN) == BROKE).then(|| self.until_s[at] - self.since_s[at])
    }

    /// When its film broke, s; `None` where it did not.
    pub fn broke_s(&self, index: usize) -> Option<f32> {
        let at = self.at(index);
        (self.state[at] & BROKE > 0).then_some(self.since_s[at])
    }

    /// Since when it has looked dry, though not long enough to count.
    pub fn looks_dry_since_s(&self, index: usize) -> Option<f32> {
        let at = self.at(index);
        (self.state[at] & (BROKE | INSIDE) == INSIDE && self.run[at] > 0).then_some(self.since_s[at])
    }
}

/// Weights as whole numbers that add up to [`LEVEL`].
fn whole_weights(weights: [f64; 3]) -> [u16; 3] {
    let sum: f64 = weights.iter().sum();
    let mut whole = weights.map(|weight| (weight / sum * f64::from(LEVEL)).floor() as u16);
    let heaviest = (0..3).fold(0, |best, i| if weights[i] > weights[best] { i } else { best });
    whole[heaviest] += LEVEL as u16 - whole.iter().sum::<u16>();
    whole
}
