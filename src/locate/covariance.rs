//! The covariance of a pose, and what it means on the panel.
//!
//! About the panel's centre it is the inverse of the fit's information,
//!     C = (Σ_k Σᵢ wᵢ JᵢᵀJᵢ / f_k)⁻¹,   f_k = max(1, (ν + Σ_c m_c²/s_c²) / (ν + n)),                            (1)
//! over the kinds k of residuals. A kind's noise is stated in `fit` for the mean m of a cell whose members share one error;
//! f_k is how much larger the n cells' means are than that, which ν cells' worth of trust in the stated noise steadies:
//! a small panel has few cells. A point x of the panel then has the covariance A C Aᵀ with A = [−[x − c]×  I].
//!
//! A camera whose distances are all too long by the share s puts the panel's centre c, seen from it, at (1 + s) c, which no
//! residual shows. The share that all scans have in common shifts the camera's mount as well, if the mount was measured with the same
//! camera near the taught place, so that it cancels there. What differs between the two scans does not cancel:
//!     C_vv += σ_s² (c − c₀)(c − c₀)ᵀ + σ_d² (c cᵀ + (R c₀)(R c₀)ᵀ),                                           (2)
//! c₀ the taught centre, R the turn from the taught place to this one, σ_s and σ_d the deviations of s in all scans alike and from scan to
//! scan. (2) does not count that the panel itself is too large by s, which over half a panel is a fraction of that, nor a mount that was
//! measured elsewhere.

use super::fit::{EDGE_CORRELATION_MM, KINDS, Residuals};
use super::grid::Motion;
use super::model::Model;
use super::scan_errors::RangeErrors;
use super::solve::{Constraint, ResidualWeighting, Sums};
use crate::geometry::statistics::WITHIN_95;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};
use std::collections::BTreeMap;

/// ν of (1).
const TRUST_CELLS: f64 = 12.0;
/// A cell needs this share of the points of a full one.
const CELL_FILLED: f64 = 0.3;

/// What (2) adds to the shifts, for the panel's centre as taught and now and the turn between: for a scale that all scans share, and for
/// one that differs from scan to scan.
fn of_scale([taught, now]: [&Vector3<f64>; 2], turn: &Matrix3<f64>, range: RangeErrors) -> [Matrix3<f64>; 2] {
    let (moved, turned) = (now - taught, turn * taught);
    [
        moved * moved.transpose() * range.scale.powi(2),
        (now * now.transpose() + turned * turned.transpose()) * range.scale_between_scans.powi(2),
    ]
}

/// A twist's covariance with a further error of the shift.
fn with_shift(mut covariance: Matrix6<f64>, further: Matrix3<f64>) -> Matrix6<f64> {
    let mut shifts = covariance.fixed_view_mut::<3, 3>(3, 3);
    shifts += further;
    covariance
}

/// The direction in which a pose is constrained least.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weakest {
    /// A shift along the panel's normal, or a tilt of it.
    Normal,
    /// A shift in the panel's plane.
    Sideways,
    /// A rotation in the panel's plane.
    Turn,
}

impl Weakest {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Weakest::Normal => "along the panel's normal",
            Weakest::Sideways => "sideways in the panel's plane",
            Weakest::Turn => "turned in the panel's plane",
        }
    }
}

/// How well a pose is known.
pub(super) struct PoseCovariance {
    /// (1) and (2), of a twist (ω, v) about the panel's centre, rad and mm.
    pub covariance: Matrix6<f64>,
    /// The direction in which it is largest.
    pub weakest: Weakest,
    /// 95 % of the errors along that direction are smaller, mm; a rotation counts by its mean displacement.
    pub weakest_mm: f64,
    /// The same without what (2) adds for a scale that all scans share, as at the taught place.
    pub at_taught_place: Matrix6<f64>,
    /// (1) alone.
    pub without_scale: Matrix6<f64>,
}

/// (1) and (2); `None` where the residuals leave a direction open.
pub(super) fn covariance(
    residuals: &Residuals,
    weighing: &[ResidualWeighting; KINDS],
    model: &Model,
    motion: &Motion,
) -> Option<PoseCovariance> {
    let across = {
        let first = model.outline.first()?.point - model.centre;
        (first - model.normal * model.normal.dot(&first)).try_normalize(1e-9)?
    };
    let up = model.normal.cross(&across);
    let cell = |point: &Vector3<f64>, side_mm: f64| {
        let offset = point - model.centre;
        let number = |along: &Vector3<f64>| (offset.dot(along) / side_mm).floor() as i64;
        (number(&across), number(&up))
    };
    let square = |sample: usize| cell(&model.points[sample], model.range.correlation_mm);
    let mark_square = |sample: usize| cell(&model.marks.points[sample].point, model.range.correlation_mm);
    // The taught outline is in order, so that a stretch of it is a run of its points.
    let mut ways_mm = Vec::with_capacity(model.outline.len());
    let mut way_mm = 0.0;
    for sample in &model.outline {
        ways_mm.push(way_mm);
        way_mm += sample.length_mm;
    }
    let stretch = |sample: usize| ((ways_mm[sample] / EDGE_CORRELATION_MM).floor() as i64, 0);
    let factors = [
        inflation(&residuals.surface, &weighing[0], square),
        inflation(&residuals.colour, &weighing[1], stretch),
        inflation(&residuals.depth, &weighing[2], stretch),
        inflation(&residuals.marks, &weighing[3], mark_square),
    ];
    let kinds = residuals.kinds();
    let mut information = Matrix6::zeros();
    for ((kind, weighing), factor) in kinds.iter().zip(weighing).zip(factors) {
        information += Sums::over(kind, weighing, &residuals.centre).information / factor;
    }
    let without_scale = information.try_inverse().filter(|c| (0..6).all(|i| c[(i, i)] > 0.0))?;
    let taught_place = Motion::of(&model.camera_from_panel);
    let (taught, turn) = (taught_place.point(&model.centre), motion.turn * taught_place.turn.transpose());
    let [shared, between_scans] = of_scale([&taught, &residuals.centre], &turn, model.range);
    let at_taught_place = with_shift(without_scale, between_scans);
    let covariance = with_shift(at_taught_place, shared);
    let weakest = weakest(&covariance, model);
    let normal = motion.turn * model.normal;
    let (turn, shift) = (weakest.moves_mm.fixed_rows::<3>(0), weakest.moves_mm.fixed_rows::<3>(3));
    let (spin, lift) = (turn.dot(&normal).powi(2), shift.dot(&normal).powi(2));
    let (tilt, slide) = (turn.norm_squared() - spin, shift.norm_squared() - lift);
    let word = if lift + tilt >= spin.max(slide) {
        Weakest::Normal
    } else if slide >= spin {
        Weakest::Sideways
    } else {
        Weakest::Turn
    };
    Some(PoseCovariance {
        covariance,
        weakest: word,
        weakest_mm: WITHIN_95 * weakest.moves_mm.norm(),
        at_taught_place,
        without_scale,
    })
}

/// One standard deviation along the direction in which a pose is held least.
pub(super) struct WeakestDirection {
    /// As a twist (ω, v) about the panel's centre, rad and mm.
    pub twist: Vector6<f64>,
    /// The same in mm, where a turn counts by what it moves on average.
    pub moves_mm: Vector6<f64>,
}

/// The largest standard deviation, turns and shifts compared by what they move on average over the panel.
pub(super) fn weakest(covariance: &Matrix6<f64>, model: &Model) -> WeakestDirection {
    let count = model.points.len().max(1) as f64;
    let squares = model.points.iter().map(|point| (point - model.centre).norm_squared()).sum::<f64>();
    let radius_mm = (squares / count).sqrt();
    let to_mm = Vector6::new(radius_mm, radius_mm, radius_mm, 1.0, 1.0, 1.0);
    let scale = Matrix6::from_diagonal(&to_mm);
    let eigen = (scale * covariance * scale).symmetric_eigen();
    let along = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let moves_mm = along * eigen.eigenvalues.max().max(0.0).sqrt();
    WeakestDirection { twist: moves_mm.component_div(&to_mm), moves_mm }
}

/// f of (1).
fn inflation(constraints: &[Constraint], weighing: &ResidualWeighting, cell: impl Fn(usize) -> (i64, i64)) -> f64 {
    let mut cells: BTreeMap<(i64, i64), (f64, f64)> = BTreeMap::new();
    for constraint in constraints {
        let robust = weighing.robust(constraint.residual);
        let sums = cells.entry(cell(constraint.sample)).or_default();
        *sums = (sums.0 + robust, sums.1 + robust * constraint.residual);
    }
    let filled = cells.values().filter(|(weight, _)| *weight >= CELL_FILLED * weighing.correlated_count);
    let (count, squares) = filled.fold((0.0, 0.0), |(count, squares), (weight, sum)| {
        let mean = sum / weight;
        (count + 1.0, squares + mean * mean / (weighing.sigma * weighing.sigma))
    });
    // The fit takes up a part of the noise, so that cells never say that there is less of it than stated.
    ((TRUST_CELLS + squares) / (TRUST_CELLS + count)).max(1.0)
}

/// One standard deviation at the worst point of the panel, along its worst direction, mm.
pub(super) fn worst_mm(covariance: &Matrix6<f64>, model: &Model, motion: &Motion) -> f64 {
    let centre = motion.point(&model.centre);
    let at = |point: &Vector3<f64>| {
        let arm = motion.point(point) - centre;
        let mut a = Matrix3x6::zeros();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&-arm.cross_matrix());
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (a * covariance * a.transpose()).symmetric_eigenvalues().max()
    };
    model.outline.iter().step_by(4).map(|sample| at(&sample.point)).fold(0.0, f64::max).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: 700 mm away and moved by 20 mm along the view, 0.1 % in all scans alike is 0.02 mm; 0.01 % from scan to scan is 0.07 mm
    /// in each of the two, along the view.
    #[test]
    fn a_scale_that_both_scans_share_counts_with_the_way_between_them() {
        let (taught, now) = (Vector3::new(0.0, 0.0, 700.0), Vector3::new(0.0, 0.0, 720.0));
        let range = RangeErrors { scale: 0.001, scale_between_scans: 0.0001, ..RangeErrors::default() };
        let none = Matrix3::identity();
        let [shared, own] = of_scale([&taught, &now], &none, range);
        assert!((shared[(2, 2)].sqrt() - 0.02).abs() < 1e-12 && shared[(0, 0)] == 0.0, "{shared}");
        assert!((own[(2, 2)].sqrt() - 0.07_f64.hypot(0.072)).abs() < 1e-12 && own[(0, 0)] == 0.0, "{own}");
        let [shared, own] = of_scale([&taught, &taught], &none, range);
        assert_eq!(shared, Matrix3::zeros());
        assert!((own[(2, 2)].sqrt() - 0.07 * std::f64::consts::SQRT_2).abs() < 1e-12, "{own}");
        // Tilted by a right angle, what the taught scan had wrong along the view lies sideways now.
        let tilt = Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0);
        let [_, own] = of_scale([&taught, &taught], &tilt, range);
        assert!((own[(0, 0)].sqrt() - 0.07).abs() < 1e-12 && (own[(2, 2)].sqrt() - 0.07).abs() < 1e-12, "{own}");
    }
}
