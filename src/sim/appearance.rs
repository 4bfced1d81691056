//! The panel's colour: dark composite with a twill weave, darker under a film of water; and the flange camera's
//! pictures of the dry and of the wet panel.
//!
//! On the wet panel and beside its edge are drops. A drop is a disc that is darker, because it refracts the light away,
//! and has a bright glint at its upper side. Drops at the panel's edge extend beyond the edge by a fraction of their
//! radius.

use super::cast::{CastView, PixelHit};
use super::noise::{PixelNoise, RandomPurpose, STEPS_PER_GRAY_LEVEL, Seed, to_bytes};
use nalgebra::Vector3;
use panelprep_base::geometry::ColorPicture;
use rand::RngExt;
use rayon::prelude::*;

/// Grey levels of the dry panel under perpendicular light of the lamp, per channel.
const DRY_GRAY: [f64; 3] = [77.0, 72.0, 68.0];

/// Ratio of the brightness under a film of water to the dry brightness, per channel.
const FILM_FACTORS: [f64; 3] = [0.63, 0.60, 0.58];

/// Width of a tow of the weave, mm.
const TOW_MM: f64 = 2.0;
/// Relative difference in brightness between the yarns of the weave.
const WEAVE_CONTRAST: f64 = 0.05;

/// A colour in 1/128 grey levels.
pub(super) type FixedColor = [u16; 3];

/// Computes the colour of one pixel when dry and under a full film. The two colours are equal beside the panel.
pub(super) fn dry_and_wet(sight: &PixelHit) -> (FixedColor, FixedColor) {
    let background = sight.background.color;
    let Some((panel, share)) = sight.panel.map(|panel| (panel, panel.coverage)).filter(|(_, share)| *share > 0.0)
    else {
        let color = background.map(to_fixed_point);
        return (color, color);
    };
    let light =
        lamp_light(&panel.normal) * (1.0 + panel.appearance.weave * weave_brightness(panel.place, panel.pixel_mm));
    let mix = |channel: usize, film: f64| {
        let dry = DRY_GRAY[channel] * panel.appearance.albedo[channel] * light;
        to_fixed_point(share * dry * film + (1.0 - share) * background[channel])
    };
    let film = FILM_FACTORS.map(|left| left.powf(panel.appearance.film));
    ([0, 1, 2].map(|channel| mix(channel, 1.0)), [0, 1, 2].map(|channel| mix(channel, film[channel])))
}

fn to_fixed_point(gray: f64) -> u16 {
    (gray * f64::from(STEPS_PER_GRAY_LEVEL)).round() as u16
}

/// Computes the relative light of a wide lamp above the cameras: brightest where the panel's normal points to the lamp.
fn lamp_light(normal: &Vector3<f64>) -> f64 {
    let lamp = Vector3::new(-0.17, 0.38, 0.91);
    0.55 + 0.47 * normal.dot(&lamp)
}

/// Computes the relative brightness of the upper yarn in a 2 × 2 twill. The contrast of the pattern decreases to zero
/// if a pixel is as wide as a tow.
fn weave_brightness([s, t]: [f64; 2], pixel_mm: f64) -> f64 {
    let (i, j) = (s / TOW_MM, t / TOW_MM);
    let (column, row) = (i.floor(), j.floor());
    let warp_on_top = (column + row).rem_euclid(4.0) < 2.0;
    let across = 2.0 * (if warp_on_top { i - column } else { j - row }) - 1.0;
    let yarn = if warp_on_top { 0.7 } else { -0.7 } + 0.5 * (0.33 - across * across);
    let blur = 2.0 * pixel_mm / TOW_MM;
    WEAVE_CONTRAST * yarn / (1.0 + blur * blur)
}

/// Renders the flange camera's picture of the dry scene; `shot` is the seed of this picture.
pub(super) fn capture_dry(view: &CastView<'_>, pixels: &PixelNoise, shot: Seed) -> ColorPicture {
    let mut picture = ColorPicture::uniform(view.width(), view.height(), [0; 3]);
    picture.rgb.par_chunks_mut(view.width()).enumerate().for_each(|(row, colors)| {
        let noise = pixels.row(shot, row, colors.len());
        view.cast_row(row, |column, sight| {
            let (dry, _) = dry_and_wet(&sight);
            colors[column] = to_bytes(dry, noise, column);
        });
    });
    picture
}

/// Side of the square that contains the centre of one drop, mm.
const DROP_SQUARE_MM: f64 = 9.0;
/// Range of the radii of the drops, mm.
const DROP_RADII_MM: std::ops::Range<f64> = 0.4..2.2;
/// Ratio of the brightness in a drop to the brightness of the film.
const DROP_FACTOR: f64 = 0.75;
/// Grey level of a drop's glint.
const DROP_GLINT_GRAY: f64 = 235.0;
/// Maximum extent of a drop beyond the panel's edge, as a fraction of the drop's radius.
const MAX_DROP_OVERHANG: f64 = 0.35;

/// Renders the flange camera's picture of the wet scene; `shot` is the seed of this picture.
pub(super) fn capture_wet(view: &CastView<'_>, pixels: &PixelNoise, shot: Seed) -> ColorPicture {
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

/// Returns the colour of this pixel with a drop, if there is a drop at the pixel.
fn apply_drop(color: [u16; 3], sight: &PixelHit, shot: Seed) -> [u16; 3] {
    let Some(panel) = sight.panel else { return color };
    let cell = panel.place.map(|mm| (mm / DROP_SQUARE_MM).floor() as i64);
    for (i, j) in (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))) {
        let (column, row) = (cell[0] + i, cell[1] + j);
        let mut random = shot.stream(RandomPurpose::FlangePicture, Seed::index_of(&[column as f64, row as f64]));
        let radius_mm = random.random_range(DROP_RADII_MM);
        let centre = [column, row].map(|at| (at as f64 + random.random_range(0.0..1.0)) * DROP_SQUARE_MM);
        let (s, t) = ((panel.place[0] - centre[0]) / radius_mm, (panel.place[1] - centre[1]) / radius_mm);
        let beyond_mm = panel.edge_px * panel.pixel_mm;
        if s.hypot(t) > 1.0 || beyond_mm > MAX_DROP_OVERHANG * radius_mm {
            continue;
        }
        if (s + 0.25).hypot(t - 0.4) < 0.3 {
            return [(DROP_GLINT_GRAY * f64::from(STEPS_PER_GRAY_LEVEL)) as u16; 3];
        }
        return color.map(|channel| (f64::from(channel) * DROP_FACTOR) as u16);
    }
    color
}

#[cfg(test)]
mod tests {
    use super::super::cast::PanelHit;
    use super::super::sanding::Appearance;
    use super::*;
    use crate::scene::Background;

    fn sight(edge_px: f64) -> PixelHit {
        let panel = PanelHit {
            place: [1.0, 1.0],
            depth_mm: 700.0,
            cos_incidence: 1.0,
            normal: Vector3::z(),
            edge_px,
            coverage: (0.5 - edge_px).clamp(0.0, 1.0),
            pixel_mm: 0.4,
            appearance: Appearance::UNTREATED,
        };
        let background = Background { depth_mm: Some(800.0), cos_incidence: 1.0, color: [180.0; 3] };
        PixelHit { ray: Vector3::z(), panel: Some(panel), background }
    }

    /// A pixel centred on the edge shows the panel on half of its area. A pixel whose centre is a quarter of a pixel
    /// outside of the edge shows the panel on a quarter of its area.
    #[test]
    fn edge_pixels_are_mixed_by_their_covered_fraction() {
        let dry = |edge_px: f64| f64::from(dry_and_wet(&sight(edge_px)).0[0]);
        let (panel, plate) = (dry(-2.0), 180.0 * 128.0);
        assert!((dry(0.0) - (panel + plate) / 2.0).abs() < 1.0);
        assert!((dry(0.25) - (0.25 * panel + 0.75 * plate)).abs() < 1.0);
        assert!((dry(2.0) - plate).abs() < 1.0);
    }

    #[test]
    fn a_film_darkens_the_panel_by_more_than_a_third() {
        let (dry, wet) = dry_and_wet(&sight(-2.0));
        for channel in 0..3 {
            let left = f64::from(wet[channel]) / f64::from(dry[channel]);
            assert!((left - FILM_FACTORS[channel]).abs() < 1e-3, "{left}");
        }
        let gray = f64::from(dry[1]) / 128.0;
        assert!((55.0..80.0).contains(&gray), "{gray}");
    }
}
