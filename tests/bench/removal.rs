//! Compares the removal model and its schedule with mr-sim and with a finer reference, and tests them on simulated
//! panels whose coefficient is known only from coupons. `cargo bench --bench removal -- [PART…]`, parts `peers`,
//! `finer`, `panels`, `speed`, `published`; without a part, all. `make bench-removal` sets up mr-sim and names its
//! Python in `PANELPREP_PEERS`. Exit code 1 if a target is missed.

#[path = "removal/finer.rs"]
mod finer;
#[path = "goal.rs"]
mod goal;
#[path = "removal/panels.rs"]
mod panels;
#[path = "removal/peers.rs"]
mod peers;
#[path = "removal/scene.rs"]
mod scene;
#[path = "removal/speed.rs"]
mod speed;

use goal::Figure;
use std::process::ExitCode;
use std::time::Instant;

const PARTS: [&str; 5] = ["peers", "finer", "panels", "speed", "published"];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let named: Vec<&str> = PARTS.into_iter().filter(|part| arguments.iter().any(|a| a == part)).collect();
    let mut missed = 0;
    for part in if named.is_empty() { PARTS.to_vec() } else { named } {
        let started = Instant::now();
        println!("== {part}");
        missed += match part {
            "peers" => peers::measure(),
            "finer" => finer::measure(),
            "panels" => panels::measure(),
            "speed" => speed::measure(),
            _ => published(),
        };
        println!("   took {:.1} s", started.elapsed().as_secs_f64());
    }
    if missed == 0 {
        println!("all targets met");
        ExitCode::SUCCESS
    } else {
        println!("{missed} targets missed");
        ExitCode::FAILURE
    }
}

/// Reports that published data cannot be compared. The tables of Technologies 2025, 13, 498 (primer, 20 N, 40 mm/s,
/// 2000 rev/min, P80: 27.5 µm) are pictures. The text contains only one depth, and one value cannot be used both to fit
/// the model and to check it.
fn published() -> usize {
    println!(
        "   not run: of the published tables the one depth of the abstract is in text, the others are in pictures"
    );
    0
}

/// Reports a figure with its maximum; a missing number misses the target.
fn most(figure: Figure, found: f64, most: f64, unit: &str) {
    figure.report(&format!("{most}{unit}"), &format!("{found:.3}{unit}"), found <= most);
}

/// Prints a number with its maximum; returns 1 if it misses the target.
fn held(what: &str, found: f64, most: f64, unit: &str) -> usize {
    let missed = found.is_nan() || found > most;
    println!("   {what}: {found:.3} {unit}, at most {most}{}", if missed { "  MISSED" } else { "" });
    usize::from(missed)
}

/// Prints a number with its minimum; returns 1 if it misses the target.
fn reached(what: &str, found: f64, least: f64, unit: &str) -> usize {
    let missed = found.is_nan() || found < least;
    println!("   {what}: {found:.3} {unit}, at least {least}{}", if missed { "  MISSED" } else { "" });
    usize::from(missed)
}
