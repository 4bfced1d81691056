//! The pinhole camera with Brown–Conrady distortion (thesis Eq. 3.5–3.13).
//!
//! A point (X, Y, Z) in the camera's frame has the undistorted image coordinates x = X/Z, y = Y/Z (Eq. 3.10). With r² =
//! x² + y² and the radial factor ρ = 1 + k1 r² + k2 r⁴ + k3 r⁶ (Eq. 3.13), its distorted image coordinates are
//!     x' = x ρ + 2 p1 x y + p2 (r² + 2x²),   y' = y ρ + p1 (r² + 2y²) + 2 p2 x y.                       (3.12)
//! The tangential terms use the undistorted coordinates, as in OpenCV's definition of the coefficients; the equation
//! printed in the thesis differs. The pixel is u = fx x' + cx, v = fy y' + cy (Eq. 3.11). Unprojection inverts (3.12)
//! by Newton's method. The whole program uses this one model; its results equal those of `cv::projectPoints`.

use super::rigid::{Frame, Pixel, Point, Vector};
use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

/// Intrinsic parameters of a camera; the result of its lens calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinholeCamera {
    /// Width of the picture, px.
    pub width_px: usize,
    /// Height of the picture, px.
    pub height_px: usize,
    /// Focal length along u, px.
    pub fx_px: f64,
    /// Focal length along v, px.
    pub fy_px: f64,
    /// Principal point along u, px.
    pub cx_px: f64,
    /// Principal point along v, px.
    pub cy_px: f64,
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
}

/// Maximum number of Newton steps of an unprojection; real lenses need three or four.
const MAX_NEWTON_STEPS: usize = 20;

impl PinholeCamera {
    /// Returns the pixel onto which a point is projected; `None` if the point is behind the camera. The pixel may lie
    /// outside of the picture.
    pub fn project<F: Frame>(&self, point: Point<F>) -> Option<Pixel> {
        let p = point.mm;
        (p.z > 1e-6).then(|| {
            let distorted = self.distort(Vector2::new(p.x / p.z, p.y / p.z)); // Eq. 3.10
            Pixel::at(self.fx_px * distorted.x + self.cx_px, self.fy_px * distorted.y + self.cy_px) // Eq. 3.11
        })
    }

    /// Returns the pixel onto which a point is projected, and the derivative of the pixel with respect to the point, px
    /// per mm along x, y, z; `None` if the point is behind the camera.
    pub fn project_with_jacobian<F: Frame>(&self, point: Point<F>) -> Option<(Pixel, Matrix2x3<f64>)> {
        let (p, pixel) = (point.mm, self.project(point)?);
        let (x, y) = (p.x / p.z, p.y / p.z);
        let flat = Matrix2x3::new(1.0, 0.0, -x, 0.0, 1.0, -y) / p.z; // of Eq. 3.10
        let focal = Matrix2::new(self.fx_px, 0.0, 0.0, self.fy_px);
        Some((pixel, focal * self.distortion_jacobian(Vector2::new(x, y)) * flat))
    }

    /// Returns the derivative of a point's pixel with respect to fx, fy, cx, cy, k1, k2, p1, p2, k3, in this order;
    /// `None` if the point is behind the camera.
    pub fn lens_jacobian<F: Frame>(&self, point: Point<F>) -> Option<SMatrix<f64, 2, 9>> {
        let p = point.mm;
        (p.z > 1e-6).then(|| {
            let (x, y) = (p.x / p.z, p.y / p.z);
            let (distorted, r2) = (self.distort(Vector2::new(x, y)), x * x + y * y);
            let (fx, fy, across) = (self.fx_px, self.fy_px, 2.0 * x * y);
            let u = [distorted.x, 0.0, 1.0, 0.0, fx * x * r2, fx * x * r2 * r2];
            let v = [0.0, distorted.y, 0.0, 1.0, fy * y * r2, fy * y * r2 * r2];
            let u = u.into_iter().chain([fx * across, fx * (r2 + 2.0 * x * x), fx * x * r2.powi(3)]);
            let v = v.into_iter().chain([fy * (r2 + 2.0 * y * y), fy * across, fy * y * r2.powi(3)]);
            SMatrix::from_row_iterator(u.chain(v))
        })
    }

    /// Returns the pixel onto which a point is projected; `None` if it lies outside of the picture, or the point is
    /// behind the camera.
    pub fn project_inside<F: Frame>(&self, point: Point<F>) -> Option<Pixel> {
        self.project(point).filter(|pixel| pixel.nearest_whole(self.width_px, self.height_px).is_some())
    }

    /// Returns the ray through a pixel, as the vector (x, y, 1): multiplied by a depth it is a point. `None` if the
    /// distortion cannot be inverted at this pixel, which happens only far outside of the picture.
    pub fn unproject<F: Frame>(&self, pixel: Pixel) -> Option<Vector<F>> {
        let distorted = Vector2::new((pixel.u - self.cx_px) / self.fx_px, (pixel.v - self.cy_px) / self.fy_px);
        let mut undistorted = distorted;
        for _ in 0..MAX_NEWTON_STEPS {
            let residual = self.distort(undistorted) - distorted;
            if residual.norm() < 1e-13 {
                return Some(Vector::new(Vector3::new(undistorted.x, undistorted.y, 1.0)));
            }
            undistorted -= self.distortion_jacobian(undistorted).try_inverse()? * residual;
        }
        None
    }

    /// Returns the largest undistorted radius within the circle around the principal point that contains the whole
    /// picture. `None` if the distortion cannot be inverted in this circle: at some radius, the distorted radius grows
    /// by less than `least_slope` times the undistorted radius.
    pub fn max_undistorted_radius(&self, least_slope: f64) -> Option<f64> {
        const DIRECTIONS: usize = 24;
        const STEPS: usize = 40;
        const MAX_STEPS: usize = 25 * STEPS;
        let (right, low) = (self.width_px as f64 - 0.5, self.height_px as f64 - 0.5);
        let away = |(u, v): (f64, f64)| ((u - self.cx_px) / self.fx_px).hypot((v - self.cy_px) / self.fy_px);
        let rim =
            [(-0.5, -0.5), (right, -0.5), (right, low), (-0.5, low)].map(away).into_iter().fold(0.0, f64::max);
        let step = rim / STEPS as f64;
        if !step.is_finite() {
            return None;
        }
        let mut largest: f64 = 0.0;
        for direction in 0..DIRECTIONS {
            let turn = std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64;
            let along = Vector2::new(turn.cos(), turn.sin());
            let reached = (1..=MAX_STEPS).find_map(|index| {
                let at = along * (step * index as f64);
                let slope = self.distortion_jacobian(at);
                if !(along.dot(&(slope * along)) >= least_slope && slope.determinant() > 0.0) {
                    return Some(None);
                }
                (self.distort(at).norm() >= rim).then_some(Some(at.norm()))
            });
            largest = largest.max(reached.flatten()?);
        }
        Some(largest)
    }

    /// Returns the displacement of the pixel, along u and v, for a displacement of the point by 1 mm along the camera's
    /// x and y at this depth, mm. This is the diagonal of the image Jacobian, without distortion.
    pub fn px_per_mm_at(&self, depth_mm: f64) -> (f64, f64) {
        (self.fx_px / depth_mm, self.fy_px / depth_mm)
    }

    // Applies the lens distortion: Eq. 3.12 and 3.13 in the documentation of this module.
    fn distort(&self, undistorted: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (undistorted.x, undistorted.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    fn distortion_jacobian(&self, undistorted: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (undistorted.x, undistorted.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3)); // dρ/dx = slope · x
        let cross = slope * x * y + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        Matrix2::new(
            radial + slope * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            cross,
            cross,
            radial + slope * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::rigid::Camera;
    use super::*;
    use proptest::prelude::*;

    const LENS: PinholeCamera = PinholeCamera {
        width_px: 1944,
        height_px: 1200,
        fx_px: 1785.0,
        fy_px: 1784.0,
        cx_px: 972.0,
        cy_px: 600.0,
        k1: -0.1,
        k2: 0.12,
        p1: 0.0006,
        p2: -0.0004,
        k3: -0.02,
    };

    /// Compares the derivative with finite differences: each parameter is changed by a small amount.
    #[test]
    fn the_lens_jacobian_agrees_with_finite_differences() {
        let point = Point::<Camera>::at(-170.0, 95.0, 700.0);
        let slope = LENS.lens_jacobian(point).expect("in front");
        let parameters: [fn(&mut PinholeCamera) -> &mut f64; 9] = [
            |lens| &mut lens.fx_px,
            |lens| &mut lens.fy_px,
            |lens| &mut lens.cx_px,
            |lens| &mut lens.cy_px,
            |lens| &mut lens.k1,
            |lens| &mut lens.k2,
            |lens| &mut lens.p1,
            |lens| &mut lens.p2,
            |lens| &mut lens.k3,
        ];
        for (column, parameter) in parameters.iter().enumerate() {
            let moved = |by: f64| {
                let mut lens = LENS;
                *parameter(&mut lens) += by;
                lens.project(point).expect("in front")
            };
            let (low, high) = (moved(-1e-4), moved(1e-4));
            let [du, dv] = [high.u - low.u, high.v - low.v].map(|difference| difference / 2e-4);
            let (u, v) = (slope[(0, column)], slope[(1, column)]);
            assert!((u - du).abs() < 1e-6 && (v - dv).abs() < 1e-6, "{column}: {u} {du}, {v} {dv}");
        }
    }

    /// Expected values, calculated by hand: x = 0.2, y = 0.1, r² = 0.05. With only k1 = −0.1, p1 = 0.01: ρ = 0.995, x'
    /// = 0.199 + 2·0.01·0.02 = 0.1994, y' = 0.0995 + 0.01·(0.05 + 0.02) = 0.1002; u = 1000·x' + 500.
    #[test]
    fn distortion_agrees_with_hand_calculation() {
        let camera = PinholeCamera {
            fx_px: 1000.0,
            fy_px: 1000.0,
            cx_px: 500.0,
            cy_px: 400.0,
            k1: -0.1,
            k2: 0.0,
            p1: 0.01,
            p2: 0.0,
            k3: 0.0,
            ..LENS
        };
        let pixel = camera.project(Point::<Camera>::at(200.0, 100.0, 1000.0)).expect("in front");
        assert!((pixel.u - 699.4).abs() < 1e-9 && (pixel.v - 500.2).abs() < 1e-9, "{pixel:?}");
    }

    /// Expected values, calculated by hand. With k1 = −1 the distorted radius r − r³ has its maximum, 0.385, at r =
    /// 0.577; the corner of this picture lies at 0.64. With k1 = −0.1 the corner is reached at r − 0.1 r³ = 0.64, which
    /// is r = 0.669.
    #[test]
    fn a_distortion_without_inverse_is_detected() {
        let plain = PinholeCamera { k1: -0.1, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, ..LENS };
        let radius = plain.max_undistorted_radius(0.05).expect("no fold");
        assert!((radius - 0.669).abs() < 0.02, "{radius}");
        assert_eq!(PinholeCamera { k1: -1.0, ..plain }.max_undistorted_radius(0.05), None);
        assert_eq!(PinholeCamera { k1: f64::NAN, ..plain }.max_undistorted_radius(0.05), None);
    }

    #[test]
    fn a_point_behind_the_camera_has_no_pixel() {
        assert_eq!(LENS.project(Point::<Camera>::at(0.0, 0.0, -700.0)), None);
        assert_eq!(LENS.project_inside(Point::<Camera>::at(500.0, 0.0, 700.0)), None);
    }

    /// Compares the derivative with central differences: the point is moved by ±0.01 mm along each axis.
    #[test]
    fn the_projection_jacobian_agrees_with_finite_differences() {
        let at = nalgebra::Point3::new(130.0, -90.0, 620.0);
        let (_, slope) = LENS.project_with_jacobian(Point::<Camera>::new(at)).expect("in front");
        for axis in 0..3 {
            let step = Vector3::ith(axis, 0.01);
            let pixel = |point| LENS.project(Point::<Camera>::new(point)).expect("in front");
            let (low, high) = (pixel(at - step), pixel(at + step));
            let (found, expected) = (Vector2::new(high.u - low.u, high.v - low.v), slope * step * 2.0);
            assert!((found - expected).norm() < 1e-9, "{axis}: {found} is not {expected}");
        }
    }

    proptest! {
        #[test]
        fn unprojection_inverts_projection(u in 0.0..1944.0f64, v in 0.0..1200.0f64, depth_mm in 300.0..1300.0f64) {
            let ray = LENS.unproject::<Camera>(Pixel::at(u, v)).expect("inside the picture");
            let pixel = LENS.project(Point::<Camera>::new((ray.mm * depth_mm).into())).expect("in front");
            prop_assert!(pixel.distance_px(Pixel::at(u, v)) < 1e-8);
        }
    }
}
