//! The panel's appearance: dark composite with a twill weave, darker under a film of water.

use super::cast::PixelHit;
use super::noise::LEVEL;
use nalgebra::Vector3;

/// Grey levels of the dry panel under perpendicular light of the lamp.
const DRY: [f64; 3] = [77.0, 72.0, 68.0];

/// The share of the dry colour that remains under a film of water, by channel.
const FILM: [f64; 3] = [0.63, 0.60, 0.58];

/// Width of a tow of the weave, mm; `WEAVE_CONTRAST` is the difference in brightness of the yarns.
const TOW_MM: f64 = 2.0;
const WEAVE_CONTRAST: f64 = 0.05;

/// A colour in 1/128 grey levels.
pub(super) type FixedColor = [u16; 3];

/// Computes the colour of one pixel, dry and under a full film. Away from the panel both are the same.
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
        let dry = DRY[channel] * panel.appearance.albedo[channel] * light;
        to_fixed_point(share * dry * film + (1.0 - share) * background[channel])
    };
    let film = FILM.map(|left| left.powf(panel.appearance.film));
    ([0, 1, 2].map(|channel| mix(channel, 1.0)), [0, 1, 2].map(|channel| mix(channel, film[channel])))
}

fn to_fixed_point(gray: f64) -> u16 {
    (gray * f64::from(LEVEL)).round() as u16
}

/// Computes the light of a wide lamp above the cameras: brightest where the panel faces the lamp.
fn lamp_light(normal: &Vector3<f64>) -> f64 {
    let lamp = Vector3::new(-0.17, 0.38, 0.91);
    0.55 + 0.47 * normal.dot(&lamp)
}

/// Computes the relative brightness of the yarn on top in a 2 × 2 twill. The pattern fades if a pixel is as wide as a
/// tow.
fn weave_brightness([s, t]: [f64; 2], pixel_mm: f64) -> f64 {
    let (i, j) = (s / TOW_MM, t / TOW_MM);
    let (column, row) = (i.floor(), j.floor());
    let warp_on_top = (column + row).rem_euclid(4.0) < 2.0;
    let across = 2.0 * (if warp_on_top { i - column } else { j - row }) - 1.0;
    let yarn = if warp_on_top { 0.7 } else { -0.7 } + 0.5 * (0.33 - across * across);
    let blur = 2.0 * pixel_mm / TOW_MM;
    WEAVE_CONTRAST * yarn / (1.0 + blur * blur)
}

#[cfg(test)]
mod tests {
    use super::super::cast::PanelHit;
    use super::super::fixture::Background;
    use super::super::sanding::Appearance;
    use super::*;

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

    /// On the edge itself a pixel is half panel, half background; a quarter of a pixel outside the edge it is a
    /// quarter panel.
    #[test]
    fn edge_pixels_mix_by_their_share() {
        let dry = |edge_px: f64| f64::from(dry_and_wet(&sight(edge_px)).0[0]);
        let (panel, plate) = (dry(-2.0), 180.0 * 128.0);
        assert!((dry(0.0) - (panel + plate) / 2.0).abs() < 1.0);
        assert!((dry(0.25) - (0.25 * panel + 0.75 * plate)).abs() < 1.0);
        assert!((dry(2.0) - plate).abs() < 1.0);
    }

    #[test]
    fn a_film_darkens_by_a_third_and_more() {
        let (dry, wet) = dry_and_wet(&sight(-2.0));
        for channel in 0..3 {
            let left = f64::from(wet[channel]) / f64::from(dry[channel]);
            assert!((left - FILM[channel]).abs() < 1e-3, "{left}");
        }
        let gray = f64::from(dry[1]) / 128.0;
        assert!((55.0..80.0).contains(&gray), "{gray}");
    }
}
