//! Computes the simple distance of a point from a mesh, like CloudCompare's cloud-to-mesh distance: to the nearest
//! triangle, with the sign of its normal, without smoothing and without an uncertainty.

use nalgebra::{Point3, Vector3};
use panelprep::nominal::Part;
use std::collections::HashMap;

/// Side of the cells that contain lists of triangles, mm. The nearest triangle is found for points within this distance
/// of the mesh.
const CELL_MM: f64 = 4.0;

/// A mesh whose triangles are listed by cells in x and y, because the drawings of trial panels are height fields.
pub struct MeshDistance<'a> {
    part: &'a Part,
    cells: HashMap<[i64; 2], Vec<usize>>,
}

fn cell(point: &Point3<f64>) -> [i64; 2] {
    [0, 1].map(|axis| (point[axis] / CELL_MM).floor() as i64)
}

impl<'a> MeshDistance<'a> {
    pub fn new(part: &'a Part) -> Self {
        let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
        for (index, triangle) in part.triangles.iter().enumerate() {
            let mut touched: Vec<[i64; 2]> =
                triangle.iter().map(|corner| cell(&part.vertices[*corner as usize])).collect();
            touched.sort_unstable();
            touched.dedup();
            touched.into_iter().for_each(|cell| cells.entry(cell).or_default().push(index));
        }
        MeshDistance { part, cells }
    }

    /// Returns the signed distance of a point, mm; `None` far from the mesh.
    pub fn signed_mm(&self, point: &Point3<f64>) -> Option<f64> {
        let [x, y] = cell(point);
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [x + i, y + j]));
        let triangles = around.filter_map(|cell| self.cells.get(&cell)).flatten();
        let one = |index: &usize| {
            let [a, b, c] = self.part.triangles[*index].map(|corner| self.part.vertices[corner as usize]);
            let off = point - nearest(point, [&a, &b, &c]);
            let normal: Vector3<f64> = (b - a).cross(&(c - a));
            (off.norm(), if normal.dot(&off) < 0.0 { -1.0 } else { 1.0 })
        };
        triangles.map(one).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(mm, sign)| sign * mm)
    }
}

/// Returns the point of a triangle that is nearest to a point: the foot of the perpendicular on the triangle's plane,
/// or else the nearest point of its sides.
fn nearest(point: &Point3<f64>, corners: [&Point3<f64>; 3]) -> Point3<f64> {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a));
    let foot = point - normal * (normal.dot(&(point - a)) / normal.norm_squared());
    let is_inside =
        [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (*to - *from).cross(&(foot - *from)).dot(&normal) >= 0.0);
    if is_inside {
        return foot;
    }
    let on_side = |(from, to): (&Point3<f64>, &Point3<f64>)| {
        let along = to - from;
        from + along * ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
    };
    let sides = [(a, b), (b, c), (c, a)].map(on_side);
    sides.into_iter().min_by(|one, other| (point - one).norm().total_cmp(&(point - other).norm())).unwrap_or(*a)
}

/// Checks the distances of three points, calculated by hand: above the middle of a triangle, beside a side, and beside
/// a corner.
pub fn check() {
    let [a, b, c] = [Point3::origin(), Point3::new(2.0, 0.0, 0.0), Point3::new(0.0, 2.0, 0.0)];
    for (point, expected) in [([0.5, 0.5, 3.0], 3.0), ([1.0, -4.0, 3.0], 5.0), ([-3.0, -4.0, 0.0], 5.0)] {
        let point = Point3::from(point);
        let mm: f64 = (point - nearest(&point, [&a, &b, &c])).norm();
        assert!((mm - expected).abs() < 1e-12, "{mm} {expected}");
    }
}
