//! The outline of a panel on its sheet: a convex polygon of straight edges with rounded corners.
//!
//! With outward unit normals nᵢ and offsets cᵢ the straight edges are nᵢ·p = cᵢ. The rounded outline is the set of
//! points at distance r from the polygon moved inwards by r, which keeps every edge where it is.

use nalgebra::{Matrix2, Vector2};

#[derive(Debug, Clone, Copy)]
struct Edge {
    normal: Vector2<f64>,
    offset_mm: f64,
}

/// A convex outline, with its corners counter-clockwise as seen from outside the panel.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    corners: Vec<Vector2<f64>>,
    rounding_mm: f64,
    edges: Vec<Edge>,
    core: Vec<Vector2<f64>>,
    /// Windows and cut-off parts.
    cuts: Vec<Outline>,
}

impl Outline {
    /// Creates an outline from the corners at which its extended straight edges would meet.
    pub fn new(corners: Vec<Vector2<f64>>, rounding_mm: f64) -> Self {
        let edges: Vec<Edge> = edge_pairs(&corners)
            .map(|(a, b)| {
                let along = (b - a).normalize();
                let normal = Vector2::new(along.y, -along.x);
                Edge { normal, offset_mm: normal.dot(&a) }
            })
            .collect();
        let core = inset_corners_from(&edges, rounding_mm);
        Outline { corners, rounding_mm, edges, core, cuts: Vec::new() }
    }

    /// Returns the same outline without the area inside another outline.
    pub fn with_hole(mut self, cut: Outline) -> Self {
        self.cuts.push(cut);
        self
    }

    /// The points where the straight edges would intersect without rounding.
    pub fn corners(&self) -> &[Vector2<f64>] {
        &self.corners
    }

    /// Returns the corners of the same polygon with every edge moved inwards.
    pub fn inset_corners(&self, by_mm: f64) -> Vec<Vector2<f64>> {
        inset_corners_from(&self.edges, by_mm)
    }

    /// Returns the signed distance to the outline, negative inside, mm, and the direction in which the distance
    /// grows. With cuts, it is the distance to the nearest of all edges.
    pub fn distance(&self, point: Vector2<f64>) -> (f64, Vector2<f64>) {
        let outer = self.outer_distance(point);
        self.cuts.iter().fold(outer, |farthest, cut| {
            let (distance, direction) = cut.distance(point);
            if -distance > farthest.0 { (-distance, -direction) } else { farthest }
        })
    }

    fn outer_distance(&self, point: Vector2<f64>) -> (f64, Vector2<f64>) {
        let (mut deepest, mut normal) = (f64::NEG_INFINITY, Vector2::zeros());
        for edge in &self.edges {
            let distance = edge.normal.dot(&point) - edge.offset_mm;
            if distance > deepest {
                (deepest, normal) = (distance, edge.normal);
            }
        }
        if deepest <= -self.rounding_mm {
            return (deepest, normal);
        }
        let away = self.vector_from_core(point);
        let distance = away.norm();
        if distance < 1e-9 { (-self.rounding_mm, normal) } else { (distance - self.rounding_mm, away / distance) }
    }

    /// Returns the vector from the nearest point of the inner polygon to a point outside this polygon.
    fn vector_from_core(&self, point: Vector2<f64>) -> Vector2<f64> {
        let mut nearest = Vector2::repeat(f64::INFINITY);
        for (a, b) in edge_pairs(&self.core) {
            let along = b - a;
            let share = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            let away = point - (a + along * share);
            if away.norm_squared() < nearest.norm_squared() {
                nearest = away;
            }
        }
        nearest
    }

    /// Returns the outline as a closed polyline; its points are at most this distance apart.
    pub fn polyline(&self, spacing_mm: f64) -> Vec<Vector2<f64>> {
        let dense = edge_pairs(&self.corners).flat_map(|(a, b)| {
            let steps = ((b - a).norm() / spacing_mm).ceil().max(1.0) as usize;
            (0..steps).map(move |i| a + (b - a) * (i as f64 / steps as f64))
        });
        // Near a corner the straight edges lie outside the rounding: these points are moved back along the direction
        // of the distance.
        dense
            .map(|point| {
                let (distance, direction) = self.outer_distance(point);
                point - direction * distance
            })
            .collect()
    }
}

fn edge_pairs(corners: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

fn inset_corners_from(edges: &[Edge], by_mm: f64) -> Vec<Vector2<f64>> {
    let count = edges.len();
    (0..count)
        .filter_map(|i| {
            let (before, after) = (&edges[(i + count - 1) % count], &edges[i]);
            let normals = Matrix2::from_rows(&[before.normal.transpose(), after.normal.transpose()]);
            Some(normals.try_inverse()? * Vector2::new(before.offset_mm - by_mm, after.offset_mm - by_mm))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> Outline {
        let corners = [(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)];
        Outline::new(corners.map(|(s, t)| Vector2::new(s, t)).to_vec(), 4.0)
    }

    /// Calculated by hand for a square of 20 mm with rounding 4 mm: the middle is 10 mm inside; (12, 0) is 2 mm
    /// outside. The corner (10, 10) is √2·4 − 4 = 1.657 mm outside the arc about (6, 6).
    #[test]
    fn distances_by_hand() {
        let at = |s, t| square().distance(Vector2::new(s, t)).0;
        assert!((at(0.0, 0.0) + 10.0).abs() < 1e-12);
        assert!((at(12.0, 0.0) - 2.0).abs() < 1e-12);
        assert!((at(8.0, 1.0) + 2.0).abs() < 1e-12);
        assert!((at(10.0, 10.0) - 1.656_854).abs() < 1e-6);
    }

    #[test]
    fn the_polyline_lies_on_the_outline() {
        for point in square().polyline(1.0) {
            assert!(square().distance(point).0.abs() < 1e-9, "{point}");
        }
    }

    /// Calculated by hand for a window of 4 mm about the middle: (4, 0) is 2 mm from the window's edge, (0, 0) is 2
    /// mm outside the panel's material.
    #[test]
    fn a_window_is_not_panel() {
        let window = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(|(s, t)| Vector2::new(s, t));
        let outline = square().with_hole(Outline::new(window.to_vec(), 0.5));
        assert!((outline.distance(Vector2::new(4.0, 0.0)).0 + 2.0).abs() < 1e-12);
        assert!((outline.distance(Vector2::zeros()).0 - 2.0).abs() < 1e-12);
        assert!((outline.distance(Vector2::new(4.0, 0.0)).1 + Vector2::x()).norm() < 1e-12, "grows inwards");
    }

    #[test]
    fn corners_move_inwards_in_order() {
        let inner = square().inset_corners(3.0);
        assert!((inner[0] - Vector2::new(-7.0, -7.0)).norm() < 1e-12, "{inner:?}");
        assert!((inner[2] - Vector2::new(7.0, 7.0)).norm() < 1e-12, "{inner:?}");
    }
}
