//! The film as a mirror: where it does not darken the panel by one factor.
//!
//! On dark composite a whole film mirrors what is above it, and a place that broke is as dull as the dry panel. So the film is
//! darker or brighter than the dry panel, by place and by channel, or not at all different; it moves with the water's waves,
//! and nothing tells what it must look like. What a break looks like is known: as the dry picture has it, in the light of
//! now, and steadily. With the brightness s, the light taken out by what lies around the panel (`lamp`), and the dry d,
//!     dry    |s − d| ≤ b,  b = half of the contrast c within its bounds,       wet    beyond it, to either side,        (1)
//! and c the mean of |s − d| while it is wet, which forgets. What looks dry long enough has broken since it first did; only
//! where c told film from dry by then, at least [`MIN_CONTRAST`]. A place without it tells nothing, and no grid passes by it.
//!
//! s is one channel or their mean: in each tile the one that tells dry from wet best against its noise.

mod judging;

use super::kernel::{self, BLOCK_PX, BROKE, Block, EVER_WET, INSIDE, LEVEL, NEW, OPEN, RUN};
use super::lamp::Lit;
use super::light::TILE_PX;
use super::measurement::PictureMeasurement;
use super::unseen::was_seen;
use crate::geometry::ColorPicture;
use crate::inspect::footprint::Window;
use judging::MIN_CONTRAST;
use judging::{Past, Rule, judge};
use rayon::prelude::*;

/// Weights of the channels in what may be looked at, and how much less noise the mean of all has.
const VIEWS: [([f64; 3], f64); 4] = [
    ([1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0], 1.6),
    ([1.0, 0.0, 0.0], 1.0),
    ([0.0, 1.0, 0.0], 1.0),
    ([0.0, 0.0, 1.0], 1.0),
];
/// A difference beyond this says no more, levels.
const MOST_SAID: f64 = 40.0;
/// Darker and brighter than these a dry place tells nothing, levels.
const DRY_LEVELS: std::ops::Range<u8> = 4..250;
/// One row in so many says whether the picture is new and how much is overexposed.
const ROWS_EVERY: usize = 8;

/// The pixels of a window over time.
#[derive(Debug)]
pub struct Mirror {
    window: Window,
    /// Blocks of a row, which are the columns of tiles, too.
    columns: usize,
    persist: u8,
    /// What each tile looks at.
    views: Vec<usize>,
    dry: Vec<Block>,
    brightness: Vec<Block>,
    before: Vec<Block>,
    kept: Vec<Block>,
    past: Vec<Past>,
    times_s: Vec<f32>,
    gains: [f64; 3],
}

/// The rows of blocks of one row of tiles.
struct Band<'a> {
    tile_row: usize,
    light: &'a [Block],
    before: &'a [Block],
    dry: &'a [Block],
    kept: &'a mut [Block],
    past: &'a mut [Past],
}

impl Mirror {
    /// Begins with the dry picture's pixels of the window, those of the region, and the first wet picture.
    pub fn new(
        (window, columns): (Window, usize),
        dry_rgb: &[[u8; 3]],
        inside: &[Block],
        persist: u8,
        (wet, lit): (&ColorPicture, &Lit),
    ) -> Self {
        let blocks = inside.len();
        let mut mirror = Mirror {
            window,
            columns,
            persist,
            views: vec![0; blocks / TILE_PX],
            dry: vec![[0; BLOCK_PX]; blocks],
            brightness: vec![[0; BLOCK_PX]; blocks],
            before: vec![[0; BLOCK_PX]; blocks],
            kept: inside.iter().map(|block| block.map(|kept| kept & INSIDE)).collect(),
            past: vec![Past::NONE; blocks],
            times_s: vec![0.0],
            gains: lit.gains,
        };
        mirror.choose_views(dry_rgb, wet);
        for index in 0..dry_rgb.len() {
            let (block, at) = mirror.at(index);
            let view = mirror.views[mirror.tile_of(block)];
            let mut out = [0];
            kernel::brightness(&dry_rgb[index..=index], weights(view, [1.0; 3]), &mut out);
            mirror.dry[block][at] = out[0];
            if dry_rgb[index].iter().any(|level| !DRY_LEVELS.contains(level)) {
                mirror.kept[block][at] = 0;
            }
        }
        mirror.read(wet);
        mirror.before.clone_from(&mirror.brightness);
        let blocks = mirror.brightness.iter().zip(&mirror.dry).zip(&mut mirror.past);
        blocks.for_each(|((light, dry), past)| past.begin(light, dry));
        mirror
    }

    /// In each tile what tells the first wet picture best from the dry one.
    fn choose_views(&mut self, dry_rgb: &[[u8; 3]], wet: &ColorPicture) {
        let mut said = vec![[0.0_f64; VIEWS.len()]; self.views.len()];
        for index in (0..dry_rgb.len()).step_by(3) {
            let (block, at) = self.at(index);
            if self.kept[block][at] & INSIDE == 0 {
                continue;
            }
            let now = wet.rgb[self.in_picture(index, wet.width)];
            let change: [f64; 3] =
                std::array::from_fn(|i| f64::from(now[i]) / self.gains[i] - f64::from(dry_rgb[index][i]));
            let tile = self.tile_of(block);
            for (said, (weights, surer)) in said[tile].iter_mut().zip(VIEWS) {
                let change: f64 = (0..3).map(|i| weights[i] * change[i]).sum();
                *said += surer * change.abs().min(MOST_SAID);
            }
        }
        for (view, said) in self.views.iter_mut().zip(said) {
            *view = (0..VIEWS.len()).fold(0, |best, view| if said[view] > said[best] { view } else { best });
        }
    }

    fn read(&mut self, picture: &ColorPicture) {
        std::mem::swap(&mut self.brightness, &mut self.before);
        let (window, columns, gains) = (self.window, self.columns, self.gains);
        let weights: [[u16; 3]; VIEWS.len()] = std::array::from_fn(|view| weights(view, gains));
        let views = &self.views;
        self.brightness.par_chunks_mut(columns * TILE_PX).enumerate().for_each(|(tile_row, light)| {
            let first = tile_row * TILE_PX;
            for (line, out) in light.chunks_mut(columns).take(window.height - first).enumerate() {
                let row = window.top + first + line;
                let pixels = &picture.rgb[row * picture.width + window.left..][..window.width];
                for (column, (pixels, out)) in pixels.chunks(BLOCK_PX).zip(out).enumerate() {
                    kernel::brightness(pixels, weights[views[tile_row * columns + column]], out);
                }
            }
        });
    }

    /// Looks at a picture in this light, and judges nothing yet.
    pub fn look(&mut self, picture: &ColorPicture, lit: &Lit) -> PictureMeasurement {
        let same_light = lit.gains == self.gains;
        self.gains = lit.gains;
        self.read(picture);
        let rows = || (0..self.kept.len() / self.columns).step_by(ROWS_EVERY);
        let blocks = || rows().flat_map(|row| row * self.columns..(row + 1) * self.columns);
        let frozen = same_light && blocks().all(|at| self.brightness[at] == self.before[at]);
        let (mut hidden, mut all) = (0_u32, 0_u32);
        for at in blocks() {
            for (kept, light) in self.kept[at].iter().zip(&self.brightness[at]) {
                let inside = u32::from(kept & INSIDE > 0);
                all += inside;
                hidden += inside & u32::from(light & kernel::HIDDEN > 0);
            }
        }
        PictureMeasurement {
            light: lit.gains.iter().sum::<f64>() / 3.0,
            told: lit.agree,
            hidden: f64::from(hidden) / f64::from(all.max(1)),
            // The first picture stands for the one before it.
            frozen: frozen && self.times_s.len() > 1,
            film_left: super::FILM_ASSUMED,
            flicker_percent: lit.flicker_percent,
        }
    }

    /// Judges the picture that was looked at last; pixels that broke now come back, as indices of the window.
    pub fn follow(&mut self, since_wet_s: f64) -> Vec<usize> {
        let now = self.times_s.len() as u16;
        self.times_s.push(since_wet_s as f32);
        let rule = Rule { persist: u16::from(self.persist), before: now - 1, now };
        let (columns, width) = (self.columns, self.window.width);
        let size = columns * TILE_PX;
        let given =
            self.brightness.par_chunks(size).zip(self.before.par_chunks(size)).zip(self.dry.par_chunks(size));
        let rows = given.zip(self.kept.par_chunks_mut(size)).zip(self.past.par_chunks_mut(size)).enumerate();
        let broke: Vec<Vec<usize>> = rows
            .map(|(tile_row, ((((light, before), dry), kept), past))| {
                let blocks = Band { tile_row, light, before, dry, kept, past }.judge(rule).into_iter();
                let stride = columns * BLOCK_PX;
                blocks.map(|(row, at)| row * width + at % stride).collect()
            })
            .collect();
        broke.concat()
    }

    fn at(&self, index: usize) -> (usize, usize) {
        let (row, column) = (index / self.window.width, index % self.window.width);
        (row * self.columns + column / BLOCK_PX, column % BLOCK_PX)
    }

    fn tile_of(&self, block: usize) -> usize {
        block / self.columns / TILE_PX * self.columns + block % self.columns
    }

    fn in_picture(&self, index: usize, picture_width: usize) -> usize {
        let (row, column) = (index / self.window.width, index % self.window.width);
        (self.window.top + row) * picture_width + self.window.left + column
    }

    fn kept(&self, index: usize) -> u16 {
        let (block, at) = self.at(index);
        self.kept[block][at]
    }

    /// Whether a pixel of the window is looked at.
    pub fn sees(&self, index: usize) -> bool {
        self.kept(index) & INSIDE > 0
    }

    /// Whether it can still be told, as far as is known, whether its film holds: it broke, or film and dry differ.
    pub fn has_contrast(&self, index: usize) -> bool {
        let (block, at) = self.at(index);
        self.kept[block][at] & BROKE > 0 || self.past[block].contrast[at] >= MIN_CONTRAST
    }

    /// Whether it showed that it is wet or dry, and did so in half of the pictures and near the end.
    pub fn saw(&self, index: usize) -> bool {
        let (block, at) = self.at(index);
        self.sees(index)
            && self.has_contrast(index)
            && was_seen(self.past[block].unseen[at], self.past[block].unseen_now[at], &self.times_s)
    }

    /// Whether its film is open now.
    pub fn is_open(&self, index: usize) -> bool {
        self.kept(index) & OPEN > 0
    }

    /// Whether it was seen wet, or tells nothing of it.
    pub fn ever_wet(&self, index: usize) -> bool {
        self.kept(index) & EVER_WET > 0 || !self.has_contrast(index)
    }

    /// When its film broke, s.
    pub fn broke_s(&self, index: usize) -> Option<f32> {
        (self.kept(index) & BROKE > 0).then(|| self.since_s(index))
    }

    /// Since when it has looked dry, though not long enough to count.
    pub fn looks_dry_since_s(&self, index: usize) -> Option<f32> {
        let kept = self.kept(index);
        let looks_dry = kept & (BROKE | INSIDE) == INSIDE && kept & RUN > 0 && self.has_contrast(index);
        looks_dry.then(|| self.since_s(index))
    }

    /// How long its film was open, where it broke and closed again, s.
    pub fn was_open_s(&self, index: usize) -> Option<f32> {
        let (block, at) = self.at(index);
        let (past, time_s) = (&self.past[block], |picture: u16| self.times_s[usize::from(picture)]);
        (self.kept(index) & (BROKE | OPEN) == BROKE).then(|| time_s(past.until[at]) - time_s(past.since[at]))
    }

    /// How far from its dry brightness it was while it looked dry, levels.
    pub fn off_levels(&self, index: usize) -> f32 {
        let (block, at) = self.at(index);
        f32::from(self.past[block].off[at] as i16) / f32::from(LEVEL)
    }

    /// By how much film and dry differ there, levels.
    pub fn contrast_levels(&self, index: usize) -> f32 {
        let (block, at) = self.at(index);
        f32::from(self.past[block].contrast[at]) / f32::from(LEVEL)
    }

    fn since_s(&self, index: usize) -> f32 {
        let (block, at) = self.at(index);
        self.times_s[usize::from(self.past[block].since[at])]
    }

    /// How bright the region is when dry, in what is looked at, levels.
    pub fn mean_dry_levels(&self) -> f64 {
        let inside =
            self.kept.as_flattened().iter().zip(self.dry.as_flattened()).filter(|(kept, _)| **kept & INSIDE > 0);
        let (sum, count) = inside
            .fold((0_u64, 0_u64), |(sum, count), (_, dry)| (sum + u64::from(dry & !kernel::HIDDEN), count + 1));
        sum as f64 / count.max(1) as f64 / f64::from(LEVEL)
    }
}

impl Band<'_> {
    /// Judges its blocks; the pixels that broke now, by their row of the window and their place in the band.
    fn judge(self, rule: Rule) -> Vec<(usize, usize)> {
        let mut broke = Vec::new();
        let columns = self.light.len() / TILE_PX;
        for at in 0..self.light.len() {
            if self.kept[at].iter().all(|kept| kept & INSIDE == 0) {
                continue;
            }
            if judge(
                [&self.light[at], &self.before[at], &self.dry[at]],
                &mut self.kept[at],
                &mut self.past[at],
                rule,
            ) {
                let row = self.tile_row * TILE_PX + at / columns;
                let new = (0..BLOCK_PX).filter(|&i| self.kept[at][i] & NEW > 0);
                broke.extend(new.map(|i| (row, at * BLOCK_PX + i)));
            }
        }
        broke
    }
}

/// The weights of a view, in light that is so much brighter by channel: its brightness is as if the light were the dry picture's.
fn weights(view: usize, gains: [f64; 3]) -> [u16; 3] {
    std::array::from_fn(|i| (VIEWS[view].0[i] / gains[i] * f64::from(LEVEL)).round() as u16)
}
