//! Preston's coefficient from coupons: its decay with the area that the disc has swept, and its uncertainty.
//!
//!     k(w) = k₀ exp(−b w)                                                                                  (3)
//!     σ²(w) = var(ln k₀) − 2 w cov(ln k₀, b) + w² var(b) + σ_r² + σ_d² + σ_F²                              (6)
//! σ_r is the standard deviation of a coupon from the model, σ_d that of a disc, σ_F that of the force. The error of
//! the coupons' measured force is also contained in σ_r, so σ is too large rather than too small. With 95 % the true
//! depth lies within exp(± q σ) of the expected one, with q Student's quantile for the degrees of freedom of σ_r and
//! σ_d.

use super::power::{MIN_LEVEL_RATIO, Power};
use super::speed::Orbit;
use nalgebra::Matrix2;
use panelprep_base::geometry::statistics::student_95;
use panelprep_cell::cell::RemovalNumbers;

/// Square millimetres per square metre.
pub const MM2_PER_M2: f64 = 1e6;
/// The message if a recipe requires a removal and the cell has no removal model.
pub const NO_MODEL_MESSAGE: &str = "the recipe has [removal], but the cell's file names no [calibration] removal, so it is \
                           unknown whether max_um is exceeded; measure coupons and name the file that `panelprep \
                           calibrate removal` writes";
/// Micrometres per millimetre.
pub const UM_PER_MM: f64 = 1_000.0;
/// Number of parameters of the fitted line; the degrees of freedom are the number of coupons minus this.
const FITTED_PARAMETERS: usize = 2;
/// Half-width of the normal distribution's 95 % interval in standard deviations, for the stated error of a force.
const NORMAL_95: f64 = 1.959_963_984_540_054;

/// A removal model: Preston's coefficient with its uncertainty, disc and pad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// Preston's coefficient of a new disc, k₀, mm²/N.
    pub preston_mm2_per_n: f64,
    /// Decay of the coefficient with the swept area, b, 1/mm².
    pub decay_per_mm2: f64,
    /// Covariance of ln k₀ and b.
    pub covariance: Matrix2<f64>,
    /// Scatter from coupon to coupon, σ_r: standard deviation of the logarithm of the depth.
    pub coupon_deviation: f64,
    /// Scatter from disc to disc, σ_d; at least [`UNKNOWN_DISC_DEVIATION`] if the coupons were sanded with fewer than
    /// [`MIN_DISCS`] discs.
    pub disc_deviation: f64,
    /// Effective degrees of freedom of σ_r and σ_d.
    pub redundancy: f64,
    /// The orbital motion of the disc.
    pub orbit: Orbit,
    /// The pad's modulus divided by its thickness, N/mm³.
    pub pad_n_mm3: f64,
    /// The minimum and maximum force on a coupon, N; `None` if the calibration does not contain them.
    pub forces_n: Option<[f64; 2]>,
    /// The exponent of the force in the depth; `None` if the coupons do not determine it.
    pub force_power: Option<Power>,
}

/// Factor beyond the coupons' minimum and maximum force up to which the model is valid, if the coupons show that the
/// depth is proportional to the force.
pub const FORCE_RANGE: f64 = MIN_LEVEL_RATIO;
/// The same factor if the coupons do not show this.
const FORCE_RANGE_FACTOR: f64 = 1.15;
/// Scatter σ from disc to disc that is assumed if the coupons do not show it: the largest measured scatter that needs
/// no review.
pub(super) const UNKNOWN_DISC_DEVIATION: f64 = 0.10;
/// Minimum number of discs at which the coupons show the scatter between discs.
pub(super) const MIN_DISCS: usize = 3;
/// Assumed 95 % uncertainty of the force's exponent if the coupons do not determine it.
const DEFAULT_POWER_UNCERTAINTY: f64 = 0.5;

impl From<&RemovalNumbers> for Model {
    fn from(found: &RemovalNumbers) -> Self {
        let deviations = [found.preston_deviation_percent() / 100.0, found.wear_deviation_per_m2() / MM2_PER_M2];
        let (coupons, discs) =
            (found.coupons().saturating_sub(FITTED_PARAMETERS).max(1) as f64, found.discs() as f64);
        let coupon = found.coupon_deviation_percent() / 100.0;
        let measured = found.disc_deviation_percent().map(|percent| percent / 100.0);
        // Two discs that agree by chance do not show that all discs agree.
        let disc =
            measured.map(|disc| if found.discs() < MIN_DISCS { disc.max(UNKNOWN_DISC_DEVIATION) } else { disc });
        let [of_coupon, of_disc] = [coupon, disc.unwrap_or(0.0)].map(|deviation| deviation.powi(2));
        let known = of_coupon.powi(2) / (coupons - discs).max(1.0) + of_disc.powi(2) / (discs - 1.0).max(1.0);
        let across = found.correlation() * deviations[0] * deviations[1];
        Model {
            preston_mm2_per_n: found.preston_mm2_per_n(),
            decay_per_mm2: found.wear_per_m2() / MM2_PER_M2,
            covariance: Matrix2::new(deviations[0].powi(2), across, across, deviations[1].powi(2)),
            coupon_deviation: coupon,
            // A scatter that was not measured is assumed to be as large as it may be without a review, not zero.
            disc_deviation: disc.unwrap_or(UNKNOWN_DISC_DEVIATION),
            // The degrees of freedom of a sum of two variances, by the Welch–Satterthwaite formula.
            redundancy: if known > 0.0 { ((of_coupon + of_disc).powi(2) / known).min(coupons) } else { coupons },
            orbit: Orbit { diameter_mm: found.orbit_mm(), speed_rev_min: found.orbit_rev_min() },
            pad_n_mm3: found.pad_n_mm3(),
            forces_n: found.least_force_n().zip(found.most_force_n()).map(|(least_n, most_n)| [least_n, most_n]),
            force_power: found
                .force_power()
                .zip(found.force_power_uncertainty())
                .map(|(value, uncertainty)| Power { value, uncertainty }),
        }
    }
}

/// A disc with this swept area, and the uncertainty of the force on the disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WornDisc {
    /// Area that the disc has swept, mm².
    pub swept_mm2: f64,
    /// Relative uncertainty of the force, 95 %.
    pub force_share_95: f64,
}

impl Model {
    /// Returns k of a disc with this swept area, mm²/N.
    pub fn preston_at_wear(&self, swept_mm2: f64) -> f64 {
        self.preston_mm2_per_n * (-self.decay_per_mm2 * swept_mm2).exp()
    }

    /// Returns σ of the logarithm of a depth by this disc.
    pub fn deviation(&self, disc: WornDisc) -> f64 {
        let (w, cov) = (disc.swept_mm2, &self.covariance);
        let of_k = cov[(0, 0)] - 2.0 * w * cov[(0, 1)] + w * w * cov[(1, 1)];
        let force = disc.force_share_95 / NORMAL_95;
        (of_k.max(0.0) + self.coupon_deviation.powi(2) + self.disc_deviation.powi(2) + force * force).sqrt()
    }

    /// Returns the relative error of a depth with this force, 95 %, that results from a force exponent different from
    /// 1.
    pub fn relative_force_law_error_95(&self, force_n: f64) -> f64 {
        let Some([least_n, most_n]) = self.forces_n else { return DEFAULT_POWER_UNCERTAINTY };
        match self.force_power {
            Some(power) => (force_n / (least_n * most_n).sqrt()).ln().abs() * power.deviation_from_one_95(),
            None => (force_n / force_n.clamp(least_n, most_n)).ln().abs() * DEFAULT_POWER_UNCERTAINTY,
        }
    }

    /// Returns the range of forces for which the model is valid, N, because the depth is known to be proportional to
    /// the force only in the measured range. `None` if the coupons' forces are not known.
    pub fn valid_force_range_n(&self) -> Option<[f64; 2]> {
        let [least_n, most_n] = self.forces_n?;
        let is_shown = self.force_power.is_some_and(|power| !power.contradicts_preston());
        let beyond = if is_shown { FORCE_RANGE } else { FORCE_RANGE_FACTOR };
        Some([least_n / beyond, most_n * beyond])
    }

    /// Returns the number of σ in the half-width of the 95 % interval.
    pub fn quantile_95(&self) -> f64 {
        student_95(self.redundancy)
    }
}

#[cfg(test)]
mod tests {
    use super::super::examples::MODEL;
    use super::*;

    /// If a calibration does not contain the scatter from disc to disc, 10 % is assumed. The same applies to a
    /// calibration whose two discs agreed.
    #[test]
    fn an_unknown_disc_scatter_has_a_default() {
        let numbers = |disc: &str| {
            let text = format!(
                "[removal]\npreston_mm2_per_n = 4e-4\npreston_deviation_percent = 2\nwear_per_m2 = 0.8\n\
                 wear_deviation_per_m2 = 0.1\ncorrelation = 0\ncoupon_deviation_percent = 3\nleft_out_percent = 3\n\
                 coupons = 12\npad_n_mm3 = 0.05\norbit_mm = 5\norbit_rev_min = 10000\n{disc}"
            );
            panelprep_cell::cell::RemovalCalibration::check("f", &text)
                .unwrap_or_else(|problems| panic!("{problems}"))
                .numbers
        };
        let model = |disc: &str| Model::from(&numbers(disc));
        assert!((model("").disc_deviation - 0.10).abs() < 1e-12 && model("").redundancy >= 10.0);
        assert!((model("discs = 2\ndisc_deviation_percent = 0.3\n").disc_deviation - 0.10).abs() < 1e-12);
        assert!((model("discs = 2\ndisc_deviation_percent = 14\n").disc_deviation - 0.14).abs() < 1e-12);
        assert!((model("discs = 4\ndisc_deviation_percent = 2.5\n").disc_deviation - 0.025).abs() < 1e-12);
    }

    /// Expected values, calculated by hand: coupons with forces of 15 and 30 N are valid from 15 / 1.5 = 10 N to 45 N,
    /// coupons with one force of 20 N from 17.4 N to 23 N.
    #[test]
    fn the_valid_range_of_forces_agrees_with_hand_calculation() {
        assert_eq!(MODEL.valid_force_range_n(), Some([10.0, 45.0]));
        let [least_n, most_n] = Model { forces_n: Some([20.0, 20.0]), force_power: None, ..MODEL }
            .valid_force_range_n()
            .expect("a range");
        assert!((least_n - 17.391).abs() < 1e-3 && (most_n - 23.0).abs() < 1e-9, "{least_n} {most_n}");
        assert_eq!(Model { forces_n: None, ..MODEL }.valid_force_range_n(), None);
        // The forces are far enough apart, but the coupons do not determine the exponent, or determine an exponent
        // other than 1.
        for force_power in [None, Some(Power { value: 0.7, uncertainty: 0.1 })] {
            let [least_n, most_n] = Model { force_power, ..MODEL }.valid_force_range_n().expect("a range");
            assert!((least_n - 13.043).abs() < 1e-3 && (most_n - 34.5).abs() < 1e-9, "{least_n} {most_n}");
        }
    }

    /// Expected values, calculated by hand: the geometric mean of 15 and 30 N is 21.213 N. At 30 N an exponent of 1.02
    /// ± 0.05 gives a relative error of ln(√2) · 0.07 = 0.024 26. If the exponent is not known, its assumed uncertainty
    /// of 0.5 has an effect only outside of the range of the coupons' forces: at 33 N ln(1.1) · 0.5.
    #[test]
    fn a_force_beside_those_of_the_coupons_adds_an_error() {
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        near(MODEL.relative_force_law_error_95(30.0), 0.024_26);
        near(MODEL.relative_force_law_error_95(21.213_203), 0.0);
        let unknown = Model { force_power: None, ..MODEL };
        near(unknown.relative_force_law_error_95(33.0), 0.047_655);
        near(unknown.relative_force_law_error_95(20.0), 0.0);
    }

    /// Expected values, calculated by hand: after half a square metre, k is e^(−0.4) = 0.670 32 of its first value;
    /// Student's 97.5 % quantile for ten degrees of freedom is 2.228.
    #[test]
    fn a_disc_wears() {
        assert!((MODEL.preston_at_wear(500_000.0) - 4e-4 * 0.670_320).abs() < 1e-9);
        assert!((MODEL.quantile_95() - 2.228).abs() < 0.001 && (student_95(1e5) - NORMAL_95).abs() < 1e-3);
    }

    /// Expected values, calculated by hand, for a new disc: √(0.02² + 0.03² + 0.05²) with a force known to ± 9.8 %.
    /// After half a square metre var = 4·10⁻⁴ − 2 · 5·10⁵ · 10⁻⁹ + 25·10¹⁰ · 10⁻¹⁴ = 0.0019; with coupons and force
    /// 0.0053.
    #[test]
    fn the_parts_of_the_uncertainty_add_up() {
        let disc = |swept_mm2: f64| WornDisc { swept_mm2, force_share_95: 0.05 * NORMAL_95 };
        assert!((MODEL.deviation(disc(0.0)) - 0.061_644).abs() < 1e-6, "{}", MODEL.deviation(disc(0.0)));
        assert!((MODEL.deviation(disc(5e5)) - 0.072_801).abs() < 1e-6, "{}", MODEL.deviation(disc(5e5)));
    }
}
