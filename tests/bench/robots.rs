//! Runs the live demo with arms that differ from their nominal geometry, with and without the arm's calibration, and
//! compares the results with the simulator's ground truth. Prints a table of the targets that are met and missed; exit
//! code 1 if a corrected arm misses a target. `cargo bench --bench robots -- [SEEDS] [REDUCTION]`

#[path = "goal.rs"]
mod goal;

use goal::{Figure, larger};
use serde_json::Value;
use std::process::{Command, ExitCode};

/// Rms deviation of the tool from its nominal pose for each arm, mm: very accurate, good, typical, bad.
const ARMS_MM: [f64; 4] = [0.02, 0.1, 0.5, 1.6];
/// Maximum error of a corrected arm at a touched point, mm.
const TOUCH_MAX_MM: f64 = 0.3;
/// Maximum distance of the executed path from the true surface, mm.
const SURFACE_MAX_MM: f64 = 0.5;
/// Maximum error of the refined pose over the panel, mm.
const REFINED_MAX_MM: f64 = 0.5;
/// Minimum covered fraction of the treated area.
const COVERAGE_MIN: f64 = 0.95;

fn demo(seed: u64, reduction: u64, arm_mm: f64, uncorrected: bool) -> Value {
    let folder = std::env::temp_dir().join(format!("panelprep-robots-{}", std::process::id()));
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["demo", "--json", "--seed", &seed.to_string(), "--reduction", &reduction.to_string()])
        .args(["--arm-error-mm", &arm_mm.to_string()])
        .args(uncorrected.then_some("--uncorrected"))
        .arg("--out")
        .arg(&folder)
        .output()
        .expect("the program starts");
    // The result is ignored: a leftover folder is inside of the system's folder for temporary files.
    let _ = std::fs::remove_dir_all(&folder);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| {
        println!("{}", String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or_default());
        Value::Null
    })
}

/// The worst results of the corrected arms, mm; NaN if a result is missing.
#[derive(Default)]
struct Worst {
    touch_mm: f64,
    surface_mm: f64,
    refined_mm: f64,
}

/// Prints a row and adds the results of a corrected arm; returns false if a corrected arm misses a target.
fn row(seed: u64, arm_mm: f64, uncorrected: bool, result: &Value, worst: &mut Worst) -> bool {
    let number = |pointer: &str| result.pointer(pointer).and_then(Value::as_f64).unwrap_or(f64::NAN);
    let abrade = result["abrade"].as_array().cloned().unwrap_or_default();
    let of = |name: &str| abrade.iter().map(|pass| pass[name].as_f64().unwrap_or(f64::NAN)).collect::<Vec<_>>();
    let largest = |name: &str| of(name).into_iter().fold(f64::NAN, f64::max);
    let coverage = of("coverage").into_iter().fold(f64::NAN, f64::min);
    let (touch, refined) = (number("/verified/tool_mm"), number("/refine/error_max_mm"));
    let surface = largest("surface_error_max_mm");
    let is_right = touch <= TOUCH_MAX_MM
        && refined <= REFINED_MAX_MM
        && surface <= SURFACE_MAX_MM
        && coverage >= COVERAGE_MIN
        && result["verdict"] == "pass";
    // An uncorrected arm that is rejected after its check by touching has not sanded and has done no harm.
    let is_refused = uncorrected && result["verdict"] == "reject" && abrade.is_empty();
    let state = match (is_right, is_refused, uncorrected) {
        (true, ..) => "ok",
        (_, true, _) => "refused",
        (.., true) => "does not hold",
        _ => "MISSED",
    };
    println!(
        "{seed:4}  {arm_mm:6.2}  {:11}  {:7}  {touch:8.3}  {:8.3} {refined:8.3}  {surface:8.3} {:8.3} {coverage:8.3}  {state}",
        if uncorrected { "no" } else { "yes" },
        result["verdict"].as_str().unwrap_or("none"),
        number("/locate/error_max_mm"),
        largest("normal_error_max_deg"),
    );
    if !uncorrected {
        worst.touch_mm = larger(worst.touch_mm, touch);
        worst.surface_mm = larger(worst.surface_mm, surface);
        worst.refined_mm = larger(worst.refined_mm, refined);
    }
    is_right || uncorrected
}

fn main() -> ExitCode {
    let mut numbers = std::env::args().skip(1).filter_map(|argument| argument.parse::<u64>().ok());
    let (seeds, reduction) = (numbers.next().unwrap_or(5), numbers.next().unwrap_or(2));
    println!(
        "seed  arm mm  calibrated   verdict  touched corners, mm  located, refined mm  contact: surface mm, \
         normal deg, coverage"
    );
    let (mut missed, mut all, mut worst) = (0, 0, Worst::default());
    for arm_mm in ARMS_MM {
        for seed in 1..=seeds {
            for uncorrected in [true, false] {
                all += 1;
                let result = demo(seed, reduction, arm_mm, uncorrected);
                missed += usize::from(!row(seed, arm_mm, uncorrected, &result, &mut worst));
            }
        }
    }
    for (figure, found, most) in [
        (Figure("robots: corrected arms: touch"), worst.touch_mm, TOUCH_MAX_MM),
        (Figure("robots: contact"), worst.surface_mm, SURFACE_MAX_MM),
        (Figure("robots: panel after refinement, worst"), worst.refined_mm, REFINED_MAX_MM),
    ] {
        figure.report(&format!("{most} mm"), &format!("{found:.3} mm"), found <= most);
    }
    println!("{missed} of {all} missed a floor");
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
