//! Estimates from coupons, in addition to k, the exponents of the force and of the number of passes in the depth, and
//! the scatter between discs, which is a variance in addition to that of the coupons.
//!
//! By Preston's law both exponents are 1:
//!     ln h − ln X = ln k₀ − b w + (a_F − 1) ln F + (a_N − 1) ln N                                           (10)
//! An exponent is determined only if the coupons differ in its quantity independently of their other quantities.
//!
//! The coupons i that were sanded with disc j differ from the model by a common error d_j and by their own errors:
//!     yᵢ = aᵢᵀ x + d_j(i) + eᵢ,   var e = σ_r²,   var d = λ σ_r².                                           (8)
//! For a known λ, the rows and values minus θ_j times the mean of their disc, θ_j = 1 − 1/√(1 + λ n_j), have
//! independent errors (Fuller & Battese, J. Am. Stat. Assoc. 68, 1973). λ is the value with the largest restricted
//! likelihood (Patterson & Thompson, Biometrika 58, 1971), which minimises
//!     (n − p) ln RSS(λ) + Σ ln(1 + λ n_j) + ln det(AᵀA)(λ).                                                  (9)

use super::coupons::Coupon;
use nalgebra::{DMatrix, DVector};
use panelprep_base::geometry::statistics::student_95;

/// Minimum ratio of the coupons' largest to smallest force, or number of passes, at which the coupons show how the
/// depth depends on this quantity.
pub const MIN_LEVEL_RATIO: f64 = 1.5;
/// Maximum 95 % uncertainty of an exponent at which the exponent is treated as determined.
const MAX_UNCERTAINTY: f64 = 0.3;
/// Maximum deviation of an exponent from 1 that needs no review.
const MAX_DEVIATION: f64 = 0.15;

/// Number of values of λ that are tried in addition to 0, at equal ratios between `MIN_LAMBDA` and `MAX_LAMBDA`.
const TRIED_VALUES: u32 = 120;
const MIN_LAMBDA: f64 = 1e-3;
const MAX_LAMBDA: f64 = 1e3;

/// An exponent of a quantity in the depth, with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    /// The estimated exponent.
    pub value: f64,
    /// Uncertainty of the exponent, 95 %.
    pub uncertainty: f64,
}

impl Power {
    /// Returns whether the coupons contradict an exponent of 1.
    pub fn contradicts_preston(self) -> bool {
        let off = (self.value - 1.0).abs();
        off.is_nan() || (off > MAX_DEVIATION && off > self.uncertainty)
    }

    /// Returns the largest difference of the exponent from 1 within its 95 % uncertainty.
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
    /// Exponent of the number of passes.
    pub passes: Option<Power>,
}

impl ForceExponents {
    /// Computes the exponents from the coupons, with the rows and values of the model (7) and the scatter between the
    /// discs.
    pub(super) fn compute(
        coupons: &[Coupon],
        (rows, y): (&DMatrix<f64>, &DVector<f64>),
        scatter: Option<&DiscScatter>,
    ) -> Self {
        let force = logarithms_without_mean(coupons, |coupon| coupon.force_n);
        let passes = logarithms_without_mean(coupons, |coupon| coupon.passes);
        let more: Vec<&DVector<f64>> = [&force, &passes].into_iter().flatten().collect();
        let first = rows.ncols();
        let mut all = rows.clone().resize_horizontally(first + more.len(), 0.0);
        more.iter().enumerate().for_each(|(index, own)| all.set_column(first + index, own));
        if all.nrows() <= all.ncols() {
            return ForceExponents::default();
        }
        let found = match scatter {
            Some(scatter) => scatter.fit_line(&all, y),
            None => fit_line(&all, y),
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

/// Returns the logarithms of a quantity of the coupons, minus their mean; `None` if the quantity is nearly the same for
/// all coupons.
fn logarithms_without_mean(coupons: &[Coupon], number: impl Fn(&Coupon) -> f64) -> Option<DVector<f64>> {
    let logarithms = DVector::from_iterator(coupons.len(), coupons.iter().map(|coupon| number(coupon).ln()));
    let mean = logarithms.mean();
    // The tolerance permits a ratio of exactly the minimum, despite rounding of the logarithm.
    let is_wide = logarithms.max() - logarithms.min() >= MIN_LEVEL_RATIO.ln() - 1e-9;
    is_wide.then(|| logarithms.map(|value| value - mean))
}

/// Result of a least-squares fit.
pub(super) struct Line {
    /// The estimated parameters.
    pub solution: DVector<f64>,
    /// The matrix (AᵀA)⁻¹.
    pub inverse: DMatrix<f64>,
    /// Standard deviation of a value y from the model.
    pub deviation: f64,
}

/// Returns the x that minimises |A x − y|², with these rows of A; `None` if the rows do not determine x.
pub(super) fn fit_line(rows: &DMatrix<f64>, y: &DVector<f64>) -> Option<Line> {
    let inverse = (rows.transpose() * rows).try_inverse()?;
    let solution = &inverse * rows.transpose() * y;
    let left = y - rows * &solution;
    let redundancy = rows.nrows().saturating_sub(rows.ncols()).max(1) as f64;
    Some(Line { solution, inverse, deviation: (left.norm_squared() / redundancy).sqrt() })
}

/// The discs of the coupons and the scatter between the discs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DiscScatter {
    /// For each coupon, the index of its disc.
    disc_of: Vec<usize>,
    /// For each disc, the number of its coupons.
    counts: Vec<f64>,
    /// Ratio λ of the variance between discs to the variance between coupons.
    ratio: f64,
}

impl DiscScatter {
    /// Estimates the scatter between discs; `discs` contains the disc of each row. `None` if a coupon has no disc, if
    /// there is only one disc, or if each disc has only one coupon.
    pub fn estimate(discs: &[Option<&str>], (rows, y): (&DMatrix<f64>, &DVector<f64>)) -> Option<Self> {
        let names: Vec<&str> = discs.iter().copied().collect::<Option<_>>()?;
        let mut known: Vec<&str> = names.clone();
        known.sort_unstable();
        known.dedup();
        if known.len() < 2 || known.len() == names.len() {
            return None;
        }
        let disc_of: Vec<usize> = names.iter().filter_map(|name| known.binary_search(name).ok()).collect();
        let count = |disc: usize| disc_of.iter().filter(|own| **own == disc).count() as f64;
        let counts: Vec<f64> = (0..known.len()).map(count).collect();
        let step = (MAX_LAMBDA / MIN_LAMBDA).powf(1.0 / f64::from(TRIED_VALUES - 1));
        let ratios = (0..TRIED_VALUES).map(|index| MIN_LAMBDA * step.powf(f64::from(index)));
        let tried = std::iter::once(0.0).chain(ratios);
        let scatter = |ratio| DiscScatter { disc_of: disc_of.clone(), counts: counts.clone(), ratio };
        let judged = tried.filter_map(|ratio| {
            let scatter = scatter(ratio);
            let unlikely = scatter.negative_log_likelihood(rows, y)?;
            Some((unlikely, scatter))
        });
        judged.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, best)| best)
    }

    /// Returns the number of discs with two or more coupons; a disc with one coupon does not show the scatter.
    pub fn discs(&self) -> usize {
        self.counts.iter().filter(|count| **count >= 2.0).count()
    }

    /// Returns the standard deviation between discs, calculated from that between coupons.
    pub fn deviation(&self, coupon_deviation: f64) -> f64 {
        self.ratio.sqrt() * coupon_deviation
    }

    /// Fits the rows, taking the scatter between discs into account; `deviation` of the result is that of a coupon on
    /// its disc.
    pub fn fit_line(&self, rows: &DMatrix<f64>, y: &DVector<f64>) -> Option<Line> {
        fit_line(
            &self.remove_disc_means(rows),
            &self.remove_disc_means(&DMatrix::from_columns(&[y.clone_owned()])).column(0).into(),
        )
    }

    /// Returns the effective degrees of freedom (Welch–Satterthwaite) of the mean of all coupons, after the fit of this
    /// number of unknowns: the number of discs minus 1 if the scatter between discs predominates, those of the coupons
    /// if the discs do not differ.
    pub fn effective_degrees_of_freedom(&self, unknowns: usize) -> f64 {
        let (coupons, discs) = (self.disc_of.len() as f64, self.counts.len() as f64);
        let of_mean = self.ratio * coupons / discs;
        let share = of_mean / (1.0 + of_mean);
        let own = (coupons - unknowns as f64 - discs + 1.0).max(1.0);
        1.0 / (share.powi(2) / (discs - 1.0) + (1.0 - share).powi(2) / own)
    }

    /// Returns the value of (9), which the best λ minimises.
    fn negative_log_likelihood(&self, rows: &DMatrix<f64>, y: &DVector<f64>) -> Option<f64> {
        let found = self.fit_line(rows, y)?;
        let redundancy = (rows.nrows() - rows.ncols()) as f64;
        let square_sum = (found.deviation.powi(2) * redundancy).max(f64::MIN_POSITIVE);
        let discs: f64 = self.counts.iter().map(|count| (self.ratio * count).ln_1p()).sum();
        Some(redundancy * square_sum.ln() + discs - found.inverse.determinant().ln())
    }

    /// Subtracts from each element θ times the mean of its column over the rows of its disc.
    fn remove_disc_means(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut means = DMatrix::<f64>::zeros(self.counts.len(), columns.ncols());
        for (row, disc) in self.disc_of.iter().enumerate() {
            means.row_mut(*disc).zip_apply(&columns.row(row), |mean, value| *mean += value / self.counts[*disc]);
        }
        DMatrix::from_fn(columns.nrows(), columns.ncols(), |row, column| {
            let disc = self.disc_of[row];
            let theta = 1.0 - 1.0 / (1.0 + self.ratio * self.counts[disc]).sqrt();
            columns[(row, column)] - theta * means[(disc, column)]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::coupons::tests::TOOL;
    use super::super::fit::fit;
    use super::super::fit::tests::coupons;
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// Returns the exponents found from twelve coupons with forces of 10 and 20 N whose depths have these true
    /// exponents of force and passes.
    fn powers(force: f64, passes: f64) -> ForceExponents {
        let mut made = coupons(&[0.01, -0.01, 0.005, 0.0, -0.005, 0.01, -0.01, 0.0, 0.005, 0.0, 0.01, -0.01]);
        for (index, own) in made.iter_mut().enumerate() {
            own.force_n = [10.0, 20.0][index % 2];
            own.depth_um *= (own.force_n / 20.0).powf(force) * own.passes.powf(passes - 1.0);
        }
        fit(&made, &TOOL).expect("a model").powers
    }

    #[test]
    fn each_exponent_is_determined_independently() {
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

    /// With one force, with forces of a ratio of 1.49, or with forces that are proportional to the passes, the force's
    /// exponent is not determined.
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

    const DISCS: [Option<&str>; 6] = [Some("D1"), Some("D1"), Some("D2"), Some("D2"), Some("D3"), Some("D3")];

    fn found(y: [f64; 6]) -> (DiscScatter, Line) {
        let (rows, y) = (DMatrix::from_element(6, 1, 1.0), DVector::from_row_slice(&y));
        let scatter = DiscScatter::estimate(&DISCS, (&rows, &y)).expect("discs");
        let line = scatter.fit_line(&rows, &y).expect("a mean");
        (scatter, line)
    }

    /// Expected values, calculated by hand as an analysis of variance: pairs ±0.01 about −0.1, 0 and 0.1. Within the
    /// discs σ_r² = 3 · 2 · 10⁻⁴ / 3 = 2·10⁻⁴; between the discs the means have the variance 0.01 = σ_d² + σ_r²/2: σ_d²
    /// = 0.0099. The mean's variance is 0.01 / 3.
    #[test]
    fn the_variances_are_those_of_an_analysis_of_variance() {
        let (scatter, line) = found([-0.11, -0.09, -0.01, 0.01, 0.09, 0.11]);
        assert!((line.deviation.powi(2) / 2e-4 - 1.0).abs() < 0.02, "{}", line.deviation);
        assert!((scatter.deviation(line.deviation).powi(2) / 0.0099 - 1.0).abs() < 0.1, "{scatter:?}");
        let mean_variance = line.inverse[(0, 0)] * line.deviation.powi(2);
        assert!((mean_variance / (0.01 / 3.0) - 1.0).abs() < 0.1, "{mean_variance}");
        // Three discs that differ have two degrees of freedom.
        assert!(
            (scatter.effective_degrees_of_freedom(1) - 2.0).abs() < 0.1,
            "{}",
            scatter.effective_degrees_of_freedom(1)
        );
    }

    #[test]
    fn equal_discs_add_no_scatter() {
        let (scatter, line) = found([-0.01, 0.01, -0.01, 0.01, -0.01, 0.01]);
        assert_eq!(scatter.deviation(line.deviation), 0.0);
        assert!((scatter.effective_degrees_of_freedom(1) - 3.0).abs() < 1e-9);
        let (rows, y) = (DMatrix::from_element(6, 1, 1.0), DVector::zeros(6));
        let mut one_without = DISCS;
        one_without[2] = None;
        assert_eq!(DiscScatter::estimate(&one_without, (&rows, &y)), None);
        assert_eq!(DiscScatter::estimate(&[Some("D1"); 6], (&rows, &y)), None);
    }

    /// Sixty sets of eight discs with four coupons each, σ_d = 0.06 and σ_r = 0.03: the estimates scatter about the
    /// true values.
    #[test]
    fn the_scatter_of_many_discs_is_found() {
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let mut even = |deviation: f64| random.random_range(-1.0..1.0) * deviation * 3.0_f64.sqrt();
        let names: Vec<String> = (0..32).map(|index| format!("D{}", index / 4)).collect();
        let discs: Vec<Option<&str>> = names.iter().map(|name| Some(name.as_str())).collect();
        let mut sums = [0.0; 2];
        for _ in 0..60 {
            let own: Vec<f64> = (0..8).map(|_| even(0.06)).collect();
            let y = DVector::from_fn(32, |row, _| own[row / 4] + even(0.03));
            let rows = DMatrix::from_element(32, 1, 1.0);
            let scatter = DiscScatter::estimate(&discs, (&rows, &y)).expect("discs");
            let deviation = scatter.fit_line(&rows, &y).expect("a mean").deviation;
            sums[0] += scatter.deviation(deviation).powi(2) / 60.0;
            sums[1] += deviation.powi(2) / 60.0;
        }
        let [disc, coupon] = sums.map(f64::sqrt);
        assert!((disc / 0.06 - 1.0).abs() < 0.1 && (coupon / 0.03 - 1.0).abs() < 0.1, "{disc} {coupon}");
    }
}
