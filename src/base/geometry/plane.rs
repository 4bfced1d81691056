//! Fits a plane through a pixel's neighbourhood: a local point and normal from an organised cloud.
//!
//! The normal is the direction of least scatter of the neighbours (the eigenvector of the smallest eigenvalue of
//! their covariance), turned towards the viewer.

use super::cloud::OrganizedCloud;
use super::frames::Frame;
use super::rigid::{Point, Vector};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

/// A neighbour belongs to another surface if its distance from the middle point is more than this multiple of the
/// distance below which the nearest quarter of the neighbours lies. It is a quarter because at an edge up to three
/// quarters may be another surface. It is a ratio so that a coarse scan is treated as a fine one.
const MAX_RATIO: f64 = 4.0;
/// A plane through fewer points is not reliable.
const MIN_POINTS: usize = 8;
/// A few points in a row do not determine a plane at a pixel beside them. With the mean and scatter S of the points'
/// pixels, a pixel at the distance d from the mean has 1 + dᵀ S⁻¹ d: 7 at the corner of an evenly filled square, 9 at
/// the corner of a triangle. Above this limit the pixel is too far beside the points.
const MAX_LEVERAGE: f64 = 12.0;

/// A plane by a point on it and its normal, a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane<F: Frame> {
    /// The centroid of the neighbours.
    pub point: Point<F>,
    /// Unit normal, towards the viewer.
    pub normal: Vector<F>,
}

impl<F: Frame> Plane<F> {
    /// The point where the ray from `origin` along `ray` intersects the plane; `None` if the ray runs parallel to
    /// it or away from it.
    pub fn intersect_ray(&self, origin: Point<F>, ray: Vector<F>) -> Option<Point<F>> {
        let slope = self.normal.mm.dot(&ray.mm);
        let distance = self.normal.mm.dot(&(self.point - origin).mm) / slope;
        (distance.is_finite() && distance > 0.0).then(|| origin + ray * distance)
    }
}

/// The plane through the points within `half_width_px` pixels of a pixel. `None` if there are too few points, or if
/// they lie far beside the pixel compared with the area that they cover. `viewer` is the camera's position.
pub fn local_plane<F: Frame>(
    cloud: &OrganizedCloud<F>,
    at: (usize, usize),
    half_width_px: usize,
    viewer: Point<F>,
) -> Option<Plane<F>> {
    local_plane_where(cloud, at, half_width_px, viewer, |_| true)
}

/// Fits the plane as [`local_plane`] does, but only through points for which `belongs` is true for the index of their
/// pixel: the points of one surface.
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
    let reach_mm = MAX_RATIO * *distances_mm.select_nth_unstable_by(quarter, f64::total_cmp).1;
    let (mut count, mut sum, mut squares) = (0usize, Vector3::zeros(), Matrix3::zeros());
    let (mut pixel_sum, mut pixel_squares) = (Vector2::zeros(), Matrix2::zeros());
    for (offset, pixel) in offsets.iter().filter(|(offset, _)| offset.norm() <= reach_mm) {
        count += 1;
        sum += offset;
        squares += offset * offset.transpose();
        pixel_sum += pixel;
        pixel_squares += pixel * pixel.transpose();
    }
    if count < MIN_POINTS || is_outside_of_points(pixel_sum / count as f64, pixel_squares / count as f64) {
        return None;
    }
    let mean = sum / count as f64;
    let eigen = (squares / count as f64 - mean * mean.transpose()).symmetric_eigen();
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let point = middle + Vector::new(mean);
    let outward = if normal.dot(&(viewer - point).mm) < 0.0 { -normal } else { normal };
    Some(Plane { point, normal: Vector::new(outward) })
}

/// Returns whether the origin lies too far beside points with this mean and this mean square.
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

#[cfg(test)]
mod tests {
    use super::super::frames::Camera;
    use super::*;

    /// By hand: on z = 700 + x/2 the normal towards the viewer at the origin is (1/2, 0, −1)/√1.25.
    #[test]
    fn a_tilted_plane_has_its_normal_and_meets_a_ray() {
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

    /// Calculated by hand: two columns of a 21 × 21 grid, 4 and 5 px beside the pixel, have their mean 4.5 px from
    /// it and a scatter of 0.5 px: 1 + (4.5/0.5)² = 82. For half of a window with the pixel at its edge, the value
    /// is 4.
    #[test]
    fn a_few_points_in_a_row_are_no_plane_for_a_pixel_beside_them() {
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
}
