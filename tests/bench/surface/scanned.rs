//! A full-size scan of the simulated panel, taught with 48 grids, in a vertical or another attitude.

use nalgebra::{Isometry3, Rotation3, Translation3, Vector3};
use panelprep::geometry::{Base, Camera, OrganizedCloud, Rigid};
use panelprep::panel::TaughtPanel;
use panelprep::recipe::Recipe;
use panelprep::sim::{Cell, SEARCH_BOX_MM, Scene, scanner_noise};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Number of rows and columns of grids.
const GRIDS: [usize; 2] = [6, 8];
/// Minimum distance from the panel at which a point does not belong to its surface, mm.
const OFF_PANEL_MM: f64 = 3.0;
/// Distance for which the white noise is stated, mm.
const WHITE_NOISE_DISTANCE_MM: f64 = 700.0;

pub struct Scanned {
    pub cell: Cell,
    pub recipe: Recipe,
    pub panel: TaughtPanel,
    pub turn: Rotation3<f64>,
}

impl Scanned {
    /// Scans the panel with all noise of the simulated camera, with the cell rotated by roll, pitch and yaw, rad, about
    /// the base.
    pub fn turned(seed: u64, [roll, pitch, yaw]: [f64; 3]) -> Self {
        let cell = Cell::new(seed, Scene::Good, 1);
        let scan = cell.taught_scan();
        Self::learnt(cell, &scan, Rotation3::from_euler_angles(roll, pitch, yaw))
    }

    /// Creates the same panel, upright.
    pub fn upright(seed: u64) -> Self {
        Self::turned(seed, [0.0; 3])
    }

    /// Scans the vertical panel with only white noise: each point is moved along its ray onto the true surface and then
    /// by the simulator's white noise.
    pub fn white(seed: u64) -> Self {
        let cell = Cell::new(seed, Scene::Good, 1);
        let scan = white(&cell, &cell.taught_scan());
        Self::learnt(cell, &scan, Rotation3::identity())
    }

    fn learnt(cell: Cell, scan: &OrganizedCloud<Camera>, turn: Rotation3<f64>) -> Self {
        let recipe = recipe(&cell, &turn, "");
        let turned: Rigid<Base, Base> =
            Rigid::from_isometry_unchecked(Isometry3::from_parts(Translation3::identity(), turn.into()));
        let base_from_camera = turned * cell.truth().base_from_camera;
        let panel = TaughtPanel::learn(scan, *cell.scanner(), base_from_camera, &recipe).expect("a panel");
        Scanned { cell, recipe, panel, turn }
    }

    /// Returns the recipe of the same panel with the additional lines `more`.
    pub fn recipe_with(&self, more: &str) -> Recipe {
        recipe(&self.cell, &self.turn, more)
    }

    /// Returns the simulator's white noise along the normal, rms over the region's points, mm.
    pub fn white_mm(&self) -> f64 {
        let scan = &self.panel.scan;
        let panel_from_camera = self.panel.panel_from_camera;
        let depths = scan.valid_points().filter(|(index, _)| {
            let (column, row) = (index % scan.width(), index / scan.width());
            self.panel.mask.contains(column, row)
        });
        let (sum, count) = depths.fold((0.0, 0_usize), |(sum, count), (_, point)| {
            let depth_mm = (panel_from_camera.inverse() * point).mm.z;
            let sigma = scanner_noise().range_white_mm * (depth_mm / WHITE_NOISE_DISTANCE_MM).powi(2);
            (sum + sigma * sigma, count + 1)
        });
        (sum / count.max(1) as f64).sqrt()
    }
}

fn recipe(cell: &Cell, turn: &Rotation3<f64>, more: &str) -> Recipe {
    let corners = cell.region().corners_px.map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = SEARCH_BOX_MM.map(|corner| turn * Vector3::from(corner));
    let (low, high) = (low.inf(&high), low.sup(&high));
    let text = format!(
        "panel = \"simulated\"\n[locate]\nbox_min_mm = {:?}\nbox_max_mm = {:?}\n\
         [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n{more}",
        low.as_slice(),
        high.as_slice(),
        GRIDS[0],
        GRIDS[1]
    );
    Recipe::check("bench.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

fn white(cell: &Cell, scan: &OrganizedCloud<Camera>) -> OrganizedCloud<Camera> {
    let (truth, mut random) = (cell.truth(), Pcg64Mcg::seed_from_u64(5));
    let mut normal = || {
        let [a, b] = [0, 1].map(|_| random.random::<f64>());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    // At the panel's nominal pose, its frame coincides with the base frame.
    let panel_from_camera =
        Rigid::<panelprep::geometry::Panel, Camera>::from_isometry_unchecked(*truth.base_from_camera.isometry());
    let point = |index: usize| {
        let Some(seen) = scan.point_at(index) else { return [f32::NAN; 3] };
        if truth.distance_mm(panel_from_camera * seen).abs() > OFF_PANEL_MM {
            return seen.mm.coords.map(|mm| mm as f32).into();
        }
        let (ray, mut along_mm) = (seen.mm.coords.normalize(), seen.mm.coords.norm());
        let mut cosine = 1.0;
        for _ in 0..3 {
            let on_panel = panel_from_camera * panelprep::geometry::Point::<Camera>::new((ray * along_mm).into());
            let outward = panel_from_camera.rotation().inverse() * truth.normal(on_panel).mm;
            cosine = -ray.dot(&outward);
            along_mm += truth.distance_mm(on_panel) / cosine;
        }
        let depth_mm = along_mm * ray.z;
        let sigma = scanner_noise().range_white_mm * (depth_mm / WHITE_NOISE_DISTANCE_MM).powi(2) / cosine;
        (ray * (along_mm + sigma * normal())).map(|mm| mm as f32).into()
    };
    let (width, height) = (scan.width(), scan.height());
    let points = (0..width * height).map(point).collect();
    let colors = (0..width * height).map(|index| scan.color_at(index)).collect();
    OrganizedCloud::new(width, height, points, colors).expect("one point and one colour a pixel")
}
