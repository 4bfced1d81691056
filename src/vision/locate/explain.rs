//! Marks in the scan's picture that show the origin of each reason of the verdict, for a person who inspects the panel
//! there.
//!
//! Every sample is evaluated once more at the located pose, in the same way as in `evidence`. This module makes no
//! decisions.

use super::camera_check::FixtureEdge;
use super::deviation::Deviation;
use super::edges::EdgeReading;
pub use super::evidence::MIN_SATURATED_LEVEL;
use super::evidence::{Fit, MAX_FOUND_EDGE_DISTANCE_PX};
use super::fit::{FitInputs, Residuals, Samples};
use super::grid::{MatrixTransform, camera_point};
use super::search::{PointObservation, observe_point};
use super::solve::apply_twist;
use super::{PreparedScan, camera_check, covariance, pieces};
use panelprep_base::geometry::statistics::NORMAL_TWO_SIDED_95;
use panelprep_base::geometry::{Camera, Panel, Pixel, Rigid};

/// Magnification of the stated error in the drawing.
pub const ERROR_DISPLAY_SCALE: f64 = 50.0;

/// The scan at a taught point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SurfaceMark {
    /// Distance of the scanned surface in front of the taught surface, along its normal, mm; negative behind it.
    On(f64),
    /// The scan shows the taught surface beside an edge or missing points; the depth is too imprecise for a value.
    Near,
    /// The scan shows a surface behind the point.
    Through,
    /// The scan shows a surface in front of the point.
    Hidden,
    /// The scan has no point at this pixel.
    Missing,
}

/// The picture at a point of the taught outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutlineMark {
    /// The edge is at its taught position.
    Found,
    /// The edge is displaced or missing.
    Elsewhere,
    /// An object is in front of the outline, or the outline is out of view.
    Hidden,
}

/// The scan at the taught position of an edge of the fixture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FixtureMark {
    /// The edge is at its taught position.
    Unmoved,
    /// The edge is displaced or missing.
    Moved,
    /// The fixture is not visible: an object is in front of it, or the scan has no point.
    Unseen,
}

/// The evidence at each evaluated pixel of the picture.
#[derive(Debug, Clone, Default)]
pub struct EvidenceMarks {
    /// Side of the square that each pixel of the surface or of an object represents, px.
    pub block_px: usize,
    /// The pixels of the taught surface.
    pub surface: Vec<(Pixel, SurfaceMark)>,
    /// The pixels of the taught outline, in order.
    pub outline: Vec<(Pixel, OutlineMark)>,
    /// The borders of taught marks, each represented by a short segment.
    pub marks: Vec<([Pixel; 2], OutlineMark)>,
    /// Pairs of a pixel of the outline and the same pixel displaced by the stated error along the least constrained
    /// direction, enlarged by [`ERROR_DISPLAY_SCALE`].
    pub weakest: Vec<(Pixel, Pixel)>,
    /// The pixel of the outline with the widest step of brightness.
    pub widest_step: Option<Pixel>,
    /// Pixels on taught edges of the fixture.
    pub fixture: Vec<(Pixel, FixtureMark)>,
    /// Objects in the search box, the largest first, each with its area, mm², and its pixels.
    pub objects_in_box: Vec<(f64, Vec<Pixel>)>,
}

/// Maximum distance between an edge of the fixture and its taught position, for the edge to be unmoved, px.
pub const MAX_FIXTURE_SHIFT_PX: f64 = 0.5;

impl PreparedScan<'_> {
    /// Evaluates all evidence again; `fit` is the result of the localization, or `None` if there is none.
    pub fn explain(&self, fit: Option<&Fit>) -> EvidenceMarks {
        let (grid, inputs) = (&self.grid, self.inputs());
        let of_block = |&block: &u32| grid.pixel(block as usize % grid.columns, block as usize / grid.columns);
        let thing = |piece: &pieces::Piece| (piece.area_mm2, piece.blocks.iter().map(of_block).collect());
        let mut explained = EvidenceMarks {
            block_px: grid.factor,
            objects_in_box: self.pieces.iter().map(thing).collect(),
            ..EvidenceMarks::default()
        };
        let Some(fit) = fit else { return explained };
        let placed: Rigid<Camera, Panel> = self.view.base_from_camera.inverse() * fit.base_from_panel;
        let deviation = Deviation::from_residuals(
            &Residuals::at_pose(&placed, inputs, &Samples::all_of_model(inputs.model).surface_only()),
            inputs.model,
            None,
        );
        let bent = deviation.as_ref().map(|deviation| deviation.bent_panel(inputs.model));
        let taught = inputs.model;
        let inputs = FitInputs { model: bent.as_ref().unwrap_or(taught), ..inputs };
        let bend_mm = |i: usize| {
            deviation.as_ref().map_or(0.0, |it| it.deviation_at_mm(&taught.points[i], &taught.normals[i]))
        };
        explained.surface = surface(&placed, inputs, bend_mm);
        let residuals = Residuals::at_pose(&placed, inputs, &Samples::all_of_model(inputs.model));
        (explained.outline, explained.widest_step) = outline(&placed, inputs, &residuals);
        explained.marks = explain_marks(&placed, inputs, &residuals);
        explained.weakest = weakest_displacement(&placed, inputs, fit);
        let mark = |(pixel, edge): (Pixel, FixtureEdge)| match edge {
            FixtureEdge::Moved(px) if px.abs() <= MAX_FIXTURE_SHIFT_PX => (pixel, FixtureMark::Unmoved),
            FixtureEdge::Moved(_) | FixtureEdge::Gone => (pixel, FixtureMark::Moved),
            FixtureEdge::Unseen => (pixel, FixtureMark::Unseen),
        };
        let (now, inside) = ((grid, self.view.scan), (self.settings, &*self.inside));
        let edges = camera_check::fixture_edges(self.taught, &self.taught_model.fixture, now, inside);
        explained.fixture = edges.into_iter().map(mark).collect();
        explained
    }
}

/// Compares the panel with its bend with the taught panel, and returns the mark of each point. `bend_mm` is the
/// distance of a point of the bent panel in front of its taught position.
fn surface(
    placed: &Rigid<Camera, Panel>,
    inputs: FitInputs<'_>,
    bend_mm: impl Fn(usize) -> f64,
) -> Vec<(Pixel, SurfaceMark)> {
    let motion = MatrixTransform::from_rigid(placed);
    let mark = |i: usize| {
        let pixel = inputs.grid.camera.project(camera_point(&motion.point(&inputs.model.points[i])))?;
        let mark = match observe_point(&motion, inputs.model, inputs.grid, i) {
            // The residual is the distance of the taught point in front of the scan.
            PointObservation::On(residual_mm) => SurfaceMark::On(bend_mm(i) - residual_mm),
            PointObservation::Near => SurfaceMark::Near,
            PointObservation::Through => SurfaceMark::Through,
            PointObservation::Hidden => SurfaceMark::Hidden,
            PointObservation::Unknown => SurfaceMark::Missing,
        };
        Some((pixel, mark))
    };
    (0..inputs.model.points.len()).filter_map(mark).collect()
}

/// Returns the mark for the edge at a point of the outline.
fn outline_mark(edge: &EdgeReading) -> OutlineMark {
    match edge.is_within_distance(MAX_FOUND_EDGE_DISTANCE_PX) {
        Some(true) => OutlineMark::Found,
        Some(false) => OutlineMark::Elsewhere,
        None => OutlineMark::Hidden,
    }
}

fn explain_marks(
    placed: &Rigid<Camera, Panel>,
    inputs: FitInputs<'_>,
    residuals: &Residuals,
) -> Vec<([Pixel; 2], OutlineMark)> {
    let motion = MatrixTransform::from_rigid(placed);
    let stretch = |(k, edge): &(usize, EdgeReading)| {
        let mark = &inputs.model.marks.points[*k];
        let end = |way_mm: f64| {
            inputs.grid.camera.project(camera_point(&motion.point(&(mark.point + mark.border_direction * way_mm))))
        };
        Some(([end(-mark.length_mm / 2.0)?, end(mark.length_mm / 2.0)?], outline_mark(edge)))
    };
    residuals.mark_edges.iter().filter_map(stretch).collect()
}

fn outline(
    placed: &Rigid<Camera, Panel>,
    inputs: FitInputs<'_>,
    residuals: &Residuals,
) -> (Vec<(Pixel, OutlineMark)>, Option<Pixel>) {
    let motion = MatrixTransform::from_rigid(placed);
    let pixel = |k: usize| inputs.grid.camera.project(camera_point(&motion.point(&inputs.model.outline[k].point)));
    let mark = |(k, edge): &(usize, EdgeReading)| Some((pixel(*k)?, outline_mark(edge)));
    let width = |(k, edge): &(usize, EdgeReading)| match edge {
        EdgeReading::Colour { width_px, .. } => Some((*k, *width_px)),
        _ => None,
    };
    let widest = residuals.edges.iter().filter_map(width).max_by(|a, b| a.1.total_cmp(&b.1));
    (residuals.edges.iter().filter_map(mark).collect(), widest.and_then(|(k, _)| pixel(k)))
}

/// Returns the pixels of the outline, each with its position displaced by the stated error along the direction of the
/// largest error.
fn weakest_displacement(placed: &Rigid<Camera, Panel>, inputs: FitInputs<'_>, fit: &Fit) -> Vec<(Pixel, Pixel)> {
    let motion = MatrixTransform::from_rigid(placed);
    let centre = motion.point(&inputs.model.centre);
    let twist = covariance::weakest_direction(&fit.covariance, inputs.model).twist
        * (NORMAL_TWO_SIDED_95 * ERROR_DISPLAY_SCALE);
    let moved = MatrixTransform::from_rigid(&apply_twist(placed, &centre, &twist));
    let project = |motion: &MatrixTransform, k: usize| {
        inputs.grid.camera.project(camera_point(&motion.point(&inputs.model.outline[k].point)))
    };
    (0..inputs.model.outline.len()).filter_map(|k| Some((project(&motion, k)?, project(&moved, k)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::taught;
    use super::super::{ScanView, TaughtModel};
    use super::*;
    use panelprep_base::geometry::OrganizedCloud;
    use panelprep_sim as sim;
    use panelprep_sim::Scene;

    /// Expected values, calculated by hand: the panel is at its taught pose, with each of its points 0.3 mm nearer to
    /// the camera along its ray. The surface is slanted by at most 20°, so along the normal the scan is 0.28 to 0.3 mm
    /// in front of the taught surface.
    #[test]
    fn a_scan_in_front_of_the_taught_surface_is_reported_as_in_front() {
        let cell = sim::Cell::new(1, Scene::Clean, 4);
        let (panel, recipe) = taught(&cell);
        let (scan, base_from_camera) = (cell.taught_scan(), cell.calibrated_base_from_camera());
        let view = ScanView {
            scan: &scan,
            camera: cell.scanner(),
            base_from_camera,
            range: crate::locate::RangeErrors::default(),
        };
        let model = TaughtModel::from_panel(&panel, view.range).expect("a panel");
        let fit = PreparedScan::new((&panel, &model), &view, recipe.locate()).locate().expect("a panel");
        let nearer = scan.raw_points_mm().iter().map(|point| {
            let way_mm = f64::from(point[0]).hypot(f64::from(point[1])).hypot(f64::from(point[2]));
            point.map(|n| (f64::from(n) * (1.0 - 0.3 / way_mm)) as f32)
        });
        let scan = OrganizedCloud::new(scan.width(), scan.height(), nearer.collect(), scan.picture().rgb);
        let view = ScanView { scan: &scan.expect("organised"), ..view };
        let explained = PreparedScan::new((&panel, &model), &view, recipe.locate()).explain(Some(&fit));
        let before_mm = explained.surface.iter().filter_map(|(_, mark)| match mark {
            SurfaceMark::On(mm) => Some(*mm),
            _ => None,
        });
        let before_mm: Vec<f64> = before_mm.collect();
        let mean_mm = before_mm.iter().sum::<f64>() / before_mm.len() as f64;
        assert!(before_mm.len() > 1_000 && (0.24..0.31).contains(&mean_mm), "{} {mean_mm}", before_mm.len());
        assert!(explained.surface.iter().any(|(_, mark)| *mark == SurfaceMark::Near), "beside the edge");
    }
}
