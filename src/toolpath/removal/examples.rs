//! Removal models for tests.

use super::model::Model;
use super::power::Power;
use super::speed::Orbit;
use nalgebra::Matrix2;

/// A model with k₀ = 4·10⁻⁴ mm²/N ± 2 %, wear 0.8/m² ± 0.1/m², and a coupon scatter of 3 %.
pub const MODEL: Model = Model {
    preston_mm2_per_n: 4e-4,
    decay_per_mm2: 0.8e-6,
    covariance: Matrix2::new(4e-4, 1e-9, 1e-9, 1e-14),
    coupon_deviation: 0.03,
    disc_deviation: 0.0,
    redundancy: 10.0,
    orbit: Orbit { diameter_mm: 5.0, speed_rev_min: 10_000.0 },
    pad_n_mm3: 0.05,
    forces_n: Some([15.0, 30.0]),
    force_power: Some(Power { value: 1.02, uncertainty: 0.05 }),
};

/// A model of a disc that does not wear, determined from coupons that follow Preston's law exactly.
pub const NO_WEAR_MODEL: Model = Model {
    decay_per_mm2: 0.0,
    covariance: Matrix2::new(4e-4, 0.0, 0.0, 0.0),
    force_power: Some(Power { value: 1.0, uncertainty: 0.0 }),
    ..MODEL
};
