//! Test coupons of the simulated cell, with which `panelprep calibrate removal` is tried.

use super::disk;
use super::fault::Fault;
use super::rendered::Rendered;
use crate::removal::coupons::{Coupon, CouponTool, Lines};
use crate::removal::pad::Pad;
use crate::removal::speed::Orbit;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write;

/// The default disc diameter of a recipe, mm.
pub const DISC_DIAMETER_MM: f64 = 30.0;
/// The simulated sander, with an orbit of 5 mm.
pub const TOOL: CouponTool = CouponTool {
    pad: Pad { radius_mm: DISC_DIAMETER_MM / 2.0, stiffness_n_mm3: 0.05 },
    orbit: Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 },
};
/// The disc's removal coefficient, mm²/N, and its decay with wear, 1/mm².
const PRESTON_MM2_PER_N: f64 = 4e-4;
const DECAY_PER_MM2: f64 = 0.8e-6;
/// Maximum relative difference of a coupon's removal from the mean, in both directions.
const DIFFER: f64 = 0.05;
const COUPONS: usize = 12;
/// The forces on the coupons, N.
const FORCES_N: [f64; 2] = [20.0, 10.0];

/// Writes `boards/coupons.csv`: thicknesses before and after, with new and worn discs.
///
/// # Errors
/// If writing to the disk fails.
pub fn write(seed: u64, rendered: &Rendered) -> Result<(), Fault> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut text = "# two forces, single lines, measured in their middle; worn_mm2 as `panelprep plan` reports \
                    it\ncoupon,place,force_n,feed_mm_s,passes,worn_mm2,before_um,after_um\n"
        .to_owned();
    for index in 0..COUPONS {
        let (passes, worn_mm2) = ([1.0, 2.0, 4.0][index % 3], 130_000.0 * (index / 3) as f64);
        let (name, lines) = (format!("C{}", index / 3 + 1), Lines::One);
        // The forces are below and above those in the recipes of the simulated cell.
        let force_n = FORCES_N[index / 3 % 2];
        let coupon = Coupon { line: 0, name, force_n, feed_mm_s: 60.0, passes, lines, worn_mm2, depth_um: 0.0 };
        let own = 1.0 + random.random_range(-DIFFER..DIFFER);
        let k = PRESTON_MM2_PER_N * (-DECAY_PER_MM2 * worn_mm2).exp();
        let depth_um = 1_000.0 * k * coupon.exposure_n_mm(&TOOL) * own;
        let before_um = 120.0 + random.random_range(-2.0..2.0);
        let place = ["left", "middle", "right"][index % 3];
        let after_um = before_um - depth_um;
        #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
        let _ =
            writeln!(text, "{},{place},{force_n},60,{passes},{worn_mm2},{before_um:.2},{after_um:.2}", coupon.name);
    }
    disk::write(&rendered.file("boards/coupons.csv"), text)
}
