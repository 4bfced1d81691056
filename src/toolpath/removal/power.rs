//! The exponents with which the depth grows with force and with the number of passes; by Preston's law both are 1.
//!
//!     ln h − ln X = ln k₀ − b w + (a_F − 1) ln F + (a_N − 1) ln N                                           (10)
//! An exponent is determined only by coupons that differ in this number, independently of the others.

use super::coupons::Coupon;
use super::disc_scatter::{DiscScatter, line};
use nalgebra::{DMatrix, DVector};
use panelprep_vision::calib::student_95;

/// Coupons whose forces, or passes, differ by this factor show how the depth grows with them.
pub const LEVELS: f64 = 1.5;
/// An exponent that is known less well than this, 95 %, is not determined.
const MAX_UNCERTAINTY: f64 = 0.3;
/// Largest deviation of an exponent from 1 that needs no review.
const MAX_DEVIATION: f64 = 0.15;

/// An exponent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    /// The exponent.
    pub value: f64,
    /// Its uncertainty, 95 %.
    pub uncertainty: f64,
}

impl Power {
    /// Returns whether the coupons contradict an exponent of 1.
    pub fn contradicts_preston(self) -> bool {
        let off = (self.value - 1.0).abs();
        off.is_nan() || (off > MAX_DEVIATION && off > self.uncertainty)
    }

    /// Returns by how much the exponent may differ from 1, 95 %.
    pub fn deviation_from_one_95(self) -> f64 {
        (self.value - 1.0).abs() + self.uncertainty
    }

    fn is_determined(self) -> bool {
        self.uncertainty <= MAX_UNCERTAINTY && self.value.is_finite()
    }
}

/// The exponents that the coupons determine.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ForceExponents {
    /// Exponent of the force.
    pub force: Option<Power>,
    /// Of the number of passes.
    pub passes: Option<Power>,
}

impl ForceExponents {
    /// Computes the exponents from the coupons, with the rows and values of the model (7) and the discs' scatter.
    pub(super) fn compute(
        coupons: &[Coupon],
        (rows, y): (&DMatrix<f64>, &DVector<f64>),
        scatter: Option<&DiscScatter>,
    ) -> Self {
        let force = column(coupons, |coupon| coupon.force_n);
        let passes = column(coupons, |coupon| coupon.passes);
        let more: Vec<&DVector<f64>> = [&force, &passes].into_iter().flatten().collect();
        let first = rows.ncols();
        let mut all = rows.clone().resize_horizontally(first + more.len(), 0.0);
        more.iter().enumerate().for_each(|(index, own)| all.set_column(first + index, own));
        if all.nrows() <= all.ncols() {
            return ForceExponents::default();
        }
        let found = match scatter {
            Some(scatter) => scatter.line(&all, y),
            None => line(&all, y),
        };
        let Some(found) = found else { return ForceExponents::default() };
        let quantile = student_95((all.nrows() - all.ncols()) as f64);
        let power = |index: usize| {
            let uncertainty = quantile * found.deviation * found.inverse[(index, index)].sqrt();
            Some(Power { value: 1.0 + found.solution[index], uncertainty }).filter(|power| power.is_determined())
        };
        ForceExponents {
            force: force.as_ref().and_then(|_| power(first)),
            passes: passes.as_ref().and_then(|_| power(first + usize::from(force.is_some()))),
        }
    }
}

/// Returns the logarithms of a number of the coupons about their mean; `None` if it is nearly the same for all.
fn column(coupons: &[Coupon], number: impl Fn(&Coupon) -> f64) -> Option<DVector<f64>> {
    let logarithms = DVector::from_iterator(coupons.len(), coupons.iter().map(|coupon| number(coupon).ln()));
    let mean = logarithms.mean();
    // The factor itself counts, whatever its logarithm's last digit.
    let is_wide = logarithms.max() - logarithms.min() >= LEVELS.ln() - 1e-9;
    is_wide.then(|| logarithms.map(|value| value - mean))
}

#[cfg(test)]
mod tests {
    use super::super::coupons::tests::TOOL;
    use super::super::fit::fit;
    use super::super::fit::tests::coupons;
    use super::*;

    /// Twelve coupons with forces of 10 and 20 N, and depths that grow with these powers of force and passes.
    fn powers(force: f64, passes: f64) -> ForceExponents {
        let mut made = coupons(&[0.01, -0.01, 0.005, 0.0, -0.005, 0.01, -0.01, 0.0, 0.005, 0.0, 0.01, -0.01]);
        for (index, own) in made.iter_mut().enumerate() {
            own.force_n = [10.0, 20.0][index % 2];
            own.depth_um *= (own.force_n / 20.0).powf(force) * own.passes.powf(passes - 1.0);
        }
        fit(&made, &TOOL).expect("a model").powers
    }

    #[test]
    fn each_exponent_is_found_by_itself() {
        let near = |power: Option<Power>, value: f64| {
            power.is_some_and(|power| (power.value - value).abs() < power.uncertainty && power.uncertainty < 0.05)
        };
        let preston = powers(1.0, 1.0);
        assert!(near(preston.force, 1.0) && near(preston.passes, 1.0), "{preston:?}");
        let other = powers(0.7, 1.2);
        assert!(near(other.force, 0.7) && near(other.passes, 1.2), "{other:?}");
        assert!(other.force.is_some_and(Power::contradicts_preston), "{other:?}");
        assert!(!preston.force.is_some_and(Power::contradicts_preston), "{preston:?}");
    }

    /// With one force, with forces 1.49 times apart, or with forces that go with the passes, no exponent of the
    /// force is stated.
    #[test]
    fn an_exponent_that_the_coupons_do_not_determine_is_not_stated() {
        let with = |force_n: &dyn Fn(usize) -> f64| {
            let mut made = coupons(&[0.02, -0.01, 0.0, 0.01, -0.02, 0.015, 0.0, -0.015, 0.01, 0.0, -0.01, 0.005]);
            for (index, own) in made.iter_mut().enumerate() {
                own.force_n = force_n(index);
                own.depth_um *= own.force_n / 20.0;
            }
            fit(&made, &TOOL).expect("a model").powers
        };
        assert_eq!(with(&|_| 20.0).force, None);
        assert_eq!(with(&|index| [20.0, 29.8][index % 2]).force, None);
        assert!(with(&|index| [20.0, 30.0][index % 2]).force.is_some());
        let goes_with_passes = with(&|index| [10.0, 20.0, 40.0][index % 3]);
        assert_eq!(goes_with_passes, ForceExponents::default());
    }
}
