//! Test coupons of the simulated cell, with which `panelprep calibrate removal` is tried.

use super::disk;
use super::fault::Fault;
use super::rendered::RenderedFiles;
use panelprep_toolpath::removal::coupons::{Coupon, CouponTool, Lines};
use panelprep_toolpath::removal::pad::PadWithDisc;
use panelprep_toolpath::removal::speed::Orbit;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write;

/// The default disc diameter of a recipe, mm.
pub const DISC_DIAMETER_MM: f64 = 30.0;
/// The simulated sander, with an orbit of 5 mm.
pub const TOOL: CouponTool = CouponTool {
    pad: PadWithDisc { radius_mm: DISC_DIAMETER_MM / 2.0, stiffness_n_mm3: 0.05 },
    orbit: Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 },
};
/// The disc's removal coefficient, mm²/N, and its decay with wear, 1/mm².
const PRESTON_MM2_PER_N: f64 = 4e-4;
const DECAY_PER_MM2: f64 = 0.8e-6;
/// Maximum relative difference of a coupon's removal from the mean of its disc, in both directions.
const MAX_RELATIVE_DIFFERENCE: f64 = 0.05;
/// The same for a disc's from the mean of all discs.
const DISCS_DIFFER: f64 = 0.03;
/// Measured places on each coupon.
const MEASURED_PLACES: [&str; 3] = ["left", "middle", "right"];
/// For each coupon its force, N, and the area that its disc had swept, mm²; two coupons for each disc.
const COUPONS: [(f64, f64); 8] = [
    (20.0, 0.0),
    (10.0, 390_000.0),
    (10.0, 130_000.0),
    (20.0, 260_000.0),
    (20.0, 390_000.0),
    (10.0, 0.0),
    (10.0, 260_000.0),
    (20.0, 130_000.0),
];

/// Writes `boards/coupons.csv`: thicknesses before and after, with new and worn discs.
///
/// # Errors
/// If writing to the disk fails.
pub fn write(seed: u64, rendered: &RenderedFiles) -> Result<(), Fault> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut text = "# two forces, single lines, measured in their middle; worn_mm2 as `panelprep plan` reports \
                    it\ncoupon,place,disc,force_n,feed_mm_s,passes,worn_mm2,before_um,after_um\n"
        .to_owned();
    let discs: Vec<f64> =
        (0..COUPONS.len() / 2).map(|_| 1.0 + random.random_range(-DISCS_DIFFER..DISCS_DIFFER)).collect();
    for index in 0..MEASURED_PLACES.len() * COUPONS.len() {
        let number = index / MEASURED_PLACES.len();
        // The forces are below and above those in the recipes of the simulated cell.
        let (passes, (force_n, worn_mm2)) = ([1.0, 2.0, 4.0][index % 3], COUPONS[number]);
        let (name, disc, lines) = (format!("C{}", number + 1), format!("D{}", number / 2 + 1), Lines::One);
        let coupon = Coupon {
            line: 0,
            name,
            disc: Some(disc.clone()),
            force_n,
            feed_mm_s: 60.0,
            passes,
            lines,
            worn_mm2,
            depth_um: 0.0,
        };
        let own =
            discs[number / 2] * (1.0 + random.random_range(-MAX_RELATIVE_DIFFERENCE..MAX_RELATIVE_DIFFERENCE));
        let k = PRESTON_MM2_PER_N * (-DECAY_PER_MM2 * worn_mm2).exp();
        let depth_um = 1_000.0 * k * coupon.exposure_n_mm(&TOOL) * own;
        let before_um = 120.0 + random.random_range(-2.0..2.0);
        let place = MEASURED_PLACES[index % MEASURED_PLACES.len()];
        let after_um = before_um - depth_um;
        #[expect(clippy::let_underscore_must_use, reason = "writing to a `String` cannot fail")]
        let _ = writeln!(
            text,
            "{},{place},{disc},{force_n},60,{passes},{worn_mm2},{before_um:.2},{after_um:.2}",
            coupon.name
        );
    }
    disk::write(&rendered.file_path("boards/coupons.csv"), text)
}
