//! Plans every pattern over many sets of grids of the demo's panels. Each plan is finite, the distances between its
//! lines are at most the recipe's step-over, and it covers everything; the uniformity of its dwell time is measured.
//! `make test` plans a few sets, `make bench-surface` all of them.

use panelprep::geometry::statistics::{QuantileRank, quantile};
use panelprep::panel::{GridId, TaughtPanel};
use panelprep::path::{self, Plan};
use panelprep::recipe::Recipe;
use panelprep::sim::{Cell, SEARCH_BOX_MM, Scene};
use panelprep::surface::{self, BSplineSurface};
use panelprep::verdict::Verdict;
use rayon::prelude::*;
use std::collections::BTreeMap;

pub const PATTERNS: [&str; 5] = ["raster", "cross-hatch", "spiral", "offset", "offset-spiral"];
/// Disc diameter for which the default limits of a pattern are chosen, mm.
pub const DEFAULT_DISC_DIAMETER_MM: f64 = 30.0;

/// The results of one pattern with one disc, over many sets of grids.
#[derive(Debug, Clone, Default)]
pub struct Row {
    pub plans: usize,
    /// Minimum coverage of all grids of all plans, 0 to 1.
    pub least_coverage: f64,
    pub widest_step_mm: f64,
    /// Maximum dwell ratio of each plan.
    pub dwell_ratios: Vec<f64>,
    /// The problems that were found, with pattern, disc, seed and grids.
    pub faults: Vec<String>,
    /// Number of plans about which a person must decide.
    pub reviews: usize,
}

impl Row {
    /// Returns the dwell ratio that this fraction of the plans does not exceed.
    pub fn dwell_ratio(&self, share: f64) -> f64 {
        quantile(&mut self.dwell_ratios.clone(), share, QuantileRank::Lower).unwrap_or(f64::NAN)
    }
}

/// A taught panel of the demo.
struct Demo {
    seed: u64,
    text: String,
    panel: TaughtPanel,
    surface: BSplineSurface,
}

impl Demo {
    fn new(seed: u64, reduction: usize) -> Self {
        let cell = Cell::new(seed, Scene::Good, reduction);
        let (region, [low, high]) = (cell.region(), SEARCH_BOX_MM);
        let corners = region.corners_px.map(|pixel| [pixel.u, pixel.v]);
        let text = format!(
            "panel = \"simulated\"\n[locate]\nbox_min_mm = {low:?}\nbox_max_mm = {high:?}\n\
             [region]\ncorners_px = {corners:?}\nrows = {}\ncolumns = {}\n",
            region.rows, region.columns
        );
        let recipe = recipe(&text);
        let base_from_camera = cell.calibrated_base_from_camera();
        let panel = TaughtPanel::learn(&cell.taught_scan(), *cell.scanner(), base_from_camera, &recipe)
            .expect("a panel that can be taught");
        let surface = surface::fit(&panel, recipe.surface()).expect("a surface").surface;
        Demo { seed, text, panel, surface }
    }

    fn planned(&self, (pattern, disc_mm): (&str, f64), grids: &[GridId]) -> Result<(Plan, Recipe), String> {
        let recipe =
            recipe(&format!("{}[path]\npattern = \"{pattern}\"\ndisc_diameter_mm = {disc_mm}\n", self.text));
        let plan = path::plan(&self.surface, &self.panel.region, grids, &self.panel.outline, recipe.path());
        plan.map(|plan| (plan, recipe)).map_err(|error| error.to_string())
    }
}

fn recipe(text: &str) -> Recipe {
    Recipe::check("demo.toml", text).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Returns every single grid, every pair of adjacent grids, every L of three grids, every row, and the set of all
/// grids.
pub fn every_set(rows: usize, columns: usize) -> Vec<Vec<GridId>> {
    let mut sets: Vec<Vec<GridId>> = Vec::new();
    let there = |id: &GridId| (1..=rows).contains(&id.row) && (1..=columns).contains(&id.column);
    for (row, column) in (1..=rows).flat_map(|row| (1..=columns).map(move |column| (row, column))) {
        let at = |down: usize, right: usize| GridId { row: row + down, column: column + right };
        sets.push(vec![at(0, 0)]);
        sets.push(vec![at(0, 0), at(0, 1)]);
        sets.push(vec![at(0, 0), at(1, 0)]);
        let square = [at(0, 0), at(0, 1), at(1, 0), at(1, 1)];
        sets.extend((0..4).map(|without| {
            square.iter().enumerate().filter(|(index, _)| *index != without).map(|(_, id)| *id).collect()
        }));
    }
    sets.retain(|set| set.iter().all(there));
    sets.extend((1..=rows).map(|row| (1..=columns).map(|column| GridId { row, column }).collect()));
    sets.push((1..=rows).flat_map(|row| (1..=columns).map(move |column| GridId { row, column })).collect());
    sets.sort();
    sets.dedup();
    sets
}

/// Plans sets of grids with every pattern and each of these discs, on these seeds of the demo; `wanted` selects the
/// sets.
pub fn run(
    (seeds, reduction): (std::ops::RangeInclusive<u64>, usize),
    discs_mm: &[f64],
    wanted: impl Fn(usize, &[GridId]) -> bool + Sync,
) -> BTreeMap<(usize, u64), Row> {
    let mut rows: BTreeMap<(usize, u64), Row> = BTreeMap::new();
    for seed in seeds {
        let demo = Demo::new(seed, reduction);
        let sets = every_set(demo.panel.region.rows, demo.panel.region.columns);
        let sets: Vec<&Vec<GridId>> =
            sets.iter().enumerate().filter(|(index, set)| wanted(*index, set)).map(|(_, set)| set).collect();
        for (index, pattern) in PATTERNS.iter().enumerate() {
            for disc_mm in discs_mm {
                let row =
                    rows.entry((index, *disc_mm as u64)).or_insert(Row { least_coverage: 1.0, ..Row::default() });
                let planned: Vec<_> = sets.par_iter().map(|set| demo.planned((pattern, *disc_mm), set)).collect();
                for (set, planned) in sets.iter().zip(planned) {
                    let names: Vec<String> = set.iter().map(ToString::to_string).collect();
                    let name = format!("{pattern}, disc {disc_mm} mm, seed {}, {}", demo.seed, names.join(" "));
                    row.plans += 1;
                    match planned {
                        Ok((plan, recipe)) => row.add(&name, &plan, recipe.path()),
                        Err(error) => row.faults.push(format!("{name}: {error}")),
                    }
                }
            }
        }
    }
    rows
}

impl Row {
    fn add(&mut self, name: &str, plan: &Plan, settings: &panelprep::recipe::Path) {
        let judgement = path::judge(plan, settings);
        let least = plan.grids.iter().map(|grid| grid.covered_fraction()).fold(1.0, f64::min);
        let step_mm = plan.step_over_mm.map_or(0.0, |step_over| step_over.max_mm);
        let ratio = plan.dwell_ratio().map(|(ratio, _)| ratio);
        self.least_coverage = self.least_coverage.min(least);
        self.widest_step_mm = self.widest_step_mm.max(step_mm);
        self.dwell_ratios.extend(ratio);
        self.reviews += usize::from(judgement.verdict == Verdict::Review);
        let is_finite = plan.is_finite() && plan.duration_s > 0.0;
        let mut wrong = vec![
            (!is_finite, "a number is not finite".to_owned()),
            (judgement.verdict == Verdict::Reject, format!("rejected: {:?}", judgement.reasons)),
            (step_mm > settings.step_over_mm(), format!("lines {step_mm:.3} mm apart")),
            (least < 0.995, format!("coverage {least:.4}")),
            (ratio.is_none(), "no dwell is reported".to_owned()),
        ];
        if settings.disc_diameter_mm() == DEFAULT_DISC_DIAMETER_MM {
            let uneven = ratio.is_none_or(|ratio| ratio > settings.max_dwell_ratio());
            wrong.push((uneven, format!("dwell ratio {ratio:?}, allowed {}", settings.max_dwell_ratio())));
        }
        self.faults
            .extend(wrong.into_iter().filter(|(is_so, _)| *is_so).map(|(_, what)| format!("{name}: {what}")));
    }
}

#[test]
fn every_pattern_plans_singles_pairs_ls_rows_and_all() {
    // Selects one set in eleven, the whole rows and all grids.
    let some = |index: usize, set: &[GridId]| index.is_multiple_of(11) || set.len() > 3;
    let rows = run((1..=2, 4), &[20.0, 30.0, 60.0], some);
    let faults: Vec<&String> = rows.values().flat_map(|row| &row.faults).collect();
    for ((pattern, disc_mm), row) in &rows {
        println!(
            "{} {disc_mm}: {} plans, coverage {:.4}, step-over {:.2}, dwell ratio {:.2} to {:.2}, {} reviews",
            PATTERNS[*pattern],
            row.plans,
            row.least_coverage,
            row.widest_step_mm,
            row.dwell_ratio(0.5),
            row.dwell_ratio(1.0),
            row.reviews
        );
    }
    assert!(rows.len() == 15 && rows.values().all(|row| row.plans > 20));
    assert!(faults.is_empty(), "{} faults: {:#?}", faults.len(), &faults[..faults.len().min(20)]);
}

/// Expected counts, by hand: 4 × 6 grids have 24 singles, 4·5 + 3·6 = 38 pairs, 4 · 15 = 60 Ls, 4 rows and one set of
/// all grids.
#[test]
fn every_set_is_there() {
    assert_eq!(every_set(4, 6).len(), 24 + 38 + 60 + 4 + 1);
}
