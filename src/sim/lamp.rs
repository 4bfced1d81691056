//! The light over time: a drift of the lamp, its flicker, and a shadow that passes.
//!
//!     gain(u, v, t) = (1 + d sin(2π t / T)) (1 + f ξ_t) (1 − s p(x)),   p = smoothstep from 1 at |x| = w to 0 at |x| = w + e,
//! x is the distance across the shadow's band, which travels over the picture; d, f, s are set in the film's spec.

use super::film_spec::FilmSpec;
use super::noise::{RandomPurpose, Seed, smoothstep};
use rand::RngExt;
use std::f64::consts::TAU;

/// The lamp and the shadow that passes.
#[derive(Debug, Clone)]
pub(super) struct Lamp {
    drift: f64,
    period_s: f64,
    flicker: f64,
    shadow: Option<ShadowBand>,
    seed: Seed,
}

/// A band of shadow that travels across the picture.
#[derive(Debug, Clone, Copy)]
struct ShadowBand {
    share: f64,
    at_s: f64,
    across: [f64; 2],
    centre_px: [f64; 2],
    speed_px_s: f64,
    half_width_px: f64,
    edge_px: f64,
}

/// The light at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct LampLight {
    /// Gain of the whole picture.
    gain: f64,
    shadow: Option<(ShadowBand, f64)>,
}

impl Lamp {
    /// Draws the lamp from the seed. `centre_px` is the panel's middle in a picture of `width_px`.
    pub fn new(spec: &FilmSpec, seed: Seed, centre_px: [f64; 2], width_px: f64) -> Self {
        let mut random = seed.stream(RandomPurpose::Light, 0);
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let direction_rad = between(-0.5, 0.5);
        let shadow = ShadowBand {
            share: spec.shadow,
            at_s: spec.shadow_at_s,
            across: [direction_rad.cos(), direction_rad.sin()],
            centre_px,
            speed_px_s: width_px * between(0.08, 0.3),
            half_width_px: width_px * between(0.05, 0.12),
            edge_px: width_px * between(0.05, 0.1),
        };
        let sign = if between(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        Lamp {
            drift: sign * spec.drift,
            period_s: between(30.0, 120.0),
            flicker: spec.flicker,
            shadow: (spec.shadow > 0.0).then_some(shadow),
            seed,
        }
    }

    pub fn light_at(&self, time_s: f64) -> LampLight {
        let chance = self.seed.stream(RandomPurpose::Light, Seed::index_of(&[time_s])).random_range(-1.0..1.0);
        let drift = 1.0 + self.drift * (TAU * time_s / self.period_s).sin();
        let shadow = self.shadow.map(|shadow| (shadow, (time_s - shadow.at_s) * shadow.speed_px_s));
        LampLight { gain: drift * (1.0 + self.flicker * chance), shadow }
    }
}

impl LampLight {
    /// Returns the light on one pixel.
    pub fn gain(&self, column: usize, row: usize) -> f32 {
        let Some((shadow, come_px)) = self.shadow else { return self.gain as f32 };
        let (du, dv) = (column as f64 - shadow.centre_px[0], row as f64 - shadow.centre_px[1]);
        let away_px = (du * shadow.across[0] + dv * shadow.across[1] - come_px).abs() - shadow.half_width_px;
        let dark = shadow.share * (1.0 - smoothstep(away_px / shadow.edge_px));
        (self.gain * (1.0 - dark)) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: in the middle of a shadow of 0.3, the light is 0.7 of the light far from the shadow.
    #[test]
    fn a_shadow_passes_and_the_drift_keeps_its_bounds() {
        let spec = FilmSpec { drift: 0.15, shadow: 0.3, shadow_at_s: 10.0, ..FilmSpec::CALM_FILM };
        let lamp = Lamp::new(&spec, Seed(4), [900.0, 600.0], 1944.0);
        let lit = lamp.light_at(10.0);
        assert!((lit.gain(900, 600) / lit.gain(0, 600) - 0.7).abs() < 1e-6);
        let gains: Vec<f64> = (0..1_200).map(|i| lamp.light_at(f64::from(i) * 0.1).gain).collect();
        assert!(gains.iter().all(|gain| (0.849..1.151).contains(gain)));
        assert!(
            gains.iter().any(|gain| (gain - 1.0).abs() > 0.14) && (lamp.light_at(0.0).gain - 1.0).abs() < 1e-12
        );
    }
}
