//! Comparison with mr-sim (PyPI) in one run: lines over a flat part and over parts of constant curvature.
//!
//! mr-sim adds up the removal by stationary discs in small steps on a grid of 1 mm. Its grain speed is that of the
//! orbit only, and the rim of its disc does not take part in the orbital motion; our model has the same settings here.
//! The bench compares the depth across the lane, away from the rim, where a grid of 1 mm is not exact.

use super::goal::{Figure, larger};
use super::scene::{FORCE_N, ORBIT, PAD, PRESTON_MM2_PER_N, bent, disc, exact_model, pose, region};
use super::{held, most, reached};
use panelprep::panel::GridId;
use panelprep::removal::map::removed;
use panelprep::removal::track::path_stretches;
use panelprep::surface::{Parameter, Treated};
use serde_json::{Value, json};
use std::process::Command;
use std::time::Instant;

const OFF_PERCENT: f64 = 2.0;
const FASTER: f64 = 20.0;
const OFF: Figure = Figure("removal: off mr-sim");
const TIMES_FASTER: Figure = Figure("removal: times faster than mr-sim, least");
/// Sides slightly shorter than whole millimetres, so that sample points are 1 mm apart.
const SIDES_MM: [f64; 2] = [119.999_9, 59.999_9];
const FEED_MM_S: f64 = 60.0;
/// Name of the case, and its curvatures, 1/mm.
const CASES: [(&str, [f64; 2]); 4] = [
    ("flat", [0.0, 0.0]),
    ("sphere of 800 mm radius, completely in contact", [1.0 / 800.0, 1.0 / 800.0]),
    ("1/1000 by 1/500 mm", [1.0 / 1_000.0, 1.0 / 500.0]),
    ("sphere of 120 mm radius, in contact in its middle", [1.0 / 120.0, 1.0 / 120.0]),
];
/// Minimum distance from the rim at which a grid of 1 mm is exact, mm.
const RIM_MM: f64 = 2.0;

pub fn measure() -> usize {
    let Ok(python) = std::env::var("PANELPREP_PEERS") else {
        println!("   not run: make bench-removal sets up mr-sim and names its Python in PANELPREP_PEERS");
        OFF.not_run(&format!("{OFF_PERCENT} %"));
        TIMES_FASTER.not_run(&FASTER.to_string());
        return 0;
    };
    let asked = json!({
        "sides_mm": SIDES_MM.map(f64::round), "radius_mm": PAD.radius_mm, "stiffness": PAD.stiffness_n_mm3, "force_n": FORCE_N,
        "kp": PRESTON_MM2_PER_N, "orbit_mm": ORBIT.diameter_mm, "rev_min": ORBIT.speed_rev_min, "feed_mm_s": FEED_MM_S,
        "step_mm": 0.25, "cases": CASES.map(|(_, bends)| bends),
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/removal_peers.py");
    let output = Command::new(python).arg(script).arg(asked.to_string()).output().expect("Python starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let reported: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let (mut missed, mut worst, mut least) = (0, 0.0, f64::INFINITY);
    for ((name, bends), peer) in CASES.iter().zip(reported.as_array().expect("cases")) {
        let (across_um, ours_s) = ours(*bends);
        let theirs: Vec<f64> =
            peer["across_um"].as_array().expect("numbers").iter().map(|n| n.as_f64().expect("a number")).collect();
        let deepest = theirs.iter().copied().fold(0.0, f64::max);
        let rim_mm = theirs.iter().filter(|um| **um > 0.02 * deepest).count() as f64 / 2.0;
        let places = across_um.iter().zip(&theirs).enumerate();
        let inner = places.filter(|(index, _)| (*index as f64 - SIDES_MM[1] / 2.0).abs() < rim_mm - RIM_MM);
        let off = inner.map(|(_, (ours, theirs))| 100.0 * (ours - theirs).abs() / deepest).fold(0.0, f64::max);
        let theirs_s = peer["seconds"].as_f64().expect("a number");
        println!(
            "   {name}: {deepest:.2} µm in the middle; mr-sim {:.1} ms, ours {:.3} ms",
            1e3 * theirs_s,
            1e3 * ours_s
        );
        missed += held("  off, of the depth in the middle", off, OFF_PERCENT, "%");
        missed += reached("  times faster", theirs_s / ours_s, FASTER, "");
        (worst, least) = (larger(worst, off), f64::min(least, theirs_s / ours_s));
    }
    most(OFF, worst, OFF_PERCENT, " %");
    TIMES_FASTER.report(&FASTER.to_string(), &format!("{least:.1}"), least >= FASTER);
    missed
}

/// Returns the depths across the middle of the line, µm, sampled every 1 mm, and the computing time of the whole map,
/// s.
fn ours(bends: [f64; 2]) -> (Vec<f64>, f64) {
    let surface = bent(SIDES_MM, bends);
    let region = region([1, 1]);
    let line: Vec<_> = (0..=16)
        .map(|n| {
            let x = -40.0 + 5.0 * f64::from(n);
            let seconds = if n == 0 { 0.0 } else { 5.0 / FEED_MM_S };
            pose([x, 0.0, -0.5 * bends[0] * x * x], [bends[0] * x, 0.0, 1.0], (0.0, seconds))
        })
        .collect();
    let (ground, treated) = (|_: Parameter| true, Treated::from_grids(&[GridId { row: 1, column: 1 }]));
    let work = || {
        let all = path_stretches(&surface, &line, (&disc(false), FORCE_N), &ground);
        removed((&surface, &region, &ground), &treated, &all, (&exact_model(), 0.0), 1.0)
    };
    let started = Instant::now();
    let runs = 20;
    let map = (0..runs).fold(None, |_, _| Some(work())).expect("a map");
    let seconds = started.elapsed().as_secs_f64() / f64::from(runs);
    let grid = &map.grids[0];
    let rows = grid.depth_um.len() / grid.columns;
    let across: Vec<f64> =
        (0..rows).map(|row| f64::from(grid.depth_um[row * grid.columns + grid.columns / 2])).collect();
    // mr-sim's sample points are at whole millimetres, ours at half millimetres.
    let whole = std::iter::once(across[0]).chain(across.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])));
    (whole.collect(), seconds)
}
