//! Test data: scans of analytic panels by a quarter-size 3D camera, and the `TaughtPanel` learnt from such a scan.

use nalgebra::{Isometry3, Vector3};
use panelprep_base::geometry::{Base, Camera, OrganizedCloud, PinholeCamera, Pixel, Point, Rigid};
use panelprep_cell::panel::TaughtPanel;
use panelprep_cell::recipe::Recipe;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// An analytic panel: a depth behind z = 700 mm in the camera's frame, which is also the panel's frame here.
#[derive(Debug, Clone, Copy)]
pub enum Shape {
    /// A tilted plane.
    Plane,
    /// A cylinder with its axis along y and a radius of 400 mm, convex towards the camera.
    Cylinder,
    /// A sphere with a radius of 600 mm, concave towards the camera.
    Sphere,
    /// A saddle, convex along x and concave along y.
    Saddle,
}

/// All shapes of analytic panels.
pub const SHAPES: [Shape; 4] = [Shape::Plane, Shape::Cylinder, Shape::Sphere, Shape::Saddle];

impl Shape {
    /// Returns the z coordinate of the panel at (x, y), mm, and its slopes.
    pub fn height(self, x: f64, y: f64) -> (f64, [f64; 2]) {
        match self {
            Shape::Plane => (700.0 + 0.2 * x - 0.1 * y, [0.2, -0.1]),
            Shape::Cylinder => {
                let rise = (400.0f64.powi(2) - x * x).sqrt();
                (1_100.0 - rise, [x / rise, 0.0])
            }
            Shape::Sphere => {
                let rise = (600.0f64.powi(2) - x * x - y * y).sqrt();
                (100.0 + rise, [-x / rise, -y / rise])
            }
            Shape::Saddle => (700.0 + (x * x - y * y) / 1_500.0, [2.0 * x / 1_500.0, -2.0 * y / 1_500.0]),
        }
    }

    /// Returns the normal that points to the camera.
    pub fn normal(self, at: Point<panelprep_base::geometry::Panel>) -> Vector3<f64> {
        let (_, [dx, dy]) = self.height(at.mm.x, at.mm.y);
        Vector3::new(dx, dy, -1.0).normalize()
    }

    /// Returns the signed distance of a point in front of the surface, to first order, mm.
    pub fn distance_mm(self, at: Point<panelprep_base::geometry::Panel>) -> f64 {
        let (z, [dx, dy]) = self.height(at.mm.x, at.mm.y);
        (z - at.mm.z) / (1.0 + dx * dx + dy * dy).sqrt()
    }
}

/// The simulated defects of a scan.
#[derive(Debug, Clone, Copy, Default)]
pub struct ScanDefects {
    /// White range noise, mm.
    pub noise_mm: f64,
    /// Fraction of points with an error of up to 2 mm.
    pub flying: f64,
    /// Fraction of points that are missing.
    pub missing: f64,
    /// Half-width of a square hole in the grid r2c2, px.
    pub hole_px: f64,
    /// Half-width of a band in the picture's middle in which the points are in reverse order, as in the scan of a fold,
    /// px.
    pub fold_px: f64,
}

/// The lens of a quarter-size 3D camera.
pub const LENS: PinholeCamera = PinholeCamera {
    width_px: 486,
    height_px: 300,
    fx_px: 446.0,
    fy_px: 446.0,
    cx_px: 243.0,
    cy_px: 150.0,
    k1: -0.05,
    k2: 0.02,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
};

/// Returns the recipe of the scene: region corners at (±140, ±84) mm, 3 rows and 5 columns, and the additional lines
/// `more`.
pub fn recipe(shape: Shape, more: &str) -> Recipe {
    let corner = |x: f64, y: f64| {
        let pixel = LENS.project(Point::<Camera>::at(x, y, shape.height(x, y).0)).expect("in front");
        format!("[{}, {}]", pixel.u, pixel.v)
    };
    let corners = [corner(-140.0, -84.0), corner(140.0, -84.0), corner(140.0, 84.0), corner(-140.0, 84.0)];
    let text = format!(
        "panel = \"p\"\n[region]\ncorners_px = [{}]\nrows = 3\ncolumns = 5\n\
         [locate]\nbox_min_mm = [-400, -400, 300]\nbox_max_mm = [400, 400, 1200]\n{more}",
        corners.join(", ")
    );
    Recipe::check("test.toml", &text).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns the taught panel |x| ≤ 170, |y| ≤ 105 mm as the camera measures it.
pub fn taught(shape: Shape, spoil: ScanDefects, recipe: &Recipe) -> TaughtPanel {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let mut normal = move || {
        let [a, b] = [0, 1].map(|_| random.random::<f64>());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let mut random = Pcg64Mcg::seed_from_u64(8);
    let mut point = |index: usize| {
        let pixel = Pixel::at((index % LENS.width_px) as f64, (index / LENS.width_px) as f64);
        let [flying, missing, how_far] = [0, 1, 2].map(|_| random.random::<f64>());
        let noise = normal() * spoil.noise_mm + if flying < spoil.flying { 4.0 * how_far - 2.0 } else { 0.0 };
        let in_hole = (pixel.u - 207.0).abs() < spoil.hole_px && (pixel.v - 150.0).abs() < spoil.hole_px;
        let ray = LENS.unproject::<Camera>(fold_pixel(pixel, spoil.fold_px)).expect("inside").mm;
        let depth = depth(shape, ray).filter(|_| missing >= spoil.missing && !in_hole);
        depth.map_or([f32::NAN; 3], |depth| {
            let seen = ray * depth + ray.normalize() * noise;
            [seen.x as f32, seen.y as f32, seen.z as f32]
        })
    };
    let count = LENS.width_px * LENS.height_px;
    let points = (0..count).map(&mut point).collect();
    let cloud = OrganizedCloud::new(LENS.width_px, LENS.height_px, points, vec![[80; 3]; count]).expect("counts");
    let base_from_camera: Rigid<Base, Camera> = Rigid::from_isometry_unchecked(Isometry3::identity());
    TaughtPanel::learn(&cloud, LENS, base_from_camera, recipe).unwrap_or_else(|e| panic!("{e}"))
}

// Returns the point that a pixel shows if the surface is folded. In the band the points run backwards by half a pixel
// per pixel, and on both sides of the band forwards again, so that adjacent points are never far from each other.
fn fold_pixel(pixel: Pixel, fold_px: f64) -> Pixel {
    let from_middle = pixel.u - LENS.cx_px;
    let (size, side) = (from_middle.abs(), from_middle.signum());
    let shown = match size {
        _ if size < fold_px => -0.5 * size,
        _ if size < 3.0 * fold_px => 1.75 * (size - fold_px) - 0.5 * fold_px,
        _ => size,
    };
    Pixel::at(LENS.cx_px + side * shown, pixel.v)
}

// Returns the depth of the panel along a ray, by Newton's method.
fn depth(shape: Shape, ray: Vector3<f64>) -> Option<f64> {
    let mut depth = 700.0;
    for _ in 0..50 {
        let (z, [dx, dy]) = shape.height(ray.x * depth, ray.y * depth);
        depth -= (depth - z) / (1.0 - dx * ray.x - dy * ray.y);
    }
    (depth.is_finite() && (ray.x * depth).abs() <= 170.0 && (ray.y * depth).abs() <= 105.0).then_some(depth)
}
