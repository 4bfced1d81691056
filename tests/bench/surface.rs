//! Measures the accuracy and speed of the surface and of the paths over it on full-size scans, compared with geomdl and
//! scipy in the same run. `cargo bench --bench surface -- [PART…] [SEEDS]`, parts `fit`, `evaluate`, `paths`,
//! `patterns`, `attitudes`, `gauntlet`; without a part, all. `make bench-surface` sets up the peers and names their
//! Python in `PANELPREP_PEERS`. Exit code 1 if a target is missed.

#[path = "surface/accuracy.rs"]
mod accuracy;
#[path = "../gauntlet.rs"]
mod gauntlet;
#[path = "goal.rs"]
mod goal;
#[path = "surface/paths.rs"]
mod paths;
#[path = "../patterns.rs"]
mod patterns;
#[path = "surface/scanned.rs"]
mod scanned;
#[path = "surface/speed.rs"]
mod speed;

use goal::Figure;
use panelprep::geometry::median;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

/// Number of seeds for the scans that test accuracy.
const SEEDS: u64 = 20;
/// Number of random paths.
const PATHS: usize = 100_000;

const PARTS: [&str; 6] = ["fit", "evaluate", "paths", "patterns", "attitudes", "gauntlet"];
/// Number of the demo's seeds on which every pattern is planned.
const DEMO_SEEDS: u64 = 10;
/// Diameters of the discs with which every pattern is planned, mm.
const DISCS_MM: [f64; 5] = [20.0, 30.0, 40.0, 50.0, 60.0];
/// Minimum coverage of all plans; the limits of the plan checks are at least as strict.
const COVERAGE_MIN: f64 = 0.995;
/// Maximum distance between adjacent lines, mm.
const STEP_MAX_MM: f64 = 12.0;

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
            "patterns" => every_pattern(seeds.min(DEMO_SEEDS)),
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

/// Prints a time with its maximum. The processor time must meet the target; the wall-clock time depends on the load of
/// the machine.
fn held_time(what: &str, found: &Timed, most_ms: f64) -> usize {
    held(&format!("{what} ({:.1} ms by the wall clock)", found.wall_ms), found.share_ms, most_ms, "ms")
}

/// Reports a figure with its maximum; a missing number misses the target.
fn most(figure: Figure, found: f64, most: f64, unit: &str) {
    figure.report(&format!("{most}{unit}"), &format!("{found:.3}{unit}"), found <= most);
}

/// Prints a number with its maximum; returns 1 if it misses the target.
fn held(what: &str, found: f64, most: f64, unit: &str) -> usize {
    let missed = found.is_nan() || found > most;
    println!("   {what}: {found:.4} {unit}, at most {most}{}", if missed { "  MISSED" } else { "" });
    usize::from(missed)
}

/// Median duration of a computation, ms.
struct Timed {
    /// Wall-clock time, which includes other work on the machine, ms.
    wall_ms: f64,
    /// Processor time of all threads together, divided by the number of threads, ms. It equals the wall-clock time on
    /// an idle machine if all threads work all the time.
    share_ms: f64,
}

fn timed<T>(runs: usize, mut work: impl FnMut() -> T) -> Timed {
    let threads = std::thread::available_parallelism().map_or(1.0, |threads| threads.get() as f64);
    let (mut walls, mut shares) = (Vec::new(), Vec::new());
    for _ in 0..runs {
        let (started, before_ms) = (Instant::now(), cpu_time_ms());
        black_box(work());
        walls.push(started.elapsed().as_secs_f64() * 1e3);
        shares.push((cpu_time_ms() - before_ms) / threads);
    }
    Timed { wall_ms: median(&mut walls).unwrap_or(f64::NAN), share_ms: median(&mut shares).unwrap_or(f64::NAN) }
}

/// Measures a computation that runs on one thread: `share_ms` is then this thread's processor time.
fn timed_alone<T>(runs: usize, work: impl FnMut() -> T) -> Timed {
    let threads = std::thread::available_parallelism().map_or(1.0, |threads| threads.get() as f64);
    let Timed { wall_ms, share_ms } = timed(runs, work);
    Timed { wall_ms, share_ms: share_ms * threads }
}

/// Returns the processor time of all threads, ms, as reported by the kernel.
fn cpu_time_ms() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let text = |task: std::fs::DirEntry| std::fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
    let spent = tasks.filter_map(|task| text(task).split(' ').next().and_then(|word| word.parse::<f64>().ok()));
    spent.sum::<f64>() / 1e6
}

/// Plans every pattern over every single grid, pair, L-shape and row of the demo's panels and over all grids, with
/// discs of 20 to 60 mm.
fn every_pattern(seeds: u64) -> usize {
    let rows = patterns::run((1..=seeds, 1), &DISCS_MM, |_, _| true);
    println!(
        "   pattern        disc mm   plans   coverage %   step-over mm   dwell ratio: half, 95 %, all   reviews   faults"
    );
    for ((pattern, disc_mm), row) in &rows {
        println!(
            "   {:13}  {disc_mm:7}  {:6}  {:11.2}  {:13.2}  {:15.2}  {:5.2}  {:5.2}  {:8}  {:7}",
            patterns::PATTERNS[*pattern],
            row.plans,
            100.0 * row.least_coverage,
            row.widest_step_mm,
            row.dwell_ratio(0.5),
            row.dwell_ratio(0.95),
            row.dwell_ratio(1.0),
            row.reviews,
            row.faults.len()
        );
    }
    let faults: Vec<&String> = rows.values().flat_map(|row| &row.faults).collect();
    let least = rows.values().map(|row| row.least_coverage).fold(f64::INFINITY, f64::min);
    let found = format!("{:.1} %", 100.0 * least);
    let is_covered = least >= COVERAGE_MIN && least.is_finite();
    Figure("surface: all patterns and discs: least coverage").report("99.5 %", &found, is_covered);
    let widest_mm = rows.values().map(|row| row.widest_step_mm).fold(0.0, f64::max);
    let is_narrow = widest_mm <= STEP_MAX_MM && widest_mm > 0.0;
    Figure("surface: widest step-over").report("12 mm", &format!("{widest_mm:.2} mm"), is_narrow);
    let plans: usize = rows.values().map(|row| row.plans).sum();
    let found = format!("{} in {plans} plans", faults.len());
    Figure("surface: faults").report("0", &found, faults.is_empty() && plans > 0);
    faults.iter().take(20).for_each(|fault| println!("   {fault}"));
    faults.len()
}

/// Sends valid paths, and the same paths with one defect each, through all acceptance checks.
fn random_paths() -> usize {
    let outcome = gauntlet::run(PATHS);
    println!("   {PATHS} good paths, {} of them refused; and each once with one defect:", outcome.refused.len());
    let mut passed_in_all = 0;
    for (defect, [planted, passed]) in &outcome.planted {
        println!("   {defect}: {planted}, {passed} passed");
        passed_in_all += passed;
    }
    println!("   {} other random paths cannot be followed in any configuration", outcome.infeasible);
    usize::from(!outcome.refused.is_empty()) + usize::from(passed_in_all > 0)
}
