//! A downsampled scan: the mean inverse depth of blocks of pixels, which is linear over the picture for a plane.
//!
//! The grid has about 490 columns of blocks, for the picture of any camera: at full resolution, the mean of a block has
//! a quarter of the noise of a pixel. A block with pixels at different depths is an edge and has no depth; so flying
//! points and glints give no depth. A point p of the panel is compared with the scan at its projection (projective
//! association, Blais & Levine, IEEE PAMI 17(8), 1995), without any search. With the depths z of p and ẑ of the scan on
//! the same ray, the scanned point is p ẑ/z. Along the normal n, the distance of p in front of this point is
//!     r = n · p (1 − ẑ/z).                                                                               (1)

use nalgebra::{Matrix3, Vector3};
use panelprep_base::geometry::{
    Base, Camera, OrganizedCloud, PinholeCamera, Pixel, Point, Rigid, interpolated_median, median,
};
use rayon::prelude::*;

/// Approximate number of blocks per row of the picture.
const APPROXIMATE_COLUMNS: usize = 486;
/// Maximum depth difference within a block that belongs to one surface without a further check, as a multiple of the
/// side of the block.
const MAX_BLOCK_SPREAD_SIDES: f64 = 1.2;
/// Maximum distance of a depth from the median of the block, as a multiple of the side of the block; other depths are
/// excluded. `MAX_SLANTED_DEVIATION_SIDES` is the smaller limit for the distance from a slanted plane.
const MAX_MEDIAN_DEVIATION_SIDES: f64 = 0.8;
const MAX_SLANTED_DEVIATION_SIDES: f64 = 0.35;
/// Minimum fraction of the pixels of a block that must agree: if the pixels on one side are missing, the mean is not
/// the depth of the centre of the block.
const MIN_AGREEING_FRACTION: f64 = 0.9;
/// Maximum difference between the depths of neighbouring blocks of one surface, as a multiple of the side of the block:
/// a slope of 73°.
const MAX_STEP_SIDES: f64 = 3.3;

/// The scan at full resolution, with its colours.
pub(super) type ColoredCloud = OrganizedCloud<Camera>;

/// The depth of a scan at the projection of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum DepthReading {
    /// The point is outside of the picture.
    OutOfView,
    /// No depth was measured at this pixel.
    Nothing,
    /// A depth, mm, on an edge or beside missing points: precise enough to distinguish in front from behind.
    Rough(f64),
    /// A depth, mm, between four blocks of one surface.
    Smooth(f64),
}

/// Inverse depths of blocks of pixels.
pub(super) struct Grid {
    /// Number of pixels along the side of a block.
    pub factor: usize,
    /// Number of blocks in a row of the grid.
    pub columns: usize,
    /// Number of rows of blocks.
    pub rows: usize,
    pub camera: PinholeCamera,
    /// For each block, the inverse depth in 1/mm; NaN if the block has no depth.
    inverse: Vec<f32>,
    /// Maximum difference between neighbouring blocks of one surface, as a fraction of their depth.
    step_share: f64,
}

impl Grid {
    /// Reduces a scan to a grid of blocks.
    pub fn from_scan(scan: &OrganizedCloud<Camera>, camera: &PinholeCamera) -> Grid {
        let points = scan.raw_points_mm();
        // A NaN is not greater than 0.
        Self::from_depths((scan.width(), scan.height()), camera, |index| {
            Some(points[index][2]).filter(|&z| z > 0.0)
        })
    }

    /// Creates a grid of blocks from the depths of the pixels, mm; `None` for a pixel that is excluded.
    pub fn from_depths(
        (width, height): (usize, usize),
        camera: &PinholeCamera,
        depth: impl Fn(usize) -> Option<f32> + Sync,
    ) -> Grid {
        let factor = ((width as f64 / APPROXIMATE_COLUMNS as f64).round() as usize).max(1);
        let (columns, rows) = ((width / factor).max(2), (height / factor).max(2));
        let block_rad = factor as f64 / camera.fx_px;
        let mut inverse = vec![f32::NAN; columns * rows];
        inverse.par_chunks_mut(columns).enumerate().for_each(|(row, line)| {
            let mut depths = Vec::with_capacity(factor * factor);
            for (column, block) in line.iter_mut().enumerate() {
                let first = row * factor * width + column * factor;
                depths.clear();
                for v in 0..factor.min(height - row * factor) {
                    depths.extend(
                        (0..factor.min(width - column * factor)).filter_map(|u| depth(first + v * width + u)),
                    );
                }
                *block = block_inverse(&mut depths, factor * factor, block_rad);
                if block.is_nan() && depths.len() >= min_agreeing_pixels(factor * factor) {
                    *block = slanted_inverse(factor, block_rad, |u, v| depth(first + v * width + u));
                }
            }
        });
        Grid { factor, columns, rows, camera: *camera, inverse, step_share: MAX_STEP_SIDES * block_rad }
    }

    /// Returns the pixel in the centre of a block.
    pub fn pixel(&self, column: usize, row: usize) -> Pixel {
        let centre = |index: usize| (index * self.factor) as f64 + (self.factor as f64 - 1.0) / 2.0;
        Pixel::at(centre(column), centre(row))
    }

    /// Converts a pixel to units of blocks.
    pub fn block_position(&self, pixel: Pixel) -> [f64; 2] {
        let block = |px: f64| (px - (self.factor as f64 - 1.0) / 2.0) / self.factor as f64;
        [block(pixel.u), block(pixel.v)]
    }

    /// Returns the depth of a block, mm.
    pub fn depth_mm(&self, index: usize) -> Option<f64> {
        let inverse = f64::from(self.inverse[index]);
        (!inverse.is_nan()).then(|| 1.0 / inverse)
    }

    /// Returns the scanned point of a block; it is on the ray through the centre of the block.
    pub fn point(&self, column: usize, row: usize) -> Option<Vector3<f64>> {
        let depth_mm = self.depth_mm(row * self.columns + column)?;
        let ray = self.camera.unproject::<Camera>(self.pixel(column, row))?;
        Some(ray.mm * depth_mm)
    }

    /// Returns whether two neighbouring blocks with these depths belong to one surface.
    pub fn are_joined(&self, a_mm: f64, b_mm: f64) -> bool {
        (a_mm - b_mm).abs() < self.step_share * a_mm
    }

    /// Returns the depth of the scan at a pixel.
    pub fn reading_at_pixel(&self, pixel: Pixel) -> DepthReading {
        self.reading_at(self.block_position(pixel))
    }

    /// Returns the depth of the scan at a position in units of blocks.
    pub fn reading_at(&self, [x, y]: [f64; 2]) -> DepthReading {
        let (across, down) = ((self.columns - 1) as f64, (self.rows - 1) as f64);
        if !(x >= -0.5 && y >= -0.5 && x <= across + 0.5 && y <= down + 0.5) {
            return DepthReading::OutOfView;
        }
        let (x, y) = (x.clamp(0.0, across - 1e-9), y.clamp(0.0, down - 1e-9));
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f64, y - j as f64);
        let at = j * self.columns + i;
        let corners = [at, at + 1, at + self.columns, at + self.columns + 1].map(|k| f64::from(self.inverse[k]));
        let (low, high) = corners.iter().fold((f64::MAX, f64::MIN), |(low, high), &c| (low.min(c), high.max(c)));
        if corners.iter().all(|c| !c.is_nan()) && high - low < self.step_share * high {
            let above = corners[0] + fx * (corners[1] - corners[0]);
            let below = corners[2] + fx * (corners[3] - corners[2]);
            return DepthReading::Smooth(1.0 / (above + fy * (below - above)));
        }
        // The nearest block that has a depth is used.
        let shares = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        let nearest = (0..4).filter(|&k| !corners[k].is_nan()).max_by(|&a, &b| shares[a].total_cmp(&shares[b]));
        nearest.map_or(DepthReading::Nothing, |k| DepthReading::Rough(1.0 / corners[k]))
    }
}

/// Returns the minimum number of pixels of a block that must agree.
fn min_agreeing_pixels(pixels: usize) -> usize {
    (MIN_AGREEING_FRACTION * pixels as f64).ceil().max(1.0) as usize
}

fn block_inverse(depths: &mut [f32], pixels: usize, block_rad: f64) -> f32 {
    let needed = min_agreeing_pixels(pixels);
    if depths.len() < needed {
        return f32::NAN;
    }
    let (low, high) = depths.iter().fold((f32::MAX, f32::MIN), |(low, high), &z| (low.min(z), high.max(z)));
    let side_mm = block_rad * f64::from(low);
    if f64::from(high - low) <= MAX_BLOCK_SPREAD_SIDES * side_mm {
        return mean_inverse(depths.iter().copied());
    }
    let Some(median) = median(depths) else { return f32::NAN };
    let reach = (MAX_MEDIAN_DEVIATION_SIDES * side_mm) as f32;
    let near = |z: &&f32| (**z - median).abs() <= reach;
    if depths.iter().filter(near).count() < needed {
        return f32::NAN;
    }
    mean_inverse(depths.iter().filter(near).copied())
}

/// Returns the inverse depth in the centre of a block on a steep plane. The slopes are the medians of the differences
/// between neighbouring pixels, so that neither a flying point nor an edge is treated as a plane.
fn slanted_inverse(factor: usize, block_rad: f64, depth: impl Fn(usize, usize) -> Option<f32>) -> f32 {
    let place = |k: usize| (k % factor, k / factor);
    let inverse: Vec<Option<f64>> =
        (0..factor * factor).map(|k| depth(place(k).0, place(k).1).map(|z| 1.0 / f64::from(z))).collect();
    let needed = min_agreeing_pixels(inverse.len());
    if factor < 2 || inverse.iter().flatten().count() < needed {
        return f32::NAN;
    }
    let slope = |step: usize, ends: &dyn Fn(usize) -> bool| {
        let pairs = (0..inverse.len()).filter(|&k| !ends(k));
        let mut slopes: Vec<f64> = pairs.filter_map(|k| Some(inverse[k + step]? - inverse[k]?)).collect();
        interpolated_median(&mut slopes)
    };
    let (Some(right), Some(down)) =
        (slope(1, &|k| place(k).0 + 1 == factor), slope(factor, &|k| place(k).1 + 1 == factor))
    else {
        return f32::NAN;
    };
    let middle = (factor as f64 - 1.0) / 2.0;
    let level = |(k, inverse): (usize, &Option<f64>)| {
        let (u, v) = place(k);
        inverse.map(|inverse| inverse - right * (u as f64 - middle) - down * (v as f64 - middle))
    };
    let levels: Vec<f64> = inverse.iter().enumerate().filter_map(level).collect();
    let Some(middle) = interpolated_median(&mut levels.clone()) else { return f32::NAN };
    // The slope is compared relative to the depth: dz / z = −z d(1/z).
    let steepest = factor as f64 * right.hypot(down) / middle;
    let near = |level: &&f64| (*level / middle - 1.0).abs() <= MAX_SLANTED_DEVIATION_SIDES * block_rad;
    let count = levels.iter().filter(near).count();
    if count < needed || steepest > MAX_STEP_SIDES * block_rad {
        return f32::NAN;
    }
    (levels.iter().filter(near).sum::<f64>() / count as f64) as f32
}

fn mean_inverse(depths: impl Iterator<Item = f32>) -> f32 {
    let (count, sum) = depths.fold((0usize, 0.0f64), |(count, sum), z| (count + 1, sum + 1.0 / f64::from(z)));
    (sum / count as f64) as f32
}

/// A rigid transform as rotation matrix and shift vector, without the types of its frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct MatrixTransform {
    pub turn: Matrix3<f64>,
    pub shift: Vector3<f64>,
}

impl MatrixTransform {
    pub fn from_rigid<To: panelprep_base::geometry::Frame, From: panelprep_base::geometry::Frame>(
        rigid: &Rigid<To, From>,
    ) -> MatrixTransform {
        MatrixTransform { turn: *rigid.rotation().matrix(), shift: rigid.origin().mm.coords }
    }

    pub fn point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.turn * point + self.shift
    }

    pub fn inverse(&self) -> MatrixTransform {
        let back = self.turn.transpose();
        MatrixTransform { turn: back, shift: -(back * self.shift) }
    }
}

/// Returns for each block whether it is in the search box.
pub(super) fn blocks_in_box(
    grid: &Grid,
    base_from_camera: &Rigid<Base, Camera>,
    low: [f64; 3],
    high: [f64; 3],
) -> Vec<bool> {
    let motion = MatrixTransform::from_rigid(base_from_camera);
    let mut inside = vec![false; grid.columns * grid.rows];
    inside.par_chunks_mut(grid.columns).enumerate().for_each(|(row, line)| {
        for (column, inside) in line.iter_mut().enumerate() {
            *inside = grid.point(column, row).is_some_and(|point| {
                let p = motion.point(&point);
                (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis]))
            });
        }
    });
    inside
}

/// Converts a vector to a point in the camera frame, mm.
pub(super) fn camera_point(point: &Vector3<f64>) -> Point<Camera> {
    Point::at(point.x, point.y, point.z)
}

/// Returns uniformly spread indices of a list: multiples of the golden section, which omit no rows.
pub(super) fn spread_indices(count: usize, wanted: usize) -> Vec<usize> {
    if wanted >= count {
        return (0..count).collect();
    }
    const GOLDEN_SECTION: f64 = 0.618_033_988_749_895;
    let mut places: Vec<usize> =
        (0..wanted).map(|k| ((k as f64 * GOLDEN_SECTION).fract() * count as f64) as usize).collect();
    places.sort_unstable();
    places.dedup();
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: PinholeCamera = PinholeCamera {
        width_px: 40,
        height_px: 30,
        fx_px: 100.0,
        fy_px: 100.0,
        cx_px: 19.5,
        cy_px: 14.5,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };

    /// Returns a scan of the plane z = 700 + x/2, with a block at 400 mm in front of its left part.
    fn scan() -> OrganizedCloud<Camera> {
        let point = |i: usize| {
            let (x, y) = ((i % 40) as f64 - 19.5, (i / 40) as f64 - 14.5);
            let z = if i % 40 < 8 { 400.0 } else { 700.0 / (1.0 - x / 200.0) };
            [(x / 100.0 * z) as f32, (y / 100.0 * z) as f32, z as f32]
        };
        OrganizedCloud::new(40, 30, (0..1_200).map(point).collect(), vec![[0; 3]; 1_200]).expect("counts agree")
    }

    /// Expected values, calculated by hand: pixel (25, 10) has x = 0.055; the plane is there at z = 700/(1 − 0.0275),
    /// also between blocks.
    #[test]
    fn a_plane_is_smooth_between_blocks_and_an_edge_is_rough() {
        let grid = Grid::from_scan(&scan(), &CAMERA);
        assert_eq!((grid.factor, grid.columns), (1, 40));
        let DepthReading::Smooth(depth_mm) = grid.reading_at_pixel(Pixel::at(25.25, 10.5)) else {
            panic!("a plane")
        };
        assert!((depth_mm - 700.0 / (1.0 - 5.75 / 200.0)).abs() < 1e-3, "{depth_mm}");
        assert!(
            matches!(grid.reading_at_pixel(Pixel::at(7.3, 10.0)), DepthReading::Rough(z) if (z - 400.0).abs() < 1e-3)
        );
        assert_eq!(grid.reading_at_pixel(Pixel::at(-0.6, 10.0)), DepthReading::OutOfView);
    }

    /// Expected values, calculated by hand: 15 of 16 pixels must agree. A single flying point is excluded; with five
    /// points of another depth, the block has no depth.
    #[test]
    fn a_block_on_an_edge_has_no_depth() {
        let block = |far: usize| {
            let mut depths: Vec<f32> = (0..16).map(|i| if i < far { 760.0 } else { 700.0 }).collect();
            block_inverse(&mut depths, 16, 4.0 / 1785.0)
        };
        assert!((1.0 / block(1) - 700.0).abs() < 1e-3 && block(5).is_nan());
        assert!(block_inverse(&mut [700.0; 14], 16, 4.0 / 1785.0).is_nan());
    }

    /// Expected values, calculated by hand: the side of the block is 4/1785 · 700 = 1.57 mm. A slope of 70° rises by
    /// 1.08 mm from pixel to pixel, so no two columns agree with one median. Its plane has 700 mm in the centre, also
    /// with a flying point. A slope of 75° rises by 1.46 mm and is too steep; a step of 3 mm between two columns is an
    /// edge.
    #[test]
    fn a_steep_plane_has_a_depth_and_a_step_has_none() {
        let rise = |per_pixel_mm: f64| {
            move |u: usize, v: usize| {
                let flies = (u, v) == (1, 2);
                Some(if flies { 730.0 } else { (700.0 + per_pixel_mm * (u as f64 - 1.5)) as f32 })
            }
        };
        let block = |depth: &dyn Fn(usize, usize) -> Option<f32>| slanted_inverse(4, 4.0 / 1785.0, depth);
        let mut depths: Vec<f32> = (0..16).filter_map(|k| rise(1.08)(k % 4, k / 4)).collect();
        assert!(block_inverse(&mut depths, 16, 4.0 / 1785.0).is_nan());
        assert!((1.0 / block(&rise(1.08)) - 700.0).abs() < 0.02, "{}", 1.0 / block(&rise(1.08)));
        assert!(block(&rise(1.46)).is_nan());
        assert!(block(&|u, _| Some(if u < 2 { 700.0 } else { 703.0 })).is_nan());
        assert!(block(&|u, v| (u + v > 0 && u + v < 6).then_some(700.0)).is_nan(), "14 of 16 are too few");
    }
}
