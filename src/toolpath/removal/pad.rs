//! The pressure below a disc: an elastic pad on a curved surface, loaded by a force, at a given tilt, cut off at the
//! panel's edge. Also the effect of the disc on a point while the disc moves past.
//!
//!     p = s · max(c, 0),   c = δ + t·x − ½ xᵀ K x,   ∫ p dA = F                                           (4), (5)
//! F is a convex, increasing function of δ, so Newton's method from too large a δ approaches the root from above and
//! never passes it. There are two closed forms.
//! - The whole disc is on the panel and in contact: the mean of t·x over a disc is 0, that of ½ xᵀ K x is R² tr K / 8,
//!   so δ = F / (π R² s) + R² tr K / 8.
//! - The surface bends away in both directions, and the contact is an ellipse completely inside of the disc: with the
//!   ellipse's middle x₀ = K⁻¹ t and the compression c₀ = δ + ½ t·x₀ at this point, the paraboloid above the ellipse
//!   has the volume π c₀² / √det K, so c₀² = F √det K / (π s).
//!
//! Otherwise the integral is a sum over points of equal area on rings and spokes, which follow the disc's edge exactly.
//!
//! Beyond the panel's edge the disc has no support: the rest of the disc bears the force, and the pressure is never
//! negative. The tilt is given (see the parent module).
//!
//! While the disc moves along a straight segment, its effect on a point is ∫ p dl, in closed form. Along a line x(l) =
//! x₀ + l d the compression is a parabola in l, c = c₀ + c₁ l + c₂ l², within the chord of the disc. The integral of
//! its positive part follows from its roots. The orbit moves the rim of the disc as well, so the integral is averaged
//! over positions on the orbit's circle. These positions are rotated by the golden angle from one segment to the next,
//! so that a few positions for each segment are sufficient for all segments together.

use nalgebra::{Matrix2, Vector2};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Number of rings of equal area in the sum over the disc.
const RING_COUNT: usize = 28;
/// Number of points on each ring.
const SPOKE_COUNT: usize = 44;
/// Maximum number of Newton steps; usually about four are sufficient.
const MAX_NEWTON_STEPS: usize = 60;
/// Relative tolerance of the force at which the iteration ends.
const FORCE_TOLERANCE: f64 = 1e-9;

/// Points of equal area over a disc of radius 1; every second ring is rotated by half the angle between two spokes.
static UNIT_PLACES: LazyLock<Vec<Vector2<f64>>> = LazyLock::new(|| {
    let place = |index: usize| {
        let (ring, spoke) = ((index / SPOKE_COUNT) as f64, (index % SPOKE_COUNT) as f64);
        let angle = TAU * (spoke + 0.25 + 0.5 * (ring % 2.0)) / SPOKE_COUNT as f64;
        Vector2::new(angle.cos(), angle.sin()) * ((ring + 0.5) / RING_COUNT as f64).sqrt()
    };
    (0..RING_COUNT * SPOKE_COUNT).map(place).collect()
});

/// Number of positions on the orbit for one segment.
const ORBIT_POSITIONS: usize = 8;
/// Minimum displacement of a disc, mm; a disc that moves less is at rest.
const MIN_STROKE_MM: f64 = 1e-9;
/// The golden angle as a fraction of 360°.
const GOLDEN_ANGLE_FRACTION: f64 = 0.381_966_011_250_105_1;

/// A pad with its disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PadWithDisc {
    /// Radius of the disc, mm.
    pub radius_mm: f64,
    /// Stiffness of the pad: its modulus divided by its thickness, N/mm³.
    pub stiffness_n_mm3: f64,
}

/// The shape of the surface below the disc, in the tangent plane at the disc's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactGeometry {
    /// Tilt: additional depth of the disc per mm along x and y.
    pub tilt: Vector2<f64>,
    /// Curvature of the surface, 1/mm, positive if the surface bends away from the disc.
    pub curvature_per_mm: Matrix2<f64>,
}

/// A function that returns whether there is panel material at an offset from the disc's middle, mm.
pub type SupportMask<'a> = &'a dyn Fn(Vector2<f64>) -> bool;

/// The contact between a disc and the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The pad with its disc.
    pub pad: PadWithDisc,
    /// The surface on which the disc lies.
    pub contact_surface: ContactGeometry,
    /// Compression in the disc's middle, δ, mm; negative if a tilted disc does not touch at its middle.
    pub depth_mm: f64,
}

impl ContactGeometry {
    /// Returns the geometry of a plane surface without tilt.
    pub fn level() -> Self {
        ContactGeometry { tilt: Vector2::zeros(), curvature_per_mm: Matrix2::zeros() }
    }

    /// Returns the depth of the disc at an offset minus the depth in its middle, mm.
    fn deeper_mm(&self, x: Vector2<f64>) -> f64 {
        self.tilt.dot(&x) - 0.5 * x.dot(&(self.curvature_per_mm * x))
    }
}

impl PadWithDisc {
    /// Returns the area of the disc, mm².
    pub fn area_mm2(&self) -> f64 {
        PI * self.radius_mm * self.radius_mm
    }

    /// Returns the contact at which the pad bears this force, N. `below` returns where there is panel material; without
    /// it there is material everywhere. `None` if there is no material below the disc, or no force.
    pub fn contact_at_force(
        &self,
        force_n: f64,
        seat: ContactGeometry,
        below: Option<SupportMask<'_>>,
    ) -> Option<Contact> {
        if !(force_n > 0.0 && force_n.is_finite()) {
            return None;
        }
        let contact = |depth_mm| Some(Contact { pad: *self, contact_surface: seat, depth_mm });
        let whole_mm = force_n / (self.area_mm2() * self.stiffness_n_mm3)
            + self.radius_mm * self.radius_mm * seat.curvature_per_mm.trace() / 8.0;
        match below {
            None if self.is_full_contact(seat, whole_mm) => contact(whole_mm),
            None => {
                contact(self.inner_depth_mm(force_n, seat).or_else(|| self.summed_depth_mm(force_n, seat, None))?)
            }
            _ => contact(self.summed_depth_mm(force_n, seat, below)?),
        }
    }

    /// Returns δ by the closed form if the contact is an ellipse inside of the disc; otherwise `None`.
    fn inner_depth_mm(&self, force_n: f64, seat: ContactGeometry) -> Option<f64> {
        let bend = seat.curvature_per_mm;
        let least_bend = bend.symmetric_eigenvalues().min();
        let middle_mm = if least_bend > 0.0 { bend.try_inverse()? * seat.tilt } else { return None };
        let peak_mm = (force_n * bend.determinant().sqrt() / (PI * self.stiffness_n_mm3)).sqrt();
        // The tilt moves the ellipse's middle. If the longest half-axis from this point ends inside of the disc, the
        // rim has no influence.
        let reach_mm = middle_mm.norm() + (2.0 * peak_mm / least_bend).sqrt();
        (reach_mm <= self.radius_mm).then(|| peak_mm - 0.5 * seat.tilt.dot(&middle_mm))
    }

    /// Returns whether the whole disc is in contact at this depth. The largest reductions by tilt and by curvature are
    /// added, which gives a conservative bound.
    fn is_full_contact(&self, seat: ContactGeometry, depth_mm: f64) -> bool {
        let (radius_mm, bends) = (self.radius_mm, seat.curvature_per_mm.symmetric_eigenvalues());
        let fall_mm = 0.5 * radius_mm * radius_mm * bends.max().max(0.0);
        depth_mm - seat.tilt.norm() * radius_mm - fall_mm > 0.0
    }

    /// Calculates δ by the sum over the points that have panel material below them.
    fn summed_depth_mm(&self, force_n: f64, seat: ContactGeometry, below: Option<SupportMask<'_>>) -> Option<f64> {
        let deeper_mm: Vec<f64> = self
            .disc_places()
            .filter(|place| below.is_none_or(|below| below(*place)))
            .map(|place| seat.deeper_mm(place))
            .collect();
        if deeper_mm.is_empty() {
            return None;
        }
        let each = self.stiffness_n_mm3 * self.area_mm2() / (RING_COUNT * SPOKE_COUNT) as f64;
        let mean_mm = deeper_mm.iter().sum::<f64>() / deeper_mm.len() as f64;
        // Start value: the depth at which all points would bear the force, also with negative pressure. This depth
        // never exceeds the solution.
        let mut depth_mm = force_n / (each * deeper_mm.len() as f64) - mean_mm;
        for _ in 0..MAX_NEWTON_STEPS {
            let pressed = deeper_mm.iter().filter(|deeper| depth_mm + **deeper > 0.0);
            let (sum_mm, count) = pressed.fold((0.0, 0_usize), |(sum, n), deeper| (sum + depth_mm + deeper, n + 1));
            let over_n = each * sum_mm - force_n;
            if over_n.abs() <= FORCE_TOLERANCE * force_n || count == 0 {
                break;
            }
            // The force is convex in the depth, so Newton's method converges from one side and needs no damping.
            depth_mm -= over_n / (each * count as f64);
        }
        Some(depth_mm)
    }

    /// Returns points of equal area over the disc, mm from its middle.
    fn disc_places(&self) -> impl Iterator<Item = Vector2<f64>> + use<> {
        let radius_mm = self.radius_mm;
        UNIT_PLACES.iter().map(move |place| place * radius_mm)
    }
}

impl Contact {
    /// Returns the pressure at an offset from the disc's middle, N/mm², assuming that there is panel material.
    pub fn pressure_n_mm2(&self, offset_mm: Vector2<f64>) -> f64 {
        if offset_mm.norm_squared() > self.pad.radius_mm * self.pad.radius_mm {
            return 0.0;
        }
        self.pad.stiffness_n_mm3 * (self.depth_mm + self.contact_surface.deeper_mm(offset_mm)).max(0.0)
    }
}

/// The motion of a disc along a straight segment, with its orbit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiscStroke {
    /// The contact, in the tangent plane at the segment's middle.
    pub contact: Contact,
    // The position of the disc's middle at the start, in the tangent plane, mm.
    start_mm: Vector2<f64>,
    // Direction in which a point of the panel moves relative to the disc: opposite to the disc's motion.
    direction: Vector2<f64>,
    length_mm: f64,
    // The curvature K times the direction d of the motion, 1/mm.
    bend_per_mm: Vector2<f64>,
    orbit_mm: [Vector2<f64>; ORBIT_POSITIONS],
}

impl DiscStroke {
    /// Creates the segment with this number. The disc's middle moves from the first to the second end, mm in the
    /// tangent plane, and describes a circle of the orbit's radius, mm.
    pub fn new(contact: Contact, ends_mm: [Vector2<f64>; 2], (orbit_radius_mm, number): (f64, usize)) -> Self {
        let orbit_mm = std::array::from_fn(|phase| {
            let turn = phase as f64 / ORBIT_POSITIONS as f64
                + (number as f64 * GOLDEN_ANGLE_FRACTION).fract() / ORBIT_POSITIONS as f64;
            Vector2::new((TAU * turn).cos(), (TAU * turn).sin()) * orbit_radius_mm
        });
        let way = ends_mm[0] - ends_mm[1];
        let length_mm = way.norm();
        let direction = if length_mm > MIN_STROKE_MM { way / length_mm } else { Vector2::zeros() };
        let bend_per_mm = contact.contact_surface.curvature_per_mm * direction;
        DiscStroke { contact, start_mm: ends_mm[0], direction, length_mm, bend_per_mm, orbit_mm }
    }

    /// Returns the largest distance from the disc's middle that the disc reaches, mm.
    pub fn reach_mm(&self) -> f64 {
        self.contact.pad.radius_mm + self.orbit_mm[0].norm()
    }

    /// Returns the mean pressure at a point while the disc moves past, N/mm². The point is given in mm from the
    /// segment's middle.
    pub fn mean_pressure_n_mm2(&self, place_mm: Vector2<f64>) -> f64 {
        if self.is_out_of_reach(place_mm) {
            return 0.0;
        }
        if self.orbit_mm[0] == Vector2::zeros() {
            return self.orbit_offset(place_mm);
        }
        self.orbit_mm.iter().map(|away| self.orbit_offset(place_mm - away)).sum::<f64>() / ORBIT_POSITIONS as f64
    }

    /// Returns whether the disc cannot reach a point.
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
    // If a parabola that is curved downwards, or a straight line, is positive at two points, it is positive between
    // them.
    if at_a >= 0.0 && at_b >= 0.0 && c2 <= 0.0 {
        return between(a, b);
    }
    let inner = c1 * c1 - 4.0 * c0 * c2;
    if inner <= 0.0 {
        return if at_a > 0.0 { between(a, b) } else { 0.0 };
    }
    // The numerically stable form of the roots; one of them is infinite if c₂ is 0.
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
    use super::*;
    use nalgebra::Matrix2;
    use proptest::prelude::*;

    const PAD: PadWithDisc = PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 };

    /// Integrates ∫ p dA numerically over a fine square grid, N.
    fn borne_n(contact: &Contact, below: impl Fn(Vector2<f64>) -> bool) -> f64 {
        let (count, side) = (600, 2.0 * contact.pad.radius_mm / 600.0);
        let at = |n: i32| (f64::from(n) + 0.5) * side - contact.pad.radius_mm;
        let places = (0..count * count).map(|n| Vector2::new(at(n % count), at(n / count)));
        places.filter(|place| below(*place)).map(|place| contact.pressure_n_mm2(place) * side * side).sum()
    }

    fn bent(k1: f64, k2: f64) -> ContactGeometry {
        ContactGeometry { curvature_per_mm: Matrix2::new(k1, 0.0, 0.0, k2), ..ContactGeometry::level() }
    }

    /// Expected values, calculated by hand: 20 N over π · 15² = 706.86 mm² are 0.028 294 N/mm², which compress a pad of
    /// 0.05 N/mm³ by 0.565 88 mm.
    #[test]
    fn a_level_disc_bears_its_force_evenly() {
        let contact = PAD.contact_at_force(20.0, ContactGeometry::level(), None).expect("contact");
        assert!((contact.depth_mm - 0.565_884).abs() < 1e-6, "{}", contact.depth_mm);
        for place in [Vector2::zeros(), Vector2::new(14.9, 0.0), Vector2::new(-8.0, 9.0)] {
            assert!((contact.pressure_n_mm2(place) - 0.028_294_2).abs() < 1e-7);
        }
        assert_eq!(contact.pressure_n_mm2(Vector2::new(15.1, 0.0)), 0.0);
    }

    /// Expected values, calculated by hand. On a sphere with a radius of 1000 mm, tr K = 0.002/mm; δ is larger by 225 ·
    /// 0.002 / 8 = 0.056 25 mm, and smaller at the rim by 225 · 0.001 / 2 = 0.1125 mm. A sphere of 100 mm with 2 N has
    /// contact in a circle of r⁴ = 4 F R / (π s): r = 8.452 mm, δ = r²/2R.
    #[test]
    fn a_sphere_is_in_contact_in_its_middle() {
        let contact = PAD.contact_at_force(20.0, bent(0.001, 0.001), None).expect("contact");
        assert!((contact.depth_mm - 0.622_134).abs() < 1e-6, "{}", contact.depth_mm);
        assert!((contact.pressure_n_mm2(Vector2::new(15.0, 0.0)) / 0.05 - (0.622_134 - 0.1125)).abs() < 1e-6);
        let small = PAD.contact_at_force(2.0, bent(0.01, 0.01), None).expect("contact");
        let radius_mm = (4.0 * 2.0 * 100.0 / (PI * 0.05)).powf(0.25);
        assert!((radius_mm - 8.447_5).abs() < 1e-3, "{radius_mm}");
        assert!((small.depth_mm / (radius_mm * radius_mm / 200.0) - 1.0).abs() < 0.005, "{}", small.depth_mm);
        assert_eq!(small.pressure_n_mm2(Vector2::new(9.0, 0.0)), 0.0, "the rim does not touch");
    }

    /// Expected values, calculated by hand for a disc tilted by 0.02 on a curvature of 1/80 by 1/60 mm with 5 N: c₀ =
    /// (5 · 0.014 434 / (π · 0.05))^½ = 0.677 8 mm, 1.6 mm beside the disc's middle. The ellipse reaches (2 · 0.677 8 ·
    /// 80)^½ = 10.41 mm from its middle. δ = c₀ − ½ · 0.02 · 1.6. The sum over points gives the same result.
    #[test]
    fn an_elliptic_contact_inside_the_disc_has_a_closed_form() {
        let seat = ContactGeometry { tilt: Vector2::new(0.02, 0.0), ..bent(1.0 / 80.0, 1.0 / 60.0) };
        let found_mm = PAD.inner_depth_mm(5.0, seat).expect("inside");
        assert!((found_mm - 0.661_8).abs() < 1e-4, "{found_mm}");
        let summed_mm = PAD.summed_depth_mm(5.0, seat, None).expect("a sum");
        assert!((summed_mm / found_mm - 1.0).abs() < 0.005, "{summed_mm} {found_mm}");
        // With 40 N, the contact would extend beyond the disc; on a cylinder, it always does.
        assert_eq!([PAD.inner_depth_mm(40.0, seat), PAD.inner_depth_mm(5.0, bent(0.01, 0.0))], [None, None]);
    }

    /// Calculated by hand: if half of the disc is beyond an edge, the pressure on the other half doubles; without
    /// material below the disc there is no contact.
    #[test]
    fn the_part_of_the_disc_beyond_the_edge_bears_no_force() {
        let half =
            PAD.contact_at_force(20.0, ContactGeometry::level(), Some(&|place| place.x < 0.0)).expect("contact");
        assert!((half.depth_mm / (2.0 * 0.565_884) - 1.0).abs() < 0.001, "{}", half.depth_mm);
        assert_eq!(PAD.contact_at_force(20.0, ContactGeometry::level(), Some(&|_| false)), None);
        assert_eq!(
            [0.0, -1.0, f64::NAN].map(|force_n| PAD.contact_at_force(force_n, ContactGeometry::level(), None)),
            [None; 3]
        );
    }

    /// Calculated by hand: a disc tilted by 0.1 touches on one side only. If the whole disc were in contact, c would be
    /// 0.566 − 1.5 at the rim, which is negative.
    #[test]
    fn a_tilted_disc_lifts_on_one_side_and_never_pulls() {
        let seat = ContactGeometry { tilt: Vector2::new(0.1, 0.0), ..ContactGeometry::level() };
        let contact = PAD.contact_at_force(20.0, seat, None).expect("contact");
        assert_eq!(contact.pressure_n_mm2(Vector2::new(-14.0, 0.0)), 0.0);
        assert!(contact.pressure_n_mm2(Vector2::new(14.0, 0.0)) > 0.05);
        assert!((borne_n(&contact, |_| true) / 20.0 - 1.0).abs() < 0.005);
    }

    proptest! {
        /// For any surface, tilt and edge, the integral of the pressure is the force, and no pressure is negative.
        #[test]
        fn the_pressures_add_up_to_the_force(
            force in 2.0..60.0f64, k1 in -0.004..0.01f64, k2 in -0.004..0.01f64, tilt in -0.05..0.05f64,
            edge in -9.0..15.0f64, turn in 0.0..6.3f64,
        ) {
            let seat = ContactGeometry { tilt: Vector2::new(tilt, -0.5 * tilt), ..bent(k1, k2) };
            let below = |place: Vector2<f64>| place.x * turn.cos() + place.y * turn.sin() < edge;
            let contact = PAD.contact_at_force(force, seat, Some(&below)).expect("contact");
            let borne = borne_n(&contact, below);
            prop_assert!((borne / force - 1.0).abs() < 0.03, "{} of {}", borne, force);
            let free = PAD.contact_at_force(force, seat, None).expect("contact");
            prop_assert!((borne_n(&free, |_| true) / force - 1.0).abs() < 0.02);
            prop_assert!(free.depth_mm <= contact.depth_mm + 0.2, "an edge never lessens the load of the rest");
        }
    }

    fn stroke(seat: ContactGeometry, orbit_radius_mm: f64) -> DiscStroke {
        let contact = PAD.contact_at_force(20.0, seat, None).expect("contact");
        DiscStroke::new(contact, [Vector2::new(-40.0, 0.0), Vector2::new(40.0, 0.0)], (orbit_radius_mm, 0))
    }

    /// Expected values, calculated by hand: a point in the middle of the lane is below the disc for 30 of 80 mm, a
    /// point 9 mm beside the middle for 24 mm, and a point 15 mm beside it never; p = 0.028 294 2 N/mm².
    #[test]
    fn the_pressure_at_a_place_follows_from_its_chord() {
        let level = stroke(ContactGeometry::level(), 0.0);
        for (y, chord_mm) in [(0.0, 30.0), (9.0, 24.0), (-9.0, 24.0), (15.0, 0.0)] {
            let found = level.mean_pressure_n_mm2(Vector2::new(3.0, y));
            assert!((found - 0.028_294_2 * chord_mm / 80.0).abs() < 1e-7, "{y}: {found}");
        }
        // A point 30 mm before the segment's middle is below the disc from the start of the segment on, for 10 + 15 mm.
        let found = level.mean_pressure_n_mm2(Vector2::new(-30.0, 0.0));
        assert!((found - 0.028_294_2 * 25.0 / 80.0).abs() < 1e-7, "{found}");
        let still = DiscStroke::new(level.contact, [Vector2::zeros(); 2], (0.0, 0));
        assert!((still.mean_pressure_n_mm2(Vector2::new(14.0, 0.0)) - 0.028_294_2).abs() < 1e-7);
    }

    /// Calculated by hand: the orbit moves pressure from inside of the rim to outside of the rim; the sum does not
    /// change.
    #[test]
    fn the_orbit_spreads_the_pressure_beyond_the_rim() {
        let [sharp, spread] = [0.0, 2.5].map(|radius_mm| stroke(ContactGeometry::level(), radius_mm));
        let at = |stroke: &DiscStroke, y: f64| stroke.mean_pressure_n_mm2(Vector2::new(0.0, y));
        assert!(at(&sharp, 16.0) == 0.0 && at(&spread, 16.0) > 0.0 && at(&spread, 14.0) < at(&sharp, 14.0));
        let sum = |stroke: &DiscStroke| (-200..=200).map(|n| at(stroke, f64::from(n) * 0.1)).sum::<f64>();
        assert!((sum(&spread) / sum(&sharp) - 1.0).abs() < 0.002);
        assert_eq!((sharp.reach_mm(), spread.reach_mm()), (15.0, 17.5));
    }

    proptest! {
        #[test]
        fn the_integral_of_the_positive_part_equals_a_sum(
            c0 in -1.0..1.0f64, c1 in -1.0..1.0f64, c2 in prop_oneof![Just(0.0), -1.0..1.0f64], a in -3.0..0.0f64, b in 0.0..3.0f64,
        ) {
            let slices = 40_000;
            let step = (b - a) / f64::from(slices);
            let at = |n: i32| a + (f64::from(n) + 0.5) * step;
            let sum: f64 = (0..slices).map(|n| (c0 + at(n) * (c1 + at(n) * c2)).max(0.0) * step).sum();
            let found = positive_part([c0, c1, c2], [a, b]);
            prop_assert!((found - sum).abs() < 1e-5, "{} {}", found, sum);
        }

        /// The mean pressure over the segment equals the mean over many discs at rest.
        #[test]
        fn a_stroke_equals_the_mean_of_many_discs_at_rest(
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
