//! Measures the time for a point with its first and second derivatives on one core, compared with geomdl and scipy.

use super::scanned::Scanned;
use super::{held, timed_alone};
use panelprep::surface::{self, BSplineSurface, KnotVector, Parameter};
use std::process::Command;

const POINT_US: f64 = 0.1;
/// Number of points in a batch.
const BATCH: usize = 100_000;
/// Number of runs, of which the median time is used.
const RUNS: usize = 9;

pub fn evaluation() -> usize {
    let scanned = Scanned::upright(1);
    let surface = surface::fit(&scanned.panel, scanned.recipe.surface()).expect("a fit").surface;
    // The parameters are distributed over the region and are the same in every run.
    let place = |n: usize| Parameter { u: (n as f64 * 0.618_034).fract(), v: (n as f64 * 0.414_214).fract() };
    let places: Vec<Parameter> = (0..BATCH).map(place).collect();
    let took = timed_alone(RUNS, || surface.derivatives_at_many(&places));
    let [point_us, wall_us] = [took.share_ms, took.wall_ms].map(|ms| ms * 1e3 / BATCH as f64);
    let what = format!("a point with both derivatives, batch, one core ({wall_us:.3} µs by the wall clock)");
    let missed = held(&what, point_us, POINT_US, "µs");
    peers(&surface, point_us);
    missed
}

/// Measures the time for the same surface in geomdl and scipy.
fn peers(surface: &BSplineSurface, point_us: f64) {
    let Ok(python) = std::env::var("PANELPREP_PEERS") else {
        println!("   peers: not run; `make bench-surface` sets them up");
        return;
    };
    let controls: Vec<[f64; 3]> = surface.controls().iter().map(|point| point.mm.coords.into()).collect();
    let knots = |knots: &KnotVector| (knots.spans(), *knots.domain().start(), *knots.domain().end());
    let net =
        serde_json::json!({"u": knots(surface.knots_u()), "v": knots(surface.knots_v()), "controls": controls});
    let file = std::env::temp_dir().join(format!("panelprep-net-{}.json", std::process::id()));
    std::fs::write(&file, net.to_string()).expect("a folder for passing files");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/surface_peers.py");
    let output = Command::new(python).arg(script).arg(&file).output();
    // The result is ignored: a leftover file is inside of the system's folder for temporary files.
    let _ = std::fs::remove_file(&file);
    match output {
        Ok(output) if output.status.success() => {
            let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
            for (name, us) in found.as_object().expect("an object") {
                let us = us.as_f64().unwrap_or(f64::NAN);
                println!("   {name}: {us:.3} µs, {:.0} times as long", us / point_us);
            }
        }
        Ok(output) => println!("   peers failed: {}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => println!("   peers did not start: {error}"),
    }
}
