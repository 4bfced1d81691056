//! The speed of an abrasive grain over the panel while the disc orbits and moves along the path.
//!
//!     v = (1/2π) ∮ |u + f| dφ = (2/π) (u + f) E(m),   m = 4 u f / (u + f)²                                 (2)
//! u is the speed on the orbit, f the feed, and E the complete elliptic integral of the second kind with the parameter
//! m, calculated by the arithmetic-geometric mean. Source: Abramowitz & Stegun, Handbook of Mathematical Functions,
//! 17.3.3 and 17.6.

use std::f64::consts::PI;

/// Maximum number of steps of the arithmetic-geometric mean; each step doubles the number of correct digits.
const MAX_MEAN_STEPS: usize = 40;
/// Number of bisections in the search for a feed.
const BISECTION_STEPS: usize = 60;

/// The orbital motion of the disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Diameter of the circle on which a grain moves, mm.
    pub diameter_mm: f64,
    /// Rotation speed of the orbit, rev/min.
    pub speed_rev_min: f64,
}

impl Orbit {
    /// Returns the speed on the orbit, mm/s.
    pub fn speed_mm_s(&self) -> f64 {
        PI * self.diameter_mm * self.speed_rev_min / 60.0
    }

    /// Returns the mean speed of a grain over the panel at this feed, mm/s.
    pub fn grain_mm_s(&self, feed_mm_s: f64) -> f64 {
        let (u, f) = (self.speed_mm_s(), feed_mm_s.abs());
        let sum = u + f;
        if sum <= 0.0 { 0.0 } else { 2.0 / PI * sum * elliptic_e(4.0 * u * f / (sum * sum)) }
    }

    /// Returns the length over which a grain rubs per mm of the disc's path at this feed, mm/mm: at least 1, and more
    /// at a lower feed.
    pub fn rubbed_per_mm(&self, feed_mm_s: f64) -> f64 {
        self.grain_mm_s(feed_mm_s) / feed_mm_s
    }

    /// Returns the feed between the limits `low` and `high` at which a grain rubs over this length per mm of the disc's
    /// path; the nearer limit if there is no such feed.
    pub fn feed_mm_s(&self, rubbed_per_mm: f64, [mut low, mut high]: [f64; 2]) -> f64 {
        for _ in 0..BISECTION_STEPS {
            let middle = 0.5 * (low + high);
            if self.rubbed_per_mm(middle) > rubbed_per_mm { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// Calculates the elliptic integral E(m), 0 ≤ m ≤ 1.
pub(super) fn elliptic_e(m: f64) -> f64 {
    if m >= 1.0 - 1e-15 {
        return 1.0;
    }
    let (mut a, mut g, mut weight, mut sum) = (1.0, (1.0 - m).sqrt(), 0.5, 0.5 * m);
    for _ in 0..MAX_MEAN_STEPS {
        let c = 0.5 * (a - g);
        (a, g) = (0.5 * (a + g), (a * g).sqrt());
        weight *= 2.0;
        sum += weight * c * c;
        if c.abs() < 1e-16 * a {
            break;
        }
    }
    PI / (2.0 * a) * (1.0 - sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ORBIT: Orbit = Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 };

    /// Expected values from tables: E(0) = π/2, E(1/2) = 1.350 643 881, E(1) = 1.
    #[test]
    fn the_elliptic_integral_agrees_with_tables() {
        assert!((elliptic_e(0.0) - PI / 2.0).abs() < 1e-15 && elliptic_e(1.0) == 1.0);
        assert!((elliptic_e(0.5) - 1.350_643_881_047_675).abs() < 1e-14, "{}", elliptic_e(0.5));
    }

    /// Expected values, calculated by hand: π · 5 mm · 10 000 / 60 s = 2617.99 mm/s. Without an orbit a grain moves
    /// with the feed, and without a feed it moves on its orbit. If both speeds are equal, the mean of |1 + e^{iφ}| is
    /// 4/π.
    #[test]
    fn the_mean_over_an_orbit() {
        assert!((ORBIT.speed_mm_s() - 2_617.993_878).abs() < 1e-5);
        assert!((ORBIT.grain_mm_s(0.0) - ORBIT.speed_mm_s()).abs() < 1e-9);
        let still = Orbit { speed_rev_min: 0.0, ..ORBIT };
        assert!((still.grain_mm_s(60.0) - 60.0).abs() < 1e-12 && still.grain_mm_s(0.0) == 0.0);
        let slow = Orbit { diameter_mm: 60.0 / PI, speed_rev_min: 60.0 };
        assert!((slow.grain_mm_s(60.0) - 60.0 * 4.0 / PI).abs() < 1e-6, "{}", slow.grain_mm_s(60.0));
        // A feed f adds f²/4u to the speed of a fast orbit u: 60²/(4 · 2618) = 0.344 mm/s.
        assert!((ORBIT.grain_mm_s(60.0) - ORBIT.speed_mm_s() - 0.343_77).abs() < 1e-4);
    }

    proptest! {
        /// Compares the closed form with the sum over 20,000 positions on the orbit.
        #[test]
        fn the_closed_form_is_the_mean(u in 1.0..500.0f64, share in 0.0..3.0f64) {
            let orbit = Orbit { diameter_mm: u / PI, speed_rev_min: 60.0 };
            let f = share * u;
            let at = |n: i32| (f64::from(n) + 0.5) * 2.0 * PI / 20_000.0;
            let mean = (0..20_000).map(|n| (u * at(n).cos() + f).hypot(u * at(n).sin())).sum::<f64>() / 20_000.0;
            prop_assert!((orbit.grain_mm_s(f) / mean - 1.0).abs() < 1e-6);
        }

        #[test]
        fn a_feed_is_found_again(feed in 2.0..200.0f64) {
            let rubbed = ORBIT.rubbed_per_mm(feed);
            prop_assert!((ORBIT.feed_mm_s(rubbed, [1.0, 300.0]) / feed - 1.0).abs() < 1e-6);
            prop_assert!(ORBIT.rubbed_per_mm(feed * 1.01) < rubbed);
        }
    }

    #[test]
    fn a_feed_out_of_bounds_is_the_nearer_bound() {
        assert!((ORBIT.feed_mm_s(1e9, [5.0, 60.0]) - 5.0).abs() < 1e-6);
        assert!((ORBIT.feed_mm_s(0.0, [5.0, 60.0]) - 60.0).abs() < 1e-6);
    }
}
