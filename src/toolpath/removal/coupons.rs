//! The measured depths on test coupons, and the exposure of each coupon according to the model.
//!
//! A coupon is flat and is sanded with straight lines. On a coupon with one line over its middle, the measured point in
//! the middle is under the disc while the disc moves by its chord. For one pass and k = 1 mm²/N the depth at this point
//! is
//!     X = F / (π R²) · c · v(f)/f,   c = 2 R · (2/π) E((e/R)²),
//! with e the radius of the orbit, because the orbit also moves the disc's rim. In a field of rows at the distance s,
//! the depth is the mean over one distance between rows in the middle of the field, and every mm² has the same
//! exposure: X = F · v(f)/f / s. Then h = k X, and ln h − ln X = ln k₀ − b w.

use super::pad::PadWithDisc;
use super::speed::{Orbit, elliptic_e};
use std::f64::consts::PI;

/// The way in which a coupon was sanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lines {
    /// One line, sanded repeatedly; the depth is measured in its middle.
    One,
    /// Rows at this distance, mm, over a width of more than the disc's diameter; the depth is the mean in the middle.
    Rows(f64),
}

/// A measured point on a coupon, with the treatment of the coupon.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupon {
    /// Line number of the measurement in the table.
    pub line: u64,
    /// Name of the coupon and of the measured point on the coupon.
    pub name: String,
    /// Name of the disc that sanded the coupon; `None` if the table does not contain it.
    pub disc: Option<String>,
    /// Force of the tool, N.
    pub force_n: f64,
    /// Feed of the tool, mm/s.
    pub feed_mm_s: f64,
    /// Number of passes.
    pub passes: f64,
    /// The lines of a pass.
    pub lines: Lines,
    /// Area that the disc had swept before it reached the measured point, mm².
    pub worn_mm2: f64,
    /// Depth removed, µm.
    pub depth_um: f64,
}

/// The tool with which the coupons were sanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CouponTool {
    /// The disc on its pad.
    pub pad: PadWithDisc,
    /// The orbital motion of the disc.
    pub orbit: Orbit,
}

impl Coupon {
    /// Calculates the exposure X: the depth, mm, for k = 1 mm²/N.
    pub fn exposure_n_mm(&self, tool: &CouponTool) -> f64 {
        let (radius_mm, area_mm2) = (tool.pad.radius_mm, tool.pad.area_mm2());
        let per_pass = match self.lines {
            Lines::One => {
                let share = (tool.orbit.diameter_mm / 2.0 / radius_mm).min(1.0);
                2.0 * radius_mm * 2.0 / PI * elliptic_e(share * share) / area_mm2
            }
            Lines::Rows(apart_mm) => 1.0 / apart_mm,
        };
        self.passes * self.force_n * tool.orbit.rubbed_per_mm(self.feed_mm_s) * per_pass
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::removal) const TOOL: CouponTool = CouponTool {
        pad: PadWithDisc { radius_mm: 15.0, stiffness_n_mm3: 0.05 },
        orbit: Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 },
    };

    pub(in crate::removal) fn coupon(lines: Lines) -> Coupon {
        let (force_n, feed_mm_s, passes, worn_mm2, depth_um) = (20.0, 60.0, 2.0, 0.0, 30.0);
        let (name, disc) = ("A1".to_owned(), None);
        Coupon { line: 2, name, disc, force_n, feed_mm_s, passes, lines, worn_mm2, depth_um }
    }

    /// Expected values, calculated by hand: v/f = 2618.34/60 = 43.639. One line: 2 · 20 N / 706.86 mm² · 30 mm · 0.993
    /// · 43.639 = 73.57 N/mm; rows of 12 mm: 2 · 20 · 43.639 / 12 = 145.46 N/mm.
    #[test]
    fn exposures_of_coupons_agree_with_hand_calculation() {
        let one = coupon(Lines::One).exposure_n_mm(&TOOL);
        assert!((one - 74.085 * (1.0 - 1.0 / 144.0)).abs() < 0.01, "{one}");
        let rows = coupon(Lines::Rows(12.0)).exposure_n_mm(&TOOL);
        assert!((rows - 145.463).abs() < 0.001, "{rows}");
    }
}
