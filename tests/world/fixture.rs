//! The cell of the simulated world: its file, its recipe, the taught panel, and the store with which all worlds begin.

use panelprep::cell::{self, LensExtent};
use panelprep::cycle;
use panelprep::geometry::{Camera, KukaPose, OrganizedCloud};
use panelprep::locate::corner;
use panelprep::panel::{CornerTeaching, TaughtCorner, TaughtPanel, panel_from_base_at_teaching};
use panelprep::recipe::Recipe;
use panelprep::setup::{Calibrations, CellSetup, CycleSetup, PreparedCycle};
use panelprep::sim::{self, CellTruth, CornerView, PanelPosition, SEARCH_BOX_MM, Scene};
use panelprep::store::{CycleStart, Store};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Factor by which pictures are smaller in each direction: the largest reduction in the tests of the renderer.
const REDUCTION: usize = 8;
/// Random seed of the simulated cell.
const CELL_SEED: u64 = 3;

/// Minimum difference of a point from the empty cell, mm, for which it is treated as a point of the panel; below it,
/// the number of pixels around it that are kept.
const MIN_DIFFERENCE_MM: f64 = 2.0;
const AROUND_PX: usize = 4;

/// Name of the file that reserves disk space and contains no data.
const RESERVE: &str = "panelprep.reserve";
const RESERVE_BYTES: u64 = 32 << 20;

const CELL: &str = "[poses]\npark = { a1_deg = -120, a2_deg = -75, a3_deg = 110, a4_deg = 0, a5_deg = 55, a6_deg = 90 }\n\
     ready = { a1_deg = 0, a2_deg = -120, a3_deg = 145, a4_deg = 0, a5_deg = -25, a6_deg = 90 }\n\
     [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
     [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\nlight_on = 5\n\
     [limits]\nbox_min_mm = [100, -450, 50]\nbox_max_mm = [700, 450, 900]\nmax_tilt_deg = 60\nmax_speed_mm_s = 500\n";

/// The data that every world shares.
pub struct Fixture {
    /// The cell's file.
    pub cell: cell::Cell,
    /// The constant data of the cell for the loop.
    pub setup: Arc<CellSetup>,
    /// A cycle's share.
    pub cycle: CycleSetup,
    /// The simulated cells with their ground truth, one for each scene.
    scenes: [sim::Cell; 3],
    truth: CellTruth,
    /// The files of a new store, with paths relative to its folder.
    store: Vec<(PathBuf, Vec<u8>)>,
}

/// The contents of the cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum CellContents {
    /// The taught panel with greasy places.
    Greasy,
    /// The taught panel without grease.
    Clean,
    /// There is no panel.
    Nothing,
    /// The taught panel with grease that no disc removes.
    Stubborn,
}

impl CellContents {
    /// Returns the contents with the same appearance before any work.
    pub fn with_initial_appearance(self) -> Self {
        if self == CellContents::Stubborn { CellContents::Greasy } else { self }
    }
}

impl Fixture {
    /// Returns the fixture that all worlds of this process share.
    pub fn shared() -> &'static Fixture {
        static FIXTURE: OnceLock<Fixture> = OnceLock::new();
        FIXTURE.get_or_init(Fixture::new)
    }

    fn new() -> Self {
        let scene = |scene| sim::Cell::new(CELL_SEED, scene, REDUCTION);
        let scenes = [Scene::Good, Scene::Clean, Scene::NoPanel].map(scene);
        let cell = cell::Cell::check("cell.toml", CELL).unwrap_or_else(|error| panic!("{error}"));
        let recipe = recipe(&scenes[0]);
        let setup = Arc::new(CellSetup::new(&cell).expect("a whole cell"));
        let taught = taught(&scenes[0], &scenes[2], &recipe);
        let cycle =
            CycleSetup::new(setup.clone(), recipe, taught, (calibrations(&scenes[0]), LensExtent::default()))
                .expect("a corner");
        // Otherwise the loop would prepare the model in a separate thread, which never gets processor time if the pool
        // has only this thread.
        assert!(cycle.taught_model().is_ok(), "the taught panel can be located");
        let at = folder("template");
        // Removes the folder that an earlier process with the same process ID may have left.
        let _ = std::fs::remove_dir_all(&at);
        drop(Store::create(&at).expect("a new store"));
        let store = files(&at, &at);
        std::fs::remove_dir_all(&at).expect("a folder of this process");
        let truth = scenes[0].truth();
        Fixture { cell, setup, cycle, scenes, truth, store }
    }

    /// Returns the simulated cell with these contents.
    pub fn scene(&self, stands: CellContents) -> &sim::Cell {
        &self.scenes[stands.with_initial_appearance() as usize]
    }

    /// Returns a scan of these contents by the 3D camera.
    pub fn scan(&self, stands: CellContents) -> OrganizedCloud<Camera> {
        let empty = self.scene(CellContents::Nothing).scan();
        cropped(&self.scene(stands).scan(), &self.scene(CellContents::Greasy).scan(), &empty)
    }

    /// Returns the ground truth of the taught panel in the cell.
    pub fn truth(&self) -> &CellTruth {
        &self.truth
    }

    /// Returns a cycle that is ready to begin.
    pub fn prepared(&self) -> PreparedCycle {
        let start = CycleStart {
            panel: self.cycle.panel_name().to_owned(),
            taught_version: "1".to_owned(),
            recipe_text: "the recipe of the simulated world".to_owned(),
            file_texts: Vec::new(),
            recording: None,
            is_air_run: false,
        };
        let request = cycle::Request::Start { max_passes: 2, max_moves: 3, dries: false };
        PreparedCycle { request, setup: self.cycle.clone(), start, recording: None, remarks: vec![] }
    }

    /// Writes a new store into this folder. The reserve file has its length but no blocks, because a world's disk
    /// becomes full only by an injected fault.
    pub fn put_store(&self, to: &Path) {
        std::fs::create_dir_all(to.join("blobs")).expect("a folder");
        for (name, bytes) in &self.store {
            std::fs::write(to.join(name), bytes).expect("a file");
        }
        let reserve = std::fs::File::create(to.join(RESERVE));
        reserve.and_then(|file| file.set_len(RESERVE_BYTES)).expect("a sparse file");
    }
}

/// Returns the files of a folder and its subfolders, except the reserve.
fn files(root: &Path, folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(files(root, &path));
        } else if !path.ends_with(RESERVE) {
            let name = path.strip_prefix(root).expect("in the root").to_owned();
            found.push((name, std::fs::read(&path).expect("a file")));
        }
    }
    found
}

/// Returns a folder for this process, in memory if the system has a file system in memory.
pub fn folder(name: &str) -> PathBuf {
    let memory = Path::new("/dev/shm");
    let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    parent.join(format!("panelprep-world-{}", std::process::id())).join(name)
}

/// Returns a recipe with short times and wide tolerances, within the limits of a recipe.
fn recipe(sim: &sim::Cell) -> Recipe {
    let region = sim.region();
    let text = format!(
        "panel = \"p\"\n[process]\nobservation_s = 5.0\nframes_per_second = 1.0\nrinse_s = 0.5\nspray_s = 3.5\n\
         drain_s = 1.0\nlight_settle_s = 0.6\nmax_passes_per_grid = 10\n\
         [corner]\nwhich = [\"top-left\", \"bottom-right\"]\nsettled_mm = 0.3\n\
         [region]\ncorners_px = {:?}\nrows = 2\ncolumns = 3\n[locate]\nbox_min_mm = {:?}\nbox_max_mm = {:?}\n\
         [inspect]\nmin_break_mm2 = 300.0\n[surface]\ncontrol_spacing_mm = 35.0\n\
         [path]\nfeed_mm_s = 120.0\nacceleration_mm_s2 = 1000\nstep_over_mm = 20\nwaypoint_spacing_mm = 25\n\
         disc_diameter_mm = 50\nmax_dwell_ratio = 20\nchord_error_mm = 1.0\n",
        region.corners_px.map(|px| [px.u, px.v]),
        SEARCH_BOX_MM[0],
        SEARCH_BOX_MM[1]
    );
    Recipe::check("world.toml", &text).unwrap_or_else(|error| panic!("{error}"))
}

fn taught(sim: &sim::Cell, empty: &sim::Cell, recipe: &Recipe) -> (TaughtPanel, Vec<TaughtCorner>) {
    let base_from_camera = sim.calibrated_base_from_camera();
    let scan = cropped(&sim.taught_scan(), &sim.taught_scan(), &empty.scan());
    let panel = TaughtPanel::learn(&scan, *sim.scanner(), base_from_camera, recipe).expect("a panel");
    let camera = sim.flange_camera();
    let teach = |(index, view): (usize, CornerView)| {
        let picture = sim.flange_picture(&view.base_from_flange, PanelPosition::Nominal).to_gray();
        let panel_from_camera =
            panel_from_base_at_teaching() * view.base_from_flange * sim.calibrated_flange_from_camera();
        let depth_mm = (panel_from_camera.inverse() * view.corner).mm.z;
        let (settings, px_per_mm) = (recipe.corner(), camera.px_per_mm_at(depth_mm).0);
        let found =
            corner::find(&picture, settings, settings.which().for_picture(index), px_per_mm).expect("a corner");
        let teaching = CornerTeaching { reference_px: found.corner_px, panel_from_camera };
        panel.corner(teaching, camera).expect("on the panel")
    };
    let corners = sim.corner_views().into_iter().enumerate().map(teach).collect();
    (panel, corners)
}

/// Returns the scan without points far from a panel, because the arm keeps its distance from every scanned point, and
/// checking each point of the fixture would take longer than everything else in a world. The points of the panel are
/// those in which `with` differs from the empty cell.
fn cropped(
    scan: &OrganizedCloud<Camera>,
    with: &OrganizedCloud<Camera>,
    empty: &OrganizedCloud<Camera>,
) -> OrganizedCloud<Camera> {
    let (width, height) = (scan.width(), scan.height());
    let differs = |column: usize, row: usize| {
        let z = |cloud: &OrganizedCloud<Camera>| cloud.point(column, row).map(|point| point.mm.z);
        match (z(with), z(empty)) {
            (Some(with), Some(empty)) => (with - empty).abs() > MIN_DIFFERENCE_MM,
            (with, empty) => with.is_some() != empty.is_some(),
        }
    };
    let is_near = |index: usize| {
        let (column, row) = (index % width, index / width);
        let rows = row.saturating_sub(AROUND_PX)..(row + AROUND_PX + 1).min(height);
        let columns = column.saturating_sub(AROUND_PX)..(column + AROUND_PX + 1).min(width);
        rows.into_iter().any(|row| columns.clone().any(|column| differs(column, row)))
    };
    let points = scan.raw_points_mm().iter().enumerate();
    let kept = points.map(|(index, xyz)| if is_near(index) { *xyz } else { [f32::NAN; 3] }).collect();
    let colors = (0..width * height).map(|index| scan.color_at(index)).collect();
    OrganizedCloud::new(width, height, kept, colors).expect("the same size")
}

fn calibrations(sim: &sim::Cell) -> Calibrations {
    Calibrations {
        scan_errors: panelprep::locate::ScanErrors::default(),
        scanner: *sim.scanner(),
        base_from_camera: sim.calibrated_base_from_camera(),
        flange_camera: *sim.flange_camera(),
        flange_from_camera: sim.calibrated_flange_from_camera(),
        flange_from_tool: KukaPose { z_mm: 160.0, ..KukaPose::default() }.to_rigid(),
        hand_eye_mm: None,
        robot_mm: None,
        removal: None,
    }
}
