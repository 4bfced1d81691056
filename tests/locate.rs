//! Localization on the simulated cell, where the truth is known.

use panelprep::geometry::{Base, Camera, OrganizedCloud, Panel, PinholeCamera, Point, Rigid, Vector};
use panelprep::locate::{self, Fit, LocateError, corner, gate, refine};
use panelprep::panel::{CornerTeaching, TaughtPanel, panel_from_base_at_teaching};
use panelprep::recipe::Recipe;
use panelprep::sim::{Cell, Place, PlacementError, SEARCH_BOX_MM, Scene};
use panelprep::verdict::{Judgement, Verdict};
use std::time::Instant;

fn recipe(cell: &Cell, which: &str) -> Recipe {
    let region = cell.region();
    let corners: Vec<String> = region.corners_px.iter().map(|p| format!("[{:.2}, {:.2}]", p.u, p.v)).collect();
    let [low, high] = SEARCH_BOX_MM;
    let text = format!(
        "panel = \"simulated\"\n[region]\ncorners_px = [{}]\nrows = {}\ncolumns = {}\n\
         [locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n[corner]\nwhich = \"{which}\"\n",
        corners.join(", "),
        region.rows,
        region.columns
    );
    Recipe::check("recipe.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}

struct Bench {
    cell: Cell,
    recipe: Recipe,
    taught: TaughtPanel,
}

impl Bench {
    fn new(seed: u64, scene: Scene, reduction: usize) -> Self {
        let cell = Cell::new(seed, scene, reduction);
        let recipe = recipe(&cell, "top-left");
        let taught =
            TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), cell.calibrated_base_from_camera(), &recipe)
                .unwrap_or_else(|error| panic!("{error}"));
        Bench { cell, recipe, taught }
    }

    fn locate(&self, scan: &OrganizedCloud<Camera>) -> Result<Fit, LocateError> {
        locate::locate(&self.taught, scan, self.cell.calibrated_base_from_camera(), self.recipe.locate())
    }

    fn error(&self, found: &Rigid<Base, Panel>) -> PlacementError {
        self.cell.truth().placement_error_mm(found)
    }
}

#[test]
#[ignore]
fn ten_seeds_at_full_size() {
    for seed in 1..=10 {
        let bench = Bench::new(seed, Scene::Good, 1);
        let scan = bench.cell.scan();
        let begun = Instant::now();
        let fit = bench.locate(&scan).unwrap_or_else(|e| panic!("{e}"));
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let e = bench.error(&fit.base_from_panel);
        let judged = gate::judge(&fit, bench.recipe.locate());
        println!(
            "{seed}: mean {:.4} max {:.4} mm | 95% {:.4} weak {:.4} | rms {:.4} outline {:.4} mm {:.3} px | found {:.3} {:.3} {:.3} | {} steps, last {:.5} | shift {:.2} turn {:.2} tilt {:.2} | {} pts {ms:.0} ms {:?}",
            e.mean_mm,
            e.max_mm,
            fit.uncertainty_mm,
            fit.weakest_mm,
            fit.rms_mm,
            fit.outline_rms_mm,
            fit.outline_rms_px,
            fit.taught_found,
            fit.scan_found,
            fit.outline_found,
            fit.iterations,
            fit.last_step_mm,
            fit.shift_mm,
            fit.turn.0,
            fit.tilt.0,
            fit.points,
            judged.reasons
        );
    }
}
