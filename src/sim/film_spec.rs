//! Disturbances in the pictures of a film: varying light, glints, drops, exposure.
//!
//! The light varies over time: a drift of the lamp, its flicker, and a shadow that passes.
//!     gain(u, v, t) = (1 + d sin(2π t / T)) (1 + f ξ_t) (1 − s p(x)),   p = smoothstep from 1 at |x| = w to 0 at |x| = w + e.
//! x is the distance from the centre line of the shadow's band, which moves across the picture; the film's spec
//! contains d, f and s.
//!
//! Glints, which add light, and drops, which are thick film that runs down, move over the film. Each exists for a
//! limited time and then appears at another position; its position depends only on the time. Its speed varies
//! periodically: x(t) = x₀ + v (t + b sin(ω t)/ω), b < 1.

use super::noise::{RandomPurpose, Seed, smoothstep};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// The difficulty of a film for its evaluation. All random values are drawn from the film's seed; the fields are their
/// limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilmSpec {
    /// Brightness factor of the whole picture; with 1, the dry panel has about 72 grey levels.
    pub exposure: f64,
    /// Maximum drift of the lamp from its initial light, up or down, as a fraction.
    pub drift: f64,
    /// Maximum flicker of the lamp from picture to picture, as a fraction of its light.
    pub flicker: f64,
    /// Fraction of the light that a passing shadow with soft edges removes; 0 is no shadow.
    pub shadow: f64,
    /// Time at which the shadow's centre line passes the panel's centre, s.
    pub shadow_at_s: f64,
    /// Number of glints that move over the film at any time.
    pub glints: usize,
    /// Number of drops that run down the panel at any time.
    pub drops: usize,
    /// Number of beads of water that remain on each spot with a broken film.
    pub beads: usize,
    /// Additional darkening by a new film compared with an old film, as a fraction.
    pub thinning: f64,
    /// Minimum brightness of a spot with a broken film, as a fraction of its dry brightness: 1 is completely dry.
    pub damp: f64,
    /// Number of droplets per 100 mm² that remain on a spot with a broken film.
    pub droplets: f64,
    /// Maximum relative change of the brightness by dust, which the first water washes off.
    pub dust: f64,
    /// Maximum relative change of the brightness of a spot, darker or lighter, by the stain of its grease. The stain is
    /// visible dry and wet, and also after the grease was sanded off.
    pub stain: f64,
}

impl FilmSpec {
    /// A film under constant light, with run-off but without glints.
    pub const CALM_FILM: FilmSpec = FilmSpec {
        exposure: 1.0,
        drift: 0.0,
        flicker: 0.0,
        shadow: 0.0,
        shadow_at_s: 0.0,
        glints: 0,
        drops: 0,
        beads: 0,
        thinning: 0.0,
        damp: 1.0,
        droplets: 0.0,
        dust: 0.0,
        stain: 0.0,
    };

    /// A typical film of a good cell.
    pub const TYPICAL_FILM: FilmSpec = FilmSpec {
        exposure: 1.0,
        drift: 0.05,
        flicker: 0.01,
        shadow: 0.0,
        shadow_at_s: 0.0,
        glints: 8,
        drops: 3,
        beads: 1,
        thinning: 0.08,
        damp: 0.9,
        droplets: 0.5,
        dust: 0.03,
        stain: 0.04,
    };

    /// Draws a film of the highest difficulty from a seed: exposures from dark to bright, ±15 % of drift, a shadow in
    /// every second film, spots that stay damp, droplets, dust and stains.
    pub fn hardest(seed: u64) -> FilmSpec {
        let mut random = Seed(seed).stream(RandomPurpose::Light, 1);
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let exposure = 0.45 * (2.5_f64 / 0.45).powf(between(0.0, 1.0));
        let shadow = between(-0.3, 0.3).max(0.0);
        FilmSpec {
            exposure,
            drift: between(0.02, 0.15),
            flicker: between(0.0, 0.03),
            shadow,
            shadow_at_s: between(6.0, 20.0),
            glints: between(8.0, 40.0) as usize,
            drops: between(2.0, 12.0) as usize,
            beads: between(0.0, 4.0) as usize,
            thinning: between(0.0, 0.15),
            damp: between(0.75, 1.0),
            droplets: between(0.0, 2.0),
            dust: between(0.0, 0.1),
            stain: between(0.0, 0.12),
        }
    }
}

/// The lamp's light over time, and the shadow that passes.
#[derive(Debug, Clone)]
pub(super) struct Lamp {
    drift: f64,
    period_s: f64,
    flicker: f64,
    shadow: Option<ShadowBand>,
    seed: Seed,
}

/// A band of shadow that moves across the picture.
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

/// The light at one time, for all pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct LampLight {
    /// Gain of the whole picture, without the shadow.
    gain: f64,
    shadow: Option<(ShadowBand, f64)>,
}

impl Lamp {
    /// Draws the lamp and the shadow from the seed. `centre_px` is the panel's centre in a picture of the width
    /// `width_px`.
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
    /// Returns the gain of the light at one pixel.
    pub fn gain(&self, column: usize, row: usize) -> f32 {
        let Some((shadow, come_px)) = self.shadow else { return self.gain as f32 };
        let (du, dv) = (column as f64 - shadow.centre_px[0], row as f64 - shadow.centre_px[1]);
        let away_px = (du * shadow.across[0] + dv * shadow.across[1] - come_px).abs() - shadow.half_width_px;
        let dark = shadow.share * (1.0 - smoothstep(away_px / shadow.edge_px));
        (self.gain * (1.0 - dark)) as f32
    }
}

/// The panel's extent in the picture, in which glints and drops start, and the number of pixels per millimetre.
#[derive(Debug, Clone, Copy)]
pub(super) struct PanelExtent {
    pub low_px: [f64; 2],
    pub high_px: [f64; 2],
    pub px_per_mm: f64,
}

/// One glint or drop at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TravellingSpot {
    pub centre_px: [f32; 2],
    pub radius_px: f32,
    /// Brightness at its centre at exposure 1, grey levels; 0 for a drop.
    pub peak_gray: f32,
}

/// All glints, or all drops, of a film.
#[derive(Debug, Clone)]
pub(super) struct TravellingSpots {
    seed: Seed,
    purpose: RandomPurpose,
    count: usize,
    ground: PanelExtent,
}

impl TravellingSpots {
    pub fn new(seed: Seed, purpose: RandomPurpose, count: usize, ground: PanelExtent) -> Self {
        TravellingSpots { seed, purpose, count, ground }
    }

    /// Returns all glints or drops at this time, s.
    pub fn at_time(&self, time_s: f64) -> Vec<TravellingSpot> {
        (0..self.count as u64).map(|index| self.spot_at_time(index, time_s)).collect()
    }

    fn spot_at_time(&self, index: u64, time_s: f64) -> TravellingSpot {
        let mut random = self.seed.stream(self.purpose, index);
        let (life_s, ahead_s) = (random.random_range(3.0..14.0), random.random_range(0.0..14.0));
        let age_s = (time_s + 1_000.0 + ahead_s).rem_euclid(life_s);
        let life = ((time_s + 1_000.0 + ahead_s) / life_s).floor() as u64;
        let mut random = self.seed.stream(self.purpose, (index + 1) * 100_000 + life);
        let glint = self.purpose == RandomPurpose::Glints;
        let start_px = [0, 1].map(|axis| random.random_range(self.ground.low_px[axis]..self.ground.high_px[axis]));
        let (speed_mm_s, radius_mm) = if glint {
            (draw_logarithmic(&mut random, 3.0, 40.0), draw_logarithmic(&mut random, 0.5, 2.0))
        } else {
            (draw_logarithmic(&mut random, 8.0, 60.0), random.random_range(0.9..2.2))
        };
        // Glints move downwards, sideways or slightly upwards; drops run down.
        let aside_rad = if glint { random.random_range(-1.8..1.8) } else { random.random_range(-0.15..0.15) };
        let (swell, beat) = (random.random_range(0.0..0.9), TAU * random.random_range(0.3..1.5));
        let gone_px = speed_mm_s * self.ground.px_per_mm * (age_s + swell * (beat * age_s).sin() / beat);
        let direction = [f64::sin(aside_rad), f64::cos(aside_rad)];
        let peak = draw_logarithmic(&mut random, 25.0, 250.0) * (0.75 + 0.25 * (3.0 * beat * age_s).sin());
        TravellingSpot {
            centre_px: [0, 1].map(|axis| (start_px[axis] + gone_px * direction[axis]) as f32),
            radius_px: (radius_mm * self.ground.px_per_mm) as f32,
            peak_gray: if glint { peak as f32 } else { 0.0 },
        }
    }
}

fn draw_logarithmic(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    low * (high / low).powf(random.random_range(0.0..1.0))
}

impl TravellingSpot {
    /// Adds the light of a glint along one row; its profile is Gaussian.
    pub fn add_glint_light(&self, row: usize, first_column: usize, levels: &mut [f32]) {
        let (reach, dv) = (3.0 * self.radius_px, row as f32 - self.centre_px[1]);
        for (column, level) in self.columns(dv, reach, first_column, levels) {
            let du = column - self.centre_px[0];
            *level += self.peak_gray * (-(du * du + dv * dv) / (2.0 * self.radius_px * self.radius_px)).exp();
        }
    }

    /// Computes the fraction of each pixel of one row that a drop covers, 0…1.
    pub fn drop_coverage(&self, row: usize, first_column: usize, shares: &mut [f32]) {
        let dv = row as f32 - self.centre_px[1];
        for (column, share) in self.columns(dv, self.radius_px + 1.0, first_column, shares) {
            let away = (column - self.centre_px[0]).hypot(dv);
            *share = share.max((self.radius_px - away + 0.5).clamp(0.0, 1.0));
        }
    }

    fn columns<'a>(
        &self,
        dv: f32,
        reach: f32,
        first_column: usize,
        row: &'a mut [f32],
    ) -> impl Iterator<Item = (f32, &'a mut f32)> + use<'a> {
        let half = (reach * reach - dv * dv).max(0.0).sqrt();
        let clip = |column: f32| ((column - first_column as f32).max(0.0) as usize).min(row.len());
        let (from, to) = (clip((self.centre_px[0] - half).ceil()), clip((self.centre_px[0] + half).floor() + 1.0));
        let to = if half > 0.0 { to.max(from) } else { from };
        row[from..to].iter_mut().enumerate().map(move |(i, value)| ((first_column + from + i) as f32, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected value, calculated by hand: in the middle of a shadow of 0.3, the light is 0.7 of the light far from the
    /// shadow.
    #[test]
    fn a_shadow_passes_and_the_drift_stays_within_its_limit() {
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

    const GROUND: PanelExtent = PanelExtent { low_px: [100.0, 100.0], high_px: [500.0, 400.0], px_per_mm: 2.0 };

    #[test]
    fn glints_and_drops_move_without_jumps() {
        let glints = TravellingSpots::new(Seed(3), RandomPurpose::Glints, 30, GROUND);
        let (now, soon) = (glints.at_time(7.0), glints.at_time(7.01));
        let steps = now
            .iter()
            .zip(&soon)
            .map(|(a, b)| (a.centre_px[0] - b.centre_px[0]).hypot(a.centre_px[1] - b.centre_px[1]));
        // The speed is at most 40 mm/s, and twice this at the peak of its variation: 1.6 px in 10 ms.
        assert!(steps.clone().filter(|step| *step < 1.6).count() >= 29 && steps.clone().any(|step| step > 0.0));
        assert_eq!(glints.at_time(7.0), now);
    }

    /// Expected value, calculated by hand: with a radius of 2 px, a pixel beside the centre has exp(−1/8) of the peak.
    #[test]
    fn a_glint_is_gaussian_and_a_drop_is_a_disc() {
        let spotted = TravellingSpot { centre_px: [10.0, 5.0], radius_px: 2.0, peak_gray: 100.0 };
        let mut row = vec![0.0; 20];
        spotted.add_glint_light(5, 0, &mut row);
        assert!((row[10] - 100.0).abs() < 1e-4 && (row[11] - 88.25).abs() < 0.01 && row[17] == 0.0);
        let mut row = vec![0.0; 20];
        spotted.drop_coverage(5, 4, &mut row);
        assert_eq!((row[6], row[8], row[9]), (1.0, 0.5, 0.0));
    }
}
