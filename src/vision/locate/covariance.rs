//! The covariance of a pose, and the uncertainty on the panel that follows from it.
//!
//! A fit with the information matrix N = Σ wᵢ JᵢᵀJᵢ transforms the errors eᵢ of its residuals into a twist about the
//! centre of the panel of −N⁻¹ Σ wᵢ Jᵢᵀ eᵢ = −Σ Bᵢ eᵢ. Its covariance is
//!     C = N⁻¹ (Σ_k f_k N_k) N⁻¹ + f σ² Σᵢⱼ κ(xᵢ − xⱼ) Bᵢ Bⱼᵀ + v Σᵢⱼ κ(xᵢ − xⱼ) B⊥ᵢ B⊥ⱼᵀ,   κ(x) = exp(−π x²/ℓ²).          (1)
//! The first term is that of the edges and marks k, whose cells have independent errors; the other two terms are those
//! of the surface. The second term is the smooth error of the scan, with the stated standard deviation σ. The
//! correlation length ℓ of this error is not known. If ℓ is larger than the panel, the error is a shift that no
//! residual shows. Therefore (1) is evaluated for ℓ of 30 to 400 mm, and the largest result is stated. The third term
//! is the deviation d of the panel from the taught panel (`deviation`), with its measured mean square v. B⊥ is B
//! without the part that consists of a shift and two tilts along the normal. Only the effect remains by which a bend
//! slides a curved panel in its plane. The factor f is
//!     f = max(1, (ν + Σ_c m_c²/s_c²) / (ν + n))                                                             (2)
//! For each kind of residual, `fit` states the noise s of the mean m of a cell, whose members have a common error. The
//! factor f states by how much the means of the n cells exceed this noise. A prior weight of ν cells for the stated
//! noise stabilises f, because a small panel has few cells. The means of the surface are computed relative to the
//! deviation. A point x of the panel then has the covariance A C Aᵀ with A = [−[x − c]×  I].
//!
//! A camera whose distances are all too long by the relative error s measures the panel's centre c, seen from the
//! camera, at (1 + s) c, which no residual shows. The part of s that all scans have in common also shifts the camera
//! mount, if the mount was measured with the same camera near the taught position; there the two shifts cancel. The
//! difference between the two scans does not cancel:
//!     C_vv += σ_s² (c − c₀)(c − c₀)ᵀ + σ_d² (c cᵀ + (R c₀)(R c₀)ᵀ),                                           (3)
//! with the taught centre c₀, the rotation R from the taught to the present pose, the standard deviation σ_s of the
//! part of s that all scans have in common, and the standard deviation σ_d of the part that differs from scan to scan.
//! (3) does not contain the error of the size of the panel by s, which is much smaller over half a panel. It also does
//! not contain the error of a mount that was measured far from the taught position.

use super::deviation::{Deviation, PanelPlane};
use super::fit::{EDGE_CORRELATION_MM, RESIDUAL_KIND_COUNT, Residuals};
use super::grid::{MatrixTransform, spread_indices};
use super::model::Model;
use super::scan_errors::RangeErrors;
use super::solve::{Constraint, ResidualSums, ResidualWeighting};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Matrix6x3, Vector3, Vector6};
use panelprep_base::geometry::statistics::NORMAL_TWO_SIDED_95;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Values of the correlation length ℓ for which (1) is evaluated, mm. They range from slightly below the cell sizes of
/// the error fields that were measured in scans to beyond the largest trial panel.
const CORRELATION_LENGTHS_MM: [f64; 4] = [30.0, 85.0, 200.0, 400.0];
/// Approximate number of surface points over which (1) is summed: on a panel of 330 × 220 mm they are 15 mm apart.
const MAX_SURFACE_POINT_COUNT: usize = 300;
/// Lower limit for the fraction of a field's variance that remains after a shift and two tilts are removed; prevents a
/// division by zero.
const MIN_VARIANCE_FRACTION: f64 = 1e-3;
/// ν of (2), the prior weight of the stated noise, in cells.
const PRIOR_CELL_COUNT: f64 = 12.0;
/// Index of the surface among the kinds of residuals.
const SURFACE_KIND: usize = 0;
/// Minimum number of points of a cell, as a fraction of a full cell.
const MIN_CELL_FILL_FRACTION: f64 = 0.3;

/// Returns the terms that (3) adds to the covariance of the shift, from the taught and the present centre of the panel
/// and the rotation between them. The first term is for a scale error that all scans have in common, the second for a
/// scale error that differs from scan to scan.
fn scale_error_terms(
    [taught, now]: [&Vector3<f64>; 2],
    turn: &Matrix3<f64>,
    range: RangeErrors,
) -> [Matrix3<f64>; 2] {
    let (moved, turned) = (now - taught, turn * taught);
    [
        moved * moved.transpose() * range.scale.powi(2),
        (now * now.transpose() + turned * turned.transpose()) * range.scan_to_scan_scale.powi(2),
    ]
}

/// Adds the covariance of a translation to the translational block of a twist's covariance.
fn add_shift_covariance(mut covariance: Matrix6<f64>, further: Matrix3<f64>) -> Matrix6<f64> {
    let mut shifts = covariance.fixed_view_mut::<3, 3>(3, 3);
    shifts += further;
    covariance
}

/// The direction in which a pose is least constrained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WeakestMotion {
    /// A shift along the normal of the panel, or a tilt of the normal.
    Normal,
    /// A shift in the plane of the panel.
    Sideways,
    /// A rotation in the plane of the panel.
    Turn,
}

impl WeakestMotion {
    /// Returns a description of the direction, as text for a person.
    pub fn describe(self) -> &'static str {
        match self {
            WeakestMotion::Normal => "along the panel's normal",
            WeakestMotion::Sideways => "sideways in the panel's plane",
            WeakestMotion::Turn => "in rotation about the panel's normal",
        }
    }
}

/// The uncertainty of a pose.
pub(super) struct PoseCovariance {
    /// The sum of (1) and (3) as the covariance of a twist (ω, v) about the centre of the panel, rad and mm.
    pub covariance: Matrix6<f64>,
    /// The direction with the largest covariance.
    pub weakest: WeakestMotion,
    /// Uncertainty along this direction, 95 %, mm; for a rotation its mean displacement of the panel.
    pub weakest_mm: f64,
    /// The covariance without the term of (3) for the common scale error, which is zero at the taught pose.
    pub at_taught_place: Matrix6<f64>,
    /// The covariance by (1), without (3).
    pub without_scale_term: Matrix6<f64>,
}

/// Computes the covariance by (1) and (3); `None` if the residuals leave a direction unconstrained. `model` is the
/// panel with its bend at this pose.
pub(super) fn covariance(
    residuals: &Residuals,
    weighing: &[ResidualWeighting; RESIDUAL_KIND_COUNT],
    model: &Model,
    (motion, deviation): (&MatrixTransform, Option<&Deviation>),
) -> Option<PoseCovariance> {
    let plane = PanelPlane::from_model(model)?;
    let cell = |point: &Vector3<f64>, side_mm: f64| {
        let [x, y] = plane.plane_position(point).map(|mm| (mm / side_mm).floor() as i64);
        (x, y)
    };
    let square = |sample: usize| cell(&model.points[sample], model.range.correlation_mm);
    let mark_square = |sample: usize| cell(&model.marks.points[sample].point, model.range.correlation_mm);
    // The points of the taught outline are ordered, so a segment consists of consecutive points.
    let mut ways_mm = Vec::with_capacity(model.outline.len());
    let mut way_mm = 0.0;
    for sample in &model.outline {
        ways_mm.push(way_mm);
        way_mm += sample.length_mm;
    }
    let stretch = |sample: usize| ((ways_mm[sample] / EDGE_CORRELATION_MM).floor() as i64, 0);
    let factors = [
        correlation_inflation(&residuals.surface, &weighing[0], square),
        correlation_inflation(&residuals.colour, &weighing[1], stretch),
        correlation_inflation(&residuals.depth, &weighing[2], stretch),
        correlation_inflation(&residuals.marks, &weighing[3], mark_square),
    ];
    let (mut information, mut of_edges) = (Matrix6::zeros(), Matrix6::zeros());
    for (k, kind) in residuals.kinds().iter().enumerate() {
        let of_kind = ResidualSums::from_constraints(kind, &weighing[k], &residuals.centre).information;
        information += of_kind;
        of_edges += if k == SURFACE_KIND { Matrix6::zeros() } else { of_kind * factors[k] };
    }
    let inverse = information.try_inverse().filter(|c| (0..6).all(|i| c[(i, i)] > 0.0))?;
    let surface = SurfaceErrorEffects::new(
        select_surface_points(residuals, &weighing[SURFACE_KIND], (model, plane)),
        &inverse,
    );
    let of_edges = inverse * of_edges * inverse;
    let variances = [
        factors[SURFACE_KIND] * weighing[SURFACE_KIND].sigma.powi(2),
        deviation.map_or(0.0, |it| it.rms_mm.powi(2)),
    ];
    // The correlation length of the scan's error is not known; the length with the largest effect is used.
    let at_lengths: Vec<Matrix6<f64>> = CORRELATION_LENGTHS_MM
        .par_iter()
        .map(|&alike_mm| of_edges + surface.covariance(alike_mm, variances))
        .collect();
    let without_scale = at_lengths
        .into_iter()
        .max_by(|a, b| worst_mm(a, model, motion).total_cmp(&worst_mm(b, model, motion)))
        .filter(|covariance| covariance.iter().all(|value| value.is_finite()))?;
    let taught_place = MatrixTransform::from_rigid(&model.camera_from_panel);
    let (taught, turn) = (taught_place.point(&model.centre), motion.turn * taught_place.turn.transpose());
    let [shared, between_scans] = scale_error_terms([&taught, &residuals.centre], &turn, model.range);
    let at_taught_place = add_shift_covariance(without_scale, between_scans);
    let covariance = add_shift_covariance(at_taught_place, shared);
    let weakest = weakest_direction(&covariance, model);
    let normal = motion.turn * model.normal;
    let (turn, shift) = (weakest.moves_mm.fixed_rows::<3>(0), weakest.moves_mm.fixed_rows::<3>(3));
    let (spin, lift) = (turn.dot(&normal).powi(2), shift.dot(&normal).powi(2));
    let (tilt, slide) = (turn.norm_squared() - spin, shift.norm_squared() - lift);
    let word = if lift + tilt >= spin.max(slide) {
        WeakestMotion::Normal
    } else if slide >= spin {
        WeakestMotion::Sideways
    } else {
        WeakestMotion::Turn
    };
    Some(PoseCovariance {
        covariance,
        weakest: word,
        weakest_mm: NORMAL_TWO_SIDED_95 * weakest.moves_mm.norm(),
        at_taught_place,
        without_scale_term: without_scale,
    })
}

/// A surface point with its contribution to the information matrix of the fit.
struct SurfacePoint {
    /// Position of the point in the plane of the panel, mm.
    at_mm: [f64; 2],
    /// The gradient w Jᵀ of (1) for this point.
    weighted_gradient: Vector6<f64>,
    /// The row of the matrix F (see `deviation`) for this point.
    rigid: Vector3<f64>,
}

/// The effect of the errors of the surface residuals on the pose of the panel.
struct SurfaceErrorEffects {
    places: Vec<SurfacePoint>,
    /// The matrix column B of (1) for each surface point.
    moves: Vec<Vector6<f64>>,
    /// The matrix column B⊥ of (1) for each surface point.
    bent: Vec<Vector6<f64>>,
    /// The inverse (FᵀF)⁻¹, with the matrix F of `deviation`.
    of_rigid: Matrix3<f64>,
}

/// Selects surface points that represent all surface residuals.
fn select_surface_points(
    residuals: &Residuals,
    weighing: &ResidualWeighting,
    (model, plane): (&Model, PanelPlane),
) -> Vec<SurfacePoint> {
    let chosen = spread_indices(residuals.surface.len(), MAX_SURFACE_POINT_COUNT);
    let each_for = residuals.surface.len() as f64 / chosen.len().max(1) as f64;
    let place = |index: usize| {
        let constraint = &residuals.surface[index];
        let (point, normal) = (&model.points[constraint.sample], &model.normals[constraint.sample]);
        SurfacePoint {
            at_mm: plane.plane_position(point),
            weighted_gradient: constraint.jacobian(&residuals.centre)
                * (weighing.weight(constraint.residual) * each_for),
            rigid: plane.motions(point, normal),
        }
    };
    chosen.into_iter().map(place).collect()
}

impl SurfaceErrorEffects {
    /// Computes the effect of the residual errors on a fit; `inverse` is the inverse of its information matrix.
    fn new(places: Vec<SurfacePoint>, inverse: &Matrix6<f64>) -> SurfaceErrorEffects {
        let moves: Vec<Vector6<f64>> = places.iter().map(|place| inverse * place.weighted_gradient).collect();
        let squares: Matrix3<f64> = places.iter().map(|place| place.rigid * place.rigid.transpose()).sum();
        let of_rigid = squares.try_inverse().unwrap_or_else(Matrix3::zeros);
        let both = || moves.iter().zip(&places);
        let taken_off: Matrix6x3<f64> = both().map(|(moves, place)| moves * place.rigid.transpose()).sum();
        let bent = both().map(|(moves, place)| moves - taken_off * (of_rigid * place.rigid)).collect();
        SurfaceErrorEffects { places, moves, bent, of_rigid }
    }

    /// Returns the last two terms of (1), for this correlation length and these variances of the scan's error and of
    /// the panel's deviation, mm².
    fn covariance(&self, alike_mm: f64, [of_scan, of_panel]: [f64; 2]) -> Matrix6<f64> {
        let count = self.places.len();
        let (mut noise, mut bend, mut rigid) = (Matrix6::zeros(), Matrix6::zeros(), Matrix3::zeros());
        for i in 0..count {
            let (mut noise_with, mut bend_with, mut rigid_with) =
                (Vector6::zeros(), Vector6::zeros(), Vector3::zeros());
            for j in 0..count {
                let [from, to] = [i, j].map(|place| self.places[place].at_mm);
                let [dx, dy] = [0, 1].map(|axis| (from[axis] - to[axis]) / alike_mm);
                let alike = (-PI * (dx * dx + dy * dy)).exp();
                noise_with += self.moves[j] * alike;
                bend_with += self.bent[j] * alike;
                rigid_with += self.places[j].rigid * alike;
            }
            noise += self.moves[i] * noise_with.transpose();
            bend += self.bent[i] * bend_with.transpose();
            rigid += self.places[i].rigid * rigid_with.transpose();
        }
        // Removing a shift and two tilts from a field of variance 1 reduces its variance. The measured variance is the
        // reduced one.
        let left = 1.0 - (self.of_rigid * rigid).trace() / count.max(1) as f64;
        noise * of_scan + bend * (of_panel / left.max(MIN_VARIANCE_FRACTION))
    }
}

/// One standard deviation along the direction in which a pose is least constrained.
pub(super) struct WeakestDirection {
    /// The standard deviation as a twist (ω, v) about the centre of the panel, rad and mm.
    pub twist: Vector6<f64>,
    /// The same twist in mm; for a rotation the mean distance by which it displaces the points of the panel.
    pub moves_mm: Vector6<f64>,
}

/// Returns the direction with the largest standard deviation. Rotations and shifts are compared by the mean
/// displacement of the panel that they cause.
pub(super) fn weakest_direction(covariance: &Matrix6<f64>, model: &Model) -> WeakestDirection {
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

/// Returns the factor f of (2).
fn correlation_inflation(
    constraints: &[Constraint],
    weighing: &ResidualWeighting,
    cell: impl Fn(usize) -> (i64, i64),
) -> f64 {
    let mut cells: BTreeMap<(i64, i64), (f64, f64)> = BTreeMap::new();
    for constraint in constraints {
        let robust = weighing.tukey_weight(constraint.residual);
        let sums = cells.entry(cell(constraint.sample)).or_default();
        *sums = (sums.0 + robust, sums.1 + robust * constraint.residual);
    }
    // The mean of a cell at the rim with few points is noisy, and would look like correlated noise.
    let filled = cells.values().filter(|(weight, _)| *weight >= MIN_CELL_FILL_FRACTION * weighing.correlated_count);
    let (count, squares) = filled.fold((0.0, 0.0), |(count, squares), (weight, sum)| {
        let mean = sum / weight;
        (count + 1.0, squares + mean * mean / (weighing.sigma * weighing.sigma))
    });
    // The fit absorbs a part of the noise. Therefore the cells never reduce the stated noise.
    ((PRIOR_CELL_COUNT + squares) / (PRIOR_CELL_COUNT + count)).max(1.0)
}

/// Returns one standard deviation at the point of the panel with the largest error, along the direction of this error,
/// mm.
pub(super) fn worst_mm(covariance: &Matrix6<f64>, model: &Model, motion: &MatrixTransform) -> f64 {
    let centre = motion.point(&model.centre);
    let at = |point: &Vector3<f64>| {
        let arm = motion.point(point) - centre;
        let mut a = Matrix3x6::zeros();
        a.fixed_view_mut::<3, 3>(0, 0).copy_from(&-arm.cross_matrix());
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
        (a * covariance * a.transpose()).symmetric_eigenvalues().max()
    };
    // The outline is sufficient: the displacement by a small rotation is largest at the rim.
    model.outline.iter().step_by(4).map(|sample| at(&sample.point)).fold(0.0, f64::max).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the effect of errors on a panel of 300 × 200 mm with 25 × 17 surface points; `slope` is its slope along
    /// x at its ends. With a linear slope the panel would be a parabola, which a slide only tilts. Here the slope is
    /// proportional to the square of x, so that a slide bends the panel. The fit has the information of the surface,
    /// and `of_outline` per mm² for a shift along x and y and for a rotation.
    fn moves(slope: f64, of_outline: f64) -> SurfaceErrorEffects {
        let place = |n: usize| {
            let [x, y] = [(n % 25) as f64 * 12.5 - 150.0, (n / 25) as f64 * 12.5 - 100.0];
            let (point, normal) = (
                Vector3::new(x, y, -slope * x.powi(3) / (3.0 * 150.0 * 150.0)),
                Vector3::new(slope * (x / 150.0).powi(2), 0.0, 1.0).normalize(),
            );
            let arm = point.cross(&normal);
            let rigid = Vector3::new(normal.z, arm.x, arm.y);
            SurfacePoint {
                at_mm: [x, y],
                weighted_gradient: Vector6::new(arm.x, arm.y, arm.z, normal.x, normal.y, normal.z),
                rigid,
            }
        };
        let places: Vec<SurfacePoint> = (0..25 * 17).map(place).collect();
        let of_surface: Matrix6<f64> =
            places.iter().map(|place| place.weighted_gradient * place.weighted_gradient.transpose()).sum();
        let outline = Matrix6::from_diagonal(&Vector6::new(0.0, 0.0, 1e4, 1.0, 1.0, 0.0)) * of_outline;
        SurfaceErrorEffects::new(places, &(of_surface + outline).try_inverse().expect("held"))
    }

    /// Expected values, calculated by hand: an error that is constant over the whole panel shifts the panel by this
    /// error and does not tilt it. An error with a much shorter correlation length is averaged over n independent cells
    /// of ℓ²: 0.1 mm over 60000 / 30² = 67 cells is 0.012 mm.
    #[test]
    fn a_scan_error_longer_than_the_panel_is_a_shift_that_no_residual_shows() {
        let flat = moves(0.0, 1.0);
        let long = flat.covariance(1e6, [0.01, 0.0]);
        assert!((long[(5, 5)].sqrt() - 0.1).abs() < 1e-6, "{}", long[(5, 5)].sqrt());
        assert!(long[(0, 0)].sqrt() * 100.0 < 1e-3 && long[(1, 1)].sqrt() * 150.0 < 1e-3, "{long}");
        let short = flat.covariance(30.0, [0.01, 0.0])[(5, 5)].sqrt();
        assert!((0.011..0.0135).contains(&short), "{short}");
    }

    /// A bend of 0.5 mm rms causes no shift or tilt along the normal, by the definition of a pose, and does not slide a
    /// flat panel. It slides a curved panel whose outline hardly constrains it; the displacement increases as the
    /// constraint by the outline decreases.
    #[test]
    fn a_bend_slides_a_curved_panel_that_its_outline_hardly_constrains() {
        let bent = |slope: f64, of_outline: f64| moves(slope, of_outline).covariance(200.0, [0.0, 0.25]);
        let flat = bent(0.0, 1.0);
        assert!(flat.iter().all(|value| value.abs() < 1e-9), "{flat}");
        let sideways = |of_outline: f64| bent(0.3, of_outline)[(3, 3)].sqrt();
        assert!(sideways(1e6) < 0.01, "{}", sideways(1e6));
        assert!(sideways(1.0) > 0.3 && sideways(1.0) > 2.0 * sideways(1e2), "{} {}", sideways(1.0), sideways(1e2));
        assert!(bent(0.3, 1e6)[(5, 5)].sqrt() < 0.02);
    }

    /// Expected values, calculated by hand for a panel at a distance of 700 mm, moved by 20 mm along the view: a common
    /// scale error of 0.1 % is 0.02 mm. A scale error of 0.01 % that differs from scan to scan is 0.07 mm in each of
    /// the two scans, along the view.
    #[test]
    fn a_common_scale_error_increases_with_the_distance_between_the_poses() {
        let (taught, now) = (Vector3::new(0.0, 0.0, 700.0), Vector3::new(0.0, 0.0, 720.0));
        let range = RangeErrors { scale: 0.001, scan_to_scan_scale: 0.0001, ..RangeErrors::default() };
        let none = Matrix3::identity();
        let [shared, own] = scale_error_terms([&taught, &now], &none, range);
        assert!((shared[(2, 2)].sqrt() - 0.02).abs() < 1e-12 && shared[(0, 0)] == 0.0, "{shared}");
        assert!((own[(2, 2)].sqrt() - 0.07_f64.hypot(0.072)).abs() < 1e-12 && own[(0, 0)] == 0.0, "{own}");
        let [shared, own] = scale_error_terms([&taught, &taught], &none, range);
        assert_eq!(shared, Matrix3::zeros());
        assert!((own[(2, 2)].sqrt() - 0.07 * std::f64::consts::SQRT_2).abs() < 1e-12, "{own}");
        // After a tilt by a right angle, the error of the taught scan along its view is sideways.
        let tilt = Matrix3::new(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0);
        let [_, own] = scale_error_terms([&taught, &taught], &tilt, range);
        assert!((own[(0, 0)].sqrt() - 0.07).abs() < 1e-12 && (own[(2, 2)].sqrt() - 0.07).abs() < 1e-12, "{own}");
    }
}
