//! The depth error that maps planes to other planes, determined from the distances between printed corners.
//!
//! A depth error that is linear over the directions, c = a + b x + c y, leaves flat boards flat, and makes distances
//! on them longer where it is larger. With the scale sᵢ of each scan's distances, and its derivative with respect to
//! each coefficient, the linear fit is
//!     sᵢ = s + a ∂s/∂a + b ∂s/∂b + c ∂s/∂c,                                                                    (1)
//! Only b and c are a correction: only the boards' depths distinguish s and a, which act as a scale.

use super::field::rms;
use super::plane_view::PlaneView;
use nalgebra::{DMatrix, DVector};
use panelprep_base::geometry::DepthField;

/// A slope is accepted if the rms of the predicted scales of left-out scans falls to this share.
const MAX_RMS_RATIO: f64 = 0.8;
/// Terms of (1).
const TERMS: usize = 4;

/// The result from the scales of all scans.
pub(super) struct ScaleTilt {
    /// b and c of (1), mm at the reference depth; `None` if they do not predict left-out scans.
    pub slope_mm: Option<[f64; 2]>,
    /// The remainder of the scales after (1), or after its first two terms if there is no slope; one standard
    /// deviation, percent.
    pub residual_percent: f64,
    /// The degrees of freedom: the number of scans minus the number of terms.
    pub degrees_of_freedom: usize,
}

/// 95 % of a normal distribution lie below this number of standard deviations.
const NORMAL_ONE_SIDED_95: f64 = 1.645;

impl ScaleTilt {
    /// Returns the standard deviation of the scales, percent, without this known variance, squared percent. Zero if
    /// the remainder may be due to chance.
    pub fn excess_std_percent(&self, known: f64) -> f64 {
        let left = self.residual_percent.powi(2);
        let by_chance = known * (1.0 + NORMAL_ONE_SIDED_95 * (2.0 / self.degrees_of_freedom as f64).sqrt());
        if left <= by_chance { 0.0 } else { (left - known).max(0.0).sqrt() }
    }
}

/// Returns the fit of (1).
pub(super) fn estimate(views: &[PlaneView], field: Option<&DepthField>) -> Option<ScaleTilt> {
    let scales = DVector::from_iterator(views.len(), views.iter().map(|view| view.scale_percent(field)));
    let term = |row: usize, column: usize| match column {
        0 => 100.0,
        1 => views[row].scale_change_percent(|_| 1.0),
        2 => views[row].scale_change_percent(|[x, _]| x),
        _ => views[row].scale_change_percent(|[_, y]| y),
    };
    let terms = DMatrix::from_fn(views.len(), TERMS, term);
    let all = LeftOutFit::fit(&terms, &scales)?;
    let scale_alone = LeftOutFit::fit(&terms.columns(0, 2).into_owned(), &scales)?;
    let is_worth_it = all.prediction_residual <= MAX_RMS_RATIO * scale_alone.prediction_residual;
    Some(ScaleTilt {
        slope_mm: is_worth_it.then(|| [all.parameters[2], all.parameters[3]]),
        residual_percent: if is_worth_it { all.residual } else { scale_alone.residual },
        degrees_of_freedom: if is_worth_it { all.degrees_of_freedom } else { scale_alone.degrees_of_freedom },
    })
}

/// A linear fit, with the residuals of its own data and of data that were left out.
struct LeftOutFit {
    parameters: DVector<f64>,
    residual: f64,
    prediction_residual: f64,
    degrees_of_freedom: usize,
}

impl LeftOutFit {
    fn fit(terms: &DMatrix<f64>, values: &DVector<f64>) -> Option<LeftOutFit> {
        let inverse = (terms.transpose() * terms).try_inverse()?;
        let solved = &inverse * terms.transpose() * values;
        let residuals = values - terms * &solved;
        let hat = terms * inverse * terms.transpose();
        let foretold: Vec<f64> =
            residuals.iter().enumerate().map(|(row, residual)| residual / (1.0 - hat[(row, row)])).collect();
        let free = values.len().checked_sub(terms.ncols()).filter(|free| *free > 0)?;
        let left = (residuals.norm_squared() / free as f64).sqrt();
        Some(LeftOutFit {
            residual: left,
            prediction_residual: rms(&foretold),
            degrees_of_freedom: free,
            parameters: solved,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calculated by hand: of 0.05 % with an uncertainty of 0.03 %, √(0.0025 − 0.0009) % = 0.04 % exceed the
    /// uncertainty. With 8 scans more than terms, chance causes up to √(1 + 1.645 · 0.5) = 1.35 times the
    /// uncertainty, 0.0405 %.
    #[test]
    fn what_chance_leaves_is_nothing() {
        let tilt =
            |left_percent| ScaleTilt { slope_mm: None, residual_percent: left_percent, degrees_of_freedom: 8 };
        let known = 0.03_f64.powi(2);
        assert!((tilt(0.05).excess_std_percent(known) - 0.04).abs() < 1e-12);
        assert_eq!(tilt(0.04).excess_std_percent(known), 0.0);
        assert!(tilt(0.041).excess_std_percent(known) > 0.02);
    }
}
