//! The organised cloud: one point and one colour for each pixel of a 3D camera. Also the fit of the camera's lens to
//! such a cloud.
//!
//! A missing point is stored as NaN, but NaN is never returned: every access returns an `Option`. A point that a file
//! or a camera delivers as NaN, infinite or (0, 0, 0) is missing.
//!
//! Every point lies on the ray of its pixel, so the cloud determines the lens. With pixels (u, v) and points (x, y, z),
//! the nine parameters of a lens minimise Σ |(u, v) − π(x, y, z)|². The first estimate is a pinhole without distortion,
//! whose normal equations are linear in x/z and y/z. Gauss–Newton then refines all nine parameters. A second run
//! excludes the points with a large projection error, such as points that a filter moved across an edge.

use super::camera::PinholeCamera;
use super::picture::ColorPicture;
use super::rigid::{Frame, Pixel, Point, Rigid};
use super::statistics::median;
use nalgebra::{SMatrix, SVector, Vector2};
use rayon::prelude::*;

const MISSING: [f32; 3] = [f32::NAN; 3];

/// Points and colours on the pixel grid of the camera that recorded them, row by row; coordinates in frame `F`, mm.
#[derive(Debug, Clone)]
pub struct OrganizedCloud<F: Frame> {
    width: usize,
    height: usize,
    points_mm: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
    frame: std::marker::PhantomData<F>,
}

/// The reason why points do not form an organised cloud.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CloudError {
    /// The number of points or of colours is not the number of pixels.
    #[error("a cloud of {width}×{height} needs {} points and colours, found {points} and {colors}", width * height)]
    Size {
        /// Number of columns that the caller requested.
        width: usize,
        /// Number of rows that the caller requested.
        height: usize,
        /// Number of points that were given.
        points: usize,
        /// Number of colours that were given.
        colors: usize,
    },
    /// The cloud has a single row or column: it is a list of points without a pixel grid.
    #[error(
        "the cloud is not organised ({width}×{height}); export it as an ordered cloud, one point for each pixel"
    )]
    NotOrganized {
        /// Number of columns of the cloud.
        width: usize,
        /// Number of rows of the cloud.
        height: usize,
    },
}

impl<F: Frame> OrganizedCloud<F> {
    /// Creates a cloud from points and colours, row by row.
    ///
    /// # Errors
    /// If the counts differ from `width`·`height`, or the cloud has fewer than two rows or columns.
    pub fn new(
        width: usize,
        height: usize,
        mut points_mm: Vec<[f32; 3]>,
        colors: Vec<[u8; 3]>,
    ) -> Result<Self, CloudError> {
        if width < 2 || height < 2 {
            return Err(CloudError::NotOrganized { width, height });
        }
        if points_mm.len() != width * height || colors.len() != width * height {
            return Err(CloudError::Size { width, height, points: points_mm.len(), colors: colors.len() });
        }
        for point in &mut points_mm {
            if !point.iter().all(|n| n.is_finite()) || *point == [0.0; 3] {
                *point = MISSING;
            }
        }
        Ok(OrganizedCloud { width, height, points_mm, colors, frame: std::marker::PhantomData })
    }

    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the point seen by this pixel; `None` if it is missing.
    pub fn point(&self, column: usize, row: usize) -> Option<Point<F>> {
        self.point_at(row * self.width + column)
    }

    /// Returns the point at this index, counted row by row.
    pub fn point_at(&self, index: usize) -> Option<Point<F>> {
        let [x, y, z] = self.points_mm[index];
        (!x.is_nan()).then(|| Point::at(x.into(), y.into(), z.into()))
    }

    /// Returns the colour at this index, counted row by row.
    pub fn color_at(&self, index: usize) -> [u8; 3] {
        self.colors[index]
    }

    /// Returns all points that are not missing, with their index, row by row.
    pub fn valid_points(&self) -> impl Iterator<Item = (usize, Point<F>)> + '_ {
        (0..self.points_mm.len()).filter_map(|index| Some((index, self.point_at(index)?)))
    }

    /// Returns the colours as a picture.
    pub fn picture(&self) -> ColorPicture {
        ColorPicture { width: self.width, height: self.height, rgb: self.colors.clone() }
    }

    /// Returns the cloud with its coordinates in another frame; the pixel grid stays.
    pub fn transformed<To: Frame>(&self, to_from_f: &Rigid<To, F>) -> OrganizedCloud<To> {
        let (rotation, shift) = (to_from_f.rotation(), to_from_f.origin().mm.coords);
        let moved = |&[x, y, z]: &[f32; 3]| {
            let p = rotation * nalgebra::Vector3::new(f64::from(x), f64::from(y), f64::from(z)) + shift;
            [p.x as f32, p.y as f32, p.z as f32]
        };
        OrganizedCloud {
            width: self.width,
            height: self.height,
            points_mm: self.points_mm.iter().map(moved).collect(),
            colors: self.colors.clone(),
            frame: std::marker::PhantomData,
        }
    }

    /// Returns the cloud with each point moved along its ray: the point's coordinates are multiplied by the factor that
    /// `factor` returns for them.
    pub fn scaled_along_rays(&self, factor: impl Fn([f64; 3]) -> f64 + Sync) -> OrganizedCloud<F> {
        let moved = |&point: &[f32; 3]| {
            if point[0].is_nan() {
                return MISSING;
            }
            let factor = factor(point.map(f64::from));
            point.map(|n| (f64::from(n) * factor) as f32)
        };
        OrganizedCloud {
            points_mm: self.points_mm.par_iter().map(moved).collect(),
            colors: self.colors.clone(),
            ..*self
        }
    }

    /// Returns the coordinates of each pixel's point, NaN if missing; for functions that write files.
    pub fn raw_points_mm(&self) -> &[[f32; 3]] {
        &self.points_mm
    }

    /// Returns the surface area of one pixel, mm²: the cross product of half of the vectors between its opposite
    /// neighbours. `None` at the border of the picture or next to a missing point.
    pub fn pixel_area_mm2(&self, column: usize, row: usize) -> Option<f64> {
        self.smoothed_pixel_area_mm2(column, row, 1)
    }

    /// Calculates the area of a pixel from neighbours at the distance `reach_px`. Noise in depth tilts the vectors
    /// between neighbours and so increases every area, by about (noise / distance)²: 1.4 % for direct neighbours in a
    /// scan with 0.44 mm per pixel and 0.055 mm of noise.
    pub fn smoothed_pixel_area_mm2(&self, column: usize, row: usize, reach_px: usize) -> Option<f64> {
        let inside = |at: usize, length: usize| at >= reach_px && at + reach_px < length;
        if reach_px == 0 || !inside(column, self.width) || !inside(row, self.height) {
            return None;
        }
        let span_px = 2.0 * reach_px as f64;
        let across = (self.point(column + reach_px, row)? - self.point(column - reach_px, row)?).mm / span_px;
        let down = (self.point(column, row + reach_px)? - self.point(column, row - reach_px)?).mm / span_px;
        Some(across.cross(&down).norm())
    }
}

/// Approximate number of points to which the lens is fitted.
const LENS_SAMPLE_SIZE: usize = 4_000;
/// Minimum number of points that determine a lens.
const MIN_LENS_POINTS: usize = 60;
const MAX_LENS_STEPS: usize = 12;
/// Maximum projection error of a point, as a multiple of the median error, at which the second run uses the point.
const MAX_ERROR_IN_MEDIANS: f64 = 6.0;

/// The lens that was fitted to a cloud, with its residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudLens {
    /// The fitted lens parameters.
    pub camera: PinholeCamera,
    /// The median distance between projected points and their pixels, px.
    pub median_px: f64,
}

/// Returns about [`LENS_SAMPLE_SIZE`] points with their pixels, evenly distributed over the picture.
pub fn sample_points<F: Frame>(cloud: &OrganizedCloud<F>) -> Vec<(Pixel, Point<F>)> {
    let count = cloud.width() * cloud.height();
    // The stride has no common factor with the width, so that the sample contains all columns.
    let mut stride = (count / LENS_SAMPLE_SIZE).max(1);
    while stride > 1 && (cloud.width().is_multiple_of(stride) || stride.is_multiple_of(2)) {
        stride -= 1;
    }
    let pixel = |index: usize| Pixel::at((index % cloud.width()) as f64, (index / cloud.width()) as f64);
    (0..count).step_by(stride).filter_map(|index| Some((pixel(index), cloud.point_at(index)?))).collect()
}

/// Returns the median distance between the projections of these points and their pixels, px; the distance of a point
/// behind the camera is infinite. `None` without points.
pub fn median_projection_error_px<F: Frame>(sample: &[(Pixel, Point<F>)], camera: &PinholeCamera) -> Option<f64> {
    let off = |(pixel, point): &(Pixel, Point<F>)| {
        camera.project(*point).map_or(f64::INFINITY, |seen| seen.distance_px(*pixel))
    };
    median(&mut sample.iter().map(off).collect::<Vec<f64>>())
}

/// Computes the lens from these points, for a picture of this size; `None` if the points do not determine the lens.
pub fn fit_lens<F: Frame>(
    sample: &[(Pixel, Point<F>)],
    (width_px, height_px): (usize, usize),
) -> Option<CloudLens> {
    let mut kept: Vec<(Pixel, Point<F>)> = sample.iter().copied().filter(|(_, point)| point.mm.z > 1e-6).collect();
    let mut camera = fit_pinhole(&kept, (width_px, height_px))?;
    for round in 0..2 {
        camera = refine_lens(&kept, camera)?;
        let allowed_px = MAX_ERROR_IN_MEDIANS * median_projection_error_px(&kept, &camera)?.max(1e-6);
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
    if kept.len() < MIN_LENS_POINTS {
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
    if kept.len() < MIN_LENS_POINTS {
        return None;
    }
    let mut camera = start;
    for _ in 0..MAX_LENS_STEPS {
        let (mut normal, mut pull) = (SMatrix::<f64, 9, 9>::zeros(), SVector::<f64, 9>::zeros());
        for (pixel, point) in kept {
            let (Some(seen), Some(slope)) = (camera.project(*point), camera.lens_jacobian(*point)) else {
                continue;
            };
            normal += slope.transpose() * slope;
            pull += slope.transpose() * Vector2::new(pixel.u - seen.u, pixel.v - seen.v);
        }
        // The matrix is scaled to a diagonal of ones, because focal lengths and k3 differ by many powers of ten.
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
    use crate::geometry::{Base, Camera};
    use nalgebra::{Isometry3, Vector3};

    fn grid(width: usize, height: usize) -> OrganizedCloud<Camera> {
        let at = |i: usize| [(i % width) as f32 * 2.0, (i / width) as f32 * 3.0, 700.0];
        OrganizedCloud::new(width, height, (0..width * height).map(at).collect(), vec![[1, 2, 3]; width * height])
            .expect("counts agree")
    }

    /// Expected value, calculated by hand: pixels 2 mm apart along a row and 3 mm along a column have an area of 6 mm²
    /// each.
    #[test]
    fn a_pixel_represents_its_surface_area() {
        let cloud = grid(4, 4);
        assert!((cloud.pixel_area_mm2(1, 2).expect("inside") - 6.0).abs() < 1e-9);
        assert_eq!(cloud.pixel_area_mm2(0, 2), None);
    }

    /// Expected value, calculated by hand: pixels of 0.4 × 0.4 mm have 0.16 mm². Depth noise of ±0.06 mm makes the
    /// vectors between direct neighbours longer.
    #[test]
    fn a_longer_reach_reduces_the_noise_of_an_area() {
        let noise = |i: usize| if (i * i * 7 + i / 5) % 11 < 5 { 0.06 } else { -0.06 };
        let at = |i: usize| [(i % 40) as f32 * 0.4, (i / 40) as f32 * 0.4, 700.0 + noise(i)];
        let cloud = OrganizedCloud::<Camera>::new(40, 40, (0..1600).map(at).collect(), vec![[0; 3]; 1600])
            .expect("counts agree");
        let mean = |reach_px: usize| {
            let areas = (5..35).flat_map(|row| (5..35).map(move |column| (row, column)));
            let areas = areas.filter_map(|(row, column)| cloud.smoothed_pixel_area_mm2(column, row, reach_px));
            areas.sum::<f64>() / 900.0
        };
        assert!(mean(1) > 0.16 * 1.01, "{}", mean(1));
        assert!((mean(3) / 0.16 - 1.0).abs() < 0.003, "{}", mean(3));
    }

    #[test]
    fn missing_points_are_never_returned() {
        let points = vec![[f32::NAN; 3], [0.0; 3], [1.0, f32::INFINITY, 2.0], [1.0, 2.0, 3.0]];
        let cloud = OrganizedCloud::<Camera>::new(2, 2, points, vec![[0; 3]; 4]).expect("counts agree");
        assert_eq!(cloud.valid_points().map(|(index, _)| index).collect::<Vec<_>>(), [3]);
        assert_eq!(cloud.point(1, 0), None);
    }

    #[test]
    fn a_cloud_of_a_single_row_is_refused_with_a_remedy() {
        let error = OrganizedCloud::<Camera>::new(4, 1, vec![[1.0; 3]; 4], vec![[0; 3]; 4]).expect_err("a list");
        assert!(error.to_string().contains("ordered cloud"), "{error}");
    }

    #[test]
    fn a_transform_keeps_the_pixel_grid() {
        let base_from_camera: Rigid<Base, Camera> =
            Rigid::from_isometry_unchecked(Isometry3::new(Vector3::new(0.0, 0.0, 100.0), Vector3::zeros()));
        let moved = grid(3, 3).transformed(&base_from_camera);
        assert!(moved.point(2, 1).expect("there").distance_mm(Point::at(4.0, 3.0, 800.0)) < 1e-4);
    }

    /// The parameters of a lens are found from points on its rays; points that were moved across an edge are excluded
    /// from the fit.
    #[test]
    fn the_lens_is_computed_from_a_cloud() {
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
