//! Rendered clips with all that makes a film hard to read, and what the test says of them.

use crate::tally::Tally;
use panelprep::geometry::{Camera, ColorPicture, Mask, Panel, Rigid};
use panelprep::inspect::{ByCell, Demands, Footprint, Inspection, Watch, score, score_within};
use panelprep::panel::TaughtPanel;
use panelprep::phase::Phase;
use panelprep::recipe::Recipe;
use panelprep::sim::{self, Cell, Film, FilmSpec, Grease, Scene, Spot, SpotKind, WET_FROM_S};
use panelprep::verdict::Verdict;

pub const FRAMES_PER_SECOND: f64 = 5.0;

/// What a bench is run with.
#[derive(Debug, Clone)]
pub struct Extent {
    pub seeds: std::ops::RangeInclusive<u64>,
    pub reduction: usize,
    pub observed_s: f64,
    /// Clips of this kind alone.
    pub kind: Option<String>,
}

/// A panel that was taught and stands displaced.
pub struct Bench {
    pub cell: Cell,
    pub taught: TaughtPanel,
    pub camera_from_panel: Rigid<Camera, Panel>,
    pub recipe: Recipe,
}

impl Bench {
    pub fn new(seed: u64, reduction: usize, inspect: &str) -> Self {
        let cell = Cell::new(seed, Scene::Clean, reduction);
        let region = cell.region();
        let corners = region.corners_px.map(|pixel| [pixel.u, pixel.v]);
        let [low, high] = sim::SEARCH_BOX_MM;
        let text = format!(
            "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
             [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n[inspect]\n{inspect}\n",
            region.rows, region.columns,
        );
        let recipe = Recipe::check("bench.toml", &text).expect("a valid recipe");
        let truth = cell.truth();
        let taught = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), truth.base_from_camera, &recipe)
            .expect("a panel to learn");
        let camera_from_panel = truth.base_from_camera.inverse() * truth.base_from_panel;
        Bench { cell, taught, camera_from_panel, recipe }
    }

    pub fn demands(&self, observation_s: f64) -> Demands {
        let settings = self.recipe.inspect();
        // No less than what pixels of this size show surely, also of a panel that was displaced.
        let limit_mm2 = Footprint::taught_detection_limit_mm2(&self.taught, settings).expect("in view");
        let (min_break_mm2, persist_s) = ((1.2 * limit_mm2).max(5.0), settings.persist_s());
        Demands {
            observation_s,
            frames_per_second: FRAMES_PER_SECOND,
            min_break_mm2,
            persist_s,
            by_cell: ByCell::default(),
        }
    }

    pub fn watch(&self, recipe: &Recipe, observation_s: f64) -> Watch {
        let demands = self.demands(observation_s);
        Watch::new(&self.taught, self.cell.scanner(), self.camera_from_panel, recipe.inspect(), demands)
            .expect("in view")
    }

    /// The same recipe with the thesis's method.
    pub fn thesis(&self) -> Recipe {
        let region = self.cell.region();
        let corners = region.corners_px.map(|pixel| [pixel.u, pixel.v]);
        let [low, high] = sim::SEARCH_BOX_MM;
        let text = format!(
            "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
             [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n[inspect]\nmethod = \"thesis\"\n",
            region.rows, region.columns,
        );
        Recipe::check("thesis.toml", &text).expect("a valid recipe")
    }
}

pub fn phase(film: &Film, time_s: f64) -> Phase {
    match film.phase(time_s) {
        sim::Phase::Dry => Phase::Dry,
        sim::Phase::Spray => Phase::Spray,
        sim::Phase::Wet => Phase::Wet,
    }
}

/// The times of a clip's pictures, s of the film.
pub fn times_s(demands: &Demands) -> impl Iterator<Item = f64> + use<> {
    let end_s = WET_FROM_S + demands.filmed_s();
    (0..=(end_s * FRAMES_PER_SECOND).round() as u32).map(|frame| f64::from(frame) / FRAMES_PER_SECOND)
}

/// What a clip shows.
struct Kind {
    name: &'static str,
    spec: FilmSpec,
    grease: Option<Grease>,
}

fn kind(seed: u64, extent: &Extent) -> Kind {
    const SHARES: [f64; 8] = [0.01, 0.03, 0.07, 0.15, 0.3, 0.5, 0.8, 1.0];
    let mixed = |count| Grease::Mixed { count, until_s: WET_FROM_S + 0.85 * extent.observed_s };
    let spray = |share| Grease::Share { share, kind: SpotKind::UnderSpray };
    let hard =
        FilmSpec { shadow_at_s: WET_FROM_S + (seed % 7) as f64 / 7.0 * extent.observed_s, ..FilmSpec::hard(seed) };
    match seed % 8 {
        0..4 => Kind { name: "mixed", spec: hard, grease: Some(mixed(2 + (seed / 8 % 5) as usize)) },
        4 => Kind { name: "usual", spec: FilmSpec::USUAL, grease: Some(mixed(4)) },
        5 => Kind { name: "spray", spec: hard, grease: Some(spray(SHARES[(seed / 8 % 8) as usize])) },
        6 if seed % 16 == 6 => Kind { name: "clean", spec: FilmSpec::USUAL, grease: None },
        _ => Kind { name: "clean", spec: hard, grease: None },
    }
}

pub fn run(extent: &Extent) {
    let mut tally = Tally::default();
    println!(
        "clip seed kind   exposure drift shadow glints verdict  iou   within  prec  rec   TF FF FP TP  missed / time errors, s"
    );
    let asked = |seed: &u64| extent.kind.as_ref().is_none_or(|name| kind(*seed, extent).name == name);
    for seed in extent.seeds.clone().filter(asked) {
        one(seed, extent, &mut tally);
    }
    tally.print();
}

fn one(seed: u64, extent: &Extent, tally: &mut Tally) {
    let bench = Bench::new(seed, extent.reduction, &std::env::var("INSPECT").unwrap_or_default());
    let Kind { name, spec, grease } = kind(seed, extent);
    let spots: Vec<Spot> = grease.iter().flat_map(|grease| bench.cell.greased(grease, seed)).collect();
    let film = bench.cell.film_as(&spots, &spec, seed);
    let demands = bench.demands(extent.observed_s);
    let mut watch = bench.watch(&bench.recipe, extent.observed_s);
    let thesis_recipe = bench.thesis();
    let mut thesis = (seed < 17 && name == "mixed").then(|| bench.watch(&thesis_recipe, extent.observed_s));
    let mut picture = film.picture(0.0);
    for time_s in times_s(&demands) {
        film.renew(&mut picture, time_s);
        watch.push(&picture, time_s, phase(&film, time_s)).expect("in order");
        if let Some(thesis) = &mut thesis {
            thesis.push(&picture, time_s, phase(&film, time_s)).expect("in order");
        }
    }
    let inspection = watch.finish().expect("wet pictures");
    let truth = film.broken(WET_FROM_S + extent.observed_s);
    if let Ok(folder) = std::env::var("PICTURES") {
        save(&folder, seed, &picture, &inspection, &truth);
    }
    let region = inspection.footprint.region();
    if let Some(thesis) = thesis {
        let found = thesis.finish().expect("wet pictures");
        tally.thesis_iou.push(score(&found.mask(), &truth, &region).expect("one size").iou);
    }
    let whole = score(&inspection.mask(), &truth, &region).expect("one size");
    let within = score_within(&inspection.mask(), &truth, &region).expect("one size");
    let confusion = inspection.confusion(&truth).expect("one size");
    let (missed, errors) = tally.spots_of(&inspection, &film, &truth);
    let expected = if name == "clean" { Verdict::Pass } else { Verdict::Fail };
    let right = inspection.judgement.verdict == expected;
    println!(
        "{seed:9} {name:6} {:6.2} {:6.2} {:6.2} {:5}   {:8} {:.3} {:.3}  {:.3} {:.3} {:3}{:3}{:3}{:4}  {missed:.0?} {errors:.2?}{}",
        spec.exposure,
        spec.drift,
        spec.shadow,
        spec.glints,
        inspection.judgement.verdict.word(),
        whole.iou,
        within.iou,
        whole.precision,
        whole.recall,
        confusion.true_fail,
        confusion.false_fail,
        confusion.false_pass,
        confusion.true_pass,
        if right { "" } else { "  <-" },
    );
    if !right {
        tally.wrong_verdicts += 1;
        inspection
            .judgement
            .reasons
            .iter()
            .for_each(|reason| println!("      {}: {}", reason.code, reason.message));
    }
    if truth.count() > 0 {
        tally.iou.push(whole.iou);
        tally.iou_within.push(within.iou);
    }
    tally.false_pass += confusion.false_pass;
    tally.false_fail += confusion.false_fail;
    tally.clean_grids += confusion.true_pass + confusion.false_fail;
    tally.broken_grids += confusion.true_fail + confusion.false_pass;
    tally.spray_wrong += usize::from(name == "spray" && inspection.judgement.verdict != Verdict::Fail);
}

/// The last picture with what was found and what is true: green both, orange found alone, blue true alone.
fn save(folder: &str, seed: u64, picture: &ColorPicture, inspection: &Inspection, truth: &Mask) {
    let mut drawn = picture.clone();
    let (found, region) = (inspection.mask(), inspection.footprint.region());
    for index in (0..drawn.rgb.len()).filter(|&index| region.inside[index]) {
        match (found.inside[index], truth.inside[index]) {
            (true, true) => drawn.rgb[index] = [0, 158, 115],
            (true, false) => drawn.rgb[index] = [230, 159, 0],
            (false, true) => drawn.rgb[index] = [86, 180, 233],
            _ => {}
        }
    }
    let png = panelprep::files::write_color_png(&drawn).expect("a picture");
    std::fs::write(format!("{folder}/clip{seed:03}.png"), png).expect("a folder");
    let png = panelprep::files::write_color_png(picture).expect("a picture");
    std::fs::write(format!("{folder}/clip{seed:03}_plain.png"), png).expect("a folder");
}
