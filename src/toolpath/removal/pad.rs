//! The pressure below a disc: an elastic pad on a curved surface, loaded by a force, at a given tilt, cut off where
//! the panel ends.
//!
//!     p = s · max(c, 0),   c = δ + t·x − ½ xᵀ K x,   ∫ p dA = F                                           (4), (5)
//! F grows with δ at an increasing rate, so Newton's steps from too large a δ approach the root from above without
//! passing it. If the whole disc is on the panel and in contact, the integral has a closed form: the mean of t·x over
//! a disc is 0, that of ½ xᵀ K x is R² tr K / 8, so δ = F / (π R² s) + R² tr K / 8. It also has a closed form if the
//! surface bends away in both directions and the contact is an ellipse wholly inside the disc. With x₀ = K⁻¹ t being
//! the ellipse's middle and c₀ = δ + ½ t·x₀ the compression there, the paraboloid above it contains π c₀² / √det K, so
//! c₀² = F √det K / (π s). Otherwise the integral is a sum over places of equal area on rings and spokes, so that the
//! disc's own edge is exact.
//!
//! Beyond the panel's edge the disc presses on nothing: the rest of the disc bears the force, and no place pulls. The
//! tilt is given (see the parent module).

use nalgebra::{Matrix2, Vector2};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Number of rings of equal area; the next constant is the number of places on each ring.
const RINGS: usize = 28;
const SPOKE_COUNT: usize = 44;
/// Largest number of Newton steps; usually about four are enough.
const STEPS: usize = 60;
/// Relative tolerance of the force.
const FORCE_TOLERANCE: f64 = 1e-9;

/// A pad with the disc on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PadWithDisc {
    /// Radius of the disc, mm.
    pub radius_mm: f64,
    /// The pad's modulus over its thickness, N/mm³.
    pub stiffness_n_mm3: f64,
}

/// The shape of the surface below the disc, in the tangent plane at the disc's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactGeometry {
    /// Additional depth of the disc per mm along x and y.
    pub tilt: Vector2<f64>,
    /// Curvature of the surface, 1/mm, positive if the surface bends away from the disc.
    pub curvature_per_mm: Matrix2<f64>,
}

/// A function that returns whether there is panel at this offset from the disc's middle, mm.
pub type SupportMask<'a> = &'a dyn Fn(Vector2<f64>) -> bool;

/// A disc in contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The pad.
    pub pad: PadWithDisc,
    /// The surface on which the disc lies.
    pub contact_surface: ContactGeometry,
    /// Compression in the disc's middle, δ, mm; below 0 if a tilted disc does not touch there.
    pub depth_mm: f64,
}

impl ContactGeometry {
    /// Returns the geometry of a plane without tilt.
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

    /// Returns the contact at which the pad bears this force, N. `below` states where there is panel; without it there
    /// is panel everywhere. `None` if there is no panel below the disc, or no force.
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

    /// Returns δ if the contact is an ellipse inside the disc; `None` if it is not.
    fn inner_depth_mm(&self, force_n: f64, seat: ContactGeometry) -> Option<f64> {
        let bend = seat.curvature_per_mm;
        let least_bend = bend.symmetric_eigenvalues().min();
        let middle_mm = if least_bend > 0.0 { bend.try_inverse()? * seat.tilt } else { return None };
        let peak_mm = (force_n * bend.determinant().sqrt() / (PI * self.stiffness_n_mm3)).sqrt();
        // The longest half-axis from a middle that the tilt has moved: if that stays inside of the disc, the rim plays
        // no part.
        let reach_mm = middle_mm.norm() + (2.0 * peak_mm / least_bend).sqrt();
        (reach_mm <= self.radius_mm).then(|| peak_mm - 0.5 * seat.tilt.dot(&middle_mm))
    }

    /// Returns whether the whole disc is in contact at this depth. The largest reductions by tilt and by curvature are
    /// added, which gives a safe bound.
    fn is_full_contact(&self, seat: ContactGeometry, depth_mm: f64) -> bool {
        let (radius_mm, bends) = (self.radius_mm, seat.curvature_per_mm.symmetric_eigenvalues());
        let fall_mm = 0.5 * radius_mm * radius_mm * bends.max().max(0.0);
        depth_mm - seat.tilt.norm() * radius_mm - fall_mm > 0.0
    }

    /// Calculates δ by summing over the places that have panel below them.
    fn summed_depth_mm(&self, force_n: f64, seat: ContactGeometry, below: Option<SupportMask<'_>>) -> Option<f64> {
        let deeper_mm: Vec<f64> = self
            .disc_places()
            .filter(|place| below.is_none_or(|below| below(*place)))
            .map(|place| seat.deeper_mm(place))
            .collect();
        if deeper_mm.is_empty() {
            return None;
        }
        let each = self.stiffness_n_mm3 * self.area_mm2() / (RINGS * SPOKE_COUNT) as f64;
        let mean_mm = deeper_mm.iter().sum::<f64>() / deeper_mm.len() as f64;
        // Start value: the depth if every place were in contact, even with a pulling force. This depth never exceeds
        // the solution.
        let mut depth_mm = force_n / (each * deeper_mm.len() as f64) - mean_mm;
        for _ in 0..STEPS {
            let pressed = deeper_mm.iter().filter(|deeper| depth_mm + **deeper > 0.0);
            let (sum_mm, count) = pressed.fold((0.0, 0_usize), |(sum, n), deeper| (sum + depth_mm + deeper, n + 1));
            let over_n = each * sum_mm - force_n;
            if over_n.abs() <= FORCE_TOLERANCE * force_n || count == 0 {
                break;
            }
            // The force is convex in the depth, so that Newton's steps settle from one side and need no damping.
            depth_mm -= over_n / (each * count as f64);
        }
        Some(depth_mm)
    }

    /// Returns places of equal area over the disc, mm from its middle.
    fn disc_places(&self) -> impl Iterator<Item = Vector2<f64>> + use<> {
        let radius_mm = self.radius_mm;
        UNIT_PLACES.iter().map(move |place| place * radius_mm)
    }
}

/// Places of equal area over a disc of radius 1; every second ring is turned by half a spoke.
static UNIT_PLACES: LazyLock<Vec<Vector2<f64>>> = LazyLock::new(|| {
    let place = |index: usize| {
        let (ring, spoke) = ((index / SPOKE_COUNT) as f64, (index % SPOKE_COUNT) as f64);
        let angle = TAU * (spoke + 0.25 + 0.5 * (ring % 2.0)) / SPOKE_COUNT as f64;
        Vector2::new(angle.cos(), angle.sin()) * ((ring + 0.5) / RINGS as f64).sqrt()
    };
    (0..RINGS * SPOKE_COUNT).map(place).collect()
});

impl Contact {
    /// Returns the pressure at an offset from the disc's middle, N/mm², if there is panel.
    pub fn pressure_n_mm2(&self, offset_mm: Vector2<f64>) -> f64 {
        if offset_mm.norm_squared() > self.pad.radius_mm * self.pad.radius_mm {
            return 0.0;
        }
        self.pad.stiffness_n_mm3 * (self.depth_mm + self.contact_surface.deeper_mm(offset_mm)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PAD: PadWithDisc = PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 };

    /// Integrates ∫ p dA over a fine square net, N.
    fn borne_n(contact: &Contact, below: impl Fn(Vector2<f64>) -> bool) -> f64 {
        let (count, side) = (600, 2.0 * contact.pad.radius_mm / 600.0);
        let at = |n: i32| (f64::from(n) + 0.5) * side - contact.pad.radius_mm;
        let places = (0..count * count).map(|n| Vector2::new(at(n % count), at(n / count)));
        places.filter(|place| below(*place)).map(|place| contact.pressure_n_mm2(place) * side * side).sum()
    }

    fn bent(k1: f64, k2: f64) -> ContactGeometry {
        ContactGeometry { curvature_per_mm: Matrix2::new(k1, 0.0, 0.0, k2), ..ContactGeometry::level() }
    }

    /// Calculated by hand: 20 N over π · 15² = 706.86 mm² is 0.028 294 N/mm², which compresses a pad of 0.05 N/mm³
    /// by 0.565 88 mm.
    #[test]
    fn a_level_disc_bears_its_force_evenly() {
        let contact = PAD.contact_at_force(20.0, ContactGeometry::level(), None).expect("contact");
        assert!((contact.depth_mm - 0.565_884).abs() < 1e-6, "{}", contact.depth_mm);
        for place in [Vector2::zeros(), Vector2::new(14.9, 0.0), Vector2::new(-8.0, 9.0)] {
            assert!((contact.pressure_n_mm2(place) - 0.028_294_2).abs() < 1e-7);
        }
        assert_eq!(contact.pressure_n_mm2(Vector2::new(15.1, 0.0)), 0.0);
    }

    /// Calculated by hand: on a sphere with a radius of 1000 mm, tr K = 0.002/mm, δ is larger by 225 · 0.002 / 8 =
    /// 0.056 25 mm, and smaller at the rim by 225 · 0.001 / 2 = 0.1125. A sphere of 100 mm with 2 N touches in a
    /// circle of r⁴ = 4 F R / (π s): r = 8.452 mm, δ = r²/2R.
    #[test]
    fn a_ball_is_pressed_in_its_middle() {
        let contact = PAD.contact_at_force(20.0, bent(0.001, 0.001), None).expect("contact");
        assert!((contact.depth_mm - 0.622_134).abs() < 1e-6, "{}", contact.depth_mm);
        assert!((contact.pressure_n_mm2(Vector2::new(15.0, 0.0)) / 0.05 - (0.622_134 - 0.1125)).abs() < 1e-6);
        let small = PAD.contact_at_force(2.0, bent(0.01, 0.01), None).expect("contact");
        let radius_mm = (4.0 * 2.0 * 100.0 / (PI * 0.05)).powf(0.25);
        assert!((radius_mm - 8.447_5).abs() < 1e-3, "{radius_mm}");
        assert!((small.depth_mm / (radius_mm * radius_mm / 200.0) - 1.0).abs() < 0.005, "{}", small.depth_mm);
        assert_eq!(small.pressure_n_mm2(Vector2::new(9.0, 0.0)), 0.0, "the rim does not touch");
    }

    /// Calculated by hand: tilted by 0.02 on a curvature of 1/80 by 1/60 mm, 5 N: c₀ = (5 · 0.014 434 / (π · 0.05))^½
    /// = 0.677 8 mm, 1.6 mm aside. The ellipse reaches (2 · 0.677 8 · 80)^½ = 10.41 mm from its middle. δ = c₀ − ½ ·
    /// 0.02 · 1.6. The sum over places gives the same result.
    #[test]
    fn an_ellipse_inside_of_the_disc_is_closed() {
        let seat = ContactGeometry { tilt: Vector2::new(0.02, 0.0), ..bent(1.0 / 80.0, 1.0 / 60.0) };
        let found_mm = PAD.inner_depth_mm(5.0, seat).expect("inside");
        assert!((found_mm - 0.661_8).abs() < 1e-4, "{found_mm}");
        let summed_mm = PAD.summed_depth_mm(5.0, seat, None).expect("a sum");
        assert!((summed_mm / found_mm - 1.0).abs() < 0.005, "{summed_mm} {found_mm}");
        // With 40 N, the contact would reach beyond the disc; on a cylinder, it always does.
        assert_eq!([PAD.inner_depth_mm(40.0, seat), PAD.inner_depth_mm(5.0, bent(0.01, 0.0))], [None, None]);
    }

    /// Calculated by hand: if half of the disc is beyond an edge, the pressure on the other half doubles; with
    /// nothing below the disc there is no contact.
    #[test]
    fn what_hangs_over_bears_nothing() {
        let half =
            PAD.contact_at_force(20.0, ContactGeometry::level(), Some(&|place| place.x < 0.0)).expect("contact");
        assert!((half.depth_mm / (2.0 * 0.565_884) - 1.0).abs() < 0.001, "{}", half.depth_mm);
        assert_eq!(PAD.contact_at_force(20.0, ContactGeometry::level(), Some(&|_| false)), None);
        assert_eq!(
            [0.0, -1.0, f64::NAN].map(|force_n| PAD.contact_at_force(force_n, ContactGeometry::level(), None)),
            [None; 3]
        );
    }

    /// By hand: tilted by 0.1 the disc touches on one side only. If the whole disc were in contact, c would be 0.566 −
    /// 1.5 at the rim.
    #[test]
    fn a_tilted_disc_lifts_on_one_side_and_never_pulls() {
        let seat = ContactGeometry { tilt: Vector2::new(0.1, 0.0), ..ContactGeometry::level() };
        let contact = PAD.contact_at_force(20.0, seat, None).expect("contact");
        assert_eq!(contact.pressure_n_mm2(Vector2::new(-14.0, 0.0)), 0.0);
        assert!(contact.pressure_n_mm2(Vector2::new(14.0, 0.0)) > 0.05);
        assert!((borne_n(&contact, |_| true) / 20.0 - 1.0).abs() < 0.005);
    }

    proptest! {
        /// For any surface, tilt and edge, the pressures add up to the force, and no pressure is negative.
        #[test]
        fn the_force_is_borne(
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
}
