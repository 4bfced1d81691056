//! Plans over the breaks of many films, and the costs that the program compares. The breaks are the simulator's true
//! ones at the end of the film, and the panel's pose is the true one, so the results depend only on the areas.

use super::goal::Figure;
use panelprep::geometry::Mask;
use panelprep::inspect::Footprint;
use panelprep::panel::TaughtPanel;
use panelprep::path::{Plan, TreatmentCost};
use panelprep::recipe::Recipe;
use panelprep::sim::{Cell, Grease, SEARCH_BOX_MM, Scene};
use panelprep::stages::plan::lay_lesser_paths;
use panelprep::stages::survey::ToolState;
use panelprep::stages::treat::{Broken, treated};
use panelprep::surface::examine_fit;
use rayon::prelude::*;

/// Numbers of rows and columns of grids on the simulated region. The grids of its recipe have sides of 42 to 50 mm.
const GRIDS: [[usize; 2]; 3] = [[4, 6], [3, 4], [2, 3]];
/// Minimum area of a break at which a grid fails, mm²: the default of a cell's file.
const MIN_BREAK_MM2: f64 = 5.0;
/// Time at which the film has ended and every break has grown, s.
const END_S: f64 = 60.0;

/// The costs of one film, with whole grids and with the planned areas: area, mm², and time, s.
struct Case {
    whole: [f64; 2],
    chosen: [f64; 2],
    /// Fraction of the break points in the failed grids that the disc reaches.
    reached: f64,
    /// Whether whole grids are planned, because the areas would have cost more.
    is_whole: bool,
}

/// Plans over the films of these seeds; returns whether every target is met.
pub fn measure(seeds: u64, reduction: u64) -> bool {
    let found = GRIDS.map(|grids| {
        let of_seed = |seed: u64| case(seed, reduction as usize, grids);
        let cases: Vec<Case> = (1..=seeds).into_par_iter().filter_map(of_seed).collect();
        let sum = |of: fn(&Case) -> f64| cases.iter().map(of).sum::<f64>();
        let [area, time] = [
            sum(|case| case.chosen[0]) / sum(|case| case.whole[0]),
            sum(|case| case.chosen[1]) / sum(|case| case.whole[1]),
        ];
        let most = |of: fn(&Case) -> f64| cases.iter().map(of).fold(f64::NAN, f64::max);
        let largest = most(|case| case.chosen[0] / case.whole[0]).max(most(|case| case.chosen[1] / case.whole[1]));
        let reached = cases.iter().map(|case| case.reached).fold(f64::NAN, f64::min);
        let whole = cases.iter().filter(|case| case.is_whole).count();
        let [rows, columns] = grids;
        println!(
            "{rows} × {columns} grids: area {area:.3}, time {time:.3}, largest ratio {largest:.3}, least share of reached \
             breaks {reached:.4}; {whole} of {} films by whole grids",
            cases.len()
        );
        ([area, time], largest, reached, [whole, cases.len()])
    });
    let text = |number: usize| found.iter().map(|of| format!("{:.2}", of.0[number])).collect::<Vec<_>>().join(", ");
    let by_whole = found.iter().map(|of| format!("{} of {}", of.3[0], of.3[1])).collect::<Vec<_>>().join(", ");
    let is_less = found.iter().all(|of| of.0.iter().all(|ratio| *ratio < 1.0));
    let largest = found.iter().map(|of| of.1).fold(f64::NAN, f64::max);
    let reached = found.iter().map(|of| of.2).fold(f64::NAN, f64::min);
    let is_less =
        Figure("treat: planned area around breaks, 4 × 6, 3 × 4 and 2 × 3 grids").report("1", &text(0), is_less);
    Figure("treat: planned time around breaks, 4 × 6, 3 × 4 and 2 × 3 grids").report("1", &text(1), is_less);
    Figure("treat: films by whole grids, 4 × 6, 3 × 4 and 2 × 3 grids").report("–", &by_whole, true);
    let is_never_more =
        Figure("treat: largest planned ratio").report("1", &format!("{largest:.2}"), largest <= 1.0);
    let is_reached =
        Figure("treat: least share of broken places reached").report("1", &format!("{reached:.4}"), reached >= 1.0);
    is_less && is_never_more && is_reached
}

/// Returns the costs for the film of a seed; every second film has smaller breaks of many shapes. `None` if no grid
/// failed.
fn case(seed: u64, reduction: usize, grids: [usize; 2]) -> Option<Case> {
    let cell = Cell::new(seed, Scene::Good, reduction);
    let recipe = recipe(&cell, grids);
    let scan = cell.taught_scan();
    let panel =
        TaughtPanel::learn(&scan, *cell.scanner(), cell.calibrated_base_from_camera(), &recipe).expect("a panel");
    let fit = examine_fit(&panel, recipe.surface()).expect("a surface");
    let film = match seed % 2 {
        0 => cell.film_with_spots(&cell.with_other_grease(&Grease::Mixed { count: 3, until_s: END_S }, 0)),
        _ => cell.film(),
    };
    let broken = broken(&cell, &panel, &recipe, &film.broken_pixels(END_S));
    let is_failed = |(id, [_, mm2]): &(_, [f64; 2])| (*mm2 >= MIN_BREAK_MM2).then_some(*id);
    let failed: Vec<_> = broken.located_mm2.iter().filter_map(is_failed).collect();
    if failed.is_empty() {
        return None;
    }
    let tool = ToolState { error_mm: None, worn_mm2: 0.0, removal: None, stroke_mm: None, in_air: false };
    let treated = treated((&panel, &fit), &broken, (&failed, &[]), &recipe);
    let plan: Plan = lay_lesser_paths((&panel, &fit), (&treated, &failed), (&recipe, tool)).expect("a path");
    let costs = plan.costs?;
    let numbers = |cost: TreatmentCost| [cost.under_disc_mm2, cost.duration_s];
    let whole = numbers(costs.whole_grids?);
    let is_whole = !costs.is_less_around_breaks();
    let chosen = if is_whole { whole } else { numbers(costs.around_breaks?) };
    Some(Case { whole, chosen, reached: plan.breaks_reached?, is_whole })
}

fn broken(cell: &Cell, panel: &TaughtPanel, recipe: &Recipe, mask: &Mask) -> Broken {
    let truth = cell.truth();
    let camera_from_panel = truth.base_from_camera.inverse() * truth.base_from_panel;
    let view = Footprint::of_view(panel, (cell.scanner(), camera_from_panel), recipe.inspect()).expect("in view");
    let grids = view.grids().iter().zip(view.broken_mm2(mask));
    let located_mm2 = grids.map(|(grid, mm2)| (grid.id, [mm2, mm2])).collect();
    Broken { places: view.taught_pixels(mask), located_mm2 }
}

fn recipe(cell: &Cell, [rows, columns]: [usize; 2]) -> Recipe {
    let corners = cell.region().corners_px.map(|pixel| [pixel.u, pixel.v]);
    let [low, high] = SEARCH_BOX_MM;
    let text = format!(
        "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n[region]\ncorners_px = \
         {corners:?}\nrows = {rows}\ncolumns = {columns}\n[treat]\nby = \"break\"\n"
    );
    Recipe::check("bench.toml", &text).unwrap_or_else(|problems| panic!("{problems}"))
}
