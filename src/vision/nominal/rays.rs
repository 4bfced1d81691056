//! Rays from a camera onto a part: the nearest triangle of each, and where it is met.
//!
//! The triangles lie in the camera's frame. A hierarchy of boxes (`obvhs`) in single precision finds the triangles
//! near a ray; each is met in double precision (Möller, Trumbore 1997, "Fast, minimum storage ray–triangle
//! intersection"), so that the depth has no error of the search.

use super::edges::PartEdges;
use super::error::NominalError;
use super::part::Part;
use glam::Vec3A;
use nalgebra::{Point3, Vector3};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};
use panelprep_base::geometry::{Drawing, Frame, Point, Rigid};
use rayon::prelude::*;

/// Boxes are larger than their triangles by this much, mm: more than single precision rounds within 10 m.
const BOX_MARGIN_MM: f64 = 0.005;
/// A ray this far beside a triangle still meets it, as a share of the triangle: no ray passes between neighbours.
const EDGE_SHARE: f64 = 1e-9;
/// An edge that passes through a triangle ends at least this far from its plane, mm; otherwise it touches it.
const TOUCHES_MM: f64 = 0.02;

/// A part in front of a camera.
pub struct PartRays<C: Frame> {
    vertices: Vec<Point<C>>,
    triangles: Vec<[u32; 3]>,
    boxes: CwBvh,
}

/// The place at which a ray meets a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PartHit {
    /// The distance in lengths of the ray's direction: the depth, mm, for a direction (x, y, 1).
    pub distance: f64,
    /// The cosine of the angle between ray and normal, 0…1.
    pub cos_incidence: f64,
    /// The triangle's index.
    pub triangle: u32,
}

fn to_vec3a(point: &Vector3<f64>) -> Vec3A {
    Vec3A::new(point.x as f32, point.y as f32, point.z as f32)
}

impl<C: Frame> PartRays<C> {
    /// Prepares a part, at this place in the camera's frame.
    pub fn new(part: Part, camera_from_drawing: &Rigid<C, Drawing>) -> Self {
        let placed = |vertex| *camera_from_drawing * Point::<Drawing>::new(vertex);
        let vertices: Vec<Point<C>> = part.vertices.into_iter().map(placed).collect();
        let margin = Vec3A::splat(BOX_MARGIN_MM as f32);
        let boxes: Vec<Aabb> = part
            .triangles
            .iter()
            .map(|triangle| {
                let corners = triangle.map(|corner| to_vec3a(&vertices[corner as usize].mm.coords));
                let around = Aabb::from_points(&corners);
                Aabb::new(around.min - margin, around.max + margin)
            })
            .collect();
        let order = (0..boxes.len() as u32).collect();
        let pairs = PlocBuilder::with_capacity(boxes.len()).build(
            PlocSearchDistance::Low,
            &boxes,
            order,
            SortPrecision::U64,
            0,
        );
        PartRays { vertices, triangles: part.triangles, boxes: bvh2_to_cwbvh(&pairs, 3, true, false) }
    }

    /// The vertices in the camera's frame.
    pub fn vertices(&self) -> &[Point<C>] {
        &self.vertices
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|corner| self.vertices[corner as usize].mm)
    }

    /// Returns the nearest place at which the ray from the camera in this direction meets the part.
    pub fn nearest(&self, direction: &Vector3<f64>) -> Option<PartHit> {
        let mut nearest: Option<PartHit> = None;
        let ray = Ray::new_inf(Vec3A::ZERO, to_vec3a(direction));
        self.boxes.ray_traverse(ray, &mut RayHit::none(), |_, index| {
            let triangle = self.boxes.primitive_indices[index];
            let Some((distance, normal)) = hit_distance(&Point3::origin(), direction, self.corners(triangle))
            else {
                return f32::INFINITY;
            };
            if nearest.is_none_or(|nearest| distance < nearest.distance) {
                let cos_incidence = (normal.dot(direction) / (normal.norm() * direction.norm())).abs();
                nearest = Some(PartHit { distance, cos_incidence, triangle });
            }
            // Rounded up, so that a triangle at the same place is not cut off.
            (distance as f32).next_up()
        });
        nearest
    }

    /// Checks that the surface does not pass through itself.
    ///
    /// # Errors
    /// The edges that pass through a face, the first with its place in the drawing's frame.
    pub fn check_crossings(
        &self,
        edges: &PartEdges,
        camera_from_drawing: &Rigid<C, Drawing>,
    ) -> Result<(), NominalError> {
        let crossings: Vec<Point3<f64>> =
            edges.all.par_iter().with_min_len(4_096).filter_map(|edge| self.edge_crossing(*edge)).collect();
        match crossings.first() {
            None => Ok(()),
            Some(&first) => {
                let at = camera_from_drawing.inverse() * Point::<C>::new(first);
                Err(NominalError::CrossesItself { count: crossings.len(), at_mm: at.mm.coords.into() })
            }
        }
    }

    /// Returns where an edge passes through a triangle that has none of its vertices.
    fn edge_crossing(&self, edge: [u32; 2]) -> Option<Point3<f64>> {
        let [from, to] = edge.map(|corner| self.vertices[corner as usize].mm);
        let along = to - from;
        let mut found = None;
        let ray = Ray::new(to_vec3a(&from.coords), to_vec3a(&along), 0.0, 1.0);
        self.boxes.ray_traverse_anyhit(ray, |_, index| {
            let triangle = self.boxes.primitive_indices[index];
            let own = self.triangles[triangle as usize];
            if found.is_some() || own.iter().any(|corner| edge.contains(corner)) {
                return;
            }
            let corners = self.corners(triangle);
            let Some((share, normal)) = hit_distance(&from, &along, corners) else { return };
            let height_mm = |point: &Point3<f64>| normal.dot(&(point - corners[0])).abs() / normal.norm();
            if share < 1.0 && height_mm(&from) > TOUCHES_MM && height_mm(&to) > TOUCHES_MM {
                found = Some(from + along * share);
            }
        });
        found
    }
}

/// Returns the distance at which a ray meets a triangle, in lengths of its direction, and the triangle's normal.
fn hit_distance(
    from: &Point3<f64>,
    direction: &Vector3<f64>,
    [a, b, c]: [Point3<f64>; 3],
) -> Option<(f64, Vector3<f64>)> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(&ac);
    let scale = ab.dot(&across);
    let away = from - a;
    let to_b = away.dot(&across) / scale;
    let around = away.cross(&ab);
    let to_c = direction.dot(&around) / scale;
    let distance = ac.dot(&around) / scale;
    // A triangle seen along its plane has no scale: the comparisons fail then.
    let is_inside = to_b >= -EDGE_SHARE && to_c >= -EDGE_SHARE && to_b + to_c <= 1.0 + EDGE_SHARE;
    (is_inside && distance > 0.0 && distance.is_finite()).then(|| (distance, ab.cross(&ac)))
}
