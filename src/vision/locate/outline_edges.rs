//! The scan's edge beside each point of the model's outline, with the panel assumed at a pose.

use super::edges::{EdgeReading, Tangent, edge};
use super::grid::{ColoredCloud, RigidF32, camera_point};
use super::model::Model;
use nalgebra::Vector3;
use panelprep_base::geometry::PinholeCamera;

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
