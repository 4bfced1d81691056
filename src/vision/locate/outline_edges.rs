//! The scan's edge beside each point of the model's outline, and the borders of the panel's marks in the scan's
//! picture, with the panel assumed at a pose.
//!
//! Beside each taught border of a mark the picture is searched across it for the nearest step of brightness with the
//! same sign. The search begins near the expected place of the border and continues farther away, because the start
//! pose of a flat panel may be several pixels off. If a nearer object lies in front of the place, or the surface faces
//! away, the mark is hidden.

use super::edges;
use super::edges::{EdgeReading, HALF_LENGTH_PX, Tangent, edge};
use super::grid::{ColoredCloud, RigidF32, camera_point};
use super::model::Model;
use super::print_features::MarkPoint;
use nalgebra::Vector3;
use panelprep_base::geometry::{PinholeCamera, Pixel};

/// A point of the outline, and the edge that the scan shows beside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeObservation {
    pub point: Vector3<f64>,
    /// The gradient of the residual across the outline in the picture, px per mm.
    pub gradient: Vector3<f64>,
    pub edge: EdgeReading,
}

/// Looks for the edge beside a point of the outline.
pub(super) fn observe_edge(
    motion: &RigidF32,
    model: &Model,
    camera: &PinholeCamera,
    scan: &ColoredCloud,
    k: usize,
) -> Option<EdgeObservation> {
    let sample = &model.outline[k];
    let point = motion.point(&sample.point);
    let (pixel, slope) = camera.project_with_jacobian(camera_point(&point))?;
    let outward = motion.turn * sample.outward_direction;
    let across = outward_px(&(slope * (motion.turn * sample.outline_direction)), &(slope * outward))?;
    let px_per_mm = across.dot(&(slope * outward));
    let gradient = slope.transpose() * across;
    let looks_away = (motion.turn * sample.normal).dot(&point) > -0.1 * point.norm() || px_per_mm < 0.1;
    let edge = if looks_away {
        EdgeReading::Hidden
    } else {
        let tangent = Tangent::new(camera, pixel, &point, &(motion.turn * sample.normal));
        edge(scan, (pixel, across), &tangent, model.has_missing_parts())
    };
    Some(EdgeObservation { point, gradient, edge })
}

/// Returns the unit vector of the picture perpendicular to an outline's direction, outwards.
pub(super) fn outward_px(
    along: &nalgebra::Vector2<f64>,
    outward: &nalgebra::Vector2<f64>,
) -> Option<nalgebra::Vector2<f64>> {
    let across = nalgebra::Vector2::new(along.y, -along.x).try_normalize(1e-9)?;
    Some(if across.dot(outward) < 0.0 { -across } else { across })
}

/// Positions at which a step is searched, px from the expected position, in this order; each search finds steps within
/// 3 px.
const SEARCH_OFFSETS_PX: [f64; 5] = [0.0, -3.0, 3.0, -6.0, 6.0];
/// A surface that is seen at a flatter angle than this shows no marks: cosine of the incidence.
const MIN_COS: f64 = 0.1;
/// Another object is nearer than the panel by at least this distance, mm.
const MIN_OCCLUDER_DISTANCE_MM: f64 = 3.0;

/// Looks for one mark.
pub(super) fn observe_mark(
    motion: &RigidF32,
    mark: &MarkPoint,
    camera: &PinholeCamera,
    scan: &ColoredCloud,
) -> Option<EdgeObservation> {
    let point = motion.point(&mark.point);
    let (pixel, slope) = camera.project_with_jacobian(camera_point(&point))?;
    let brighter = slope * (motion.turn * mark.brighter_direction);
    let across = outward_px(&(slope * (motion.turn * mark.border_direction)), &brighter)?;
    let gradient = slope.transpose() * across;
    let normal = motion.turn * mark.normal;
    let is_averted = normal.dot(&point) > -MIN_COS * point.norm();
    let edge = if is_averted || is_covered(scan, pixel, &Tangent::new(camera, pixel, &point, &normal)) {
        EdgeReading::Hidden
    } else {
        step_across(scan, pixel, [across.x, across.y])
    };
    Some(EdgeObservation { point, gradient, edge })
}

/// Returns whether the scan has a nearer object at this pixel. A missing point does not count as an obstacle.
fn is_covered(scan: &ColoredCloud, pixel: Pixel, tangent: &Tangent) -> bool {
    let Some((column, row)) = pixel.nearest_whole(scan.width(), scan.height()) else { return false };
    let [_, _, z] = scan.raw_points_mm()[row * scan.width() + column];
    !z.is_nan() && tangent.depth_behind_mm(column, row, f64::from(z)) < -MIN_OCCLUDER_DISTANCE_MM
}

fn step_across(scan: &ColoredCloud, pixel: Pixel, across: [f64; 2]) -> EdgeReading {
    let margin = HALF_LENGTH_PX as f64 + 1.0;
    let (width, height) = (scan.width() as f64, scan.height() as f64);
    if !(pixel.u >= margin && pixel.v >= margin && pixel.u < width - margin && pixel.v < height - margin) {
        return EdgeReading::OutOfView;
    }
    let Some(line) = edges::line(scan, pixel, across) else { return EdgeReading::OutOfView };
    let near = |&expected_px: &f64| edges::step(&line, expected_px).filter(|step| step.contrast > 0.0);
    match SEARCH_OFFSETS_PX.iter().find_map(near) {
        Some(step) => EdgeReading::Colour { offset_px: step.offset_px, width_px: step.width_px },
        None => EdgeReading::Absent,
    }
}
