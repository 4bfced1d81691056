//! Objects that move over the film: glints, which are additive and bright, and drops, which are thick film that
//! runs down.
//!
//! Each exists for a while and then appears elsewhere; its position is a function of time only. Its speed varies
//! periodically: x(t) = x₀ + v (t + b sin(ω t)/ω), b < 1.

use super::noise::{RandomPurpose, Seed};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// The panel's pixels: the area in which glints and drops start, and the size of a millimetre in pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct PanelGround {
    pub low_px: [f64; 2],
    pub high_px: [f64; 2],
    pub px_per_mm: f64,
}

/// One glint or drop at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TravellingSpot {
    pub centre_px: [f32; 2],
    pub radius_px: f32,
    /// Grey levels at exposure 1; 0 for a drop.
    pub peak_gray: f32,
}

/// Glints or drops.
#[derive(Debug, Clone)]
pub(super) struct TravellingSpots {
    seed: Seed,
    purpose: RandomPurpose,
    count: usize,
    ground: PanelGround,
}

impl TravellingSpots {
    pub fn new(seed: Seed, purpose: RandomPurpose, count: usize, ground: PanelGround) -> Self {
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

    /// Computes the share of each pixel of one row that a drop covers, 0…1.
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

    const GROUND: PanelGround = PanelGround { low_px: [100.0, 100.0], high_px: [500.0, 400.0], px_per_mm: 2.0 };

    #[test]
    fn travellers_move_without_jumps_while_they_live() {
        let glints = TravellingSpots::new(Seed(3), RandomPurpose::Glints, 30, GROUND);
        let (now, soon) = (glints.at_time(7.0), glints.at_time(7.01));
        let steps = now
            .iter()
            .zip(&soon)
            .map(|(a, b)| (a.centre_px[0] - b.centre_px[0]).hypot(a.centre_px[1] - b.centre_px[1]));
        // At most 40 mm/s, and twice this speed at the peak of the variation: 1.6 px in 10 ms.
        assert!(steps.clone().filter(|step| *step < 1.6).count() >= 29 && steps.clone().any(|step| step > 0.0));
        assert_eq!(glints.at_time(7.0), now);
    }

    /// Calculated by hand: with a radius of 2 px, a pixel beside the centre has exp(−1/8) of the peak.
    #[test]
    fn a_glint_is_a_bell_and_a_drop_a_disc() {
        let spotted = TravellingSpot { centre_px: [10.0, 5.0], radius_px: 2.0, peak_gray: 100.0 };
        let mut row = vec![0.0; 20];
        spotted.add_glint_light(5, 0, &mut row);
        assert!((row[10] - 100.0).abs() < 1e-4 && (row[11] - 88.25).abs() < 0.01 && row[17] == 0.0);
        let mut row = vec![0.0; 20];
        spotted.drop_coverage(5, 4, &mut row);
        assert_eq!((row[6], row[8], row[9]), (1.0, 0.5, 0.0));
    }
}
