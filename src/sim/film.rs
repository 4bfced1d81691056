//! The water film as the 3D camera's colour picture shows it: dry, sprayed, whole, breaking.
//!
//! All that does not change is computed once: the dry and the fully wet colour of each pixel, and the effect of
//! water on it ([`super::wetting`]). A picture at time t then is
//!     exposure · light(t) · (bare + (wet − bare) w r (1 + n) + glints w) + noise,
//! with `bare` the colour of the place without a film: dry and dusty until water has reached it, washed afterwards.
//! w is the film's presence, r the run-off, a streaky pattern that travels down the panel, and n how much thicker
//! the new film is. A drop is thick film, also over a break, if water has reached the place. A picture is a
//! function of its time: any frame rate shows the same film.

use super::appearance::{Color, dry_and_wet};
use super::cast::View;
use super::film_defects::Spot;
use super::film_spec::FilmSpec;
use super::glints_droplets::{Ground, Spotted, Travellers};
use super::lamp::Lamp;
use super::noise::{PixelNoise, Purpose, Seed, ValueNoise, to_byte};
use super::runoff::Runoff;
use super::timing::{Phase, SPRAY_FROM_S, WET_FROM_S};
use super::wetting::{Colors, Water, Wetted};
use crate::geometry::{ColorPicture, Mask};
use rand::RngExt;
use rayon::prelude::*;
use std::ops::Range;

/// Time constant of the thinning of a new film, s.
const THINS_S: f64 = 12.0;
/// Additional darkening by a drop, compared with the film.
const DROP_THICKNESS: f32 = 1.2;

/// The pixels of one row that show the panel.
#[derive(Debug, Clone, Default)]
struct Row {
    first_column: usize,
    wetted: Vec<Wetted>,
}

/// A clip of one panel at one pose.
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

/// The grease and dust on the panel when its film begins.
#[derive(Debug, Clone, Copy)]
pub(super) struct OnPanel<'a> {
    /// The grease now.
    pub spots: &'a [Spot],
    /// The present and the earlier grease: each spot leaves a stain.
    pub stained: &'a [Spot],
    /// Whether water has already washed the dust off.
    pub washed: bool,
}

/// Dust lies in patches of this size, mm.
const DUST_MM: f64 = 18.0;

impl Film {
    pub(super) fn new(
        view: &View<'_>,
        OnPanel { spots, stained, washed }: OnPanel<'_>,
        spec: &FilmSpec,
        pixels: &PixelNoise,
        seed: Seed,
    ) -> Self {
        let (width, height) = (view.width(), view.height());
        let water = Water::new(spots, spec, seed);
        let stains = Stains::new(stained, spec, seed);
        let dust = ValueNoise::new(seed.stream(Purpose::Condition, 1_000), DUST_MM, 260.0);
        let most_dust = if washed { 0.0 } else { spec.dust };
        let mut dry = vec![Color::default(); width * height];
        let mut rows = vec![Row::default(); height];
        dry.par_chunks_mut(width).zip(rows.par_iter_mut()).enumerate().for_each(|(index, (dry, row))| {
            view.look_along_row(index, |column, sight| {
                let (dry_color, wet) = dry_and_wet(&sight);
                dry[column] = exposed(dry_color, spec.exposure);
                let Some(panel) = sight.panel.filter(|panel| panel.coverage > 0.0) else { return };
                // A pixel that shows the panel only in part changes only by that part.
                let stained = 1.0 + panel.coverage * (stains.at(panel.place) - 1.0);
                let dusty = 1.0 + panel.coverage * most_dust * dust.at(panel.place).clamp(-1.0, 1.0);
                let [washed, wet] = [dry_color, wet].map(|color| exposed(color, spec.exposure * stained));
                dry[column] = exposed(dry_color, spec.exposure * stained * dusty);
                let colors = Colors { wet, washed };
                if row.wetted.is_empty() {
                    row.first_column = column;
                }
                // Outlines are convex, so the panel's pixels in a row are neighbours; a gap would be dry.
                row.wetted.resize(column - row.first_column, Wetted::beside(washed));
                row.wetted.push(water.at(panel.place, panel.pixel_mm, colors));
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

    /// Returns the phase of the film at this time.
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

    /// Renders the picture of this time over an earlier one of this film, only around the panel. This is several
    /// times faster; beyond 16 px from the panel the earlier picture remains.
    ///
    /// # Panics
    /// If the picture has another size.
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
                let washed = wetted.reached(time_s as f32);
                let color = std::array::from_fn(|channel| {
                    let [dry, bare, wet] =
                        [dry[column], wetted.bare, wetted.wet].map(|color| f32::from(color[channel]));
                    let bare = dry + (bare - dry) * washed;
                    (bare + (wet - bare) * film + glint) * gain
                });
                pixels[column] = shown(color, noise, column);
            }
        });
    }

    /// Truth: the pixels with a film that has broken by this time, s, even if it closed again.
    pub fn broken(&self, time_s: f64) -> Mask {
        self.truth(|wetted| f64::from(wetted.breaks_at_s) <= time_s)
    }

    /// Truth: the pixels with a film that had broken by this time, s, and has closed since.
    pub fn closed(&self, time_s: f64) -> Mask {
        self.truth(|wetted| f64::from(wetted.closes_at_s) <= time_s)
    }

    fn truth(&self, holds: impl Fn(&Wetted) -> bool) -> Mask {
        let mut mask = Mask::empty(self.width, self.height);
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let open = wetted.is_greasy() && holds(wetted);
                mask.inside[index * self.width + row.first_column + offset] = open;
            }
        }
        mask
    }

    /// Returns the ground truth: the colours of each pixel, dry and under an unbroken film, grey levels. Both are
    /// equal beside the panel.
    pub fn dry_and_wet_levels(&self) -> Vec<[[f64; 3]; 2]> {
        let levels = |color: Color| color.map(|level| f64::from(level) / f64::from(super::noise::LEVEL));
        let mut both: Vec<[[f64; 3]; 2]> = self.dry.iter().map(|dry| [levels(*dry); 2]).collect();
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate() {
                both[index * self.width + row.first_column + offset][1] = levels(wetted.wet);
            }
        }
        both
    }

    /// Truth: when the film breaks at each pixel, s of the film, row by row; infinite if it holds.
    pub fn break_times_s(&self) -> Vec<f32> {
        let mut times_s = vec![f32::INFINITY; self.width * self.height];
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate().filter(|(_, wetted)| wetted.is_greasy()) {
                times_s[index * self.width + row.first_column + offset] = wetted.breaks_at_s;
            }
        }
        times_s
    }
}

/// Stains of grease on the panel, each with the factor of its brightness.
struct Stains<'a>(Vec<(&'a Spot, f64)>);

impl<'a> Stains<'a> {
    fn new(spots: &'a [Spot], spec: &FilmSpec, seed: Seed) -> Self {
        let factor = |(index, spot): (usize, &'a Spot)| {
            // A spot has the same stain in each film of a cell: the stain belongs to the spot.
            let [s, t] = spot.centre_mm();
            let mut random = seed.stream(Purpose::Condition, Seed::index_of(&[s, t]) ^ index as u64);
            (spot, 1.0 + spec.stain * random.random_range(-1.0..1.0))
        };
        Stains(spots.iter().enumerate().map(factor).collect())
    }

    fn at(&self, place: [f64; 2]) -> f64 {
        let factor = |(spot, factor): &(&Spot, f64)| {
            let [s, t] = spot.centre_mm();
            let is_near = (place[0] - s).hypot(place[1] - t) < spot.radius_mm();
            // A stain has a soft edge: it reaches its full strength at a tenth of the distance from the outline to the
            // centre.
            let share = if is_near { ((1.0 - spot.reach(place).0) / 0.1).clamp(0.0, 1.0) } else { 0.0 };
            1.0 + share * (factor - 1.0)
        };
        self.0.iter().map(factor).product()
    }
}

fn exposed(color: Color, exposure: f64) -> Color {
    color.map(|level| (f64::from(level) * exposure).round() as u16)
}

#[inline]
fn shown(color: [f32; 3], row_noise: &[i16], column: usize) -> [u8; 3] {
    std::array::from_fn(|channel| to_byte(color[channel] as u16, row_noise[3 * column + channel]))
}

/// Computes the light of glints and the coverage by drops on one row of the panel.
fn travelling(row: &Row, index: usize, glints: &[Spotted], drops: &[Spotted]) -> (Vec<f32>, Vec<f32>) {
    let (mut shine, mut covered) = (vec![0.0; row.wetted.len()], vec![0.0; row.wetted.len()]);
    glints.iter().for_each(|glint| glint.shine(index, row.first_column, &mut shine));
    drops.iter().for_each(|drop| drop.cover(index, row.first_column, &mut covered));
    (shine, covered)
}

/// The panel's extent in the picture.
fn ground(rows: &[Row], view: &View<'_>) -> Ground {
    let shown = || rows.iter().enumerate().filter(|(_, row)| !row.wetted.is_empty());
    let (top, bottom) = (shown().next().map_or(0, |row| row.0), shown().next_back().map_or(1, |row| row.0 + 1));
    let left = shown().map(|(_, row)| row.first_column).min().unwrap_or(0);
    let right = shown().map(|(_, row)| row.first_column + row.wetted.len()).max().unwrap_or(1).max(left + 1);
    // The panel is about 780 mm in front of the camera.
    let px_per_mm = view.focal_px() / 780.0;
    Ground { low_px: [left as f64, top as f64], high_px: [right as f64, bottom as f64], px_per_mm }
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
