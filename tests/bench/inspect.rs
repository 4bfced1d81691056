//! The water-break test on rendered films of ten seeds at full size: agreement with the truth early and late, grids,
//! time a picture. `cargo bench --bench inspect -- [SEEDS] [FRAMES_PER_SECOND] [REDUCTION]`

use panelprep::inspect::{Demands, Inspection, Watch, score};
use panelprep::panel::TaughtPanel;
use panelprep::phase::Phase;
use panelprep::recipe::Recipe;
use panelprep::sim::{self, Cell, Scene, WET_FROM_S};
use std::time::Instant;

const OBSERVED_S: f64 = 45.0;

fn main() {
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<f64>().ok());
    let seeds = numbers.next().unwrap_or(10.0) as u64;
    let frames_per_second = numbers.next().unwrap_or(1.0);
    let reduction = numbers.next().unwrap_or(1.0) as usize;
    println!(
        "scene seed verdict  found/true mm²   iou early  iou late  prec.  recall  grids TF FF FP TP  ms/frame (new)"
    );
    for scene in [Scene::Good, Scene::Clean] {
        for seed in 1..=seeds {
            row(&Cell::new(seed, scene, reduction), scene, frames_per_second);
        }
    }
}

fn row(cell: &Cell, scene: Scene, frames_per_second: f64) {
    let region = cell.region();
    let corners = region.corners_px.map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = sim::SEARCH_BOX_MM;
    let text = format!(
        "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
         [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n[inspect]\n{}\n",
        region.rows,
        region.columns,
        std::env::var("INSPECT").unwrap_or_default(),
    );
    let recipe = Recipe::check("bench.toml", &text).expect("a valid recipe");
    let truth = cell.truth();
    let taught = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), truth.base_from_camera, &recipe)
        .expect("a panel to learn");
    let camera_from_panel = truth.base_from_camera.inverse() * truth.base_from_panel;
    let started = Instant::now();
    let demands = Demands { observation_s: OBSERVED_S, frames_per_second, min_break_mm2: 5.0 };
    let mut watch =
        Watch::new(&taught, cell.scanner(), camera_from_panel, recipe.inspect(), demands).expect("in view");
    let new_ms = started.elapsed().as_secs_f64() * 1e3;
    let film = cell.film();
    let mut times_ms = Vec::new();
    let frames = ((WET_FROM_S + OBSERVED_S) * frames_per_second) as usize;
    for frame in 0..=frames {
        let time_s = frame as f64 / frames_per_second;
        let phase = match film.phase(time_s) {
            sim::Phase::Dry => Phase::Dry,
            sim::Phase::Spray => Phase::Spray,
            sim::Phase::Wet => Phase::Wet,
        };
        let picture = film.picture(time_s);
        let started = Instant::now();
        watch.push(&picture, time_s, phase).expect("in order");
        if phase == Phase::Wet {
            times_ms.push(started.elapsed().as_secs_f64() * 1e3);
        }
    }
    let inspection = watch.finish().expect("wet pictures");
    times_ms.sort_by(f64::total_cmp);
    let late = film.broken(WET_FROM_S + OBSERVED_S);
    let confusion = inspection.confusion(&late).expect("one size");
    let real_mm2: f64 = inspection.footprint.broken_mm2(&late).iter().sum();
    let found_mm2: f64 = inspection.grids.iter().map(|grid| grid.broken_mm2).sum();
    let agreement = score(&inspection.mask(), &late, &inspection.footprint.region()).expect("one size");
    println!(
        "{:5} {:4} {:7} {found_mm2:8.1} {real_mm2:8.1}  {}  {:9.3}  {:5.3}  {:6.3}  {:8} {:2} {:2} {:2}  {:.1} ({new_ms:.0})",
        scene.word(),
        truth.seed,
        inspection.judgement.verdict.word(),
        early(&inspection, &film),
        agreement.iou,
        agreement.precision,
        agreement.recall,
        confusion.true_fail,
        confusion.false_fail,
        confusion.false_pass,
        confusion.true_pass,
        times_ms[times_ms.len() / 2],
    );
    for spot in &truth.spots {
        let (from, to) = (spot.breaks_at_s - WET_FROM_S, spot.grown_at_s - WET_FROM_S);
        let inside = camera_from_panel * spot.centre;
        let pixel = cell.scanner().project(inside).expect("in front");
        let seen = inspection.break_time_s(pixel.u.round() as usize, pixel.v.round() as usize);
        println!("      spot {:.0} mm² breaks {from:.1}…{to:.1} s, seen {seen:.1?} s", spot.area_mm2);
    }
    for found in inspection.breaks.iter().filter(|_| truth.spots.is_empty()) {
        println!("      false break {:.1} mm² at {:.1} s", found.area_mm2, found.first_seen_s);
    }
}

/// Agreement a second after the first break is 10 mm² large in truth.
fn early(inspection: &Inspection, film: &sim::Film) -> String {
    let region = inspection.footprint.region();
    let begun = (0..=450).map(|i| f64::from(i) * 0.1).find(|&since_wet_s| {
        inspection.footprint.broken_mm2(&film.broken(WET_FROM_S + since_wet_s)).iter().sum::<f64>() >= 10.0
    });
    let Some(begun) = begun else { return "        –".to_owned() };
    let at = begun.ceil() + 1.0;
    let truth = film.broken(WET_FROM_S + at);
    format!("{:9.3}", score(&inspection.mask_at(at), &truth, &region).expect("one size").iou)
}
