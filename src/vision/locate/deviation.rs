//! Calculates the bend of the present panel relative to the taught panel: a smooth field of distances along the
//! normals.
//!
//! A pose is rigid, but a panel is not: it bends under its own weight, by moisture, or by its clamping. Therefore the
//! pose of a bent panel is defined as follows. Along the normal it is the rigid pose nearest to the surface. In the
//! plane of the panel it is the pose in which the outline of the bent panel agrees with the measured edges. The
//! remainder is the deviation
//!     d = c − F (FᵀF)⁻¹Fᵀ c.                                                                             (1)
//! Here c is the smooth field that is fitted to the residuals of the surface (`geometry/smooth_field`). The matrix F
//! contains, for each sample, the three rigid motions along the normal: a shift and two tilts. A bow is therefore never
//! treated as a shift or a tilt, and a shift or a tilt is never treated as a bow. A slide of a curved panel in its
//! plane looks like a deviation: only outline and marks constrain a bent panel there (`covariance`).

use super::fit::{FitInputs, FitState, Residuals, Samples, fit};
use super::grid::spread_indices;
use super::model::Model;
use nalgebra::{Matrix3, Vector3};
use panelprep_base::geometry::statistics::rms;
use panelprep_base::geometry::{HeightSample, RobustField, SmoothField};

/// Approximate number of samples to which the field is fitted. For a panel of 330 × 220 mm this is forty samples per
/// coefficient, so that the error of a coefficient is a sixth of the noise of a sample.
const MAX_FITTED_SAMPLES: usize = 2_500;
/// Maximum distance between a sample of the panel and the taught surface, mm; the limit is the same as for the present
/// surface.
const MAX_DISTANCE_MM: f64 = 20.0;
/// Minimum number of samples for a fit of the field; with fewer, no deviation is assumed.
const MIN_FITTED_SAMPLES: usize = 200;

/// Number of iterations, each of which calculates the deviation and fits the pose to the bent panel. The second
/// iteration moves the pose by less than the noise.
const DEVIATION_ITERATIONS: usize = 2;

/// The result of a fit, with the bend of the panel at this pose.
pub(super) struct BentFit {
    pub fitted: FitState,
    /// `None` if too little of the surface is visible: the taught panel is then used without a bend.
    pub deviation: Option<Deviation>,
    /// The taught panel, bent by the deviation.
    pub model: Option<Model>,
}

/// Estimates the deviation, starting with a fit of the taught panel to these samples.
pub(super) fn estimate_deviation(fitted: FitState, inputs: FitInputs<'_>, samples: &Samples) -> BentFit {
    let of_surface = samples.surface_only();
    let mut bent = BentFit { fitted, deviation: None, model: None };
    for _ in 0..DEVIATION_ITERATIONS {
        let now = FitInputs { model: bent.model.as_ref().unwrap_or(inputs.model), ..inputs };
        let residuals = Residuals::at_pose(&bent.fitted.camera_from_panel, now, &of_surface);
        let Some(deviation) = Deviation::from_residuals(&residuals, inputs.model, bent.deviation.as_ref()) else {
            break;
        };
        let model = deviation.bent_panel(inputs.model);
        // The fit is repeated after each estimate of the bend: the bend moves the outline, and only the outline
        // constrains a bent panel sideways.
        let Some(fitted) = fit(&bent.fitted.camera_from_panel, FitInputs { model: &model, ..inputs }, samples)
        else {
            break;
        };
        bent = BentFit { fitted, deviation: Some(deviation), model: Some(model) };
    }
    bent
}

/// The mean plane of a panel, with two coordinates for a position.
#[derive(Debug, Clone, Copy)]
pub(super) struct PanelPlane {
    centre: Vector3<f64>,
    /// Two directions in the plane, and its normal.
    axes: [Vector3<f64>; 3],
}

impl PanelPlane {
    /// Returns the plane through the middle of the panel, perpendicular to its mean normal; `None` for a panel without
    /// outline.
    pub fn from_model(model: &Model) -> Option<Self> {
        let first = model.outline.first()?.point - model.centre;
        let across = (first - model.normal * model.normal.dot(&first)).try_normalize(1e-9)?;
        Some(PanelPlane { centre: model.centre, axes: [across, model.normal.cross(&across), model.normal] })
    }

    /// Returns the coordinates of a point of the panel in the plane, mm from its middle.
    pub fn plane_position(&self, point: &Vector3<f64>) -> [f64; 2] {
        let arm = point - self.centre;
        [arm.dot(&self.axes[0]), arm.dot(&self.axes[1])]
    }

    /// Returns the row of F for a point: how far the point moves along its normal for each of three motions. The
    /// motions are a shift along the mean normal of the panel, and a rotation of one radian about each axis in the
    /// plane.
    pub fn motions(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> Vector3<f64> {
        let about = (point - self.centre).cross(normal);
        Vector3::new(normal.dot(&self.axes[2]), about.dot(&self.axes[0]), about.dot(&self.axes[1]))
    }
}

/// The deviation d of (1), as a smooth field on the plane of the panel.
#[derive(Debug, Clone)]
pub(super) struct Deviation {
    plane: PanelPlane,
    field: SmoothField,
    /// Lower corner and side lengths of the rectangle in the plane on which the field is defined.
    low_mm: [f64; 2],
    sides_mm: [f64; 2],
    /// The shift and the rotations that (1) removes from c.
    rigid: Vector3<f64>,
    /// Maximum deviation over the visible samples, mm.
    pub largest_mm: f64,
    /// Root mean square deviation over the visible samples, mm.
    pub rms_mm: f64,
}

impl Deviation {
    /// Computes the deviation from the residuals of the surface. `bent` is the deviation by which `model` is already
    /// bent. `None` if too little of the surface is visible.
    pub fn from_residuals(residuals: &Residuals, model: &Model, bent: Option<&Deviation>) -> Option<Self> {
        let plane = PanelPlane::from_model(model)?;
        let places: Vec<[f64; 2]> = model.points.iter().map(|point| plane.plane_position(point)).collect();
        let [low_mm, high_mm] = [f64::min, f64::max].map(|extreme: fn(f64, f64) -> f64| {
            places.iter().copied().reduce(|a, b| [extreme(a[0], b[0]), extreme(a[1], b[1])]).unwrap_or_default()
        });
        let sides_mm = [0, 1].map(|axis| (high_mm[axis] - low_mm[axis]).max(1.0));
        // The residual is the distance of the model in front of the scan.
        let seen = |index: usize| {
            let constraint = &residuals.surface[index];
            let sample = constraint.sample;
            // The total deviation from the taught panel is fitted in each iteration, so that rounding and noise do not
            // accumulate.
            let before_mm =
                bent.map_or(0.0, |bent| bent.deviation_at_mm(&model.points[sample], &model.normals[sample]));
            let at = [0, 1].map(|axis| (places[sample][axis] - low_mm[axis]) / sides_mm[axis]);
            let height = HeightSample { position: at, height_mm: before_mm - constraint.residual };
            // A sample beyond this limit is on another object, which must not bend the panel towards itself.
            (height.height_mm.abs() <= MAX_DISTANCE_MM).then_some((sample, height))
        };
        let seen: Vec<(usize, HeightSample)> =
            spread_indices(residuals.surface.len(), MAX_FITTED_SAMPLES).into_iter().filter_map(seen).collect();
        if seen.len() < MIN_FITTED_SAMPLES {
            return None;
        }
        let heights: Vec<HeightSample> = seen.iter().map(|(_, height)| *height).collect();
        let RobustField { field, limit_mm } = SmoothField::fit_robust(sides_mm, &heights)?;
        // Samples without weight, for example on a clamp, are not part of the panel.
        let of_panel: Vec<(Vector3<f64>, f64)> = seen
            .iter()
            .map(|(sample, height)| (sample, height, field.height_at(height.position)))
            .filter(|(_, height, there_mm)| (height.height_mm - there_mm).abs() < limit_mm)
            .map(|(sample, _, there_mm)| (plane.motions(&model.points[*sample], &model.normals[*sample]), there_mm))
            .collect();
        let (mut squares, mut sums) = (Matrix3::zeros(), Vector3::zeros());
        for (row, there_mm) in &of_panel {
            squares += row * row.transpose();
            sums += row * *there_mm;
        }
        // A shift and two tilts belong to the pose: as a part of the bend they would be counted twice or not at all.
        let rigid = squares.cholesky()?.solve(&sums);
        let sizes: Vec<f64> = of_panel.iter().map(|(row, there_mm)| there_mm - rigid.dot(row)).collect();
        let mut deviation = Deviation { plane, field, low_mm, sides_mm, rigid, largest_mm: 0.0, rms_mm: 0.0 };
        deviation.largest_mm = sizes.iter().fold(0.0, |largest, mm| mm.abs().max(largest));
        deviation.rms_mm = rms(sizes.iter().copied());
        Some(deviation)
    }

    /// Returns the distance of the present panel in front of the taught panel, at a point of the taught panel with this
    /// normal, mm.
    pub fn deviation_at_mm(&self, point: &Vector3<f64>, normal: &Vector3<f64>) -> f64 {
        let place = self.plane.plane_position(point);
        let at = [0, 1].map(|axis| (place[axis] - self.low_mm[axis]) / self.sides_mm[axis]);
        self.field.height_at(at) - self.rigid.dot(&self.plane.motions(point, normal))
    }

    /// Returns the taught panel, bent by this deviation.
    pub fn bent_panel(&self, model: &Model) -> Model {
        let moved =
            |point: &Vector3<f64>, normal: &Vector3<f64>| point + normal * self.deviation_at_mm(point, normal);
        let mut bent = model.clone();
        bent.points = model.points.iter().zip(&model.normals).map(|(point, normal)| moved(point, normal)).collect();
        bent.outline.iter_mut().for_each(|sample| sample.point = moved(&sample.point, &sample.normal));
        bent.marks.points.iter_mut().for_each(|mark| mark.point = moved(&mark.point, &mark.normal));
        bent
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::taught;
    use super::super::{Fit, RangeErrors, ScanView, gate, locate};
    use panelprep_base::geometry::{Camera, OrganizedCloud};
    use panelprep_base::verdict::{Judgement, Verdict};
    use panelprep_sim::{Cell, Scene};

    /// Locates the panel of a cell in a scan of the cell, and returns the fit and the verdict.
    fn located(cell: &Cell, scan: &OrganizedCloud<Camera>) -> (Fit, Judgement) {
        let (panel, recipe) = taught(cell);
        let (camera, base_from_camera) = (cell.scanner(), cell.calibrated_base_from_camera());
        let view = ScanView { scan, camera, base_from_camera, range: RangeErrors::default() };
        let fit = locate(&panel, &view, recipe.locate()).expect("a panel");
        let judgement = gate::judge(&fit, &recipe);
        (fit, judgement)
    }

    fn codes(judgement: &Judgement) -> Vec<&str> {
        judgement.reasons.iter().map(|reason| &*reason.code).collect()
    }

    /// Expected values, calculated by hand: a parabola of 2 mm over ±165 mm differs from its mean by 2/3 mm in the
    /// middle, and by 4/3 mm in the opposite direction at its ends. The remaining residual is the noise of the scans,
    /// less than 0.12 mm. Parts of the panel are farther out than its straight ends, so the deviation may be slightly
    /// larger.
    #[test]
    fn a_panel_that_bows_by_2_mm_is_the_panel() {
        for bow_mm in [2.0, -2.0] {
            let cell = Cell::new(4, Scene::Good, 4).with_bow(bow_mm);
            let (fit, judgement) = located(&cell, &cell.scan());
            assert_eq!(judgement.verdict, Verdict::Accept, "{bow_mm}: {judgement:?}");
            assert!(
                fit.rms_mm < 0.12 && fit.deviation_mm.is_some_and(|mm| (1.1..1.7).contains(&mm)),
                "{bow_mm}: {fit:?}"
            );
        }
    }

    /// A panel with the same outline and a curvature that differs by 6 mm needs at least a review by a person.
    #[test]
    fn another_curvature_is_not_accepted() {
        for bow_mm in [6.0, -6.0] {
            let cell = Cell::new(4, Scene::Good, 4).with_bow(bow_mm);
            let (fit, judgement) = located(&cell, &cell.scan());
            assert_ne!(judgement.verdict, Verdict::Accept, "{bow_mm}: {fit:?}");
        }
    }

    /// A plate 2 mm thick on a quarter of the panel, and waves of 50 mm length and 0.5 mm height: neither of them is
    /// explained by a smooth bend.
    #[test]
    fn a_shape_that_no_smooth_bend_explains_is_a_poor_fit() {
        let cell = Cell::new(4, Scene::Good, 4);
        let scan = cell.scan();
        let nearer = |before_mm: &dyn Fn([f64; 3]) -> f64| {
            let base_from_camera = cell.calibrated_base_from_camera();
            let points = scan.raw_points_mm().iter().map(|point| {
                let [x, y, z] = point.map(f64::from);
                let place = (base_from_camera * panelprep_base::geometry::Point::<Camera>::at(x, y, z)).mm;
                let way_mm = x.hypot(y).hypot(z);
                point.map(|n| (f64::from(n) * (1.0 - before_mm([place.x, place.y, place.z]) / way_mm)) as f32)
            });
            let cloud = OrganizedCloud::new(scan.width(), scan.height(), points.collect(), scan.picture().rgb);
            cloud.expect("organised")
        };
        let is_covered = |[_, y, z]: [f64; 3]| (-120.0..20.0).contains(&y) && (330.0..430.0).contains(&z);
        let covered = nearer(&|place| if is_covered(place) { 2.0 } else { 0.0 });
        let (fit, judgement) = located(&cell, &covered);
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Reject, vec!["poor_fit"]), "{fit:?}");
        let waves = nearer(&|[_, y, _]| 0.5 * (std::f64::consts::TAU * y / 50.0).sin());
        let (fit, judgement) = located(&cell, &waves);
        assert_eq!((judgement.verdict, codes(&judgement)), (Verdict::Reject, vec!["poor_fit"]), "{fit:?}");
    }
}
