//! The effect of a disc in contact on a place while the disc moves past along a straight segment: ∫ p dl, in closed
//! form.
//!
//! Along a line x(l) = x₀ + l d the compression is a parabola in l, c = c₀ + c₁ l + c₂ l², within the chord of the
//! disc. The integral of its positive part follows from its roots. The orbit moves the rim of the disc as well: the
//! integral is the mean over places on the orbit's circle. These places turn by the golden angle from one segment to
//! the next, so that a few places for each segment are enough for all segments together.

use super::pad::Contact;
use nalgebra::Vector2;
use std::f64::consts::TAU;

/// Number of places on the orbit for one segment.
const PHASES: usize = 8;
/// A disc that moves less than this is at rest, mm.
const MIN_STROKE_MM: f64 = 1e-9;
/// The golden angle as a fraction of a full turn.
const GOLDEN: f64 = 0.381_966_011_250_105_1;

/// The motion of a disc along a straight segment, with its orbit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscStroke {
    /// The contact, in the tangent plane at the segment's middle.
    pub contact: Contact,
    // The position of the disc's middle at the start, in the tangent plane, mm.
    start_mm: Vector2<f64>,
    // The direction opposite to the disc's motion: seen from the disc, a place moves in this direction.
    direction: Vector2<f64>,
    length_mm: f64,
    // K d
    bend_per_mm: Vector2<f64>,
    orbit_mm: [Vector2<f64>; PHASES],
}

impl DiscStroke {
    /// Creates the `number`th segment. The disc's middle moves from the first to the second end, mm in the tangent
    /// plane, and describes a circle of this radius, mm, on its orbit.
    pub fn new(contact: Contact, ends_mm: [Vector2<f64>; 2], (orbit_radius_mm, number): (f64, usize)) -> Self {
        let orbit_mm = std::array::from_fn(|phase| {
            let turn = phase as f64 / PHASES as f64 + (number as f64 * GOLDEN).fract() / PHASES as f64;
            Vector2::new((TAU * turn).cos(), (TAU * turn).sin()) * orbit_radius_mm
        });
        let way = ends_mm[0] - ends_mm[1];
        let length_mm = way.norm();
        let direction = if length_mm > MIN_STROKE_MM { way / length_mm } else { Vector2::zeros() };
        let bend_per_mm = contact.contact_surface.curvature_per_mm * direction;
        DiscStroke { contact, start_mm: ends_mm[0], direction, length_mm, bend_per_mm, orbit_mm }
    }

    /// Returns the largest reach of the disc from its middle, mm.
    pub fn reach_mm(&self) -> f64 {
        self.contact.pad.radius_mm + self.orbit_mm[0].norm()
    }

    /// Returns the mean pressure at a place, mm from the segment's middle, while the disc moves past: N/mm².
    pub fn mean_pressure_n_mm2(&self, place_mm: Vector2<f64>) -> f64 {
        if self.is_out_of_reach(place_mm) {
            return 0.0;
        }
        if self.orbit_mm[0] == Vector2::zeros() {
            return self.orbit_offset(place_mm);
        }
        self.orbit_mm.iter().map(|away| self.orbit_offset(place_mm - away)).sum::<f64>() / PHASES as f64
    }

    /// Returns whether a place is too far away for the disc to reach.
    fn is_out_of_reach(&self, place_mm: Vector2<f64>) -> bool {
        let (from, reach_mm) = (place_mm - self.start_mm, self.reach_mm());
        let along_mm = from.dot(&self.direction);
        let ahead_mm = (along_mm.max(0.0), (-along_mm - self.length_mm).max(0.0));
        let across2 = from.norm_squared() - along_mm * along_mm;
        across2 + ahead_mm.0.max(ahead_mm.1).powi(2) > reach_mm * reach_mm
    }

    fn orbit_offset(&self, place_mm: Vector2<f64>) -> f64 {
        let (from, direction, length_mm) = (place_mm - self.start_mm, self.direction, self.length_mm);
        if length_mm <= MIN_STROKE_MM {
            return self.contact.pressure_n_mm2(from);
        }
        let (along_mm, radius_mm) = (from.dot(&direction), self.contact.pad.radius_mm);
        let half2 = radius_mm * radius_mm - (from.norm_squared() - along_mm * along_mm);
        if half2 <= 0.0 {
            return 0.0;
        }
        let half_mm = half2.sqrt();
        let chord = [(-along_mm - half_mm).max(0.0), (-along_mm + half_mm).min(length_mm)];
        if chord[0] >= chord[1] {
            return 0.0;
        }
        let (seat, bend) = (&self.contact.contact_surface, self.bend_per_mm);
        let c0 = self.contact.depth_mm + seat.tilt.dot(&from) - 0.5 * from.dot(&(seat.curvature_per_mm * from));
        let (c1, c2) = (seat.tilt.dot(&direction) - bend.dot(&from), -0.5 * bend.dot(&direction));
        self.contact.pad.stiffness_n_mm3 * positive_part([c0, c1, c2], chord) / length_mm
    }
}

/// Calculates ∫ max(c₀ + c₁ l + c₂ l², 0) dl from a to b.
fn positive_part([c0, c1, c2]: [f64; 3], [a, b]: [f64; 2]) -> f64 {
    let value = |l: f64| c0 + l * (c1 + l * c2);
    let whole = |l: f64| l * (c0 + l * (c1 / 2.0 + l * c2 / 3.0));
    let between = |low: f64, high: f64| if low < high { whole(high) - whole(low) } else { 0.0 };
    let (at_a, at_b) = (value(a), value(b));
    // A parabola that is curved downwards, or a straight line, is positive between two points at which it is positive.
    if at_a >= 0.0 && at_b >= 0.0 && c2 <= 0.0 {
        return between(a, b);
    }
    let inner = c1 * c1 - 4.0 * c0 * c2;
    if inner <= 0.0 {
        return if at_a > 0.0 { between(a, b) } else { 0.0 };
    }
    // The stable form of the roots; one of them goes to infinity if c₂ is 0.
    let q = -0.5 * (c1 + inner.sqrt().copysign(c1));
    let (one, other) = (c0 / q, if c2 == 0.0 { f64::INFINITY.copysign(q) } else { q / c2 });
    let (low, high) = (one.min(other), one.max(other));
    if c2 > 0.0 {
        return between(a, b.min(low)) + between(a.max(high), b);
    }
    if c2 < 0.0 {
        return between(a.max(low), b.min(high));
    }
    if c1 > 0.0 { between(a.max(one), b) } else { between(a, b.min(one)) }
}

#[cfg(test)]
mod tests {
    use super::super::pad::{ContactGeometry, PadWithDisc};
    use super::*;
    use nalgebra::Matrix2;
    use proptest::prelude::*;

    const PAD: PadWithDisc = PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 };

    fn stroke(seat: ContactGeometry, orbit_radius_mm: f64) -> DiscStroke {
        let contact = PAD.contact_at_force(20.0, seat, None).expect("contact");
        DiscStroke::new(contact, [Vector2::new(-40.0, 0.0), Vector2::new(40.0, 0.0)], (orbit_radius_mm, 0))
    }

    /// Calculated by hand: a place in the lane's middle is below the disc for 30 of 80 mm, a place 9 mm beside the
    /// middle for 24, a place 15 mm beside it never; p = 0.028 294 2 N/mm².
    #[test]
    fn a_place_is_pressed_for_its_chord() {
        let level = stroke(ContactGeometry::level(), 0.0);
        for (y, chord_mm) in [(0.0, 30.0), (9.0, 24.0), (-9.0, 24.0), (15.0, 0.0)] {
            let found = level.mean_pressure_n_mm2(Vector2::new(3.0, y));
            assert!((found - 0.028_294_2 * chord_mm / 80.0).abs() < 1e-7, "{y}: {found}");
        }
        // At a place 30 mm before the segment's middle, the disc is above the place from the start of the segment, for
        // 10 + 15 mm.
        let found = level.mean_pressure_n_mm2(Vector2::new(-30.0, 0.0));
        assert!((found - 0.028_294_2 * 25.0 / 80.0).abs() < 1e-7, "{found}");
        let still = DiscStroke::new(level.contact, [Vector2::zeros(); 2], (0.0, 0));
        assert!((still.mean_pressure_n_mm2(Vector2::new(14.0, 0.0)) - 0.028_294_2).abs() < 1e-7);
    }

    /// By hand: the orbit spreads pressure beyond the rim, and reduces it by as much inside the rim.
    #[test]
    fn the_orbit_spreads_the_rim() {
        let [sharp, spread] = [0.0, 2.5].map(|radius_mm| stroke(ContactGeometry::level(), radius_mm));
        let at = |stroke: &DiscStroke, y: f64| stroke.mean_pressure_n_mm2(Vector2::new(0.0, y));
        assert!(at(&sharp, 16.0) == 0.0 && at(&spread, 16.0) > 0.0 && at(&spread, 14.0) < at(&sharp, 14.0));
        let sum = |stroke: &DiscStroke| (-200..=200).map(|n| at(stroke, f64::from(n) * 0.1)).sum::<f64>();
        assert!((sum(&spread) / sum(&sharp) - 1.0).abs() < 0.002);
        assert_eq!((sharp.reach_mm(), spread.reach_mm()), (15.0, 17.5));
    }

    proptest! {
        #[test]
        fn the_positive_part_is_the_sum_of_its_slices(
            c0 in -1.0..1.0f64, c1 in -1.0..1.0f64, c2 in prop_oneof![Just(0.0), -1.0..1.0f64], a in -3.0..0.0f64, b in 0.0..3.0f64,
        ) {
            let slices = 40_000;
            let step = (b - a) / f64::from(slices);
            let at = |n: i32| a + (f64::from(n) + 0.5) * step;
            let sum: f64 = (0..slices).map(|n| (c0 + at(n) * (c1 + at(n) * c2)).max(0.0) * step).sum();
            let found = positive_part([c0, c1, c2], [a, b]);
            prop_assert!((found - sum).abs() < 1e-5, "{} {}", found, sum);
        }

        /// The mean over the segment equals the mean of many discs at rest.
        #[test]
        fn a_stroke_is_many_still_discs(
            k1 in -0.004..0.01f64, k2 in -0.004..0.01f64, tilt in -0.05..0.05f64, x in -60.0..60.0f64, y in -16.0..16.0f64,
        ) {
            let seat = ContactGeometry { tilt: Vector2::new(tilt, tilt), curvature_per_mm: Matrix2::new(k1, 0.001, 0.001, k2) };
            let stroke = stroke(seat, 0.0);
            let place = Vector2::new(x, y);
            let at = |n: i32| Vector2::new(-40.0 + 80.0 * (f64::from(n) + 0.5) / 8_000.0, 0.0);
            let mean = (0..8_000).map(|n| stroke.contact.pressure_n_mm2(place - at(n))).sum::<f64>() / 8_000.0;
            prop_assert!((stroke.mean_pressure_n_mm2(place) - mean).abs() < 3e-5);
        }
    }
}
