//! Computes today's surface: the taught surface, smoothly corrected with the scan in which the panel was located.
//!
//! The found pose transforms a point P of this scan to the panel's frame. The taught camera sees the point in a pixel,
//! which gives the point's parameters (u, v). Then r = N(u, v) · (P − S(u, v)) is the distance of today's panel in
//! front of the taught panel. The correction c(u, v) is a smooth field that is fitted to r (`geometry/smooth_field`).
//! Each control point of the surface is moved along the normal at its Greville abscissa, until the surface there is
//! moved by c. The region is divided into cells with approximately equal sides, stored row by row.

use super::bspline::{BSplineSurface, Parameter, SurfaceError};
use super::map::{DeviationMap, MapPixel};
use super::patch::sides_mm;
use nalgebra::Point2;
use panelprep_base::geometry::statistics::rms;
use panelprep_base::geometry::{
    Camera, HeightSample, OrganizedCloud, Panel, Point, RasterSize, Rigid, RobustField, SmoothField, Vector,
};
use panelprep_cell::panel::TaughtPanel;
use rayon::prelude::*;

/// Approximate number of points of the region that are stored: four per square of 6 mm in a region of 600 × 900 mm.
const MAX_POINTS: usize = 60_000;
/// Approximate number of points to which the correction is fitted: they determine each of a hundred coefficients to a
/// tenth of a point's noise.
const MAX_FITTED_POINTS: usize = 8_000;
/// Maximum distance of a panel point from the taught surface, mm; points that are farther away belong to other objects.
const MAX_DISTANCE_MM: f64 = 20.0;
/// Number of points along each side of the region at which the deviation is evaluated.
const EVALUATION_POINTS: usize = 32;
/// Number of iterations in which the control points are moved until the surface has moved by the correction.
const DISPLACEMENT_ITERATIONS: usize = 6;

/// A point of today's scan with its parameters on the taught surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TodaysPoint {
    /// The point's position in the taught camera's picture, in the region's unit square.
    at: Parameter,
    /// The point in the panel's frame, mm.
    point: Vector<Panel>,
}

impl TodaysPoint {
    /// Returns the point in the panel's frame.
    pub fn position(&self) -> Point<Panel> {
        Point::new(self.point.mm.into())
    }

    /// Returns the point's parameters on the taught surface.
    pub fn parameter(&self) -> Parameter {
        self.at
    }
}

/// Today's surface with its deviations from the taught surface and from the scan.
#[derive(Debug, Clone)]
pub struct TodaysSurfaceFit {
    /// The surface; the region is the unit square of its parameters.
    pub surface: BSplineSurface,
    /// Largest distance between today's surface and the taught surface, mm.
    pub largest_mm: f64,
    /// Root mean square of the points' distances from the surface, mm.
    pub rms_mm: f64,
    /// The fraction of the region in which no point was seen, or in which most points belong to other objects, percent.
    pub missing_percent: f64,
    /// Side of the largest square in which the surface is not visible, mm.
    pub largest_hole_mm: f64,
    /// Distance of today's surface in front of the taught surface for each pixel; missing if no point was seen.
    pub map: DeviationMap,
    /// The measured distances to which today's surface was fitted.
    pub(super) measured: MeasuredHeights,
}

/// The points' distances in front of the taught surface, and the field that was fitted to these distances.
#[derive(Debug, Clone)]
pub(super) struct MeasuredHeights {
    /// All points of the scan in the region, including points of other objects.
    pub seen: Vec<HeightSample>,
    /// The fitted correction c.
    pub field: SmoothField,
    /// Maximum distance of a point from the correction, mm, at which the point belongs to the panel.
    pub limit_mm: f64,
}

/// The reason why a scan does not determine today's surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TodayError {
    /// The scan has no point near the taught region.
    #[error("the scan in which the panel was located has no point in the panel's region; scan again")]
    NoPoints,
    /// The equations of the correction have no solution.
    #[error("the scan in which the panel was located does not determine the region's surface; scan again")]
    Undetermined,
    /// The corrected control points do not form a surface.
    #[error("the surface corrected with today's scan is not valid: {0}; scan the panel again")]
    Surface(#[from] SurfaceError),
}

/// Returns the points of a scan that lie in the region, thinned to the required number; `panel_from_camera` is the
/// panel's pose found in this scan.
pub fn todays_points(
    panel: &TaughtPanel,
    scan: &OrganizedCloud<Camera>,
    panel_from_camera: &Rigid<Panel, Camera>,
) -> Vec<TodaysPoint> {
    let taught_from_camera = panel.panel_from_camera.inverse() * *panel_from_camera;
    let seen = |index: usize| {
        let point = scan.point(index % scan.width(), index / scan.width())?;
        let unit = panel.region.unit(panel.camera.project(taught_from_camera * point)?);
        let is_inside = (0.0..=1.0).contains(&unit.x) && (0.0..=1.0).contains(&unit.y);
        let point = Vector::new((*panel_from_camera * point).mm.coords);
        is_inside.then_some(TodaysPoint { at: Parameter { u: unit.x, v: unit.y }, point })
    };
    // The stride assumes that the region covers at least a sixteenth of the picture.
    let every = ((scan.width() * scan.height()) as f64 / (16 * MAX_POINTS) as f64).sqrt().floor().max(1.0) as usize;
    let rows: Vec<usize> = (0..scan.height()).step_by(every).collect();
    let of_row = |row: usize| (0..scan.width()).step_by(every).map(move |column| row * scan.width() + column);
    let all: Vec<TodaysPoint> = rows.into_par_iter().flat_map_iter(|row| of_row(row).filter_map(&seen)).collect();
    let step = all.len().div_ceil(MAX_POINTS).max(1);
    all.into_iter().step_by(step).collect()
}

/// Corrects the taught surface with the points of today's scan.
///
/// # Errors
/// If no point lies near the taught surface, or the points do not determine a surface.
pub fn correct_taught_surface(
    taught: &BSplineSurface,
    panel: &TaughtPanel,
    map: &DeviationMap,
    (points, max_hole_mm): (&[TodaysPoint], f64),
) -> Result<TodaysSurfaceFit, TodayError> {
    let in_front = |point: &TodaysPoint| {
        let there = taught.tangents(point.at);
        let mm = taught.unit_normal(&there)?.mm.dot(&(point.point.mm - there.point.mm.coords));
        Some(HeightSample { position: [point.at.u, point.at.v], height_mm: mm })
    };
    let seen: Vec<HeightSample> = points.par_iter().filter_map(in_front).collect();
    let near: Vec<HeightSample> =
        seen.iter().copied().filter(|height| height.height_mm.abs() <= MAX_DISTANCE_MM).collect();
    if near.is_empty() {
        return Err(TodayError::NoPoints);
    }
    let fitted: Vec<HeightSample> = near.iter().copied().step_by(near.len().div_ceil(MAX_FITTED_POINTS)).collect();
    let sides_mm = sides_mm(taught);
    let RobustField { field, limit_mm } =
        SmoothField::fit_robust(sides_mm, &fitted).ok_or(TodayError::Undetermined)?;
    let surface = displaced_surface(taught, &field, panel)?;
    // Includes points far from the taught surface, which do not belong to the panel.
    let off_mm: Vec<f64> =
        seen.par_iter().map(|height| (height.height_mm - field.height_at(height.position)).abs()).collect();
    let near_mm = off_mm.iter().copied().filter(|off_mm| *off_mm < limit_mm);
    let rms_mm = rms(near_mm);
    let mut cells = Cells::new(sides_mm, max_hole_mm / 2.0);
    seen.iter().zip(&off_mm).for_each(|(height, off_mm)| cells.count(height.position, *off_mm < limit_mm));
    let map = map.fill_region(|pixel| {
        let unit: Point2<f64> = panel.region.unit(pixel);
        let at = [unit.x, unit.y].map(|share| share.clamp(0.0, 1.0));
        if cells.is_visible(cells.raster.index(at)) {
            MapPixel::Fits { mm: field.height_at(at) as f32 }
        } else {
            MapPixel::Missing
        }
    });
    let middle = |index: usize| (index as f64 + 0.5) / EVALUATION_POINTS as f64;
    let middles = (0..EVALUATION_POINTS * EVALUATION_POINTS)
        .map(|n| [middle(n % EVALUATION_POINTS), middle(n / EVALUATION_POINTS)]);
    Ok(TodaysSurfaceFit {
        surface,
        largest_mm: middles.map(|at| field.height_at(at).abs()).fold(0.0, f64::max),
        rms_mm,
        missing_percent: cells.missing_percent(),
        largest_hole_mm: cells.largest_hole_mm(),
        map,
        measured: MeasuredHeights { seen, field, limit_mm },
    })
}

/// The cells of the region, with the numbers of points that decide where today's surface was seen.
struct Cells {
    raster: CellRaster,
    /// For each cell, the number of points, and the number of these points that belong to the surface.
    counts: Vec<[u32; 2]>,
}

impl Cells {
    /// Creates cells with sides of about this length.
    fn new(sides_mm: [f64; 2], cell_mm: f64) -> Self {
        let raster = CellRaster::new(sides_mm, cell_mm);
        Cells { raster, counts: vec![[0; 2]; raster.count()] }
    }

    fn count(&mut self, at: [f64; 2], is_of_surface: bool) {
        let index = self.raster.index(at);
        self.counts[index][0] += 1;
        self.counts[index][1] += u32::from(is_of_surface);
    }

    /// Returns whether most points of a cell belong to the surface; `false` for a cell without points.
    fn is_visible(&self, index: usize) -> bool {
        let [all, of_surface] = self.counts[index];
        2 * of_surface > all
    }

    fn missing_percent(&self) -> f64 {
        let missing = (0..self.counts.len()).filter(|index| !self.is_visible(*index)).count();
        100.0 * missing as f64 / self.counts.len() as f64
    }

    fn largest_hole_mm(&self) -> f64 {
        let squares = self.raster.size.largest_squares(|index| !self.is_visible(index));
        f64::from(squares.into_iter().max().unwrap_or(0)) * self.raster.side_mm
    }
}

/// Returns the surface moved by c along its normals. A control point without a normal is not moved; a control point
/// outside of the region is moved like the region's border.
fn displaced_surface(
    taught: &BSplineSurface,
    correction: &SmoothField,
    panel: &TaughtPanel,
) -> Result<BSplineSurface, SurfaceError> {
    let (along_u, along_v) = (taught.knots_u().greville_abscissa(), taught.knots_v().greville_abscissa());
    let places: Vec<Parameter> =
        along_u.iter().flat_map(|u| along_v.iter().map(|v| Parameter { u: *u, v: *v })).collect();
    let wanted: Vec<f64> = places.iter().map(|at| correction.height_at([at.u, at.v])).collect();
    let normals: Vec<_> =
        places.iter().map(|at| taught.normal(*at).map_or_else(Default::default, |n| n.mm)).collect();
    let knots = || [taught.knots_u().clone(), taught.knots_v().clone()];
    let viewer = panel.panel_from_camera.origin();
    let mut surface = taught.clone();
    for _ in 0..DISPLACEMENT_ITERATIONS {
        let moved = places.iter().zip(&wanted).zip(&normals).zip(surface.controls());
        let controls = moved.map(|(((at, wanted), normal), control)| {
            let is = normal.dot(&(surface.point(*at) - taught.point(*at)).mm);
            *control + Vector::new(*normal * (wanted - is))
        });
        surface = BSplineSurface::new(knots(), controls.collect(), viewer)?;
    }
    Ok(surface)
}

/// Returns points of a panel that lies in front of the taught panel by this distance, with white noise of 0.06 mm.
#[cfg(test)]
pub(super) fn points_of(fit: &super::Fit, in_front_mm: impl Fn(Parameter) -> f64) -> Vec<TodaysPoint> {
    use rand::{RngExt, SeedableRng};
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(5);
    let side = 140;
    let mut point = |n: usize| {
        let at = Parameter { u: (n % side) as f64 / (side - 1) as f64, v: (n / side) as f64 / (side - 1) as f64 };
        let noise_mm = 0.06 * 1.732 * random.random_range(-1.0..1.0);
        let normal = fit.surface.normal(at).expect("a normal").mm;
        let point = fit.surface.point(at).mm.coords + normal * (in_front_mm(at) + noise_mm);
        TodaysPoint { at, point: Vector::new(point) }
    };
    (0..side * side).map(&mut point).collect()
}

/// A division of the region into cells.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellRaster {
    /// Number of cells along u and v.
    pub size: RasterSize,
    /// The shorter side of a cell, mm.
    pub side_mm: f64,
}

impl CellRaster {
    /// Divides a region with these sides, mm, into cells of about this side, mm.
    pub fn new(sides_mm: [f64; 2], cell_mm: f64) -> Self {
        let [width, height] = sides_mm.map(|mm| ((mm / cell_mm).round() as usize).max(1));
        let side_mm = (sides_mm[0] / width as f64).min(sides_mm[1] / height as f64);
        CellRaster { size: RasterSize { width, height }, side_mm }
    }

    /// Returns the number of cells.
    pub fn count(&self) -> usize {
        self.size.width * self.size.height
    }

    /// Returns the index of the cell that contains a point of the unit square.
    pub fn index(&self, [u, v]: [f64; 2]) -> usize {
        let along = |share: f64, count: usize| ((share * count as f64) as usize).min(count - 1);
        along(v, self.size.height) * self.size.width + along(u, self.size.width)
    }

    /// Returns the centre of a cell.
    pub fn middle(&self, index: usize) -> Parameter {
        let along = |cell: usize, count: usize| (cell as f64 + 0.5) / count as f64;
        let RasterSize { width, height } = self.size;
        Parameter { u: along(index % width, width), v: along(index / width, height) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::scene::{ScanDefects, Shape, recipe, taught};
    use crate::surface::{Fit, fit};

    /// Returns a taught panel of 280 × 168 mm with its fitted surface.
    fn learnt() -> (TaughtPanel, Fit) {
        let recipe = recipe(Shape::Cylinder, "");
        let panel = taught(Shape::Cylinder, ScanDefects::default(), &recipe);
        let fit = fit(&panel, recipe.surface()).expect("a surface");
        (panel, fit)
    }

    /// Returns the largest distance between today's surface and the true surface, mm; the true surface lies in front of
    /// the taught surface by `in_front_mm`.
    fn error_mm(fit: &Fit, todays: &TodaysSurfaceFit, in_front_mm: impl Fn(Parameter) -> f64) -> f64 {
        let error = |n: usize| {
            let at = Parameter { u: (n % 41) as f64 / 40.0, v: (n / 41) as f64 / 40.0 };
            let normal = fit.surface.normal(at).expect("a normal").mm;
            let moved = normal.dot(&(todays.surface.point(at) - fit.surface.point(at)).mm);
            (moved - in_front_mm(at)).abs()
        };
        (0..41 * 41).map(error).fold(0.0, f64::max)
    }

    /// Returns a bow of 1.5 mm plus a wave with a wavelength of 200 mm.
    fn bent(at: Parameter) -> f64 {
        1.5 * (1.0 - (2.0 * at.u - 1.0).powi(2)) + 0.3 * (280.0 / 200.0 * std::f64::consts::TAU * at.u).sin()
    }

    #[test]
    fn a_bowed_panel_is_measured_correctly() {
        let (panel, fit) = learnt();
        let todays = correct_taught_surface(&fit.surface, &panel, &fit.map, (&points_of(&fit, bent), 12.0))
            .expect("a surface");
        let error_mm = error_mm(&fit, &todays, bent);
        assert!(error_mm < 0.06, "{error_mm}");
        // Expected value, calculated by hand: at u = 0.3 the bow is 1.5 (1 − 0.16) = 1.26 mm and the wave 0.3 ·
        // sin(0.42 · 2π) = 0.145 mm.
        assert!((todays.largest_mm - 1.405).abs() < 0.03, "{}", todays.largest_mm);
        assert!(
            (todays.rms_mm / 0.06 - 1.0).abs() < 0.1
                && todays.missing_percent == 0.0
                && todays.largest_hole_mm == 0.0,
            "{todays:?}"
        );
    }

    /// If the panel has not changed, today's surface is the taught surface within the noise.
    #[test]
    fn an_unchanged_panel_is_not_corrected() {
        let (panel, fit) = learnt();
        let todays = correct_taught_surface(&fit.surface, &panel, &fit.map, (&points_of(&fit, |_| 0.0), 12.0))
            .expect("a surface");
        let error_mm = error_mm(&fit, &todays, |_| 0.0);
        assert!(error_mm < 0.03 && todays.largest_mm < 0.02, "{error_mm} {}", todays.largest_mm);
    }

    /// A clamp 8 mm above a corner is not part of the panel, and the surface below the clamp is not seen; beside the
    /// clamp the surface is correct.
    #[test]
    fn a_clamp_has_no_influence() {
        let (panel, fit) = learnt();
        let is_clamped = |at: Parameter| at.u < 0.15 && at.v < 0.2;
        let todays_points = points_of(&fit, |at| if is_clamped(at) { 8.0 } else { bent(at) });
        let todays =
            correct_taught_surface(&fit.surface, &panel, &fit.map, (&todays_points, 12.0)).expect("a surface");
        let beside = |at: Parameter| if is_clamped(at) { f64::NAN } else { bent(at) };
        let error_mm = error_mm(&fit, &todays, beside);
        assert!(error_mm < 0.1, "{error_mm}");
        // Expected value, calculated by hand: 15 % of the length by 20 % of the width, 42 × 34 mm, in whole cells of 6
        // mm.
        assert!((todays.missing_percent - 3.0).abs() < 1.0, "{}", todays.missing_percent);
        assert!((24.0..=42.0).contains(&todays.largest_hole_mm), "{}", todays.largest_hole_mm);
    }

    /// The correction does not follow a patch of 30 mm that lies 3 mm higher: like a clamp, the patch is treated as a
    /// hole of today's surface.
    #[test]
    fn a_step_that_the_correction_does_not_follow_is_a_hole() {
        let (panel, fit) = learnt();
        let is_patch = |at: Parameter| (at.u - 0.5).abs() < 15.0 / 280.0 && (at.v - 0.5).abs() < 15.0 / 168.0;
        let patched = points_of(&fit, |at| if is_patch(at) { 3.0 } else { 0.0 });
        let todays = correct_taught_surface(&fit.surface, &panel, &fit.map, (&patched, 12.0)).expect("a surface");
        assert!((18.0..=36.0).contains(&todays.largest_hole_mm), "{todays:?}");
        assert!(todays.missing_percent < 4.0 && todays.largest_mm < 0.1, "{todays:?}");
    }

    #[test]
    fn a_scan_without_the_region_is_refused() {
        let (panel, fit) = learnt();
        let far = points_of(&fit, |_| 60.0);
        assert_eq!(
            correct_taught_surface(&fit.surface, &panel, &fit.map, (&far, 12.0)).expect_err("none"),
            TodayError::NoPoints
        );
    }
}
