//! Planes through points: the local plane of a pixel's neighbourhood, and the flatness of points.
//!
//! The local plane gives a point and a normal of an organised cloud. The normal is the direction in which the
//! neighbours scatter least (the eigenvector of the smallest eigenvalue of their covariance), oriented towards the
//! viewer.
//!
//! The flatness is the least distance between two parallel planes that contain all points. Let x and y be coordinates
//! along the points' plane and z across it. The planes z = a x + b y + c and z = a x + b y + c + f contain all points
//! with the least
//! f(a, b) = max (z − a x − b y) − min (z − a x − b y), which is convex. For each pair (i, j) of points
//!     f(a, b) ≥ (z_i − z_j) − a (x_i − x_j) − b (y_i − y_j),                                                 (1)
//! with equality at the highest and the lowest point for this a and b. The least f is the linear program over (1) for
//! all pairs. It is solved by cutting planes (Kelley, J. SIAM 8(4), 1960). In each step, the program over the pairs
//! found so far gives a lower bound of f and the next a and b. The value of f at this a and b is an upper bound, and
//! the pair of its highest and lowest point is added to the program. There are finitely many pairs, so the bounds meet.
//! The distance across the planes is f / √(1 + a² + b²).
//!
//! This is the minimum zone of ISO 12781-1 (reference planes MZPL) and ASME Y14.5. Of all tilts it minimises f, not the
//! distance across: for slopes up to 0.01 the two differ by less than 10⁻⁴ of the distance. The zone about the plane of
//! least squares (LSPL) is never narrower, and is given as an upper bound.

use super::cloud::OrganizedCloud;
use super::rigid::{Frame, Point, Vector};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// Maximum distance of a neighbour from the central point, as a multiple of the first quartile of these distances; a
/// neighbour that is farther away belongs to another surface. The limit is based on the quartile because at an edge up
/// to three quarters of the neighbours may belong to another surface. It is a ratio, so that it applies to coarse and
/// fine scans alike.
const MAX_DISTANCE_RATIO: f64 = 4.0;
/// Minimum number of points for a reliable plane.
const MIN_PLANE_POINTS: usize = 8;
/// Maximum leverage of a pixel. A few points in a row do not determine a plane at a pixel beside them. With the mean
/// and scatter S of the points' pixels, a pixel at the distance d from the mean has the leverage 1 + dᵀ S⁻¹ d: 7 at the
/// corner of a uniformly filled square, 9 at the corner of a triangle. Above this limit the pixel is too far beside the
/// points.
const MAX_LEVERAGE: f64 = 12.0;

/// A plane, given by a point on it and its unit normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane<F: Frame> {
    /// The centroid of the neighbours.
    pub point: Point<F>,
    /// Unit normal, oriented towards the viewer.
    pub normal: Vector<F>,
}

impl<F: Frame> Plane<F> {
    /// Returns the point where the ray from `origin` along `ray` intersects the plane; `None` if the ray runs parallel
    /// to the plane or away from it.
    pub fn intersect_ray(&self, origin: Point<F>, ray: Vector<F>) -> Option<Point<F>> {
        let slope = self.normal.mm.dot(&ray.mm);
        let distance = self.normal.mm.dot(&(self.point - origin).mm) / slope;
        (distance.is_finite() && distance > 0.0).then(|| origin + ray * distance)
    }
}

/// Returns the plane through the points within `half_width_px` pixels of a pixel, with its normal oriented towards the
/// camera's position, `viewer`. `None` if there are too few points, or if the pixel's leverage exceeds
/// `MAX_LEVERAGE`.
pub fn local_plane<F: Frame>(
    cloud: &OrganizedCloud<F>,
    at: (usize, usize),
    half_width_px: usize,
    viewer: Point<F>,
) -> Option<Plane<F>> {
    local_plane_where(cloud, at, half_width_px, viewer, |_| true)
}

/// Fits the plane as [`local_plane`] does, but only through the points of one surface: those for whose pixel index
/// `belongs` is true.
pub fn local_plane_where<F: Frame>(
    cloud: &OrganizedCloud<F>,
    (column, row): (usize, usize),
    half_width_px: usize,
    viewer: Point<F>,
    belongs: impl Fn(usize) -> bool,
) -> Option<Plane<F>> {
    let point = |u: usize, v: usize| cloud.point(u, v).filter(|_| belongs(v * cloud.width() + u));
    let middle = nearest_valid_pixel((cloud.width(), cloud.height()), (column, row), half_width_px, &point)?;
    let mut offsets: Vec<(Vector3<f64>, Vector2<f64>)> = Vec::with_capacity((2 * half_width_px + 1).pow(2));
    for v in row.saturating_sub(half_width_px)..=(row + half_width_px).min(cloud.height() - 1) {
        for u in column.saturating_sub(half_width_px)..=(column + half_width_px).min(cloud.width() - 1) {
            let pixel = Vector2::new(u as f64 - column as f64, v as f64 - row as f64);
            offsets.extend(point(u, v).map(|point| ((point - middle).mm, pixel)));
        }
    }
    let mut distances_mm: Vec<f64> = offsets.iter().map(|(offset, _)| offset.norm()).collect();
    let quarter = distances_mm.len() / 4;
    let reach_mm = MAX_DISTANCE_RATIO * *distances_mm.select_nth_unstable_by(quarter, f64::total_cmp).1;
    let (mut count, mut sum, mut squares) = (0usize, Vector3::zeros(), Matrix3::zeros());
    let (mut pixel_sum, mut pixel_squares) = (Vector2::zeros(), Matrix2::zeros());
    for (offset, pixel) in offsets.iter().filter(|(offset, _)| offset.norm() <= reach_mm) {
        count += 1;
        sum += offset;
        squares += offset * offset.transpose();
        pixel_sum += pixel;
        pixel_squares += pixel * pixel.transpose();
    }
    if count < MIN_PLANE_POINTS || is_outside_of_points(pixel_sum / count as f64, pixel_squares / count as f64) {
        return None;
    }
    let mean = sum / count as f64;
    let eigen = (squares / count as f64 - mean * mean.transpose()).symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let point = middle + Vector::new(mean);
    let outward = if normal.dot(&(viewer - point).mm) < 0.0 { -normal } else { normal };
    Some(Plane { point, normal: Vector::new(outward) })
}

/// Returns whether the leverage of the pixel at the origin, for points with this mean and this mean square, exceeds
/// `MAX_LEVERAGE`.
fn is_outside_of_points(mean: Vector2<f64>, square: Matrix2<f64>) -> bool {
    let scatter = square - mean * mean.transpose();
    scatter.try_inverse().is_none_or(|inverse| 1.0 + mean.dot(&(inverse * mean)) > MAX_LEVERAGE)
}

fn nearest_valid_pixel<F: Frame>(
    (width, height): (usize, usize),
    (column, row): (usize, usize),
    half_width_px: usize,
    point: &dyn Fn(usize, usize) -> Option<Point<F>>,
) -> Option<Point<F>> {
    (0..=half_width_px).find_map(|reach| {
        let columns = column.saturating_sub(reach)..=(column + reach).min(width - 1);
        let rows = row.saturating_sub(reach)..=(row + reach).min(height - 1);
        rows.flat_map(|v| columns.clone().map(move |u| (u, v))).find_map(|(u, v)| point(u, v))
    })
}

/// Maximum difference between the lower and the upper bound of f at which the solution is accepted, mm.
const MAX_GAP_MM: f64 = 1e-7;
/// Maximum number of cutting planes; twenty are usual.
const MAX_CUTS: usize = 60;
/// Maximum slope of the planes against the plane of least squares, as a multiple of the zone about that plane divided
/// by the points' scatter.
const MAX_SLOPE: f64 = 4.0;
/// Minimum scatter of the points in each direction of their plane, mm; with less scatter they do not determine a plane.
const MIN_SCATTER_MM: f64 = 1e-3;
/// Relative tolerance for rounding errors when a vertex of the linear program is checked against the constraints.
const ROUNDING_TOLERANCE: f64 = 1e-10;

/// The zone between two parallel planes that contain all points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneZone {
    /// Distance between the planes of the minimum zone, mm.
    pub minimum_mm: f64,
    /// Distance between the planes that are parallel to the plane of least squares, mm.
    pub least_squares_mm: f64,
}

impl PlaneZone {
    /// Computes the zone of these points; `None` if the points do not determine a plane. If the bounds do not meet, the
    /// result is the narrowest zone that was found: an upper bound.
    pub fn compute<F: Frame>(points: &[Point<F>]) -> Option<PlaneZone> {
        let (local, scatter_mm) = to_plane_coordinates(points)?;
        let level = Zone::at(&local, [0.0; 2]);
        let max_slope = MAX_SLOPE * level.width_mm.max(MAX_GAP_MM);
        let sides = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
        let mut rows: Vec<Row> =
            sides.map(|[x, y]| Row { of: Vector3::new(x, y, 0.0), least: -max_slope }).to_vec();
        rows.push(level.cut(&local));
        let mut best = level;
        for _ in 0..MAX_CUTS {
            let Some(lowest) = lowest_corner(&rows) else { break };
            let zone = Zone::at(&local, [lowest.x, lowest.y]);
            if zone.width_mm < best.width_mm {
                best = zone;
            }
            if best.width_mm - lowest.z <= MAX_GAP_MM {
                break;
            }
            rows.push(zone.cut(&local));
        }
        let slopes = [0, 1].map(|axis| best.slopes[axis] / scatter_mm[axis]);
        let across = best.width_mm / (1.0 + slopes[0].powi(2) + slopes[1].powi(2)).sqrt();
        Some(PlaneZone { minimum_mm: across, least_squares_mm: level.width_mm })
    }
}

/// Returns the points in coordinates along their plane of least squares, with x and y divided by their scatter, and
/// this scatter, mm; `None` if the points lie on a line.
fn to_plane_coordinates<F: Frame>(points: &[Point<F>]) -> Option<(Vec<Vector3<f64>>, [f64; 2])> {
    // The eigenvalue decomposition would not terminate for numbers that are not finite.
    if points.len() < 3 || !points.iter().all(|point| point.mm.coords.iter().all(|mm| mm.is_finite())) {
        return None;
    }
    let count = points.len() as f64;
    let middle = points.iter().map(|point| point.mm.coords).sum::<Vector3<f64>>() / count;
    let arms: Vec<Vector3<f64>> = points.iter().map(|point| point.mm.coords - middle).collect();
    let eigen = (arms.iter().map(|arm| arm * arm.transpose()).sum::<Matrix3<f64>>() / count).symmetric_eigen();
    let mut axes = [0, 1, 2];
    axes.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let scatter_mm = [axes[0], axes[1]].map(|axis| eigen.eigenvalues[axis].max(0.0).sqrt());
    let is_plane = scatter_mm[1] > MIN_SCATTER_MM;
    let [x, y, z] = axes.map(|axis| eigen.eigenvectors.column(axis).into_owned());
    let local =
        |arm: &Vector3<f64>| Vector3::new(x.dot(arm) / scatter_mm[0], y.dot(arm) / scatter_mm[1], z.dot(arm));
    is_plane.then(|| (arms.iter().map(local).collect(), scatter_mm))
}

/// The value of f for one tilt (a, b), with the highest and the lowest point at this tilt.
#[derive(Clone, Copy)]
struct Zone {
    slopes: [f64; 2],
    width_mm: f64,
    highest: usize,
    lowest: usize,
}

impl Zone {
    fn at(points: &[Vector3<f64>], slopes: [f64; 2]) -> Zone {
        let height = |point: &Vector3<f64>| point.z - slopes[0] * point.x - slopes[1] * point.y;
        let (mut highest, mut lowest) = ((0, f64::NEG_INFINITY), (0, f64::INFINITY));
        for (index, height) in points.iter().map(height).enumerate() {
            if height > highest.1 {
                highest = (index, height);
            }
            if height < lowest.1 {
                lowest = (index, height);
            }
        }
        Zone { slopes, width_mm: highest.1 - lowest.1, highest: highest.0, lowest: lowest.0 }
    }

    /// Returns the constraint (1) of the highest and the lowest point.
    fn cut(&self, points: &[Vector3<f64>]) -> Row {
        let between = points[self.highest] - points[self.lowest];
        Row { of: Vector3::new(between.x, between.y, 1.0), least: between.z }
    }
}

/// A constraint of the linear program over (a, b, f): `of` · (a, b, f) ≥ `least`.
#[derive(Clone, Copy)]
struct Row {
    of: Vector3<f64>,
    least: f64,
}

/// Returns the vertex (a, b, f) with the least f that satisfies all constraints. Three constraints hold with equality
/// at a vertex.
fn lowest_corner(rows: &[Row]) -> Option<Vector3<f64>> {
    let scale = rows.iter().map(|row| row.least.abs()).fold(MAX_GAP_MM, f64::max);
    let meets_all =
        |at: &Vector3<f64>| rows.iter().all(|row| row.of.dot(at) >= row.least - ROUNDING_TOLERANCE * scale);
    let mut lowest: Option<Vector3<f64>> = None;
    for (i, first) in rows.iter().enumerate() {
        for (j, second) in rows.iter().enumerate().skip(i + 1) {
            for third in &rows[j + 1..] {
                let system = Matrix3::from_rows(&[first.of, second.of, third.of].map(|of| of.transpose()));
                let Some(inverse) = system.try_inverse() else { continue };
                let at = inverse * Vector3::new(first.least, second.least, third.least);
                let is_lower = lowest.is_none_or(|lowest| at.z < lowest.z);
                if is_lower && meets_all(&at) {
                    lowest = Some(at);
                }
            }
        }
    }
    lowest
}

#[cfg(test)]
mod tests {
    use super::super::rigid::Camera;
    use super::*;
    use crate::geometry::Panel;

    /// Expected value, calculated by hand: on z = 700 + x/2 the normal towards the viewer at the origin is (1/2, 0,
    /// −1)/√1.25.
    #[test]
    fn a_tilted_plane_is_fitted_and_intersected_by_a_ray() {
        let point = |i: usize| {
            let (x, y) = ((i % 21) as f32 * 0.4 - 4.0, (i / 21) as f32 * 0.4 - 4.0);
            if i == 220 { [f32::NAN; 3] } else { [x, y, 700.0 + x / 2.0] }
        };
        let cloud = OrganizedCloud::<Camera>::new(21, 21, (0..441).map(point).collect(), vec![[0; 3]; 441])
            .expect("counts agree");
        let plane = local_plane(&cloud, (10, 10), 5, Point::at(0.0, 0.0, 0.0)).expect("a plane");
        let expected = Vector3::new(0.5, 0.0, -1.0).normalize();
        assert!((plane.normal.mm - expected).norm() < 1e-5, "{:?}", plane.normal);
        let met = plane
            .intersect_ray(Point::at(0.0, 0.0, 0.0), Vector::new(Vector3::new(0.002, 0.0, 1.0)))
            .expect("ahead");
        // z = 700 + 0.002 z / 2, so z = 700 / 0.999.
        assert!((met.mm.z - 700.700_700).abs() < 1e-3, "{met:?}");
    }

    /// Expected values, calculated by hand. Two columns of a 21 × 21 grid, 4 and 5 px beside the pixel, have their mean
    /// 4.5 px from the pixel and a scatter of 0.5 px: the leverage is 1 + (4.5/0.5)² = 82. For half of a window with
    /// the pixel at its edge, the leverage is 4.
    #[test]
    fn a_few_points_in_a_row_give_no_plane_for_a_pixel_beside_them() {
        let cloud = |columns: std::ops::Range<usize>| {
            let point = |i: usize| {
                let (x, y) = ((i % 21) as f32 * 0.4, (i / 21) as f32 * 0.4);
                if columns.contains(&(i % 21)) { [x, y, 700.0] } else { [f32::NAN; 3] }
            };
            OrganizedCloud::<Camera>::new(21, 21, (0..441).map(point).collect(), vec![[0; 3]; 441])
                .expect("counts agree")
        };
        let plane = |columns| local_plane(&cloud(columns), (10, 10), 5, Point::at(0.0, 0.0, 0.0));
        assert_eq!(plane(14..16), None);
        assert!(plane(10..21).is_some());
    }

    /// Returns the zone of heights at 41 × 21 points of 400 × 200 mm, x from 0 to 1, on a plane with the slopes 1/10
    /// and 1/20.
    fn zone(height_mm: impl Fn(f64, f64) -> f64) -> PlaneZone {
        let normal = Vector3::new(-0.1, -0.05, 1.0).normalize();
        let point = |n: usize| {
            let (x, y) = ((n % 41) as f64 / 40.0, (n / 41) as f64 / 20.0);
            let at = Vector3::new(400.0 * x, 200.0 * y, 40.0 * x + 10.0 * y) + normal * height_mm(x, y);
            Point::<Panel>::new((at + Vector3::new(560.0, 30.0, 360.0)).into())
        };
        PlaneZone::compute(&(0..41 * 21).map(point).collect::<Vec<_>>()).expect("a plane")
    }

    #[test]
    fn a_tilted_plane_is_flat() {
        let PlaneZone { minimum_mm, least_squares_mm } = zone(|_, _| 0.0);
        assert!(minimum_mm < 1e-6 && least_squares_mm < 1e-6, "{minimum_mm} {least_squares_mm}");
    }

    /// Expected value, calculated by hand: a cylinder of radius 10 m over 400 mm has the sagitta 10000 − √(10000² −
    /// 200²) = 2.0002 mm; this is its minimum zone.
    #[test]
    fn the_flatness_of_a_cylinder_is_its_sagitta() {
        let radius_mm = 1e4_f64;
        let found = zone(|x, _| (radius_mm.powi(2) - (400.0 * (x - 0.5)).powi(2)).sqrt() - radius_mm);
        assert!((found.minimum_mm - 2.0002).abs() < 1e-3, "{found:?}");
        assert!((found.least_squares_mm - 2.0002).abs() < 1e-3, "{found:?}");
    }

    /// Expected values, calculated by hand: x³ lies between the lines x and x − 2/3^1.5, which are 0.3849 apart. The
    /// least-squares line of dense points has the slope 0.9 and the zone 0.1 + 2 · 0.3^1.5 = 0.4286.
    #[test]
    fn the_minimum_zone_is_narrower_than_that_of_least_squares() {
        let found = zone(|x, _| x.powi(3));
        assert!((found.minimum_mm - 0.3849).abs() < 1e-3, "{found:?}");
        assert!((found.least_squares_mm - 0.4286).abs() < 0.012, "{found:?}");
    }

    /// Expected value, calculated by hand: each edge of a twisted surface is a straight line, and the heights at the
    /// corners are 0, 0, 0 and 1. The planes through the two diagonals are 0.5 apart.
    #[test]
    fn the_flatness_of_a_twist_is_half_of_its_corner_height() {
        let found = zone(|x, y| x * y);
        assert!((found.minimum_mm - 0.5).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn a_line_has_no_flatness() {
        let line: Vec<Point<Panel>> = (0..9).map(|n| Point::at(f64::from(n), f64::from(2 * n), 1.0)).collect();
        assert_eq!(PlaneZone::compute(&line), None);
        assert_eq!(PlaneZone::compute::<Panel>(&[]), None);
    }
}
