//! The water film as the 3D camera's colour picture shows it: dry, sprayed, unbroken, breaking.
//!
//! Everything that does not change with time is computed once: the dry and the fully wet colour of each pixel, and the
//! effect of water on the pixel ([`super::wetting`]). A picture at time t then is
//!     exposure · light(t) · (bare + (wet − bare) w r (1 + n) + glints w) + noise,
//! with `bare` the colour without a film: dry and dusty until water has reached the pixel, washed afterwards. w is the
//! presence of the film, r the run-off, a streaky pattern that moves down the panel, and n the additional thickness of
//! a new film. A drop is thick film, also over a break if water has reached the pixel. A picture depends only on its
//! time, so that any frame rate shows the same film.

use super::appearance::{FixedColor, dry_and_wet};
use super::cast::CastView;
use super::film_defects::GreasySpot;
use super::film_spec::{FilmSpec, Lamp, PanelExtent, TravellingSpot, TravellingSpots};
use super::noise::{PixelNoise, RandomPurpose, Seed, ValueNoise, to_byte};
use super::wetting::{Phase, PixelColors, RunoffPattern, SPRAY_FROM_S, WET_FROM_S, Water, WetPixel};
use panelprep_base::geometry::{ColorPicture, Mask};
use rand::RngExt;
use rayon::prelude::*;
use std::ops::Range;

/// Time constant of the thinning of a new film, s.
const THINNING_TIME_S: f64 = 12.0;
/// Additional darkening by a drop, compared with the film.
const DROP_THICKNESS: f32 = 1.2;

/// The pixels of one row of the picture that show the panel.
#[derive(Debug, Clone, Default)]
struct Row {
    first_column: usize,
    wetted: Vec<WetPixel>,
}

/// The water film on one panel at one pose, from which pictures at any time are rendered.
#[derive(Debug, Clone)]
pub struct Film {
    width: usize,
    height: usize,
    dry: Vec<FixedColor>,
    rows: Vec<Row>,
    runoff: RunoffPattern,
    lamp: Lamp,
    glints: TravellingSpots,
    drops: TravellingSpots,
    spec: FilmSpec,
    pixels: PixelNoise,
    seed: Seed,
}

/// The grease and dust on the panel when its film begins.
#[derive(Debug, Clone, Copy)]
pub(super) struct PanelCondition<'a> {
    /// The greasy spots that are present.
    pub spots: &'a [GreasySpot],
    /// The present and the earlier greasy spots, each of which leaves a stain.
    pub stained: &'a [GreasySpot],
    /// Whether water has already washed the dust off.
    pub washed: bool,
}

/// Size of the patches of dust, mm.
const DUST_MM: f64 = 18.0;

impl Film {
    pub(super) fn new(
        view: &CastView<'_>,
        PanelCondition { spots, stained, washed }: PanelCondition<'_>,
        spec: &FilmSpec,
        pixels: &PixelNoise,
        seed: Seed,
    ) -> Self {
        let (width, height) = (view.width(), view.height());
        let water = Water::new(spots, spec, seed);
        let stains = GreaseStains::new(stained, spec, seed);
        let dust = ValueNoise::new(seed.stream(RandomPurpose::Condition, 1_000), DUST_MM, 260.0);
        let most_dust = if washed { 0.0 } else { spec.dust };
        let mut dry = vec![FixedColor::default(); width * height];
        let mut rows = vec![Row::default(); height];
        dry.par_chunks_mut(width).zip(rows.par_iter_mut()).enumerate().for_each(|(index, (dry, row))| {
            view.cast_row(index, |column, sight| {
                let (dry_color, wet) = dry_and_wet(&sight);
                dry[column] = apply_exposure(dry_color, spec.exposure);
                let Some(panel) = sight.panel.filter(|panel| panel.coverage > 0.0) else { return };
                // A pixel that the panel covers partly changes only in proportion to the covered fraction.
                let stained = 1.0 + panel.coverage * (stains.brightness_factor(panel.place) - 1.0);
                let dusty = 1.0 + panel.coverage * most_dust * dust.value_at(panel.place).clamp(-1.0, 1.0);
                let [washed, wet] = [dry_color, wet].map(|color| apply_exposure(color, spec.exposure * stained));
                dry[column] = apply_exposure(dry_color, spec.exposure * stained * dusty);
                let colors = PixelColors { wet, washed };
                if row.wetted.is_empty() {
                    row.first_column = column;
                }
                // Outlines are convex, so the panel's pixels in a row are contiguous. Pixels in a gap are rendered as
                // dry background.
                row.wetted.resize(column - row.first_column, WetPixel::background(washed));
                row.wetted.push(water.wetting_at(panel.place, panel.pixel_mm, colors));
            });
        });
        let ground = panel_extent(&rows, view);
        let centre_px = [0, 1].map(|axis| (ground.low_px[axis] + ground.high_px[axis]) / 2.0);
        Film {
            lamp: Lamp::new(spec, seed, centre_px, width as f64),
            glints: TravellingSpots::new(seed, RandomPurpose::Glints, spec.glints, ground),
            drops: TravellingSpots::new(seed, RandomPurpose::Drops, spec.drops, ground),
            spec: *spec,
            width,
            height,
            dry,
            rows,
            runoff: RunoffPattern::new(seed),
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

    /// Returns the picture captured at this time, s.
    pub fn picture(&self, time_s: f64) -> ColorPicture {
        let mut picture = ColorPicture::uniform(self.width, self.height, [0; 3]);
        self.render_rows(&mut picture, time_s, 0..self.height, 0..self.width);
        picture
    }

    /// Renders this film at another time into one of its pictures, only within 16 px of the panel. This is several
    /// times faster than a new picture; outside of this area the picture is unchanged.
    ///
    /// # Panics
    /// If the picture has another size than the film's pictures.
    pub fn renew(&self, picture: &mut ColorPicture, time_s: f64) {
        const MARGIN_PX: usize = 16;
        assert_eq!(
            (picture.width, picture.height),
            (self.width, self.height),
            "the picture must have the size \
            of this film's pictures"
        );
        let shown = || self.rows.iter().enumerate().filter(|(_, row)| !row.wetted.is_empty());
        let (Some((top, _)), Some((bottom, _))) = (shown().next(), shown().next_back()) else { return };
        let left = shown().map(|(_, row)| row.first_column).min().unwrap_or(0);
        let right = shown().map(|(_, row)| row.first_column + row.wetted.len()).max().unwrap_or(0);
        let span = |from: usize, to: usize, size: usize| from.saturating_sub(MARGIN_PX)..(to + MARGIN_PX).min(size);
        self.render_rows(picture, time_s, span(top, bottom + 1, self.height), span(left, right, self.width));
    }

    fn render_rows(&self, picture: &mut ColorPicture, time_s: f64, rows: Range<usize>, columns: Range<usize>) {
        let seed = self.seed.child(RandomPurpose::Film, Seed::index_of(&[time_s]));
        let lit = self.lamp.light_at(time_s);
        let (glints, drops) = (self.glints.at_time(time_s), self.drops.at_time(time_s));
        let drift = self.runoff.thickness_at(time_s);
        let new = self.spec.thinning * (-(time_s - WET_FROM_S).max(0.0) / THINNING_TIME_S).exp();
        let lines = picture.rgb[rows.start * self.width..rows.end * self.width].par_chunks_mut(self.width);
        lines.enumerate().for_each(|(line, pixels)| {
            let index = rows.start + line;
            let noise = self.pixels.row(seed, index, self.width);
            let dry = &self.dry[index * self.width..(index + 1) * self.width];
            let gains: Vec<f32> = columns.clone().map(|column| lit.gain(column, index)).collect();
            for (column, &gain) in columns.clone().zip(&gains) {
                pixels[column] = to_pixel(dry[column].map(|level| f32::from(level) * gain), noise, column);
            }
            let row = &self.rows[index];
            let (shine, covered) = travelling_effects(row, index, &glints, &drops);
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let column = row.first_column + offset;
                let thickness = drift.thickness(wetted.streak) * (1.0 + new as f32);
                let own = wetted.film(time_s as f32) * thickness;
                let drop = covered[offset] * wetted.wetted_fraction(time_s as f32);
                let film = own + drop * (DROP_THICKNESS - own).max(0.0);
                let gain = gains[column - columns.start];
                let glint = shine[offset] * film.min(1.0) * (self.spec.exposure * 128.0) as f32;
                let washed = wetted.wetted_fraction(time_s as f32);
                let color = std::array::from_fn(|channel| {
                    let [dry, bare, wet] =
                        [dry[column], wetted.bare, wetted.wet].map(|color| f32::from(color[channel]));
                    let bare = dry + (bare - dry) * washed;
                    (bare + (wet - bare) * film + glint) * gain
                });
                pixels[column] = to_pixel(color, noise, column);
            }
        });
    }

    /// Returns the ground truth: the pixels at which the film has broken by this time, s, even if it has closed again.
    pub fn broken_pixels(&self, time_s: f64) -> Mask {
        self.truth(|wetted| f64::from(wetted.breaks_at_s) <= time_s)
    }

    /// Returns the ground truth: the pixels at which the film has broken and closed again by this time, s.
    pub fn closed_pixels(&self, time_s: f64) -> Mask {
        self.truth(|wetted| f64::from(wetted.closes_at_s) <= time_s)
    }

    fn truth(&self, holds: impl Fn(&WetPixel) -> bool) -> Mask {
        let mut mask = Mask::all_outside(self.width, self.height);
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate() {
                let open = wetted.is_mostly_greasy() && holds(wetted);
                mask.inside[index * self.width + row.first_column + offset] = open;
            }
        }
        mask
    }

    /// Returns the ground truth: the colours of each pixel, dry and under an unbroken film, grey levels. The two
    /// colours are equal beside the panel.
    pub fn dry_and_wet_levels(&self) -> Vec<[[f64; 3]; 2]> {
        let levels =
            |color: FixedColor| color.map(|level| f64::from(level) / f64::from(super::noise::STEPS_PER_GRAY_LEVEL));
        let mut both: Vec<[[f64; 3]; 2]> = self.dry.iter().map(|dry| [levels(*dry); 2]).collect();
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate() {
                both[index * self.width + row.first_column + offset][1] = levels(wetted.wet);
            }
        }
        both
    }

    /// Returns the ground truth: the time at which the film breaks at each pixel, s from the start of the film, row by
    /// row; infinite if the film does not break.
    pub fn break_times_s(&self) -> Vec<f32> {
        let mut times_s = vec![f32::INFINITY; self.width * self.height];
        for (index, row) in self.rows.iter().enumerate() {
            for (offset, wetted) in row.wetted.iter().enumerate().filter(|(_, wetted)| wetted.is_mostly_greasy()) {
                times_s[index * self.width + row.first_column + offset] = wetted.breaks_at_s;
            }
        }
        times_s
    }
}

/// Stains of grease on the panel: each spot with the factor of its brightness.
struct GreaseStains<'a>(Vec<(&'a GreasySpot, f64)>);

impl<'a> GreaseStains<'a> {
    fn new(spots: &'a [GreasySpot], spec: &FilmSpec, seed: Seed) -> Self {
        let factor = |(index, spot): (usize, &'a GreasySpot)| {
            // The stain belongs to the spot: it is the same in each film of a cell.
            let [s, t] = spot.centre_mm();
            let mut random = seed.stream(RandomPurpose::Condition, Seed::index_of(&[s, t]) ^ index as u64);
            (spot, 1.0 + spec.stain * random.random_range(-1.0..1.0))
        };
        GreaseStains(spots.iter().enumerate().map(factor).collect())
    }

    fn brightness_factor(&self, place: [f64; 2]) -> f64 {
        let factor = |(spot, factor): &(&GreasySpot, f64)| {
            let [s, t] = spot.centre_mm();
            let is_near = (place[0] - s).hypot(place[1] - t) < spot.radius_mm();
            // A stain has a soft edge: it has its full strength from a tenth of the distance from the outline to the
            // centre.
            let share = if is_near { ((1.0 - spot.reach(place).0) / 0.1).clamp(0.0, 1.0) } else { 0.0 };
            1.0 + share * (factor - 1.0)
        };
        self.0.iter().map(factor).product()
    }
}

fn apply_exposure(color: FixedColor, exposure: f64) -> FixedColor {
    color.map(|level| (f64::from(level) * exposure).round() as u16)
}

#[inline]
fn to_pixel(color: [f32; 3], row_noise: &[i16], column: usize) -> [u8; 3] {
    std::array::from_fn(|channel| to_byte(color[channel] as u16, row_noise[3 * column + channel]))
}

/// Computes the light of the glints and the coverage by drops along one row of the panel.
fn travelling_effects(
    row: &Row,
    index: usize,
    glints: &[TravellingSpot],
    drops: &[TravellingSpot],
) -> (Vec<f32>, Vec<f32>) {
    let (mut shine, mut covered) = (vec![0.0; row.wetted.len()], vec![0.0; row.wetted.len()]);
    glints.iter().for_each(|glint| glint.add_glint_light(index, row.first_column, &mut shine));
    drops.iter().for_each(|drop| drop.drop_coverage(index, row.first_column, &mut covered));
    (shine, covered)
}

/// Returns the extent of the panel in the picture.
fn panel_extent(rows: &[Row], view: &CastView<'_>) -> PanelExtent {
    let shown = || rows.iter().enumerate().filter(|(_, row)| !row.wetted.is_empty());
    let (top, bottom) = (shown().next().map_or(0, |row| row.0), shown().next_back().map_or(1, |row| row.0 + 1));
    let left = shown().map(|(_, row)| row.first_column).min().unwrap_or(0);
    let right = shown().map(|(_, row)| row.first_column + row.wetted.len()).max().unwrap_or(1).max(left + 1);
    // The panel is about 780 mm in front of the camera.
    let px_per_mm = view.focal_px() / 780.0;
    PanelExtent { low_px: [left as f64, top as f64], high_px: [right as f64, bottom as f64], px_per_mm }
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
