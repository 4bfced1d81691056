//! The conditions under which coupons determine a model, and the reasons why a set of coupons does not.

use panelprep_base::number_text::{distinguishable_texts, fixed_decimals};

/// Smallest number of coupons: two for the two numbers, and four more to show how well they are known.
pub const MIN_COUPONS: usize = 6;
/// The largest exposure must be at least this many times the smallest, to show that the depth follows the exposure.
pub(super) const LEVELS: f64 = 1.3;
/// The areas that the discs had swept must differ by this much, mm², to show the wear: a fiftieth of a square
/// metre.
pub(super) const WORN_LEVELS_MM2: f64 = 20_000.0;
/// Largest scatter of the coupons, σ of ln h; above this they contradict each other.
pub(super) const CONTRADICTORY: f64 = 0.5;

/// The reason why coupons do not determine a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too few.
    #[error(
        "{found} places were measured, at least {MIN_COUPONS} are needed to determine k, the wear and their \
         uncertainties"
    )]
    TooFew {
        /// Number of places found.
        found: usize,
    },
    /// All coupons have nearly the same load.
    #[error(
        "all coupons had nearly the same load: the highest is only {} times the lowest, at least {} times is \
         needed to determine how the depth depends on it; change passes, feed_mm_s or force_n",
        distinguishable_texts(*ratio, LEVELS, 2)[0], distinguishable_texts(*ratio, LEVELS, 2)[1]
    )]
    OneLoad {
        /// Ratio of the largest exposure to the smallest.
        ratio: f64,
    },
    /// All coupons have nearly the same disc wear.
    #[error(
        "the discs had swept {} to {} m² (worn_mm2), but a difference of at least 0.02 m² is needed to determine \
         the wear: measure one coupon with a new disc and one with a used disc",
        fixed_decimals(*least_m2, 3), fixed_decimals(*most_m2, 3)
    )]
    OneWear {
        /// Smallest swept area, m².
        least_m2: f64,
        /// Largest swept area, m².
        most_m2: f64,
    },
    /// The coupons contradict each other.
    #[error(
        "the coupons contradict each other: depths differ from the best model by {percent:.0} % rms; the largest \
         deviation is that of {name} (line {line})"
    )]
    Contradictory {
        /// Rms, percent.
        percent: f64,
        /// Name of the coupon that deviates most.
        name: String,
        /// Its line.
        line: u64,
    },
    /// Worn discs remove more.
    #[error(
        "worn discs removed more than new discs: ln k grows by {per_m2:.2} ± {known_m2:.2} per square metre swept; \
         check that worn_mm2 and the depth belong to the same coupon"
    )]
    GrowsWithWear {
        /// Growth, 1/m².
        per_m2: f64,
        /// The 95 % uncertainty of the growth, 1/m².
        known_m2: f64,
    },
}
