//! The water film as the 3D camera's colour picture shows it: dry, sprayed, whole, breaking.
//!
//! What does not change is made once: the dry and the fully wet colour of each pixel, when water reaches it, when its
//! film breaks and when it closes. A picture at time t then is
//!     exposure · light(t) · (dry + (wet − dry) w r (1 + n) + glints w) + noise,
//! with w the film's presence, r the run-off, a streaky pattern that travels down the panel, and n how much thicker the
//! new film is; a drop is thick film, also over a break, where water has come. A picture is a function of its time: any
//! frame rate shows the same film.

use super::appearance::{Color, dry_and_wet};
use super::cast::View;
use super::film_spec::FilmSpec;
use super::lamp::Lamp;
use super::noise::{PixelNoise, Purpose, Seed, ValueNoise, to_byte};
use super::runoff::Runoff;
use super::spots::{Spot, SpotKind};
use super::travellers::{Ground, Spotted, Travellers};
use crate::geometry::{ColorPicture, Mask};
use rand::RngExt;
use rayon::prelude::*;
use std::ops::Range;

/// What happens to the panel at a time of the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Before the spray.
    Dry,
    /// Water runs down over the panel.
    Spray,
    /// The whole panel has been reached; the film is watched.
    Wet,
}

impl Phase {
    /// The word in `clip.csv`.
    pub fn word(self) -> &'static str {
        match self {
            Phase::Dry => "dry",
            Phase::Spray => "spray",
            Phase::Wet => "wet",
        }
    }
}

/// When the spray begins, s.
pub const SPRAY_FROM_S: f64 = 1.0;
/// When the panel is fully wet and its film is watched from, s.
pub const WET_FROM_S: f64 = 4.0;

/// How long the front takes from the panel's top to its bottom, s, and how unevenly it comes.
const FRONT_S: f64 = 2.3;
const FRONT_UNEVEN_S: f64 = 0.12;
/// How long a place takes to become wet, its film to open, and to close again, s.
const WETTING_S: f64 = 0.2;
const OPENING_S: f64 = 0.15;
const CLOSING_S: f64 = 0.4;
/// How fast the new film thins out, s.
const THINS_S: f64 = 12.0;
/// How much a drop darkens beyond the film.
const DROP_THICKNESS: f32 = 1.2;

/// A pixel of the panel.
#[derive(Debug, Clone, Copy)]
struct Wetted {
    wet: Color,
    wet_from_s: f32,
    /// Infinite where no grease is.
    breaks_at_s: f32,
    closes_at_s: f32,
    /// The share of this pixel that lies in the spot.
    greasy: f32,
    /// The share of it that a bead keeps wet when the film around it has broken.
    bead: f32,
    /// Column and row of the run-off pattern.
    streak: [u16; 2],
}

/// The pixels of one row that show the panel.
#[derive(Debug, Clone, Default)]
struct Row {
    first_column: usize,
    wetted: Vec<Wetted>,
}

/// A clip of one panel at one place.
#[derive(Debug, Clone)]
pub struct Film {
    width: usize,
    height: usize,
    dry: Vec<Color>,
    rows: Vec<Row>,
    runoff: Runoff,
    lamp: Lamp,
    glints: Travellers,
    drops: Travellers,
    spec: FilmSpec,
    pixels: PixelNoise,
    seed: Seed,
}

/// A place that stays wet in a break.
struct Bead {
    centre_mm: [f64; 2],
    radius_mm: f64,
}

impl Film {
    pub(super) fn new(view: &View<'_>, spots: &[Spot], spec: &FilmSpec, pixels: &PixelNoise, seed: Seed) -> Self {
        let (width, height) = (view.width(), view.height());
        let front = ValueNoise::new(seed.stream(Purpose::Film, 0), 25.0, 260.0);
        let beads: Vec<Vec<Bead>> =
            spots.iter().enumerate().map(|(index, spot)| beads(spot, index, spec, seed)).collect();
        let mut dry = vec![Color::default(); width * height];
        let mut rows = vec![Row::default(); height];
        dry.par_chunks_mut(width).zip(rows.par_iter_mut()).enumerate().for_each(|(index, (dry, row))| {
            view.look_along_row(index, |column, sight| {
                let (dry_color, wet) = dry_and_wet(&sight);
                let [dry_color, wet] = [dry_color, wet].map(|color| exposed(color, spec.exposure));
                dry[column] = dry_color;
                let Some(panel) = sight.panel.filter(|panel| panel.coverage > 0.0) else { return };
                if row.wetted.is_empty() {
                    row.first_column = column;
                }
                // Outlines are convex, so a row's pixels of the panel are neighbours; a gap would be dry.
                row.wetted.resize(column - row.first_column, Wetted { wet: dry_color, ..NEVER });
                let place = panel.place;
                let wetted =
                    Wetted { wet, wet_from_s: reached_s(&front, place), streak: Runoff::place(place), ..NEVER };
                row.wetted.push(broken(spots, &beads, (place, panel.pixel_mm), wetted));
            });
        });
        let ground = ground(&rows, view);
        let centre_px = [0, 1].map(|axis| (ground.low_px[axis] + ground.high_px[axis]) / 2.0);
        Film {
            lamp: Lamp::new(spec, seed, centre_px, width as f64),
            glints: Travellers::new(seed, Purpose::Glints, spec.glints, ground),
            drops: Travellers::new(seed, Purpose::Drops, spec.drops, ground),
            spec: *spec,
            width,
            height,
            dry,
            rows,
            runoff: Runoff::new(seed),
            pixels: pixels.clone(),
            seed,
        }
    }

    /// What happens at this time.
    pub fn phase(&self, time_s: f64) -> Phase {
        if time_s < SPRAY_FROM_S {
            Phase::Dry
        } else if time_s < WET_FROM_S {
            Phase::Spray
        } else {
            Phase::Wet
        }
    }

    /// The picture taken at this time, s.
    pub fn picture(&self, time_s: f64) -> ColorPicture {
        let mut picture = ColorPicture::filled(self.width, self.height, [0; 3]);
        self.expose(&mut picture, time_s, 0..self.height, 0..self.width);
        picture
    }

    /// Takes the picture of this time over an earlier one of this film, around the panel alone: several times faster,
    /// and beyond 16 px from the panel still the earlier picture.
    ///
    /// # Panics
    /// Where the picture is of another size.
    pub fn renew(&self, picture: &mut ColorPicture, time_s: f64) {
        const AROUND_PX: usize = 16;
        assert_eq!((picture.width, picture.height), (self.width, self.height), "a picture of this film");
        let shown = || self.rows.iter().enumerate().filter(|(_, row)| !row.wetted.is_empty());
        let (Some((top, _)), Some((bottom, _))) = (shown().next(), shown().next_back()) else { return };
        let left = shown().map(|(_, row)| row.first_column).min().unwrap_or(0);
        let right = shown().map(|(_, row)| row.first_column + row.wetted.len()).max().unwrap_or(0);
        let span = |from: usize, to: usize, size: usize| from.saturating_sub(AROUND_PX)..(to + AROUND_PX).min(size);
        self.expose(picture, time_s, span(top, bottom + 1, self.height), span(left, right, self.width));
    }

    fn expose(&self, picture: &mut ColorPicture, time_s: f64, rows: Range<usize>, columns: Range<usize>) {
        let seed = self.seed.child(Purpose::Film, Seed::index_of(&[time_s]));
        let lit = self.lamp.at(time_s);
        let (glints, drops) = (self.glints.at(time_s), self.drops.at(time_s));
        let drift = self.runoff.at(time_s);
        let new = self.spec.thinning * (-(time_s - WET_FROM_S).max(0.0) / THINS_S).exp();
        let lines = picture.rgb[rows.start * self.width..rows.end * self.width].par_chunks_mut(self.width);
        lines.enumerate().for_each(|(line, pixels)| {
            let index = rows.start + line;
            let noise = self.pixels.row(seed, index, self.width);
            let dry = &self.dry[index * self.width..(index + 1) * self.width];
            let gains: Vec<f32> = columns.clone().map(|column| lit.gain(column, index)).collect();
            for (column, &gain) in columns.clone().zip(&gains) {
                pixels[column] = shown(dry[column].map(|level| f32::from(level) * gain), noise, column);
            }
            let row = &self.rows[index];
            let (shine, covered) = travelling(row, index, &glints, &drops);
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let column = row.first_column + offset;
                let thickness = drift.thickness(wetted.streak) * (1.0 + new as f32);
                let own = wetted.film(time_s as f32) * thickness;
                let drop = covered[offset] * wetted.reached(time_s as f32);
                let film = own + drop * (DROP_THICKNESS - own).max(0.0);
                let gain = gains[column - columns.start];
                let glint = shine[offset] * film.min(1.0) * (self.spec.exposure * 128.0) as f32;
                let color = std::array::from_fn(|channel| {
                    let (from, to) = (f32::from(dry[column][channel]), f32::from(wetted.wet[channel]));
                    (from + (to - from) * film + glint) * gain
                });
                pixels[column] = shown(color, noise, column);
            }
        });
    }

    /// Truth: the pixels whose film has broken by this time, s, whether or not it closed again.
    pub fn broken(&self, time_s: f64) -> Mask {
        self.truth(|wetted| f64::from(wetted.breaks_at_s) <= time_s)
    }

    /// Truth: the pixels whose film had broken by this time, s, and has closed since.
    pub fn closed(&self, time_s: f64) -> Mask {
        self.truth(|wetted| f64::from(wetted.closes_at_s) <= time_s)
    }

    fn truth(&self, holds: impl Fn(&Wetted) -> bool) -> Mask {
        let mut mask = Mask::empty(self.width, self.height);
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let open = wetted.greasy >= 0.5 && holds(wetted);
                mask.inside[index * self.width + row.first_column + offset] = open;
            }
        }
        mask
    }

    /// Truth: when the film breaks at each pixel, s of the film, row by row; infinite where it holds.
    pub fn break_times_s(&self) -> Vec<f32> {
        let mut times_s = vec![f32::INFINITY; self.width * self.height];
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate().filter(|(_, wetted)| wetted.greasy >= 0.5) {
                times_s[index * self.width + row.first_column + offset] = wetted.breaks_at_s;
            }
        }
        times_s
    }
}

const NEVER: Wetted = Wetted {
    wet: [0; 3],
    wet_from_s: f32::INFINITY,
    breaks_at_s: f32::INFINITY,
    closes_at_s: f32::INFINITY,
    greasy: 0.0,
    bead: 0.0,
    streak: [0; 2],
};

fn exposed(color: Color, exposure: f64) -> Color {
    color.map(|level| (f64::from(level) * exposure).round() as u16)
}

#[inline]
fn shown(color: [f32; 3], row_noise: &[i16], column: usize) -> [u8; 3] {
    std::array::from_fn(|channel| to_byte(color[channel] as u16, row_noise[3 * column + channel]))
}

/// The light of glints and the cover of drops on one row of the panel.
fn travelling(row: &Row, index: usize, glints: &[Spotted], drops: &[Spotted]) -> (Vec<f32>, Vec<f32>) {
    let (mut shine, mut covered) = (vec![0.0; row.wetted.len()], vec![0.0; row.wetted.len()]);
    glints.iter().for_each(|glint| glint.shine(index, row.first_column, &mut shine));
    drops.iter().for_each(|drop| drop.cover(index, row.first_column, &mut covered));
    (shine, covered)
}

/// Where the panel is in the picture.
fn ground(rows: &[Row], view: &View<'_>) -> Ground {
    let shown = || rows.iter().enumerate().filter(|(_, row)| !row.wetted.is_empty());
    let (top, bottom) = (shown().next().map_or(0, |row| row.0), shown().next_back().map_or(1, |row| row.0 + 1));
    let left = shown().map(|(_, row)| row.first_column).min().unwrap_or(0);
    let right = shown().map(|(_, row)| row.first_column + row.wetted.len()).max().unwrap_or(1).max(left + 1);
    // The panel stands 780 mm before the camera, more or less.
    let px_per_mm = view.focal_px() / 780.0;
    Ground { low_px: [left as f64, top as f64], high_px: [right as f64, bottom as f64], px_per_mm }
}

fn beads(spot: &Spot, index: usize, spec: &FilmSpec, seed: Seed) -> Vec<Bead> {
    let mut random = seed.stream(Purpose::Drops, 1_000_000 + index as u64);
    let [s, t] = spot.centre_mm();
    let reach_mm = 0.7 * spot.least_radius_mm();
    let bead = |_| {
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let (away_mm, angle_rad) = (reach_mm * between(0.0, 1.0).sqrt(), between(0.0, std::f64::consts::TAU));
        Bead {
            centre_mm: [s + away_mm * angle_rad.cos(), t + away_mm * angle_rad.sin()],
            radius_mm: between(0.4, 1.2).min(0.25 * reach_mm),
        }
    };
    (0..spec.beads).map(bead).collect()
}

impl Wetted {
    /// How far water has come over this pixel at this time, 0…1.
    fn reached(&self, time_s: f32) -> f32 {
        ((time_s - self.wet_from_s) / WETTING_S as f32).clamp(0.0, 1.0)
    }

    /// How much of this pixel has its film at this time, 0…1.
    fn film(&self, time_s: f32) -> f32 {
        let reached = self.reached(time_s);
        let open = ((time_s - self.breaks_at_s) / OPENING_S as f32 + 0.5).clamp(0.0, 1.0);
        let closed = ((time_s - self.closes_at_s) / CLOSING_S as f32).clamp(0.0, 1.0);
        reached * (1.0 - self.greasy * (1.0 - self.bead) * open * (1.0 - closed))
    }
}

/// When the spray's front comes to a place, s.
fn reached_s(front: &ValueNoise, place: [f64; 2]) -> f32 {
    const TOP_MM: f64 = 130.0;
    const HEIGHT_MM: f64 = 260.0;
    let down = ((TOP_MM - place[1]) / HEIGHT_MM).clamp(0.0, 1.0);
    let uneven = (FRONT_UNEVEN_S * front.at(place)).clamp(-0.3, 0.3);
    (SPRAY_FROM_S + 0.35 + FRONT_S * down + uneven - WETTING_S / 2.0) as f32
}

/// The pixel with when its film breaks and closes, and which share of it lies in a spot.
fn broken(spots: &[Spot], beads: &[Vec<Bead>], (place, pixel_mm): ([f64; 2], f64), wetted: Wetted) -> Wetted {
    let away_mm = |[s, t]: [f64; 2]| (place[0] - s).hypot(place[1] - t);
    for (spot, beads) in spots.iter().zip(beads) {
        if away_mm(spot.centre_mm()) > spot.radius_mm() + 2.0 * pixel_mm {
            continue;
        }
        let (reached, left_mm) = spot.reach(place);
        let greasy = (0.5 + left_mm / pixel_mm).clamp(0.0, 1.0);
        if greasy > 0.0 {
            let share = |bead: &Bead| (0.5 + (bead.radius_mm - away_mm(bead.centre_mm)) / pixel_mm).clamp(0.0, 1.0);
            let bead = beads.iter().map(share).fold(0.0, f64::max);
            return Wetted {
                breaks_at_s: spot.breaks_where_wet_s(reached, f64::from(wetted.wet_from_s)) as f32,
                closes_at_s: spot.closes_at_s as f32,
                greasy: greasy as f32,
                // Where water never stays no bead does.
                bead: if spot.kind == SpotKind::NeverWets { 0.0 } else { bead as f32 },
                ..wetted
            };
        }
    }
    wetted
}

#[cfg(test)]
mod tests {
    use super::super::{Cell, Scene};
    use super::*;

    #[test]
    fn the_film_is_whole_when_the_spray_ends() {
        for seed in 0..5 {
            let film = Cell::new(seed, Scene::Good, 8).film();
            let wetted = || film.rows.iter().flat_map(|row| &row.wetted);
            assert!(wetted().count() > 3_000);
            let least = |time_s: f32| wetted().map(|pixel| pixel.film(time_s)).fold(f32::INFINITY, f32::min);
            assert!((least(WET_FROM_S as f32) - 1.0).abs() < 1e-6, "seed {seed}: {}", least(WET_FROM_S as f32));
            assert!(least(3.0) < 1e-6, "the front is still on its way");
            assert!(wetted().all(|pixel| pixel.film(SPRAY_FROM_S as f32) < 1e-6));
        }
    }
}
