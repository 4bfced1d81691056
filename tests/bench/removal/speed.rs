//! Measures the computing time of the schedule for 48 grids: segments, matrix and descent.

use super::goal::Figure;
use super::panels::{beyond, path_recipe};
use super::scene::{FORCE_N, bent, disc, exact_model};
use super::{held, most};
use panelprep::geometry::median;
use panelprep::panel::{GridId, Region};
use panelprep::path::dwell;
use panelprep::removal::schedule::{RemovalTarget, schedule};
use panelprep::removal::track::path_stretches;
use panelprep::stages::removal::contact_moves;
use panelprep::surface::Parameter;
use std::time::Instant;

const MAX_MS: f64 = 100.0;
const RUNS: usize = 9;

pub fn measure() -> usize {
    let recipe = path_recipe("");
    let region = Region::new(recipe.region()).expect("convex");
    let surface = bent([320.0, 240.0], [1.0 / 800.0, -1.0 / 1_500.0]);
    let grids: Vec<GridId> = region.ids().collect();
    let laid = beyond(&surface, &region, &grids, &recipe);
    let (settings, asked) = (recipe.path(), recipe.removal().expect("stated"));
    let all: Vec<_> = laid.paths.iter().flat_map(|path| path.waypoints.iter().copied()).collect();
    let (moves, ground, model) = (contact_moves(&all, asked, settings), |_: Parameter| true, exact_model());
    let wanted = RemovalTarget { target_um: asked.target_um(), acceleration_mm_s2: settings.acceleration_mm_s2() };
    let mut times_ms: Vec<f64> = (0..RUNS)
        .map(|_| {
            let started = Instant::now();
            let on = path_stretches(&surface, &dwell::timed_poses(&laid), (&disc(true), FORCE_N), &ground);
            let found = schedule((&surface, &region, &ground), &laid.treated, (&on, &moves), &model, &wanted);
            std::hint::black_box(found);
            1e3 * started.elapsed().as_secs_f64()
        })
        .collect();
    let found_ms = median(&mut times_ms).expect("runs");
    println!("   {} moves over {} grids", moves.len(), grids.len());
    most(Figure("removal: schedule of 48 grids"), found_ms, MAX_MS, " ms");
    held("scheduling of 48 grids, median", found_ms, MAX_MS, "ms")
}
