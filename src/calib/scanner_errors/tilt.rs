//! What turns planes into other planes, by the distances between printed corners.
//!
//! A depth error that is linear over the directions, c = a + b x + c y, leaves flat boards flat, and makes distances on them longer where it is
//! larger. With the scale sᵢ of each scan's distances, and how much it would change by each part,
//!     sᵢ = s + a ∂s/∂a + b ∂s/∂b + c ∂s/∂c,                                                                    (1)
//! a linear fit. Only b and c are a correction: s and a are told apart by the boards' depths alone, and act as a scale.

use super::field::rms;
use super::plane_view::PlaneView;
use crate::geometry::DepthField;
use nalgebra::{DMatrix, DVector};

/// Scales of scans that were left out are foretold so much better by a slope that is one, rms.
const WORTH_IT: f64 = 0.8;
/// Terms of (1).
const TERMS: usize = 4;

/// What the scales of all scans say.
pub(super) struct Tilt {
    /// b and c of (1), mm at the reference depth; none where scans that were left out are not foretold by them.
    pub slope_mm: Option<[f64; 2]>,
    /// What (1), or where there is no slope its first two terms, leave of the scales, one standard deviation, percent.
    pub left_percent: f64,
    /// By so many scans more than terms.
    pub free: usize,
}

/// 95 % of a normal distribution lie below this many standard deviations.
const BELOW_95_PERCENT: f64 = 1.645;

impl Tilt {
    /// What is left of the scales beyond this variance, squared percent, that is known to be in them; one standard deviation, percent. Nothing where
    /// chance alone may leave as much.
    pub fn beyond_percent(&self, known: f64) -> f64 {
        let left = self.left_percent.powi(2);
        let by_chance = known * (1.0 + BELOW_95_PERCENT * (2.0 / self.free as f64).sqrt());
        if left <= by_chance { 0.0 } else { (left - known).max(0.0).sqrt() }
    }
}

/// The fit of (1).
pub(super) fn estimate(views: &[PlaneView], field: Option<&DepthField>) -> Option<Tilt> {
    let scales = DVector::from_iterator(views.len(), views.iter().map(|view| view.scale_percent(field)));
    let term = |row: usize, column: usize| match column {
        0 => 100.0,
        1 => views[row].scale_percent_by(|_| 1.0),
        2 => views[row].scale_percent_by(|[x, _]| x),
        _ => views[row].scale_percent_by(|[_, y]| y),
    };
    let terms = DMatrix::from_fn(views.len(), TERMS, term);
    let all = LeftOut::of(&terms, &scales)?;
    let scale_alone = LeftOut::of(&terms.columns(0, 2).into_owned(), &scales)?;
    let is_worth_it = all.foretold <= WORTH_IT * scale_alone.foretold;
    Some(Tilt {
        slope_mm: is_worth_it.then(|| [all.solved[2], all.solved[3]]),
        left_percent: if is_worth_it { all.left } else { scale_alone.left },
        free: if is_worth_it { all.free } else { scale_alone.free },
    })
}

/// A linear fit, and what it leaves of its own data and of data that were left out.
struct LeftOut {
    solved: DVector<f64>,
    left: f64,
    foretold: f64,
    free: usize,
}

impl LeftOut {
    fn of(terms: &DMatrix<f64>, values: &DVector<f64>) -> Option<LeftOut> {
        let inverse = (terms.transpose() * terms).try_inverse()?;
        let solved = &inverse * terms.transpose() * values;
        let residuals = values - terms * &solved;
        let hat = terms * inverse * terms.transpose();
        let foretold: Vec<f64> =
            residuals.iter().enumerate().map(|(row, residual)| residual / (1.0 - hat[(row, row)])).collect();
        let free = values.len().checked_sub(terms.ncols()).filter(|free| *free > 0)?;
        let left = (residuals.norm_squared() / free as f64).sqrt();
        Some(LeftOut { left, foretold: rms(&foretold), free, solved })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: of 0.05 % with 0.03 % known, √(0.0025 − 0.0009) % = 0.04 % are beyond it. With 8 scans more than terms chance leaves up to
    /// √(1 + 1.645 · 0.5) = 1.35 times what is known, 0.0405 %.
    #[test]
    fn what_chance_leaves_is_nothing() {
        let tilt = |left_percent| Tilt { slope_mm: None, left_percent, free: 8 };
        let known = 0.03_f64.powi(2);
        assert!((tilt(0.05).beyond_percent(known) - 0.04).abs() < 1e-12);
        assert_eq!(tilt(0.04).beyond_percent(known), 0.0);
        assert!(tilt(0.041).beyond_percent(known) > 0.02);
    }
}
