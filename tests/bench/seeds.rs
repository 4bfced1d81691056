//! From rendering to the planned path for ten seeds, against the renderer's truth: a table, and exit code 1 where a
//! floor is missed. `cargo bench --bench seeds -- [SEEDS] [REDUCTION]`

use serde_json::Value;
use std::process::{Command, ExitCode};

/// What each seed must reach.
const LOCATED_MAX_MM: f64 = 5.0;
const CORNER_MAX_MM: f64 = 0.5;
const COVERAGE_MIN: f64 = 0.95;
const NORMAL_MAX_DEG: f64 = 1.0;

fn demo(seed: u64, scene: &str, reduction: u64) -> Value {
    let folder = std::env::temp_dir().join(format!("panelprep-bench-{}", std::process::id()));
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["demo", "--json", "--scene", scene, "--seed", &seed.to_string()])
        .args(["--reduction", &reduction.to_string(), "--out"])
        .arg(&folder)
        .output()
        .expect("the program starts");
    // Best effort: what stays behind is in the system's own folder for such things.
    let _ = std::fs::remove_dir_all(&folder);
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

fn main() -> ExitCode {
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<u64>().ok());
    let (seeds, reduction) = (numbers.next().unwrap_or(10), numbers.next().unwrap_or(1));
    println!(
        "seed  verdict  located mm (mean, max)  ms   corner mm  refined max mm  iou    grids failed/true/wrong  ms/frame  \
         coverage  normal °  surface mm  wall s"
    );
    let mut missed = 0;
    for seed in 1..=seeds {
        let result = demo(seed, "good", reduction);
        missed += usize::from(!row(seed, &result));
    }
    for scene in ["clean", "no-panel", "wrong-panel"] {
        let result = demo(1, scene, reduction);
        let expected = if scene == "clean" { "pass" } else { "reject" };
        println!("{scene}: {} {}", result["verdict"], result["reasons"]);
        missed += usize::from(result["verdict"] != expected);
    }
    println!("{missed} of {} missed a floor", seeds + 3);
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Prints a seed's row; false where it misses a floor.
fn row(seed: u64, result: &Value) -> bool {
    let number = |pointer: &str| result.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    println!(
        "{seed:4}  {:7}  {:10.3} {:10.3}  {:5.0}  {:9.3}  {:14.3}  {:.3}  {:12} / {} / {}  {:14.1}  {:8.3}  {:8.2}  {:10.3}  {:6.1}",
        result["verdict"].as_str().unwrap_or("-"),
        number("/locate/error_mean_mm"),
        number("/locate/error_max_mm"),
        number("/locate/elapsed_ms"),
        number("/refine/corner_error_mm"),
        number("/refine/error_max_mm"),
        number("/inspect/0/iou"),
        number("/inspect/0/grids_failed"),
        number("/inspect/0/grids_true"),
        number("/inspect/0/grids_wrong"),
        number("/inspect/0/ms_per_frame"),
        number("/plan/coverage"),
        number("/plan/normal_error_max_deg"),
        number("/plan/surface_error_max_mm"),
        number("/wall_s"),
    );
    result["verdict"] == "accept"
        && number("/locate/error_max_mm") <= LOCATED_MAX_MM
        && number("/refine/corner_error_mm") <= CORNER_MAX_MM
        && number("/inspect/0/grids_wrong") == 0.0
        && number("/inspect/0/grids_true") > 0.0
        && number("/plan/coverage") >= COVERAGE_MIN
        && number("/plan/normal_error_max_deg") <= NORMAL_MAX_DEG
}
