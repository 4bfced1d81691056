//! Whether the points of a cloud lie on the rays of their pixels.
//!
//! A 3D camera measures each point on the ray of its pixel, so that a point which the camera's own model projects to another pixel was
//! changed on its way: by a disk, a cable or a program. This is looked at where the model describes the cloud at all: the makers'
//! figures are approximations, and a cloud may be in another frame. Distances along the ray are not looked at.

use super::cloud_error::CloudFileError;
use crate::geometry::{Camera, OrganizedCloud, PinholeCamera, Pixel, median};
use rayon::prelude::*;

/// The model describes the cloud where half of its points project nearer to their pixels, px.
const DESCRIBED_PX: f64 = 2.0;
/// A point that projects farther away was not measured at its pixel, px: ten times as much, for filters that smooth a scan.
const ELSEWHERE_PX: f64 = 20.0;
/// One of so many points is looked at to judge the model.
const SAMPLE_STEP: usize = 97;

/// Refuses a cloud in which points do not lie on the rays of their pixels, where the others do.
pub(super) fn check_rays(cloud: &OrganizedCloud<Camera>, camera: &PinholeCamera) -> Result<(), CloudFileError> {
    let own = |index: usize| Pixel::at((index % cloud.width()) as f64, (index / cloud.width()) as f64);
    // How far from its pixel a point projects, px.
    let off_px = |index: usize| {
        let seen = cloud.point_at(index)?;
        let (own, seen) = (own(index), camera.project(seen));
        Some(seen.map_or(f64::INFINITY, |seen| (seen.u - own.u).abs().max((seen.v - own.v).abs())))
    };
    let count = cloud.width() * cloud.height();
    let mut sample: Vec<f64> = (0..count).step_by(SAMPLE_STEP).filter_map(off_px).collect();
    if median(&mut sample).is_none_or(|off_px| off_px > DESCRIBED_PX) {
        return Ok(());
    }
    let elsewhere = |index: &usize| off_px(*index).is_some_and(|off_px| off_px > ELSEWHERE_PX);
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

    /// A plane at 700 mm whose rays are those of a camera with its middle elsewhere, and one changed point.
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

    /// By hand: x = 700 mm · 19/90 = 147.8 mm more is seen 19 px to the right, 163.3 mm are 21 px.
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

    #[test]
    fn a_cloud_that_the_model_does_not_describe_is_not_judged_by_it() {
        let far = Some((3_010, [900.0, 0.0, 700.0]));
        assert_eq!(check_rays(&cloud(2.5, far), &CAMERA), Ok(()));
        assert!(check_rays(&cloud(1.5, far), &CAMERA).is_err());
    }
}
