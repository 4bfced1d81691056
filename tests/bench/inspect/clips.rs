//! Clips of the simulator with all effects that make a film difficult to evaluate, and the results of the water-break
//! test on these clips.

use crate::conditions::Conditions;
use crate::goal::Figure;
use crate::tally::{Clip, Figures, Tally, Truth, contrast_to_noise};
use panelprep::geometry::{Camera, ColorPicture, Mask, Panel, Point, Rigid, Vector};
use panelprep::inspect::{CellDemands, Demands, FilmView, FilmWatch, Footprint, Inspection};
use panelprep::panel::{GridId, TaughtPanel};
use panelprep::phase::Phase;
use panelprep::recipe::Recipe;
use panelprep::sim::{
    self, Cell, Film, FilmSpec, Grease, GreasySpot, Sanding, SandingStrength, Scene, SpotKind, WET_FROM_S,
};
use std::time::Instant;

/// The frame rate that the recipes of all clips require.
pub const FRAMES_PER_SECOND: f64 = 5.0;
/// Standard deviation of the simulator's pixel noise, grey levels.
const NOISE_LEVELS: f64 = 2.0;

/// Margin by which the declared sanded area extends beyond the true sanded area, mm.
pub const SANDED_MARGIN_MM: f64 = 3.0;

/// The part of the bench that is selected by the arguments.
#[derive(Debug, Clone)]
pub struct Extent {
    pub seeds: std::ops::RangeInclusive<u64>,
    pub reduction: usize,
    pub observed_s: f64,
    /// The kind of the clips that are run; `None` for all kinds.
    pub kind: Option<String>,
}

/// A cell with a panel that was taught and then displaced.
pub struct Bench {
    pub cell: Cell,
    pub taught: TaughtPanel,
    pub camera_from_panel: Rigid<Camera, Panel>,
    pub recipe: Recipe,
}

impl Bench {
    pub fn new(seed: u64, reduction: usize, inspect: &str) -> Self {
        let cell = Cell::new(seed, Scene::Clean, reduction);
        let recipe = recipe(&cell, inspect);
        let truth = cell.truth();
        let taught = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), truth.base_from_camera, &recipe)
            .expect("a panel to learn");
        let camera_from_panel = truth.base_from_camera.inverse() * truth.base_from_panel;
        Bench { cell, taught, camera_from_panel, recipe }
    }

    pub fn demands(&self, observation_s: f64) -> Demands {
        let settings = self.recipe.inspect();
        // The limit is at least the smallest break that pixels of this size show reliably, also on a displaced panel.
        let limit_mm2 = Footprint::taught_detection_limit_mm2(&self.taught, settings).expect("in view");
        Demands {
            observation_s,
            frames_per_second: FRAMES_PER_SECOND,
            min_break_mm2: (1.2 * limit_mm2).max(5.0),
            persist_s: settings.persist_s(),
            cell_demands: CellDemands::default(),
        }
    }

    pub fn watch(&self, observation_s: f64, sanded: Option<&Mask>) -> FilmWatch {
        let demands = self.demands(observation_s);
        let (taught, camera_from_panel) = (&self.taught, self.camera_from_panel);
        let view = FilmView { taught, camera: self.cell.scanner(), camera_from_panel, sanded };
        FilmWatch::new(&view, self.recipe.inspect(), demands).expect("in view")
    }

    /// Returns the sanding of the panel after these grids were sanded, pass by pass.
    fn sanded(&self, conditions: &Conditions) -> Sanding {
        let mut sanding = Sanding::default();
        for pass in &conditions.sanded {
            let areas: Vec<[Point<Panel>; 4]> =
                pass.iter().map(|id| self.widened(*id, conditions.beyond_mm)).collect();
            self.cell.sand_areas(&mut sanding, &areas, SandingStrength::EXTREME);
        }
        sanding
    }

    /// Returns the corners of a grid, moved outwards by this distance, mm.
    fn widened(&self, id: GridId, by_mm: f64) -> [Point<Panel>; 4] {
        let grid = self.taught.grids.iter().find(|grid| grid.id == id).expect("a grid of the region");
        let middle = grid.corners.iter().map(|corner| corner.mm.coords).sum::<nalgebra::Vector3<f64>>() / 4.0;
        grid.corners.map(|corner| {
            let away = corner.mm.coords - middle;
            corner + Vector::new(away.normalize() * by_mm * 2.0_f64.sqrt())
        })
    }
}

fn recipe(cell: &Cell, inspect: &str) -> Recipe {
    let region = cell.region();
    let corners = region.corners_px.map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = sim::SEARCH_BOX_MM;
    let text = format!(
        "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
         [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n[inspect]\n{inspect}\n",
        region.rows, region.columns,
    );
    Recipe::check("bench.toml", &text).expect("a valid recipe")
}

pub fn phase(film: &Film, time_s: f64) -> Phase {
    match film.phase(time_s) {
        sim::Phase::Dry => Phase::Dry,
        sim::Phase::Spray => Phase::Spray,
        sim::Phase::Wet => Phase::Wet,
    }
}

/// Returns the times of a clip's pictures without special conditions, s from the start of the film.
pub fn times_s(demands: &Demands) -> Vec<f64> {
    Conditions::plain(FRAMES_PER_SECOND).times_s(WET_FROM_S + demands.filmed_s())
}

/// The contents of a clip.
struct Kind {
    name: &'static str,
    spec: FilmSpec,
    grease: Option<Grease>,
}

fn kind(seed: u64, extent: &Extent) -> Kind {
    const SHARES: [f64; 8] = [0.01, 0.03, 0.07, 0.15, 0.3, 0.5, 0.8, 1.0];
    let mixed = |count| Grease::Mixed { count, until_s: WET_FROM_S + 0.85 * extent.observed_s };
    let spray = |share| Grease::Share { share, kind: SpotKind::UnderSpray };
    let hard = FilmSpec {
        shadow_at_s: WET_FROM_S + (seed % 7) as f64 / 7.0 * extent.observed_s,
        ..FilmSpec::hardest(seed)
    };
    match seed % 8 {
        0..4 => Kind { name: "mixed", spec: hard, grease: Some(mixed(2 + (seed / 8 % 5) as usize)) },
        4 => Kind { name: "usual", spec: FilmSpec::TYPICAL_FILM, grease: Some(mixed(4)) },
        5 => Kind { name: "spray", spec: hard, grease: Some(spray(SHARES[(seed / 8 % 8) as usize])) },
        6 if seed % 16 == 6 => Kind { name: "clean", spec: FilmSpec::TYPICAL_FILM, grease: None },
        _ => Kind { name: "clean", spec: hard, grease: None },
    }
}

pub fn run(extent: &Extent) {
    let mut tally = Tally::default();
    println!("renderer seed kind fps sanded verdict IoU | grids: failed passed not seen | reasons");
    let asked = |seed: &u64| extent.kind.as_ref().is_none_or(|name| kind(*seed, extent).name == name);
    for seed in extent.seeds.clone().filter(asked) {
        one(seed, extent, &mut tally);
    }
    tally.print("the simulator's clips");
    tally.report(&Figures {
        passed: Figure("film: failed grids that passed"),
        failed: Figure("film: clean grids that failed"),
        not_seen: Some(Figure("film: clean grids not seen")),
        iou: Some(Figure("film: intersection over union, from 10 times the noise on")),
        time: Some(Figure("film: time to break within 0.5 s, from 10 mm² on")),
    });
}

fn one(seed: u64, extent: &Extent, tally: &mut Tally) {
    let bench = Bench::new(seed, extent.reduction, &std::env::var("INSPECT").unwrap_or_default());
    let Kind { name, spec, grease } = kind(seed, extent);
    let conditions = Conditions::new(seed, &bench.taught.grids.iter().map(|grid| grid.id).collect::<Vec<_>>());
    let spots: Vec<GreasySpot> =
        grease.iter().flat_map(|grease| bench.cell.with_other_grease(grease, seed)).collect();
    let sanding = bench.sanded(&conditions);
    let film = bench.cell.sanded_film_with_spec((&spots, &spots), &sanding, &spec, seed);
    let demands = bench.demands(extent.observed_s);
    // The path of the disc gives the sanded area to within a few millimetres.
    let declared = bench.cell.sanded_taught_pixels(&sanding, SANDED_MARGIN_MM);
    let mut watch = bench.watch(extent.observed_s, Some(&declared));
    let before = bench.cell.film_with_spec(&spots, &spec, seed);
    watch.push(&before.picture(0.0), 0.0, Phase::Dry).expect("the first");
    let mut last = None;
    for time_s in conditions.times_s(WET_FROM_S + demands.filmed_s()) {
        let phase = phase(&film, time_s);
        if phase == Phase::Dry {
            continue;
        }
        let picture = film.picture(time_s);
        let begun = Instant::now();
        watch.push(&picture, time_s, phase).expect("in order");
        if time_s >= WET_FROM_S + 1.0 {
            tally.judged_in(begun.elapsed());
        }
        last = Some((picture, time_s));
    }
    let (picture, last_s) = last.expect("pictures");
    let inspection = watch.finish().expect("wet pictures");
    let wet_from_s = last_s - inspection.observation.observed_s;
    let broken = film.broken_pixels(last_s.min(wet_from_s + extent.observed_s));
    if let Ok(folder) = std::env::var("PICTURES") {
        save(&folder, &format!("clip{seed:04}"), &picture, &inspection, &broken);
    }
    let looks = film.dry_and_wet_levels();
    let contrast: Vec<f64> = looks.into_iter().map(|looks| contrast_to_noise(looks, |_| NOISE_LEVELS)).collect();
    let truth = Truth { broken: &broken, later: &film.broken_pixels(last_s), contrast: &contrast };
    let sanded = bench.taught.grids.iter().filter(|grid| conditions.passes_of(grid.id) > 0).count();
    let clip = Clip { renderer: "sim", seed, kind: name, frames_per_second: conditions.frames_per_second, sanded };
    tally.add(&clip, &inspection, &truth, |id| conditions.passes_of(id) > 0);
    let true_s = film.break_times_s();
    tally.times(&inspection, &broken, |index| f64::from(true_s[index]) - wet_from_s);
}

/// Saves the last picture with the found and the true breaks: green both, orange only found, blue only true, yellow not
/// seen.
pub fn save(folder: &str, name: &str, picture: &ColorPicture, inspection: &Inspection, truth: &Mask) {
    let mut drawn = picture.clone();
    let (found, region, not_seen) = (inspection.mask(), inspection.footprint.region(), inspection.unseen_pixels());
    for index in (0..drawn.rgb.len()).filter(|&index| region.inside[index]) {
        match (found.inside[index], truth.inside[index]) {
            (true, true) => drawn.rgb[index] = [0, 158, 115],
            (true, false) => drawn.rgb[index] = [230, 159, 0],
            (false, true) => drawn.rgb[index] = [86, 180, 233],
            _ if not_seen.inside[index] => drawn.rgb[index] = [240, 228, 66],
            _ => {}
        }
    }
    for (suffix, picture) in [("", &drawn), ("_plain", picture)] {
        let png = panelprep::files::write_color_png(picture).expect("a picture");
        std::fs::write(format!("{folder}/{name}{suffix}.png"), png).expect("a folder");
    }
}
