//! The surface and the paths over it on full-size scans: how exact, how fast, beside geomdl and scipy in one run.
//! `cargo bench --bench surface -- [PART…] [SEEDS]`, parts `fit`, `evaluate`, `paths`, `attitudes`, `gauntlet`; without
//! one, all. `make bench-surface` sets up the peers and names their Python in `PANELPREP_PEERS`. Exit code 1 where a
//! target is missed.

#[path = "surface/accuracy.rs"]
mod accuracy;
#[path = "../gauntlet.rs"]
mod gauntlet;
#[path = "surface/paths.rs"]
mod paths;
#[path = "surface/scanned.rs"]
mod scanned;
#[path = "surface/speed.rs"]
mod speed;

use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

/// Seeds of the accuracy's scans, and random paths.
const SEEDS: u64 = 20;
const PATHS: usize = 100_000;

const PARTS: [&str; 5] = ["fit", "evaluate", "paths", "attitudes", "gauntlet"];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let seeds = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(SEEDS);
    let named: Vec<&str> = PARTS.into_iter().filter(|part| arguments.iter().any(|a| a == part)).collect();
    let mut missed = 0;
    for part in if named.is_empty() { PARTS.to_vec() } else { named } {
        let started = Instant::now();
        println!("== {part}");
        missed += match part {
            "fit" => accuracy::measure(seeds),
            "evaluate" => speed::evaluation(),
            "paths" => paths::panel(),
            "attitudes" => paths::attitudes(),
            _ => random_paths(),
        };
        println!("   took {:.0} s", started.elapsed().as_secs_f64());
    }
    if missed == 0 {
        println!("all targets met");
        ExitCode::SUCCESS
    } else {
        println!("{missed} targets missed");
        ExitCode::FAILURE
    }
}

/// Says how a number stands to its target; 1 where it misses it.
fn held(what: &str, found: f64, most: f64, unit: &str) -> usize {
    let missed = found.is_nan() || found > most;
    println!("   {what}: {found:.4} {unit}, at most {most}{}", if missed { "  MISSED" } else { "" });
    usize::from(missed)
}

/// Median time of a piece of work, ms.
fn median_ms<T>(runs: usize, mut work: impl FnMut() -> T) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let started = Instant::now();
            black_box(work());
            started.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

/// Good paths and the same with one defect, through every gate.
fn random_paths() -> usize {
    let outcome = gauntlet::run(PATHS);
    println!("   {PATHS} good paths, {} of them refused; and each once with one defect:", outcome.refused.len());
    let mut passed_in_all = 0;
    for (defect, [planted, passed]) in &outcome.planted {
        println!("   {defect}: {planted}, {passed} passed");
        passed_in_all += passed;
    }
    println!("   {} other random paths cannot be followed in any configuration", outcome.barren);
    usize::from(!outcome.refused.is_empty()) + usize::from(passed_in_all > 0)
}
