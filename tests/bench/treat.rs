//! Whole cycles on the simulated cell with areas around breaks (`[treat] by = "break"`), beside the same cycles with
//! whole grids: the area that was under the disc, the time of the paths, and the breaks that are left at the end.
//! `cargo bench --bench treat -- seeds=60 from=1 reduction=4`; exit code 1 if a target is missed.
//!
//! Each seed is one panel with its own greasy spots, and two films or more. The numbers are the simulator's: the area and
//! the time are those of the path that the mock controller executed, and a break is left if the film truly broke in the
//! last picture of the last film.

#[path = "arguments.rs"]
mod arguments;
#[path = "goal.rs"]
mod goal;

use goal::Figure;
use serde_json::Value;
use std::process::{Command, ExitCode};

/// A cycle with areas around breaks should sand less than one with whole grids.
const MOST_OF_AREA: f64 = 1.0;

/// The result of one cycle.
struct Ran {
    verdict: String,
    films: usize,
    /// Surface under the disc, mm², summed over the passes.
    sanded_mm2: f64,
    /// Time of the paths in contact, s.
    path_s: f64,
    /// Grids that were truly broken in the first film, and in the last one.
    broken: [Option<u64>; 2],
    /// Truly broken grids of the last film that this film did not find.
    missed: bool,
}

fn cycle(seed: u64, reduction: u64, by: &str) -> Ran {
    let folder = std::env::temp_dir().join(format!("panelprep-bench-treat-{}", std::process::id()));
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["demo", "--json", "--tool", "spring", "--treat", by, "--seed", &seed.to_string()])
        .args(["--reduction", &reduction.to_string(), "--out"])
        .arg(&folder)
        .output()
        .expect("the program starts");
    // Best effort: leftover files are in the system's folder for temporary files.
    let _ = std::fs::remove_dir_all(&folder);
    let result: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let list = |name: &str| result[name].as_array().cloned().unwrap_or_default();
    let (films, paths) = (list("inspect"), list("abrade"));
    let sum = |key: &str| paths.iter().map(|path| path[key].as_f64().unwrap_or(f64::NAN)).sum();
    let broken = |film: Option<&Value>| film.and_then(|film| film["grids_true"].as_u64());
    Ran {
        verdict: result["verdict"].as_str().unwrap_or("-").to_owned(),
        films: films.len(),
        sanded_mm2: sum("sanded_mm2"),
        path_s: sum("path_s"),
        broken: [broken(films.first()), broken(films.last())],
        missed: films.last().is_none_or(|film| film["grids_wrong"] != 0),
    }
}

fn main() -> ExitCode {
    let (seeds, from) = (arguments::number("seeds").unwrap_or(60), arguments::number("from").unwrap_or(1));
    let reduction = arguments::number("reduction").unwrap_or(4);
    println!("seed  by     verdict  films  broken first, last  under the disc mm²  path s");
    let (mut sums, mut left, mut compared) = ([[0.0; 2]; 2], 0, 0);
    for seed in from..from + seeds {
        let ran = ["grid", "break"].map(|by| (by, cycle(seed, reduction, by)));
        for (by, ran) in &ran {
            let shown = ran.broken.map(|count| count.map_or("-".to_owned(), |count| count.to_string()));
            println!(
                "{seed:4}  {by:5}  {:7}  {:5}  {:>12}, {:>4}  {:18.0}  {:6.1}",
                ran.verdict, ran.films, shown[0], shown[1], ran.sanded_mm2, ran.path_s
            );
        }
        let [(_, by_grid), (_, by_break)] = &ran;
        // A cycle that does not come to a second film has shown nothing about its breaks.
        let is_missed = by_break.verdict == "pass" && (by_break.broken[1] != Some(0) || by_break.missed);
        left += usize::from(is_missed);
        if by_grid.verdict == "pass" && by_break.verdict == "pass" && by_grid.films > 1 {
            compared += 1;
            for (sum, ran) in sums.iter_mut().zip([by_grid, by_break]) {
                *sum = [sum[0] + ran.sanded_mm2, sum[1] + ran.path_s];
            }
        }
    }
    let [area, time] = [0, 1].map(|number| sums[1][number] / sums[0][number]);
    let of = format!("of whole grids, {compared} of {seeds} cycles");
    let is_less = Figure("treat: area under the disc, around breaks").report(
        &format!("{MOST_OF_AREA}"),
        &format!("{area:.2} {of}"),
        area <= MOST_OF_AREA,
    );
    Figure("treat: time of the paths around breaks").report("–", &format!("{time:.2} {of}"), true);
    let found = format!("{left} of {seeds} cycles");
    let is_none = Figure("treat: cycles that passed with a break left").report("0", &found, left == 0);
    if is_less && is_none { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
