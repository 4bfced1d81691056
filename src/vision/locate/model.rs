//! The taught panel in the form that the search and the fit use: points with normals, an outline in space, and its
//! depth grid.
//!
//! The outline is measured in the colours and depths of the taught scan (`taught_outline`). All data that depend only
//! on the taught panel are derived once, before there is a scan.

use super::error::LocateError;
use super::grid::{Grid, MatrixTransform, camera_point};
use super::pieces::centroid_and_normal;
use super::print_features::TaughtMarks;
use super::scan_errors::RangeErrors;
use super::taught_outline::{MIN_OUTLINE_POINTS, OutlineEvidence, OutlinePoint, Surface, TaughtOutline};
use nalgebra::Vector3;
use panelprep_base::geometry::{Base, Camera, Panel, Pixel, Point, Rigid, Vector};
use panelprep_cell::panel::TaughtPanel;
use std::sync::Arc;

/// Minimum fraction of the surface with measured points, for a panel without missing parts.
const MIN_COMPLETE_FRACTION: f64 = 0.9;
/// Minimum number of surface points: with fewer, the panel is not sufficiently constrained.
const MIN_SURFACE_POINTS: usize = 200;

/// The taught panel as points, outline and marks.
#[derive(Clone)]
pub(super) struct Model {
    /// Points of the surface in the panel frame, mm.
    pub points: Vec<Vector3<f64>>,
    /// Normals at the points, towards the camera that recorded them.
    pub normals: Vec<Vector3<f64>>,
    /// The points of the outline, in order.
    pub outline: Vec<OutlinePoint>,
    /// The borders of marks inside of the outline.
    pub marks: TaughtMarks,
    /// The centre of the surface.
    pub centre: Vector3<f64>,
    /// The mean normal: the direction in which the points of the surface scatter least, towards the camera.
    pub normal: Vector3<f64>,
    /// Area of the surface, mm².
    pub area_mm2: f64,
    /// The depths of the panel in the taught scan, with the lens model of the camera.
    pub grid: Arc<Grid>,
    /// The taught pose of the panel in the camera frame.
    pub camera_from_panel: Rigid<Camera, Panel>,
    /// The nominal pose of the panel frame.
    pub nominal_pose: Rigid<Base, Panel>,
    /// Median width of the steps of brightness at the outline, px.
    pub edge_width_px: f64,
    /// Fraction of the panel with measured points at teaching, 0…1, if a person drew its outline; otherwise 1.
    pub measured_fraction: f64,
    /// The fractions of the outline that are visible, held and unseen.
    pub outline_evidence: OutlineEvidence,
    /// The quadrilaterals of the taught picture in which a holder touches the panel.
    pub held_px: Vec<[Pixel; 4]>,
    /// The errors of the scans.
    pub range: RangeErrors,
}

/// Returns the depths of the taught scan: of its panel if `of_panel` is true, otherwise of all other surfaces.
fn taught_grid(panel: &TaughtPanel, of_panel: bool) -> Grid {
    let motion = MatrixTransform::from_rigid(&panel.panel_from_camera.inverse());
    let depth_row = motion.turn.row(2).into_owned();
    let raw = panel.scan.raw_points_mm();
    let depth = |index: usize| {
        let [x, y, z] = raw[index];
        let depth = (depth_row * Vector3::new(f64::from(x), f64::from(y), f64::from(z)))[0] + motion.shift.z;
        (panel.mask.inside[index] == of_panel && depth > 0.0).then_some(depth as f32)
    };
    Grid::from_depths((panel.scan.width(), panel.scan.height()), &panel.camera, depth)
}

impl Model {
    /// Derives the model of a taught panel, for scans with these errors.
    pub fn from_panel(panel: &TaughtPanel, range: RangeErrors) -> Result<Model, LocateError> {
        let camera_from_panel = panel.panel_from_camera.inverse();
        let grid = taught_grid(panel, true);
        let surface = Surface::from_grid(&grid);
        let (TaughtOutline { points: outline, edge_width_px, evidence: outline_seen }, marks) = rayon::join(
            || TaughtOutline::detect(panel, &grid, &surface),
            || TaughtMarks::detect(panel, (&grid, &surface), range.correlation_mm),
        );
        let few = LocateError::Degenerate { surface: surface.samples.len(), outline: outline.len() };
        if surface.samples.len() < MIN_SURFACE_POINTS || outline.len() < MIN_OUTLINE_POINTS {
            return Err(few);
        }
        let turn = panel.panel_from_camera.rotation();
        let points: Vec<Vector3<f64>> = surface
            .samples
            .iter()
            .map(|sample| (panel.panel_from_camera * camera_point(&sample.point)).mm.coords)
            .collect();
        let normals = surface.samples.iter().map(|sample| turn * sample.normal).collect();
        let (centre, axis) = centroid_and_normal(&points).ok_or(few)?;
        let towards = panel.panel_from_camera.origin().mm.coords - centre;
        Ok(Model {
            normals,
            outline,
            marks,
            centre,
            normal: if axis.dot(&towards) < 0.0 { -axis } else { axis },
            area_mm2: surface.samples.iter().map(|sample| sample.area_mm2).sum(),
            points,
            grid: Arc::new(grid),
            camera_from_panel,
            nominal_pose: panel.nominal_pose,
            edge_width_px,
            measured_fraction: panel.measured_fraction(),
            outline_evidence: outline_seen,
            held_px: panel.held_px.clone(),
            range,
        })
    }

    /// Returns whether large parts of the panel had no points at teaching. Now points may be missing as well, possibly
    /// elsewhere.
    pub fn has_missing_parts(&self) -> bool {
        self.measured_fraction < MIN_COMPLETE_FRACTION
    }

    /// Returns the centre of the surface in the panel frame.
    pub fn centre_point(&self) -> Point<Panel> {
        Point::new(self.centre.into())
    }

    /// Returns the mean normal in the panel frame.
    pub fn normal_direction(&self) -> Vector<Panel> {
        Vector::new(self.normal)
    }

    /// Returns the sine of the angle between the taught view of the panel and its view at a pose.
    pub fn view_change(&self, placed: &MatrixTransform) -> f64 {
        let taught = MatrixTransform::from_rigid(&self.camera_from_panel);
        let view = |motion: &MatrixTransform| (motion.turn.transpose() * -motion.point(&self.centre)).normalize();
        view(&taught).cross(&view(placed)).norm()
    }

    /// Returns the maximum distance between the positions of one outline point at two poses, mm.
    pub fn largest_distance_mm(&self, a: &Rigid<Camera, Panel>, b: &Rigid<Camera, Panel>) -> f64 {
        let (a, b) = (MatrixTransform::from_rigid(a), MatrixTransform::from_rigid(b));
        let apart = |sample: &OutlinePoint| (a.point(&sample.point) - b.point(&sample.point)).norm();
        self.outline.iter().step_by(4).map(apart).fold(0.0, f64::max)
    }
}

/// A taught panel in the form that the localization uses.
pub struct TaughtModel {
    /// The model of the panel.
    pub(super) model: Model,
    /// The other surfaces in the taught scan: the fixture.
    pub(super) fixture: Grid,
}

impl TaughtModel {
    /// Derives the model from a taught panel.
    ///
    /// # Errors
    /// If the taught panel has too little surface or outline.
    pub fn from_panel(panel: &TaughtPanel, range: RangeErrors) -> Result<Self, LocateError> {
        let (model, fixture) = rayon::join(|| Model::from_panel(panel, range), || taught_grid(panel, false));
        Ok(TaughtModel { model: model?, fixture })
    }
}

impl std::fmt::Debug for TaughtModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TaughtModel").finish_non_exhaustive()
    }
}
