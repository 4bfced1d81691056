//! Teaching from scans with large parts missing. Measures the number of panels that are taught, and the distance of
//! their grids' edges from those that the whole scan teaches, at the same pixels.

use super::held::{PriorKnowledge, keys};
use super::{recipe, reduction, row, share};
use panelprep::panel::{LearnError, TaughtPanel};
use panelprep::sim::Trial;
use std::ops::RangeInclusive;

/// Shares of the panel without points.
const MISSING: [f64; 3] = [0.2, 0.35, 0.5];
/// Minimum share of the panels that must be taught.
const TAUGHT: f64 = 0.95;
/// Allowed deviation of an edge along the view, mm. Sideways, it moves by half of that in a picture from 30° to the
/// side. The edge determines to which grid a break belongs, and no pose depends on it.
const OFF_MM: f64 = 2.0;

/// Teaches with each missing share on both kinds of panel, with these seeds; returns the number of targets that
/// were missed.
pub fn panels(seeds: RangeInclusive<u64>) -> usize {
    let kinds: [(&str, fn(u64, usize) -> Trial); 2] = [("bent", Trial::good), ("flat", Trial::flat)];
    let each = kinds.into_iter().flat_map(|kind| MISSING.map(|missing| (kind, missing)));
    each.map(|((words, trial), missing)| kind(words, trial, missing, &seeds)).sum()
}

fn kind(words: &str, trial: fn(u64, usize) -> Trial, missing: f64, seeds: &RangeInclusive<u64>) -> usize {
    let (mut count, mut done, mut off_mm) = (0, 0, 0.0_f64);
    for seed in seeds.clone() {
        count += 1;
        let whole = learnt(&trial(seed, reduction())).expect("the whole panel is taught");
        match learnt(&trial(seed, reduction()).patchy(missing)) {
            Ok(panel) => {
                done += 1;
                let edges = panel.grids.iter().zip(&whole.grids);
                let points = edges.flat_map(|(a, b)| a.edge.iter().zip(&b.edge));
                off_mm = points.map(|(a, b)| (*a).distance_mm(*b)).fold(off_mm, f64::max);
            }
            Err(error) => println!("seed {seed}: not taught: {error}"),
        }
    }
    let told = format!(
        "{words}, {:.0} % without points, outline drawn: {done} of {count} are taught, edges of grids at most {off_mm:.2} mm off",
        100.0 * missing
    );
    row(share(done, count) >= TAUGHT && off_mm <= OFF_MM, &told)
}

fn learnt(trial: &Trial) -> Result<TaughtPanel, LearnError> {
    let recipe = recipe(trial, &keys(trial, PriorKnowledge::Outline));
    TaughtPanel::learn(&trial.taught_scan(), *trial.camera(), trial.base_from_camera(), &recipe)
}
