//! The camera model compared with OpenCV's model, which the calibrations use.

use opencv::calib3d;
use opencv::core::{Mat, Point2d, Point3d, Vector};
use panelprep::geometry::{Camera, PinholeCamera, Point};
use proptest::prelude::*;

fn opencv_pixel(camera: &PinholeCamera, point: Point<Camera>) -> opencv::Result<(f64, f64)> {
    let matrix = Mat::from_slice_2d(&[
        [camera.fx_px, 0.0, camera.cx_px],
        [0.0, camera.fy_px, camera.cy_px],
        [0.0, 0.0, 1.0],
    ])?;
    let distortion: Vector<f64> = [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3].into_iter().collect();
    let points: Vector<Point3d> = [Point3d::new(point.mm.x, point.mm.y, point.mm.z)].into_iter().collect();
    let still: Vector<f64> = [0.0; 3].into_iter().collect();
    let mut pixels: Vector<Point2d> = Vector::new();
    calib3d::project_points_def(&points, &still, &still, &matrix, &distortion, &mut pixels)?;
    let pixel = pixels.get(0)?;
    Ok((pixel.x, pixel.y))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]
    #[test]
    fn projection_equals_opencv_to_a_billionth_of_a_pixel(
        k in prop::array::uniform3(-0.2..0.2f64),
        p in prop::array::uniform2(-0.002..0.002f64),
        f in prop::array::uniform2(500.0..3_000.0f64),
        c in prop::array::uniform2(200.0..1_100.0f64),
        xy in prop::array::uniform2(-350.0..350.0f64),
        depth_mm in 300.0..1_500.0f64,
    ) {
        let camera = PinholeCamera {
            width_px: 1944, height_px: 1200, fx_px: f[0], fy_px: f[1], cx_px: c[0], cy_px: c[1],
            k1: k[0], k2: k[1], p1: p[0], p2: p[1], k3: k[2],
        };
        let point = Point::at(xy[0], xy[1], depth_mm);
        let ours = camera.project(point).expect("in front of the camera");
        let (u, v) = opencv_pixel(&camera, point).expect("OpenCV projects");
        prop_assert!((ours.u - u).abs() < 1e-9 && (ours.v - v).abs() < 1e-9, "{ours:?} is not ({u}, {v})");
    }
}
