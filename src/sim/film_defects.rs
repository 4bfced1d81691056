//! Greasy spots: where and when the water film breaks, and how the break grows.
//!
//! A spot's outline is an ellipse whose radius varies with the angle in waves. The film breaks at the centre at t₀. The
//! break reaches the fraction ρ of the distance to the outline at t₀ + T ρ^1.5: fast at first, and never beyond the
//! outline.

use super::noise::{RandomPurpose, Seed};
use super::shape::Shape;
use nalgebra::{Rotation2, Vector2};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

/// A greasy spot, which belongs to the panel and moves with it.
#[derive(Debug, Clone, PartialEq)]
pub struct GreasySpot {
    centre: Vector2<f64>,
    half_axes_mm: Vector2<f64>,
    turn: Rotation2<f64>,
    /// Number, relative amplitude and phase of the waves around the outline: two, three and five waves.
    waves: [(f64, f64, f64); 3],
    /// Time at which the film breaks at the centre, s from the start of the film.
    pub breaks_at_s: f64,
    /// Time that the break needs to grow from the centre to the outline, s.
    pub grows_s: f64,
    /// Time at which the film closes over the spot again, s from the start of the film; infinite if it does not close.
    pub closes_at_s: f64,
    /// The kind of the spot: how its film differs from the break described above.
    pub kind: SpotKind,
}

/// The behaviour of the film on a greasy spot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpotKind {
    /// The film breaks while it is observed.
    Breaks,
    /// The spot becomes wet and dries half a second later, while the spray is still on.
    UnderSpray,
    /// Water never stays on the spot.
    NeverWets,
}

/// The greasy spots that are drawn for a film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Grease {
    /// `count` spots from 25 to 600 mm², of all kinds. Each break has reached its outline by `until_s`, s from the
    /// start of the film.
    Mixed {
        /// Number of spots.
        count: usize,
        /// Time by which the last break has reached its outline, s from the start of the film.
        until_s: f64,
    },
    /// One spot that covers this fraction of the panel, 0…1.
    Share {
        /// The covered fraction of the panel, 0…1.
        share: f64,
        /// The kind of the spot.
        kind: SpotKind,
    },
}

/// Minimum distance of a spot's outline from the panel's outline, mm, so that the spot lies inside of the region.
const MIN_MIXED_EDGE_MM: f64 = 18.0;

/// Returns the spots that `grease` specifies on this panel; the panel is fully wet from `wet_from_s` on.
pub(super) fn draw_spots(seed: Seed, shape: &Shape, wet_from_s: f64, grease: &Grease) -> Vec<GreasySpot> {
    match *grease {
        Grease::Mixed { count, until_s } => draw_mixed_spots(seed, shape, count, (wet_from_s, until_s)),
        Grease::Share { share, kind } => vec![covering_spot(share, kind)],
    }
}

fn draw_mixed_spots(seed: Seed, shape: &Shape, count: usize, (wet_from_s, until_s): (f64, f64)) -> Vec<GreasySpot> {
    const MAX_ATTEMPTS: usize = 2_000;
    let mut random = seed.stream(RandomPurpose::Grease, 0);
    let mut spots: Vec<GreasySpot> = Vec::new();
    for _ in 0..MAX_ATTEMPTS {
        if spots.len() == count {
            break;
        }
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let area_mm2 = 25.0 * 24.0_f64.powf(between(0.0, 1.0));
        let aspect = between(1.0, 1.7);
        let half_axes_mm = Vector2::new((area_mm2 * aspect / PI).sqrt(), (area_mm2 / aspect / PI).sqrt());
        let grows_s = between(0.5, 6.0).min(0.4 * (until_s - wet_from_s));
        let breaks_at_s = between(wet_from_s + 0.5, until_s - grows_s);
        let chance = between(0.0, 1.0);
        let (kind, closes_at_s) = match chance {
            0.0..0.15 => (SpotKind::NeverWets, f64::INFINITY),
            0.15..0.3 => (SpotKind::UnderSpray, f64::INFINITY),
            0.3..0.45 => (SpotKind::Breaks, breaks_at_s + grows_s + between(2.0, 5.0)),
            _ => (SpotKind::Breaks, f64::INFINITY),
        };
        let spot = GreasySpot {
            centre: Vector2::new(between(-170.0, 170.0), between(-120.0, 120.0)),
            half_axes_mm,
            turn: Rotation2::new(between(0.0, TAU)),
            waves: [2.0, 3.0, 5.0].map(|count| (count, between(0.02, 0.08), between(0.0, TAU))),
            breaks_at_s,
            grows_s,
            closes_at_s,
            kind,
        };
        let apart =
            |other: &GreasySpot| (other.centre - spot.centre).norm() > other.radius_mm() + spot.radius_mm() + 6.0;
        let inside = shape.outline().distance(spot.centre).0 < -(MIN_MIXED_EDGE_MM + spot.radius_mm());
        if inside && spots.iter().all(apart) {
            spots.push(spot);
        }
    }
    spots
}

fn covering_spot(share: f64, kind: SpotKind) -> GreasySpot {
    // Approximate area of the panel, mm²: 334 × 228 mm without a corner. From a fraction of nine tenths on, the ellipse
    // is larger than the panel.
    const PANEL_MM2: f64 = 73_000.0;
    const ASPECT: f64 = 1.45;
    let area_mm2 = if share < 0.9 { share * PANEL_MM2 } else { 6.0 * PANEL_MM2 };
    GreasySpot {
        centre: Vector2::zeros(),
        half_axes_mm: Vector2::new((area_mm2 * ASPECT / PI).sqrt(), (area_mm2 / ASPECT / PI).sqrt()),
        turn: Rotation2::identity(),
        waves: [(2.0, 0.0, 0.0); 3],
        breaks_at_s: 0.0,
        grows_s: 0.1,
        closes_at_s: f64::INFINITY,
        kind,
    }
}

/// Minimum distance of a spot's centre from the panel's outline, mm.
const MIN_SPOT_EDGE_MM: f64 = 42.0;
/// Minimum distance between the centres of two spots, mm.
const MIN_SPOT_DISTANCE_MM: f64 = 52.0;

/// Draws two to four spots on this panel at random; the panel is fully wet from `wet_from_s` on.
pub(super) fn draw(seed: Seed, shape: &Shape, wet_from_s: f64) -> Vec<GreasySpot> {
    let mut random = seed.stream(RandomPurpose::Spots, 0);
    let count = random.random_range(2..=4);
    let mut spots: Vec<GreasySpot> = Vec::new();
    while spots.len() < count {
        let centre = Vector2::new(random.random_range(-170.0..170.0), random.random_range(-120.0..120.0));
        let apart = spots.iter().all(|spot| (spot.centre - centre).norm() > MIN_SPOT_DISTANCE_MM);
        if apart && shape.outline().distance(centre).0 < -MIN_SPOT_EDGE_MM {
            // The first spot breaks early, so that a film that is observed for a short time also has a break.
            let latest_s = if spots.is_empty() { 6.0 } else { 25.0 };
            spots.push(draw_spot(&mut random, centre, wet_from_s + 1.5, latest_s));
        }
    }
    spots
}

fn draw_spot(random: &mut Pcg64, centre: Vector2<f64>, earliest_s: f64, span_s: f64) -> GreasySpot {
    let mut between = |low: f64, high: f64| random.random_range(low..high);
    GreasySpot {
        centre,
        half_axes_mm: Vector2::new(between(10.0, 15.0), between(7.0, 10.0)),
        turn: Rotation2::new(between(0.0, TAU)),
        waves: [2.0, 3.0, 5.0].map(|count| (count, between(0.04, 0.10), between(0.0, TAU))),
        breaks_at_s: earliest_s + between(0.0, span_s),
        grows_s: between(4.0, 9.0),
        closes_at_s: f64::INFINITY,
        kind: SpotKind::Breaks,
    }
}

impl GreasySpot {
    /// Returns the spot's centre on the sheet, mm.
    pub(super) fn centre_mm(&self) -> [f64; 2] {
        self.centre.into()
    }

    /// Returns the distance of a point from the spot's centre as a fraction of the distance from the centre to the
    /// outline, and the remaining distance to the outline in mm, negative outside.
    pub(super) fn reach(&self, place: [f64; 2]) -> (f64, f64) {
        let away = Vector2::from(place) - self.centre;
        let flat = (self.turn.inverse() * away).component_div(&self.half_axes_mm);
        let reached = flat.norm() / self.radius(flat.y.atan2(flat.x));
        let left_mm =
            if reached > 1e-6 { away.norm() / reached * (1.0 - reached) } else { self.half_axes_mm.min() };
        (reached, left_mm)
    }

    /// Returns the time at which the film breaks at this fraction of the distance from the centre to the outline, s
    /// from the start of the film.
    pub(super) fn opening_time_s(&self, reached: f64) -> f64 {
        self.breaks_at_s + self.grows_s * reached.powf(1.5)
    }

    /// Returns the time at which the film breaks at a point of the spot that becomes wet at `wet_from_s`, s from the
    /// start of the film.
    pub(super) fn break_time_at_s(&self, reached: f64, wet_from_s: f64) -> f64 {
        const WET_DURATION_S: f64 = 0.5;
        match self.kind {
            SpotKind::Breaks => self.opening_time_s(reached),
            SpotKind::UnderSpray => wet_from_s + WET_DURATION_S,
            SpotKind::NeverWets => f64::NEG_INFINITY,
        }
    }

    /// Returns the largest distance of the spot's outline from its centre, mm.
    pub(super) fn radius_mm(&self) -> f64 {
        self.half_axes_mm.max() * (1.0 + self.waves.iter().map(|(_, share, _)| share).sum::<f64>())
    }

    /// Returns a lower bound of the distance of the spot's outline from its centre, mm.
    pub(super) fn min_radius_mm(&self) -> f64 {
        self.half_axes_mm.min() * (1.0 - self.waves.iter().map(|(_, share, _)| share).sum::<f64>())
    }

    /// Returns the spot's outline on the sheet as a closed polyline, mm.
    pub(super) fn outline_mm(&self) -> Vec<[f64; 2]> {
        const POINTS: usize = 72;
        let point = |i: usize| {
            let angle_rad = TAU * i as f64 / POINTS as f64;
            let flat = Vector2::new(angle_rad.cos(), angle_rad.sin()) * self.radius(angle_rad);
            (self.centre + self.turn * flat.component_mul(&self.half_axes_mm)).into()
        };
        (0..POINTS).map(point).collect()
    }

    fn radius(&self, angle_rad: f64) -> f64 {
        1.0 + self.waves.iter().map(|(count, share, phase)| share * (count * angle_rad + phase).cos()).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_mm2(outline: &[[f64; 2]]) -> f64 {
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).map(|(a, b)| (a[0] * b[1] - b[0] * a[1]) / 2.0).sum::<f64>().abs()
    }

    #[test]
    fn spots_are_a_few_hundred_square_millimetres_and_well_inside() {
        for seed in 0..50 {
            let shape = Shape::taught(Seed(seed));
            let spots = draw(Seed(seed), &shape, 4.0);
            assert!((2..=4).contains(&spots.len()));
            assert!(spots[0].breaks_at_s < 12.0);
            for spot in &spots {
                let outline = spot.outline_mm();
                assert!((180.0..600.0).contains(&area_mm2(&outline)), "{}", area_mm2(&outline));
                for place in outline {
                    assert!(shape.outline().distance(place.into()).0 < -20.0);
                    let (reached, left_mm) = spot.reach(place);
                    assert!((reached - 1.0).abs() < 1e-9 && left_mm.abs() < 1e-6);
                }
            }
        }
    }

    /// Expected value, calculated by hand: the break reaches a quarter of the distance after an eighth of the time:
    /// 0.25^1.5 = 0.125.
    #[test]
    fn a_break_grows_from_the_centre() {
        let shape = Shape::taught(Seed(1));
        let spot = &draw(Seed(1), &shape, 4.0)[0];
        assert!(spot.reach(spot.centre_mm()).0 < 1e-12);
        assert!((spot.opening_time_s(0.25) - spot.breaks_at_s - 0.125 * spot.grows_s).abs() < 1e-12);
    }
}
