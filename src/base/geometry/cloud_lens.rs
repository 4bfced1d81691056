//! The lens of an organised cloud: every point lies on the ray of its pixel, so the cloud determines the lens that
//! recorded it.
//!
//! With pixels (u, v) and points (x, y, z), the nine numbers of a lens minimise Σ |(u, v) − π(x, y, z)|². First a
//! pinhole is computed, whose normal equations are linear in x/z and y/z; then Gauss–Newton runs on all nine.
//! Points that filters moved across edges are left out once.

use super::camera::PinholeCamera;
use super::cloud::OrganizedCloud;
use super::frames::Frame;
use super::median::median;
use super::rigid::Point;
use super::units::Pixel;
use nalgebra::{SMatrix, SVector, Vector2};

/// Approximate number of points that are evaluated.
const SAMPLE: usize = 4_000;
/// Fewer points do not determine a lens.
const MIN_POINTS: usize = 60;
const STEPS: usize = 12;
/// Points whose distance is more than this many medians are left out.
const MAX_MEDIANS: f64 = 6.0;

/// A cloud's lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudLens {
    /// The lens.
    pub camera: PinholeCamera,
    /// The median distance between projected points and their pixels, px.
    pub median_px: f64,
}

/// Returns about [`SAMPLE`] points with their pixels, evenly distributed over the picture.
pub fn sample_points<F: Frame>(cloud: &OrganizedCloud<F>) -> Vec<(Pixel, Point<F>)> {
    let count = cloud.width() * cloud.height();
    // The stride has no common factor with the width, so that the columns vary.
    let mut stride = (count / SAMPLE).max(1);
    while stride > 1 && (cloud.width().is_multiple_of(stride) || stride.is_multiple_of(2)) {
        stride -= 1;
    }
    let pixel = |index: usize| Pixel::at((index % cloud.width()) as f64, (index / cloud.width()) as f64);
    (0..count).step_by(stride).filter_map(|index| Some((pixel(index), cloud.point_at(index)?))).collect()
}

/// Returns the median distance between the projections of these points and their pixels, px; a point behind the camera
/// is at infinity. `None` without points.
pub fn median_projection_error_px<F: Frame>(sample: &[(Pixel, Point<F>)], camera: &PinholeCamera) -> Option<f64> {
    let off = |(pixel, point): &(Pixel, Point<F>)| {
        camera.project(*point).map_or(f64::INFINITY, |seen| seen.distance_px(*pixel))
    };
    median(&mut sample.iter().map(off).collect::<Vec<f64>>())
}

/// Computes the lens from these points, for a picture of this size; `None` if the points do not determine it.
pub fn fit_lens<F: Frame>(
    sample: &[(Pixel, Point<F>)],
    (width_px, height_px): (usize, usize),
) -> Option<CloudLens> {
    let mut kept: Vec<(Pixel, Point<F>)> = sample.iter().copied().filter(|(_, point)| point.mm.z > 1e-6).collect();
    let mut camera = fit_pinhole(&kept, (width_px, height_px))?;
    for round in 0..2 {
        camera = refine_lens(&kept, camera)?;
        let allowed_px = MAX_MEDIANS * median_projection_error_px(&kept, &camera)?.max(1e-6);
        if round == 0 {
            kept.retain(|(pixel, point)| {
                camera.project(*point).is_some_and(|seen| seen.distance_px(*pixel) <= allowed_px)
            });
        }
    }
    Some(CloudLens { camera, median_px: median_projection_error_px(sample, &camera)? })
}

fn fit_pinhole<F: Frame>(
    kept: &[(Pixel, Point<F>)],
    (width_px, height_px): (usize, usize),
) -> Option<PinholeCamera> {
    if kept.len() < MIN_POINTS {
        return None;
    }
    let line = |along: fn(&Point<F>) -> f64, across: fn(&Pixel) -> f64| {
        let count = kept.len() as f64;
        let sums = kept.iter().fold([0.0; 4], |[a, b, aa, ab], (pixel, point)| {
            let (x, u) = (along(point) / point.mm.z, across(pixel));
            [a + x, b + u, aa + x * x, ab + x * u]
        });
        let [a, b, aa, ab] = sums.map(|sum| sum / count);
        let focal = (ab - a * b) / (aa - a * a);
        (focal.is_finite() && focal > 0.0).then_some((focal, b - focal * a))
    };
    let (fx_px, cx_px) = line(|point| point.mm.x, |pixel| pixel.u)?;
    let (fy_px, cy_px) = line(|point| point.mm.y, |pixel| pixel.v)?;
    let [k1, k2, p1, p2, k3] = [0.0; 5];
    Some(PinholeCamera { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3 })
}

fn refine_lens<F: Frame>(kept: &[(Pixel, Point<F>)], start: PinholeCamera) -> Option<PinholeCamera> {
    if kept.len() < MIN_POINTS {
        return None;
    }
    let mut camera = start;
    for _ in 0..STEPS {
        let (mut normal, mut pull) = (SMatrix::<f64, 9, 9>::zeros(), SVector::<f64, 9>::zeros());
        for (pixel, point) in kept {
            let (Some(seen), Some(slope)) = (camera.project(*point), camera.lens_slope(*point)) else { continue };
            normal += slope.transpose() * slope;
            pull += slope.transpose() * Vector2::new(pixel.u - seen.u, pixel.v - seen.v);
        }
        // Scaled so that the diagonal is one: focal lengths and k3 differ by many powers of ten.
        let scale = normal.diagonal().map(|entry| if entry > 0.0 { entry.sqrt().recip() } else { 0.0 });
        let scaled = SMatrix::<f64, 9, 9>::from_fn(|row, column| {
            normal[(row, column)] * scale[row] * scale[column] + if row == column { 1e-12 } else { 0.0 }
        });
        let step = scaled.cholesky()?.solve(&pull.component_mul(&scale)).component_mul(&scale);
        camera.fx_px += step[0];
        camera.fy_px += step[1];
        camera.cx_px += step[2];
        camera.cy_px += step[3];
        camera.k1 += step[4];
        camera.k2 += step[5];
        camera.p1 += step[6];
        camera.p2 += step[7];
        camera.k3 += step[8];
        if step.fixed_rows::<4>(0).norm() < 1e-9 {
            break;
        }
    }
    let sound = camera.fx_px.is_finite() && camera.fx_px > 0.0 && camera.fy_px > 0.0 && camera.k3.is_finite();
    sound.then_some(camera)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Camera;

    /// The numbers of a lens are found from points on its rays; points that were moved across an edge are left out.
    #[test]
    fn a_cloud_states_its_lens() {
        let lens = PinholeCamera {
            width_px: 200,
            height_px: 160,
            fx_px: 190.0,
            fy_px: 189.0,
            cx_px: 98.0,
            cy_px: 81.5,
            k1: -0.08,
            k2: 0.1,
            p1: 0.0006,
            p2: -0.0004,
            k3: -0.02,
        };
        let point = |index: usize| {
            let (u, v) = (index % 200, index / 200);
            let ray = lens.unproject::<Camera>(Pixel::at(u as f64, v as f64)).expect("a ray").mm;
            let depth = 700.0 + 0.3 * u as f64 + if index % 50 == 7 { 90.0 } else { 0.0 };
            let moved = if index % 50 == 7 { 30.0 } else { 0.0 };
            [ray.x * depth + moved, ray.y * depth, depth].map(|number| number as f32)
        };
        let cloud = OrganizedCloud::<Camera>::new(200, 160, (0..32_000).map(point).collect(), vec![[0; 3]; 32_000]);
        let found = fit_lens(&sample_points(&cloud.expect("counts agree")), (200, 160)).expect("a lens");
        let off = [found.camera.fx_px - 190.0, found.camera.fy_px - 189.0, found.camera.cx_px - 98.0];
        assert!(off.iter().all(|off| off.abs() < 1e-2) && found.median_px < 1e-3, "{found:?}");
    }
}
