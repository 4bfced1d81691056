//! The water film as the 3D camera's colour picture shows it: dry, sprayed, whole, breaking.
//!
//! What does not change is made once: the dry and the fully wet colour of each pixel, when water reaches it and when
//! its film breaks. A picture at time t then blends the two by w (1 + a r), with w the film's presence and r the run-off,
//! a streaky pattern that travels down the panel. A picture is a function of its time: any frame rate shows the same film.

use super::appearance::{Color, dry_and_wet};
use super::cast::View;
use super::noise::{PixelNoise, Purpose, Seed, ValueNoise, to_byte, to_bytes};
use super::runoff::Runoff;
use super::spots::Spot;
use crate::geometry::{ColorPicture, Mask};
use rayon::prelude::*;

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
/// How long a place takes to become wet, and its film to open, s.
const WETTING_S: f64 = 0.2;
const OPENING_S: f64 = 0.15;

/// A pixel of the panel.
#[derive(Debug, Clone, Copy)]
struct Wetted {
    wet: Color,
    wet_from_s: f32,
    /// Infinite where no grease is.
    breaks_at_s: f32,
    /// The share of this pixel that lies in the spot.
    greasy: f32,
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
    pixels: PixelNoise,
    seed: Seed,
}

impl Film {
    pub(super) fn new(view: &View<'_>, spots: &[Spot], pixels: &PixelNoise, seed: Seed) -> Self {
        let (width, height) = (view.width(), view.height());
        let front = ValueNoise::new(seed.stream(Purpose::Film, 0), 25.0, 260.0);
        let mut dry = vec![Color::default(); width * height];
        let mut rows = vec![Row::default(); height];
        dry.par_chunks_mut(width).zip(rows.par_iter_mut()).enumerate().for_each(|(index, (dry, row))| {
            view.look_along_row(index, |column, sight| {
                let (dry_color, wet) = dry_and_wet(&sight);
                dry[column] = dry_color;
                let Some(panel) = sight.panel.filter(|panel| panel.coverage > 0.0) else { return };
                if row.wetted.is_empty() {
                    row.first_column = column;
                }
                // Outlines are convex, so a row's pixels of the panel are neighbours; a gap would be dry.
                row.wetted.resize(column - row.first_column, Wetted { wet: dry_color, ..NEVER });
                let (breaks_at_s, greasy) = broken(spots, panel.place, panel.pixel_mm);
                let streak = Runoff::place(panel.place);
                row.wetted.push(Wetted {
                    wet,
                    wet_from_s: reached_s(&front, panel.place),
                    breaks_at_s,
                    greasy,
                    streak,
                });
            });
        });
        Film { width, height, dry, rows, runoff: Runoff::new(seed), pixels: pixels.clone(), seed }
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
        let seed = self.seed.child(Purpose::Film, Seed::index_of(&[time_s]));
        let drift = self.runoff.at(time_s);
        let time_s = time_s as f32;
        picture.rgb.par_chunks_mut(self.width).enumerate().for_each(|(index, pixels)| {
            let noise = self.pixels.row(seed, index, self.width);
            let dry = &self.dry[index * self.width..(index + 1) * self.width];
            let flat = pixels.as_flattened_mut().iter_mut().zip(dry.as_flattened()).zip(noise);
            flat.for_each(|((pixel, &color), &noise)| *pixel = to_byte(color, noise));
            let row = &self.rows[index];
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let column = row.first_column + offset;
                let film = wetted.film(time_s) * drift.thickness(wetted.streak);
                let color = std::array::from_fn(|channel| {
                    let (from, to) = (f32::from(dry[column][channel]), f32::from(wetted.wet[channel]));
                    (from + (to - from) * film) as u16
                });
                pixels[column] = to_bytes(color, noise, column);
            }
        });
        picture
    }

    /// Truth: the pixels whose film is broken at this time, s.
    pub fn broken(&self, time_s: f64) -> Mask {
        let mut mask = Mask::empty(self.width, self.height);
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let open = wetted.greasy >= 0.5 && f64::from(wetted.breaks_at_s) <= time_s;
                mask.inside[index * self.width + row.first_column + offset] = open;
            }
        }
        mask
    }
}

const NEVER: Wetted =
    Wetted { wet: [0; 3], wet_from_s: f32::INFINITY, breaks_at_s: f32::INFINITY, greasy: 0.0, streak: [0; 2] };

impl Wetted {
    /// How much of this pixel has its film at this time, 0…1.
    fn film(&self, time_s: f32) -> f32 {
        let reached = ((time_s - self.wet_from_s) / WETTING_S as f32).clamp(0.0, 1.0);
        let open = ((time_s - self.breaks_at_s) / OPENING_S as f32 + 0.5).clamp(0.0, 1.0);
        reached * (1.0 - self.greasy * open)
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

/// When the film breaks at a place, and which share of the pixel lies in a spot.
fn broken(spots: &[Spot], place: [f64; 2], pixel_mm: f64) -> (f32, f32) {
    for spot in spots {
        let [s, t] = spot.centre_mm();
        if (place[0] - s).hypot(place[1] - t) > spot.radius_mm() + 2.0 * pixel_mm {
            continue;
        }
        let (reached, left_mm) = spot.reach(place);
        let greasy = (0.5 + left_mm / pixel_mm).clamp(0.0, 1.0);
        if greasy > 0.0 {
            return (spot.breaks_s(reached) as f32, greasy as f32);
        }
    }
    (f32::INFINITY, 0.0)
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
