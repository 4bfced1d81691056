//! Checks whether the points of a cloud lie on the rays of their pixels.
//!
//! A 3D camera measures each point on the ray of its pixel. If half of the points do not project to their pixels with
//! the camera's calibration, then cloud and calibration do not belong together: another camera, another frame or unit,
//! or reversed rows. The error names the lens or the order that fits. If most points project to their pixels, then the
//! other points were corrupted after the capture, by a disk, a cable or a program. The distances along the rays are not
//! checked, except for their unit.

use super::error::CloudFileError;
use panelprep_base::geometry::{
    Camera, OrganizedCloud, PinholeCamera, Pixel, Point, fit_lens, median, median_projection_error_px,
    sample_points,
};
use rayon::prelude::*;

/// Maximum median distance between the pixels and the projections of their points at which a lens fits, px in a picture
/// of [`REFERENCE_WIDTH_PX`] columns. The limit is wide because the manufacturers' parameters are approximations.
const MAX_MEDIAN_ERROR_PX: f64 = 2.0;
const REFERENCE_WIDTH_PX: f64 = 1_944.0;
/// Lower bound of this limit in small pictures, px: the pixel centres of a downsampled scan may be defined differently.
const MIN_ERROR_LIMIT_PX: f64 = 1.0;
/// Maximum distance between a pixel and the projection of its point, px. The value is ten times
/// [`MAX_MEDIAN_ERROR_PX`], so that smoothed scans are accepted.
const MAX_PROJECTION_ERROR_PX: f64 = 20.0;
/// Minimum number of points at which lens, frame and unit are checked.
const MIN_CHECKED_POINTS: usize = 60;
/// Minimum depth that a 3D camera measures, mm; smaller values are metres.
const MIN_DISTANCE_MM: f64 = 20.0;
/// Range of the depths that a 3D camera measures, mm; other values have another unit.
const MEASURING_RANGE_MM: std::ops::Range<f64> = 150.0..5_000.0;
/// Maximum residual at which an estimated lens fits a cloud, px.
const MAX_FIT_RESIDUAL_PX: f64 = 0.5;

type RaySample = Vec<(Pixel, Point<Camera>)>;

/// Checks without a calibration that the points are in mm in the frame of a camera: not in metres, not behind the
/// camera, and on the rays of any lens.
///
/// # Errors
/// If the points have another unit or another frame; the error states which.
pub fn check_camera_frame(cloud: &OrganizedCloud<Camera>) -> Result<(), CloudFileError> {
    let sample = sample_points(cloud);
    if sample.len() < MIN_CHECKED_POINTS {
        return Ok(());
    }
    check_unit_and_side(&sample)?;
    let size = (cloud.width(), cloud.height());
    match fit_lens(&sample, size) {
        Some(own) if own.median_px <= allowed_px(cloud.width()) => Ok(()),
        own => {
            let off_px =
                panelprep_base::number_text::fixed_decimals(own.map_or(f64::INFINITY, |own| own.median_px), 1)
                    .to_string();
            Err(CloudFileError::OtherFrame { off_px })
        }
    }
}

fn allowed_px(width: usize) -> f64 {
    (MAX_MEDIAN_ERROR_PX * width as f64 / REFERENCE_WIDTH_PX).max(MIN_ERROR_LIMIT_PX)
}

fn check_unit_and_side(sample: &RaySample) -> Result<(), CloudFileError> {
    let depths = || sample.iter().map(|(_, point)| point.mm.z);
    let middle = median(&mut depths().collect::<Vec<f64>>()).unwrap_or(0.0);
    let ends = depths().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)]);
    let [from, to] = ends.map(|end| panelprep_base::number_text::fixed_decimals(end, 2).to_string());
    if middle > 0.0 && middle < MIN_DISTANCE_MM {
        return Err(CloudFileError::Metres { from, to });
    }
    if middle < 0.0 {
        return Err(CloudFileError::Behind { from, to });
    }
    if !MEASURING_RANGE_MM.contains(&middle) {
        return Err(CloudFileError::OtherUnit { from, to });
    }
    Ok(())
}

/// Returns the error for a cloud whose points do not lie on the rays of this camera. The error names the change after
/// which they would.
fn lens_mismatch_error(
    cloud: &OrganizedCloud<Camera>,
    sample: &RaySample,
    camera: &PinholeCamera,
    off_px: f64,
) -> CloudFileError {
    let allowed = allowed_px(cloud.width());
    let (last_u, last_v) = (cloud.width() as f64 - 1.0, cloud.height() as f64 - 1.0);
    let fits = |at: &dyn Fn(&Pixel) -> Pixel| {
        let changed: RaySample = sample.iter().map(|(pixel, point)| (at(pixel), *point)).collect();
        median_projection_error_px(&changed, camera).is_some_and(|off_px| off_px <= allowed)
    };
    let order = if fits(&|pixel| Pixel::at(pixel.u, last_v - pixel.v)) {
        Some("the rows are upside down")
    } else if fits(&|pixel| Pixel::at(last_u - pixel.u, pixel.v)) {
        Some("the columns are mirrored")
    } else if fits(&|pixel| Pixel::at(last_u - pixel.u, last_v - pixel.v)) {
        Some("the picture is rotated by 180°")
    } else {
        None
    };
    let off_px = panelprep_base::number_text::fixed_decimals(off_px, 1).to_string();
    if let Some(order) = order {
        return CloudFileError::OtherOrder { order };
    }
    match fit_lens(sample, (cloud.width(), cloud.height())) {
        Some(own) if own.median_px <= MAX_FIT_RESIDUAL_PX => {
            let numbers = |lens: &PinholeCamera| {
                let [fx, fy, cx, cy] = [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px]
                    .map(|number| panelprep_base::number_text::fixed_decimals(number, 2));
                format!("fx {fx}, fy {fy}, cx {cx}, cy {cy} px")
            };
            CloudFileError::OtherLens { off_px, own: numbers(&own.camera), stated: numbers(camera) }
        }
        _ => CloudFileError::OtherFrame { off_px },
    }
}

/// Checks on a sample of points that the cloud can be from this camera. The check takes one or two milliseconds.
///
/// # Errors
/// If the points belong to another lens, frame, unit or order; the error states which.
pub fn check_lens(cloud: &OrganizedCloud<Camera>, camera: &PinholeCamera) -> Result<(), CloudFileError> {
    let sample = sample_points(cloud);
    if sample.len() < MIN_CHECKED_POINTS {
        return Ok(());
    }
    check_unit_and_side(&sample)?;
    let middle_px = median_projection_error_px(&sample, camera).unwrap_or(f64::INFINITY);
    if middle_px > allowed_px(cloud.width()) {
        return Err(lens_mismatch_error(cloud, &sample, camera, middle_px));
    }
    Ok(())
}

/// Checks the lens as [`check_lens`] does, and in addition every point.
///
/// # Errors
/// The errors of [`check_lens`], or if a point does not lie on the ray of its pixel; the error states the first such
/// point.
pub fn check_rays(cloud: &OrganizedCloud<Camera>, camera: &PinholeCamera) -> Result<(), CloudFileError> {
    check_lens(cloud, camera)?;
    let own = |index: usize| Pixel::at((index % cloud.width()) as f64, (index / cloud.width()) as f64);
    // Distance between a pixel and the projection of its point, px.
    let off_px = |index: usize| {
        let seen = cloud.point_at(index)?;
        let (own, seen) = (own(index), camera.project(seen));
        Some(seen.map_or(f64::INFINITY, |seen| (seen.u - own.u).abs().max((seen.v - own.v).abs())))
    };
    let count = cloud.width() * cloud.height();
    if count < MIN_CHECKED_POINTS {
        return Ok(());
    }
    let elsewhere = |index: &usize| off_px(*index).is_some_and(|off_px| off_px > MAX_PROJECTION_ERROR_PX);
    let found: Vec<usize> = (0..count).into_par_iter().filter(elsewhere).collect();
    match found.first() {
        None => Ok(()),
        Some(first) => Err(CloudFileError::OffRays {
            points: found.len(),
            column: first % cloud.width(),
            row: first / cloud.width(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: PinholeCamera = PinholeCamera {
        width_px: 100,
        height_px: 80,
        fx_px: 90.0,
        fy_px: 90.0,
        cx_px: 50.0,
        cy_px: 40.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };

    /// Returns a plane at 700 mm, seen by a camera whose image centre is shifted, with one changed point.
    fn cloud(shift_px: f64, changed: Option<(usize, [f32; 3])>) -> OrganizedCloud<Camera> {
        let point = |index: usize| {
            let (u, v) = ((index % 100) as f64 + shift_px, (index / 100) as f64);
            [(u - 50.0) / 90.0 * 700.0, (v - 40.0) / 90.0 * 700.0, 700.0].map(|n| n as f32)
        };
        let mut points: Vec<[f32; 3]> = (0..8_000).map(point).collect();
        if let Some((index, point)) = changed {
            points[index] = point;
        }
        OrganizedCloud::new(100, 80, points, vec![[0; 3]; 8_000]).expect("counts agree")
    }

    /// Expected values, calculated by hand: a point that is moved by 700 mm · 19/90 = 147.8 mm in x is projected 19 px
    /// to the right; 163.3 mm are 21 px.
    #[test]
    fn a_point_of_another_pixel_is_refused_with_its_place() {
        let [x, y, z] = [(10.0 - 50.0) / 90.0 * 700.0, (30.0 - 40.0) / 90.0 * 700.0, 700.0_f32];
        let changed = |point| check_rays(&cloud(0.0, Some((3_010, point))), &CAMERA);
        assert_eq!(check_rays(&cloud(0.0, None), &CAMERA), Ok(()));
        assert_eq!(changed([x + 147.8, y, z]), Ok(()));
        let refused = Err(CloudFileError::OffRays { points: 1, column: 10, row: 30 });
        assert_eq!(changed([x + 163.3, y, z]), refused);
        assert_eq!(changed([x, y, -z]), refused, "behind the camera");
        assert_eq!(changed([x, y, 4.0 * z]), refused, "x and y of 700 mm, but 2,800 mm away: 30 px");
        assert_eq!(changed([4.0 * x, 4.0 * y, 4.0 * z]), Ok(()), "another distance on the same ray");
    }

    /// Expected value, calculated by hand: points that are projected 5 px away from their pixels belong to a lens with
    /// its centre at 55 px.
    #[test]
    fn a_cloud_of_another_lens_is_refused_and_its_lens_is_stated() {
        let other = check_rays(&cloud(-5.0, None), &CAMERA).expect_err("another lens").to_string();
        assert!(
            other.contains("cx 55.00") && other.contains("cx 50.00") && other.contains("--from-scan"),
            "{other}"
        );
        assert!(check_rays(&cloud(0.9, None), &CAMERA).is_ok());
        assert!(check_camera_frame(&cloud(-5.0, None)).is_ok(), "without a calibration any lens will do");
    }

    /// The same points in other frames, units and orders are refused, each with its cause.
    #[test]
    fn other_frames_units_and_orders_are_named() {
        let step = |index: usize| if (index / 10).is_multiple_of(2) { 1.0 } else { 1.3 };
        let with = |change: &dyn Fn(usize, [f32; 3]) -> [f32; 3]| {
            let plane = cloud(0.0, None);
            let points = (0..8_000).map(|index| {
                let p = plane.point_at(index).expect("a point").mm;
                change(index, [p.x, p.y, p.z].map(|n| (n * step(index)) as f32))
            });
            OrganizedCloud::new(100, 80, points.collect(), vec![[0; 3]; 8_000]).expect("counts agree")
        };
        assert_eq!(check_rays(&with(&|_, p| p), &CAMERA), Ok(()));
        let words = |cloud: &OrganizedCloud<Camera>| check_rays(cloud, &CAMERA).expect_err("refused").to_string();
        let metres = with(&|_, p| p.map(|n| n / 1e3));
        assert!(words(&metres).contains("metres") && words(&metres).contains("0.70 to 0.91"), "{}", words(&metres));
        let open_gl = with(&|_, [x, y, z]| [x, -y, -z]);
        assert!(words(&open_gl).contains("behind the camera"), "{}", words(&open_gl));
        let base = with(&|_, [x, y, z]| [0.8 * x + 0.6 * z + 300.0, y - 200.0, -0.6 * x + 0.8 * z + 100.0]);
        assert!(words(&base).contains("another frame"), "{}", words(&base));
        let right = with(&|_, p| p);
        let from_below = (0..8_000).map(|index| {
            let p = right.point_at((79 - index / 100) * 100 + index % 100).expect("a point").mm;
            [p.x, p.y, p.z].map(|n| n as f32)
        });
        let rows = OrganizedCloud::new(100, 80, from_below.collect(), vec![[0; 3]; 8_000]).expect("counts agree");
        assert!(words(&rows).contains("upside down"), "{}", words(&rows));
        for wrong in [&metres, &open_gl, &base] {
            assert!(check_camera_frame(wrong).is_err());
        }
    }
}
