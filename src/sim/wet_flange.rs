//! The wet panel in front of the flange camera: darker under its film, with drops on it and beside its edge.
//!
//! A drop is a disc: dark where it bends the light away, with a bright glint at its upper side. Drops on the
//! panel's edge hang over it by a part of their radius.

use super::appearance::dry_and_wet;
use super::cast::{CastView, PixelHit};
use super::noise::{LEVEL, PixelNoise, RandomPurpose, Seed, to_bytes};
use panelprep_base::geometry::ColorPicture;
use rand::RngExt;
use rayon::prelude::*;

/// Side of the square that contains one drop, mm; `RADII_MM` are the radii of the drops.
const SQUARE_MM: f64 = 9.0;
const RADII_MM: std::ops::Range<f64> = 0.4..2.2;
/// Share of the film's brightness that remains in a drop; `GLINT` is the grey level of the drop's glint.
const DARK: f64 = 0.75;
const GLINT: f64 = 235.0;
/// Largest extent of a drop beyond the panel's edge, as a share of the drop's radius.
const OVERHANG: f64 = 0.35;

/// Takes a picture of the wet scene; `shot` is its own seed.
pub(super) fn capture(view: &CastView<'_>, pixels: &PixelNoise, shot: Seed) -> ColorPicture {
    let mut picture = ColorPicture::uniform(view.width(), view.height(), [0; 3]);
    picture.rgb.par_chunks_mut(view.width()).enumerate().for_each(|(row, colors)| {
        let noise = pixels.row(shot, row, colors.len());
        view.cast_row(row, |column, sight| {
            let (_, wet) = dry_and_wet(&sight);
            colors[column] = to_bytes(apply_drop(wet, &sight, shot), noise, column);
        });
    });
    picture
}

/// Applies the drop at this pixel to the colour, if there is a drop.
fn apply_drop(color: [u16; 3], sight: &PixelHit, shot: Seed) -> [u16; 3] {
    let Some(panel) = sight.panel else { return color };
    let cell = panel.place.map(|mm| (mm / SQUARE_MM).floor() as i64);
    for (i, j) in (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))) {
        let (column, row) = (cell[0] + i, cell[1] + j);
        let mut random = shot.stream(RandomPurpose::FlangePicture, Seed::index_of(&[column as f64, row as f64]));
        let radius_mm = random.random_range(RADII_MM);
        let centre = [column, row].map(|at| (at as f64 + random.random_range(0.0..1.0)) * SQUARE_MM);
        let (s, t) = ((panel.place[0] - centre[0]) / radius_mm, (panel.place[1] - centre[1]) / radius_mm);
        let beyond_mm = panel.edge_px * panel.pixel_mm;
        if s.hypot(t) > 1.0 || beyond_mm > OVERHANG * radius_mm {
            continue;
        }
        if (s + 0.25).hypot(t - 0.4) < 0.3 {
            return [(GLINT * f64::from(LEVEL)) as u16; 3];
        }
        return color.map(|channel| (f64::from(channel) * DARK) as u16);
    }
    color
}
