//! The default method: models how each pixel looks dry and wet, and for how long it has looked dry.
//!
//! A film removes a fraction of the panel's brightness and keeps its pattern (it is multiplicative). Light multiplies the whole picture
//! and is smooth. A glint adds to it and moves. With the dry picture d of a pixel, the brightness is s = g τ d while its film is closed
//! and s = g d once it has broken. τ is one number for the panel and is estimated from the clip while the panel becomes wet
//! ([`wetting`], [`preparation`]); g ([`light`]) is estimated from each picture, by the pixels whose state is known. A pixel that looks dry
//! for long enough has been broken since it first did ([`judging`], row by row in a [`band`]).
//!
//! Where the first wet picture shows that the film does not remove one fraction everywhere, it is a mirror, and is judged as one
//! ([`mirror`]).
//!
//! Memory is fixed: about 22 bytes for each pixel of the window. The model does not know grids or verdicts.

mod answers;
mod band;
mod colour;
mod flicker;
mod judging;
mod kernel;
mod lamp;
mod light;
mod measurement;
mod mirror;
mod preparation;
mod region;
#[cfg(test)]
mod tests;
mod unseen;
mod wetting;

use super::footprint::Window;
use crate::geometry::ColorPicture;
use band::Band;
use colour::is_of_dry_colour;
use judging::{Past, Rule};
use kernel::{Adding, BLOCK_PX, BROKE, Block, CELL_PX, CELLS, INSIDE, LEVEL, NEW, OPEN, RUN, Sum};
use lamp::Lamp;
use light::{Light, TILE_PX};
pub use measurement::PictureMeasurement;
pub use mirror::Mirror;
use rayon::prelude::*;
use region::{HIDDEN_EVERY, LIGHT_EVERY, Region};
use std::ops::Range;
pub use wetting::FILM_ASSUMED;
use wetting::Wetting;

/// Of the film's light this is the most and the least, 1/1024 …
const WIDE_Q10: [u16; 2] = [512, 1331];
/// … and then what lies about the first mean.
const ABOUT: [f64; 2] = [0.86, 1.16];
/// Every nth row is used for the first mean: thousands of pixels remain.
const MEAN_EVERY: usize = 4;

/// Of the region's tiles more than this share that look neither wet nor dry in the first wet picture say that the film mirrors.
const MOST_ODD: f64 = 0.03;
/// … and so does more than this share of its cells that were never wet and are this far from their dry brightness.
const MOST_WRONG_DRY: f64 = 0.005;
const WRONG_DRY: f64 = 0.04;

/// More pictures than these are not counted.
pub const MOST_PICTURES: usize = u16::MAX as usize;

/// The pixels of a window over time.
#[derive(Debug)]
pub struct Model {
    window: Window,
    /// Blocks of a row, which are the columns of tiles, too.
    columns: usize,
    weights: [u16; 3],
    persist: u8,
    dry: Vec<Block>,
    brightness: Vec<Block>,
    before: Vec<Block>,
    /// State and run.
    kept: Vec<Block>,
    past: Vec<Past>,
    region: Region,
    light: Light,
    /// The light of the picture that was looked at last.
    next_light: Option<Light>,
    /// Of each tile the sum over the pictures of by how much it is brighter than the region's median, and their number.
    beyond: Vec<(f64, u32)>,
    wetting: Wetting,
    watching: bool,
    /// The last dry picture in its channels, and what lies around the panel in it.
    dry_rgb: Vec<[u8; 3]>,
    lamp: Lamp,
    /// By how much each channel of the lamp is brighter than when the panel was dry, where that is sure.
    tint: [f64; 3],
    /// Where the film mirrors, all of this instead.
    mirror: Option<Box<Mirror>>,
    /// The times of the pictures that were judged, s; the first stands for the beginning.
    times_s: Vec<f32>,
}

impl Model {
    /// A model of the window's pixels for which `inside` says so; `persist` pictures make a break.
    pub fn new(window: Window, inside: &[bool], channel_weights: [f64; 3], persist: u8) -> Self {
        let columns = window.width.div_ceil(TILE_PX);
        let tile_rows = window.height.div_ceil(TILE_PX);
        let blocks = columns * tile_rows * TILE_PX;
        let mut kept = vec![[0; BLOCK_PX]; blocks];
        for (index, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
            kept[index / window.width * columns + index % window.width / BLOCK_PX]
                [index % window.width % BLOCK_PX] = INSIDE | OPEN;
        }
        Model {
            window,
            columns,
            weights: whole_weights(channel_weights),
            persist,
            dry: vec![[0; BLOCK_PX]; blocks],
            brightness: vec![[0; BLOCK_PX]; blocks],
            before: vec![[0; BLOCK_PX]; blocks],
            region: Region::of(&kept, columns),
            kept,
            past: vec![Past::NONE; blocks],
            light: Light::even(columns, tile_rows),
            next_light: None,
            beyond: vec![(0.0, 0); columns * tile_rows],
            wetting: Wetting::new(blocks * BLOCK_PX),
            watching: false,
            dry_rgb: Vec::new(),
            lamp: Lamp::default(),
            tint: [1.0; 3],
            mirror: None,
            times_s: vec![0.0],
        }
    }

    /// Takes the brightness of a picture; whether it is bit-equal to the one before, and while it is at hand each tile's
    /// sums, as [`Model::sums`] has them.
    fn read(&mut self, picture: &ColorPicture, band_q10: [u16; 2]) -> (bool, Vec<Sum>) {
        std::mem::swap(&mut self.brightness, &mut self.before);
        let (window, weights, columns) = (self.window, self.weights, self.columns);
        let mut brightness = std::mem::take(&mut self.brightness);
        let tile_row = |(index, light): (usize, &mut [Block])| {
            let first = index * TILE_PX;
            let lines = light.chunks_mut(columns).take(window.height - first);
            for (line, out) in lines.enumerate() {
                let row = window.top + first + line;
                let pixels = &picture.rgb[row * picture.width + window.left..][..window.width];
                kernel::brightness(pixels, weights, &mut out.as_flattened_mut()[..window.width]);
            }
            (*light == self.before[first * columns..][..light.len()], self.sums_of(light, index, band_q10))
        };
        let rows: Vec<(bool, Vec<Sum>)> =
            brightness.par_chunks_mut(columns * TILE_PX).enumerate().map(tile_row).collect();
        self.brightness = brightness;
        (rows.iter().all(|(same, _)| *same), rows.into_iter().flat_map(|(_, sums)| sums).collect())
    }

    /// Looks at a picture of the wet panel, and judges nothing yet.
    pub fn look(&mut self, picture: &ColorPicture) -> PictureMeasurement {
        let lit = self.lamp.at(picture);
        if let Some(mirror) = &mut self.mirror {
            return mirror.look(picture, &lit);
        }
        let is_first = !self.watching;
        let (frozen, sums) = if self.watching {
            self.read(picture, WIDE_Q10)
        } else {
            self.begin(picture);
            // The first picture stands for the one before it.
            self.before.clone_from(&self.brightness);
            (false, self.sums(WIDE_Q10))
        };
        self.tint = lit.sure().unwrap_or([1.0; 3]);
        let around = lit.sure().map(|gains| self.lit_by(gains));
        let light = self.light.found(&sums, &self.region.inside, around);
        let look = PictureMeasurement {
            light: light.global,
            told: light.share,
            hidden: self.hidden_under(light.global),
            frozen,
            film_left: self.wetting.film,
            flicker_percent: lit.flicker_percent,
        };
        if is_first && self.is_mirror(&light, around) {
            let place = (self.window, self.columns);
            let wet = (picture, &lit);
            let mut mirror = Box::new(Mirror::new(place, &self.dry_rgb, &self.kept, self.persist, wet));
            let look = mirror.look(picture, &lit);
            self.mirror = Some(mirror);
            return look;
        }
        self.next_light = Some(light);
        look
    }

    /// The light in what is looked at, of a lamp whose channels are so bright.
    fn lit_by(&self, gains: [f64; 3]) -> f64 {
        (0..3).map(|i| f64::from(self.weights[i]) * gains[i]).sum::<f64>() / f64::from(LEVEL)
    }

    /// Whether the first wet picture shows places that are neither dry nor as much darker as the film makes the others.
    fn is_mirror(&self, light: &Light, around: Option<f64>) -> bool {
        let is_wrong = |lit: f64| self.wrong_dry_share(lit) > MOST_WRONG_DRY;
        self.has_dry() && (self.odd_share(light) > MOST_ODD || around.is_some_and(is_wrong))
    }

    /// The share of the region's cells that were wet in no picture and have not the dry brightness either: what no water
    /// wetted has it to a few percent.
    fn wrong_dry_share(&self, lit: f64) -> f64 {
        let gain = u64::from(light::q12(lit));
        let (mut wrong, mut cells) = (0, 0);
        let rows = self.kept.len() / self.columns;
        for (row, cell) in
            (0..rows / CELL_PX).flat_map(|row| (0..self.columns * CELLS).map(move |cell| (row, cell)))
        {
            let (mut inside, mut never_wet, mut found, mut expected) = (0, 0, 0, 0);
            for line in row * CELL_PX..(row + 1) * CELL_PX {
                let at = line * self.columns + cell / CELLS;
                for i in cell % CELLS * CELL_PX..(cell % CELLS + 1) * CELL_PX {
                    if self.kept[at][i] & INSIDE > 0 {
                        inside += 1;
                        if self.kept[at][i] & kernel::EVER_WET > 0 {
                            continue;
                        }
                        never_wet += 1;
                        found += u64::from(self.brightness[at][i] & kernel::BRIGHTNESS);
                        expected += u64::from(self.dry[at][i]) * gain / 4096;
                    }
                }
            }
            if inside >= CELL_PX * CELL_PX * 3 / 4 {
                cells += 1;
                let off = (found as f64 / expected.max(1) as f64 - 1.0).abs();
                // At the rim of a place that never wets pixels are in between.
                wrong += usize::from(never_wet * 10 >= inside * 9 && off > WRONG_DRY);
            }
        }
        wrong as f64 / cells.max(1) as f64
    }

    /// The share of the region's tiles of which most pixels look neither dry nor wet.
    fn odd_share(&self, light: &Light) -> f64 {
        let (film_q16, columns) = (self.film_q16(), self.columns);
        let (mut odd_tiles, mut tiles) = (0, 0);
        for tile_row in 0..self.kept.len() / columns / TILE_PX {
            let gains = light.blocks_q12(tile_row);
            for column in 0..columns {
                let (mut odd, mut all) = (0, 0);
                for row in (0..TILE_PX).step_by(LIGHT_EVERY) {
                    let at = (tile_row * TILE_PX + row) * columns + column;
                    let gain_q12 = &gains[row / CELL_PX * columns + column];
                    odd += kernel::odd(&self.brightness[at], &self.dry[at], &self.kept[at], gain_q12, film_q16);
                    all += self.kept[at].iter().filter(|kept| **kept & INSIDE > 0).count() as u32;
                }
                if all >= (TILE_PX * TILE_PX / LIGHT_EVERY / 4) as u32 {
                    tiles += 1;
                    odd_tiles += u32::from(2 * odd > all);
                }
            }
        }
        f64::from(odd_tiles) / f64::from(tiles.max(1))
    }

    /// The share of the region that is hidden under this light.
    fn hidden_under(&self, gain: f64) -> f64 {
        let gain_q12 = light::q12(gain);
        let hidden = |(row, inside): (usize, &Range<usize>)| {
            let part = row * self.columns + inside.start..row * self.columns + inside.end;
            let (light, dry, kept) = (&self.brightness[part.clone()], &self.dry[part.clone()], &self.kept[part]);
            kernel::hidden(light, dry, kept, gain_q12)
        };
        let hidden: u32 = self.region.rows.iter().enumerate().step_by(HIDDEN_EVERY).map(hidden).sum();
        f64::from(hidden) / f64::from(self.region.hidden_of.max(1))
    }

    /// Judges the picture that was looked at last. The pixels that broke now come back, as indices of the window.
    pub fn follow(&mut self, picture: &ColorPicture, since_wet_s: f64) -> Vec<usize> {
        if let Some(mirror) = &mut self.mirror {
            return mirror.follow(since_wet_s);
        }
        let Some(light) = self.next_light.take().filter(|_| self.times_s.len() < MOST_PICTURES) else {
            return Vec::new();
        };
        for ((sum, count), beyond) in self.beyond.iter_mut().zip(&light.beyond) {
            (*sum, *count) = (*sum + beyond.unwrap_or(0.0), *count + u32::from(beyond.is_some()));
        }
        let brighter = light.global / self.light.global.max(f64::MIN_POSITIVE);
        self.light = light;
        let now = self.times_s.len() as u16;
        self.times_s.push(since_wet_s as f32);
        let broke = self.judge(Rule {
            film_q16: self.film_q16(),
            persist: u16::from(self.persist),
            before: now - 1,
            now,
            brighter_q12: light::q12(brighter),
            notes: BROKE | NEW,
        });
        let (broke, mirrors): (Vec<usize>, Vec<usize>) =
            broke.into_iter().partition(|&index| self.has_dry_colour(picture, index));
        mirrors.into_iter().for_each(|index| self.take_back(index));
        broke
    }

    /// Whether a pixel of the window has the dry panel's colour; without a dry picture nobody knows better.
    fn has_dry_colour(&self, picture: &ColorPicture, index: usize) -> bool {
        let (row, column) = (index / self.window.width, index % self.window.width);
        let now = picture.rgb[(self.window.top + row) * picture.width + self.window.left + column];
        self.dry_rgb.get(index).is_none_or(|dry| is_of_dry_colour(now, *dry, self.tint))
    }

    /// What looks dry is a reflection: it did not break, and since it looks dry it has said nothing of its film. Its run stays one picture
    /// short, so that the next one is looked at as well.
    fn take_back(&mut self, index: usize) {
        let (block, at) = self.at(index);
        let now = self.times_s.len() as u16 - 1;
        let (kept, past) = (&mut self.kept[block][at], &mut self.past[block]);
        *kept = *kept & !(BROKE | NEW | OPEN | RUN) | (u16::from(self.persist) - 1);
        past.unseen[at] += 1;
        past.unseen_now[at] = now - past.since[at];
    }

    /// Each tile's sums, first over a wide band, then about their mean.
    fn sums(&self, band_q10: [u16; 2]) -> Vec<Sum> {
        let tile_rows = self.brightness.chunks(self.columns * TILE_PX).enumerate();
        tile_rows.flat_map(|(index, light)| self.sums_of(light, index, band_q10)).collect()
    }

    /// Those of one row of tiles.
    fn sums_of(&self, light: &[Block], tile_row: usize, band_q10: [u16; 2]) -> Vec<Sum> {
        let (stride, film_q16) = (self.columns, self.film_q16());
        let first = tile_row * TILE_PX * stride;
        let tile = |column: usize| {
            if self.region.inside[tile_row * stride + column] == 0 {
                return Sum::default();
            }
            let (light, dry, kept) = (&light[column..], &self.dry[first + column..], &self.kept[first + column..]);
            let add =
                |every, band_q10| kernel::add_up(light, dry, kept, Adding { stride, every, film_q16, band_q10 });
            let first = add(MEAN_EVERY, band_q10);
            if first.expected == 0 {
                return first;
            }
            let mean = f64::from(first.found) / f64::from(first.expected) * 1024.0;
            add(LIGHT_EVERY, ABOUT.map(|share| (share * mean) as u16))
        };
        (0..stride).map(tile).collect()
    }

    fn film_q16(&self) -> u16 {
        (self.wetting.film * 65_536.0).round() as u16
    }

    /// Judges every pixel; those that broke now come back.
    fn judge(&mut self, rule: Rule) -> Vec<usize> {
        let (columns, width) = (self.columns, self.window.width);
        let (lamp, watching) = (&self.light, self.watching);
        let size = columns * TILE_PX;
        let given =
            self.brightness.par_chunks(size).zip(self.before.par_chunks(size)).zip(self.dry.par_chunks(size));
        let over_time = self.kept.par_chunks_mut(size).zip(self.past.par_chunks_mut(size));
        let rows = given.zip(over_time).zip(self.region.rows.par_chunks(TILE_PX)).enumerate();
        let broke: Vec<Vec<usize>> = rows
            .map(|(index, ((((light, before), dry), (kept, past)), inside))| {
                let mut band = Band { columns, light, before, dry, kept, past, inside };
                let pixels = band.judge(lamp, index, rule, watching).into_iter();
                let stride = columns * BLOCK_PX;
                pixels.map(|at| (index * TILE_PX + at / stride) * width + at % stride).collect()
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
