//! Teaching from scans with large parts missing. Measures the number of panels that can be taught, and the distance of
//! their grids' edges from those taught with the complete scan, at the same pixels.

use super::goal::Figure;
use super::held::{PriorKnowledge, keys};
use super::{recipe, reduction, row, share};
use panelprep::panel::{LearnError, TaughtPanel};
use panelprep::sim::TrialScene;
use std::ops::RangeInclusive;

/// Fractions of the panel's points that are missing.
const MISSING_FRACTIONS: [f64; 3] = [0.2, 0.35, 0.5];
/// Minimum fraction of the panels that must be taught.
const MIN_TAUGHT_FRACTION: f64 = 0.95;
/// Maximum error of an edge along the view, mm. In a picture captured at 30° from the side, the edge moves sideways by
/// half of this. The edge determines only to which grid a break belongs; no pose depends on it.
const MAX_EDGE_ERROR_MM: f64 = 2.0;

/// Teaches both kinds of panel with each fraction of missing points, for these seeds; returns the number of missed
/// targets.
pub fn panels(seeds: RangeInclusive<u64>) -> usize {
    let bent = Figures {
        taught: Figure("locate: taught with 20, 35, 50 % of the points missing, bent panels"),
        off: Figure("locate: error of grid edges on these panels, bent"),
    };
    let flat = Figures { taught: Figure("locate: flat panels"), off: Figure("locate: error there, flat") };
    kind(("bent", TrialScene::good_scene), &seeds, &bent) + kind(("flat", TrialScene::flat_scene), &seeds, &flat)
}

/// The figures of a kind of panel: the fraction that was taught, and the error of the grids' edges.
struct Figures {
    taught: Figure,
    off: Figure,
}

type KindOfPanel = (&'static str, fn(u64, usize) -> TrialScene);

fn kind((words, trial): KindOfPanel, seeds: &RangeInclusive<u64>, figures: &Figures) -> usize {
    let found = MISSING_FRACTIONS.map(|missing| taught(words, trial, missing, seeds));
    let done: Vec<String> = found.iter().map(|found| found.done.to_string()).collect();
    let (goal, count) = (format!("{} %", 100.0 * MIN_TAUGHT_FRACTION), seeds.clone().count());
    let is_taught = found.iter().all(|found| count > 0 && share(found.done, count) >= MIN_TAUGHT_FRACTION);
    figures.taught.report(&goal, &format!("{} of {count}", done.join(", ")), is_taught);
    let off_mm = found.iter().map(|found| found.off_mm).fold(0.0, f64::max);
    let is_measured = found.iter().any(|found| found.done > 0);
    figures.off.report(
        &format!("{MAX_EDGE_ERROR_MM} mm"),
        &format!("{off_mm:.1} mm"),
        is_measured && off_mm <= MAX_EDGE_ERROR_MM,
    );
    found.iter().map(|found| found.missed).sum()
}

/// The results for one kind of panel with one fraction of missing points: the number of panels that were taught, and
/// the largest error of an edge.
struct Taught {
    missed: usize,
    done: usize,
    off_mm: f64,
}

fn taught(words: &str, trial: fn(u64, usize) -> TrialScene, missing: f64, seeds: &RangeInclusive<u64>) -> Taught {
    let (mut count, mut done, mut off_mm) = (0, 0, 0.0_f64);
    for seed in seeds.clone() {
        count += 1;
        let whole = learnt(&trial(seed, reduction())).expect("the whole panel is taught");
        match learnt(&trial(seed, reduction()).with_missing_patches(missing)) {
            Ok(panel) => {
                done += 1;
                let edges = panel.grids.iter().zip(&whole.grids);
                let points = edges.flat_map(|(a, b)| a.edge.iter().zip(&b.edge));
                off_mm = points.map(|(a, b)| (*a).distance_mm(*b)).fold(off_mm, f64::max);
            }
            Err(error) => println!("seed {seed}: not taught: {error}"),
        }
    }
    let summary = format!(
        "{words}, {:.0} % without points, outline drawn: {done} of {count} are taught, edges of grids at most {off_mm:.2} mm off",
        100.0 * missing
    );
    Taught {
        missed: row(share(done, count) >= MIN_TAUGHT_FRACTION && off_mm <= MAX_EDGE_ERROR_MM, &summary),
        done,
        off_mm,
    }
}

fn learnt(trial: &TrialScene) -> Result<TaughtPanel, LearnError> {
    let recipe = recipe(trial, &keys(trial, PriorKnowledge::Outline));
    TaughtPanel::learn(&trial.taught_scan(), *trial.camera(), trial.base_from_camera(), &recipe)
}
