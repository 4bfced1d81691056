//! Measures all paths of a panel: computing time, distance between passes, and coverage of each grid, in every pattern
//! and attitude.

use super::goal::Figure;
use super::scanned::Scanned;
use super::{held, held_time, most, timed};
use panelprep::geometry::{Panel, Point};
use panelprep::panel::GridId;
use panelprep::path::{self, Plan, dwell};
use panelprep::surface::{self, BSplineSurface, Parameter, ParameterPatch};
use std::f64::consts::FRAC_PI_2;

const PATHS_MS: f64 = 50.0;
const LEFT: f64 = 0.005;
const MAX_PASS_DEVIATION: f64 = 0.01;
/// Number of runs, of which the median time is used.
const RUNS: usize = 9;

const ATTITUDES: [(&str, [f64; 3]); 4] = [
    ("upright", [0.0, 0.0, 0.0]),
    ("face up", [0.0, FRAC_PI_2, 0.0]),
    ("face down", [0.0, -FRAC_PI_2, 0.0]),
    ("aside", [0.0, 0.0, FRAC_PI_2]),
];

/// A patch that is the whole region.
const WHOLE: ParameterPatch =
    ParameterPatch { low: Parameter { u: 0.0, v: 0.0 }, high: Parameter { u: 1.0, v: 1.0 } };

/// Tests time, distances between passes and every pattern on one panel of 48 grids.
pub fn panel() -> usize {
    let scanned = Scanned::upright(1);
    let surface = surface::fit(&scanned.panel, scanned.recipe.surface()).expect("a fit").surface;
    let (region, outline, settings) = (&scanned.panel.region, &scanned.panel.outline, scanned.recipe.path());
    let grids: Vec<GridId> = region.ids().collect();
    let all = timed(RUNS, || path::plan(&surface, region, &grids, outline, settings));
    // Every other grid, as on a chessboard: no grids are adjacent, so none are combined.
    let apart: Vec<GridId> = grids.iter().copied().filter(|id| (id.row + id.column) % 2 == 0).collect();
    let alone = timed(RUNS, || path::plan(&surface, region, &apart, outline, settings));
    let plan = path::plan(&surface, region, &grids, outline, settings).expect("a plan");
    let radius_mm = settings.disc_diameter_mm() / 2.0;
    let executed = dwell::timed_poses(&plan);
    let simulated = timed(3, || dwell::simulate(&surface, region, &grids, &executed, radius_mm));
    println!("   {:.0} mm of path simulated in {:.1} ms", plan.length_mm, simulated.wall_ms);
    let mut missed = held_time(&format!("paths of {} grids, joined", grids.len()), &all, PATHS_MS);
    missed += held_time(&format!("paths of {} grids that touch only at corners", apart.len()), &alone, PATHS_MS);
    let off = passes_off(&surface, &path::raster(&surface, &WHOLE, settings).expect("rows").rows);
    most(Figure("surface: paths of 48 grids"), all.share_ms, PATHS_MS, " ms");
    let goal = format!("{} %", 100.0 * MAX_PASS_DEVIATION);
    Figure("surface: distance between passes off r'").report(
        &goal,
        &format!("{:.2} %", 100.0 * off),
        off <= MAX_PASS_DEVIATION,
    );
    missed += held("distance between passes off r', largest", off, MAX_PASS_DEVIATION, "");
    println!("   pattern, feed       verdict  least grid %  step-over mm    length mm");
    for (pattern, more) in [
        ("raster", ""),
        ("raster", "feed_angle_deg = 90"),
        ("raster", "feed_angle_deg = 30"),
        ("cross-hatch", ""),
        ("spiral", ""),
        ("offset", ""),
        ("offset-spiral", ""),
    ] {
        let settings = scanned.recipe_with(&format!("[path]\npattern = \"{pattern}\"\n{more}\n"));
        let plan = path::plan(&surface, region, &grids, outline, settings.path()).expect("a plan");
        missed += row(&format!("{pattern} {more}"), &plan, settings.path());
    }
    missed
}

fn row(name: &str, plan: &Plan, settings: &panelprep::recipe::Path) -> usize {
    let judgement = path::judge(plan, settings);
    let least = plan.grids.iter().map(|grid| grid.covered_fraction()).fold(1.0, f64::min);
    let steps = plan.step_over_mm.map_or("-".to_owned(), |s| format!("{:.2} to {:.2}", s.min_mm, s.max_mm));
    println!(
        "   {name:30}  {}  {:6.2}  {steps}  {:.0}",
        judgement.verdict.keyword(),
        100.0 * least,
        plan.length_mm
    );
    usize::from(1.0 - least > LEFT || judgement.verdict.keyword() != "accept")
}

/// Returns the largest relative deviation of the distance between two adjacent passes from r', without the ends of the
/// passes. r' is the distance between the first and the last pass at the same position, divided by the number of steps
/// between them.
fn passes_off(surface: &BSplineSurface, rows: &[Vec<Parameter>]) -> f64 {
    let lines: Vec<Vec<Point<Panel>>> = rows
        .iter()
        .enumerate()
        .map(|(index, row)| {
            let mut line: Vec<_> = row.iter().map(|at| surface.point(*at)).collect();
            if index % 2 == 1 {
                line.reverse();
            }
            line
        })
        .collect();
    let mut worst: f64 = 0.0;
    for share in 1..20 {
        let start = lines[0][(lines[0].len() - 1) * share / 20];
        let mut at = start;
        let steps: Vec<f64> = lines[1..]
            .iter()
            .map(|line| {
                let (foot, distance_mm) = nearest(line, at);
                at = foot;
                distance_mm
            })
            .collect();
        let mean_mm = steps.iter().sum::<f64>() / steps.len() as f64;
        worst = steps.iter().map(|mm| (mm / mean_mm - 1.0).abs()).fold(worst, f64::max);
    }
    worst
}

fn nearest(line: &[Point<Panel>], point: Point<Panel>) -> (Point<Panel>, f64) {
    let foot = |pair: &[Point<Panel>]| {
        let way = pair[1] - pair[0];
        let share = ((point - pair[0]).mm.dot(&way.mm) / way.mm.norm_squared()).clamp(0.0, 1.0);
        pair[0] + way * share
    };
    let feet = line.windows(2).map(foot).map(|foot| (foot, foot.distance_mm(point)));
    feet.min_by(|a, b| a.1.total_cmp(&b.1)).expect("a line")
}

/// Tests the panel in different attitudes, hanging or lying: no result may depend on the direction of gravity.
pub fn attitudes() -> usize {
    let mut missed = 0;
    for (name, turn) in ATTITUDES {
        let scanned = Scanned::turned(2, turn);
        let fit = surface::fit(&scanned.panel, scanned.recipe.surface()).expect("a fit");
        let (region, settings) = (&scanned.panel.region, scanned.recipe.path());
        let grids: Vec<GridId> = region.ids().collect();
        let plan = path::plan(&fit.surface, region, &grids, &scanned.panel.outline, settings).expect("a plan");
        let outward = fit.surface.normal(Parameter { u: 0.5, v: 0.5 }).expect("a normal");
        let upright = scanned.turn.inverse() * outward.mm;
        let [x, y, z]: [f64; 3] = outward.mm.into();
        missed += row(&format!("{name}, normal ({x:.2}, {y:.2}, {z:.2})"), &plan, settings);
        missed += usize::from(upright.x > -0.7);
    }
    missed
}
