//! The default method: what each pixel looks like dry and wet, and for how long it has looked so.
//!
//! A film takes a part of the panel's brightness and keeps its pattern (it is multiplicative), light multiplies all of it
//! and is smooth, a glint adds to it and moves on. So with the dry picture d of a pixel, s = g τ d while its film holds
//! and s = g d when it has broken; τ, one number for the panel, is read from the clip where the panel becomes wet
//! ([`wetting`]), and g ([`light`]) from each picture, by the pixels whose state is known. What looks dry long enough has
//! broken since it first did ([`judging`], row by row in a [`band`]).
//!
//! Memory is fixed: some 20 bytes for each pixel of the window. Does not know grids or verdicts.

mod answers;
mod band;
mod judging;
mod kernel;
mod light;
mod wetting;

use super::footprint::Window;
use crate::geometry::ColorPicture;
use band::Band;
use judging::{OverTime, Rule};
use kernel::{Adding, BROKE, INSIDE, LEVEL, NEW, OPEN, Sum};
use light::{Light, TILE_PX};
use rayon::prelude::*;
use wetting::Wetting;

/// Of the film's light this is the most and the least, 1/1024 …
const WIDE_Q10: [u16; 2] = [512, 1331];
/// … and then what lies about the first mean.
const ABOUT: [f64; 2] = [0.86, 1.16];
/// One row in so many tells the first mean, the light, and how much is hidden: thousands of pixels are left.
const MEAN_EVERY: usize = 4;
const LIGHT_EVERY: usize = 2;
const HIDDEN_EVERY: usize = 4;

/// More pictures than these are not counted.
pub const MOST_PICTURES: usize = u16::MAX as usize;

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
    dry: Vec<u16>,
    brightness: Vec<u16>,
    before: Vec<u16>,
    kept: Vec<u16>,
    since: Vec<u16>,
    until: Vec<u16>,
    off: Vec<i16>,
    unseen: Vec<u16>,
    /// Of each tile the region's pixels in the rows that tell the light.
    inside: Vec<u32>,
    light: Light,
    next_light: Option<Light>,
    wetting: Wetting,
    watching: bool,
    /// The times of the pictures that were judged, s; the first stands for the beginning.
    times_s: Vec<f32>,
}

impl Model {
    /// A model of the window's pixels for which `inside` says so; `persist` pictures make a break.
    pub fn new(window: Window, inside: &[bool], channel_weights: [f64; 3], persist: u8) -> Self {
        let columns = window.width.div_ceil(TILE_PX);
        let tile_rows = window.height.div_ceil(TILE_PX);
        let (stride, pixels) = (columns * TILE_PX, columns * tile_rows * TILE_PX * TILE_PX);
        let mut kept = vec![0; pixels];
        for (index, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
            kept[index / window.width * stride + index % window.width] = INSIDE | OPEN;
        }
        let mut model = Model {
            window,
            stride,
            tile_rows,
            weights: whole_weights(channel_weights),
            persist,
            dry: vec![0; pixels],
            brightness: vec![0; pixels],
            before: vec![0; pixels],
            kept,
            since: vec![0; pixels],
            until: vec![0; pixels],
            off: vec![0; pixels],
            unseen: vec![0; pixels],
            inside: Vec::new(),
            light: Light::even(columns, tile_rows),
            next_light: None,
            wetting: Wetting::new(pixels),
            watching: false,
            times_s: vec![0.0],
        };
        model.count_inside();
        model
    }

    fn count_inside(&mut self) {
        let columns = self.stride / TILE_PX;
        let (kept, stride) = (&self.kept, self.stride);
        let count = |tile: usize| {
            let (left, top) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
            let row =
                |row: usize| kept[row * stride + left..][..TILE_PX].iter().filter(|s| **s & INSIDE > 0).count();
            (top..top + TILE_PX).step_by(LIGHT_EVERY).map(row).sum::<usize>() as u32
        };
        self.inside = (0..columns * self.tile_rows).map(count).collect();
    }

    /// Takes the brightness of a picture; whether it is bit-equal to the one before.
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

    /// Looks at a picture of the wet panel, and judges nothing yet.
    pub fn look(&mut self, picture: &ColorPicture) -> Look {
        let frozen = self.read(picture) && self.watching;
        if !self.watching {
            self.begin();
            // The first picture stands for the one before it.
            self.before.clone_from(&self.brightness);
        }
        let light = self.light.found(&self.sums(WIDE_Q10), &self.inside);
        let look = Look { light: light.global, told: light.share, hidden: self.hidden_under(light.global), frozen };
        self.next_light = Some(light);
        look
    }

    /// The share of the region that is hidden under this light.
    fn hidden_under(&self, gain: f64) -> f64 {
        let gain_q12 = light::q12(gain);
        let rows = self
            .brightness
            .chunks(self.stride)
            .zip(self.dry.chunks(self.stride))
            .zip(self.kept.chunks(self.stride));
        let (mut hidden, mut all) = (0, 0);
        for ((light, dry), kept) in rows.step_by(HIDDEN_EVERY) {
            hidden += kernel::hidden(light, dry, kept, gain_q12);
            all += kernel::inside(kept);
        }
        f64::from(hidden) / f64::from(all.max(1))
    }

    /// Judges the picture that was looked at last. The pixels that broke now come back, as indices of the window.
    pub fn follow(&mut self, since_wet_s: f64) -> Vec<usize> {
        let Some(light) = self.next_light.take().filter(|_| self.times_s.len() < MOST_PICTURES) else {
            return Vec::new();
        };
        let brighter = light.global / self.light.global.max(f64::MIN_POSITIVE);
        self.light = light;
        let now = self.times_s.len() as u16;
        self.times_s.push(since_wet_s as f32);
        self.judge(Rule {
            film_q16: self.film_q16(),
            persist: u16::from(self.persist),
            before: now - 1,
            now,
            brighter_q12: light::q12(brighter),
            notes: BROKE | NEW,
        })
    }

    /// Each tile's sums, first over a wide band, then about their mean.
    fn sums(&self, band_q10: [u16; 2]) -> Vec<Sum> {
        let (stride, columns, film_q16) = (self.stride, self.stride / TILE_PX, self.film_q16());
        let tile = |index: usize| {
            let at = index / columns * TILE_PX * stride + index % columns * TILE_PX;
            let part = at..at + (TILE_PX - 1) * stride + TILE_PX;
            let (light, dry, kept) = (&self.brightness[part.clone()], &self.dry[part.clone()], &self.kept[part]);
            let add =
                |every, band_q10| kernel::add_up(light, dry, kept, Adding { stride, every, film_q16, band_q10 });
            let first = add(MEAN_EVERY, band_q10);
            if first.expected == 0 {
                return first;
            }
            let mean = f64::from(first.found) / f64::from(first.expected) * 1024.0;
            add(LIGHT_EVERY, ABOUT.map(|share| (share * mean) as u16))
        };
        (0..self.inside.len()).into_par_iter().with_min_len(columns).map(tile).collect()
    }

    fn film_q16(&self) -> u16 {
        (self.wetting.film * 65_536.0).round() as u16
    }

    /// Judges every pixel; those that broke now come back.
    fn judge(&mut self, rule: Rule) -> Vec<usize> {
        let (stride, window) = (self.stride, self.window);
        let band = stride * TILE_PX;
        let (lamp, watching) = (&self.light, self.watching);
        let given =
            self.brightness.par_chunks(band).zip(self.before.par_chunks(band)).zip(self.dry.par_chunks(band));
        let kept = self.kept.par_chunks_mut(band).zip(self.unseen.par_chunks_mut(band));
        let times = self.since.par_chunks_mut(band).zip(self.until.par_chunks_mut(band));
        let rows = given.zip(kept).zip(times.zip(self.off.par_chunks_mut(band))).enumerate();
        let broke: Vec<Vec<usize>> = rows
            .map(|(index, ((((light, before), dry), (kept, unseen)), ((since, until), off)))| {
                let over_time = OverTime { kept, since, until, off, unseen };
                let mut broke = Vec::new();
                Band { light, before, dry, over_time }.judge(lamp, (index, stride), rule, watching, |at| {
                    let (row, column) = (index * TILE_PX + at / stride, at % stride);
                    broke.push(row * window.width + column);
                });
                broke
            })
            .collect();
        broke.concat()
    }
}

/// Weights as whole numbers that add up to [`LEVEL`].
fn whole_weights(weights: [f64; 3]) -> [u16; 3] {
    let sum: f64 = weights.iter().sum();
    let mut whole = weights.map(|weight| (weight / sum * f64::from(LEVEL)).floor() as u16);
    let heaviest = (0..3).fold(0, |best, i| if weights[i] > weights[best] { i } else { best });
    whole[heaviest] += LEVEL - whole.iter().sum::<u16>();
    whole
}
