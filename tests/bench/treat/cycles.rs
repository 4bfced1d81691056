//! Whole cycles. The area and the time are those of the path that the mock controller executed; a break remains if the
//! true film is broken in the last picture of the last film.

use super::arguments;
use super::goal::Figure;
use serde_json::Value;
use std::process::Command;
use std::time::{Duration, Instant};

/// Maximum ratio of the area, and of the time, of a cycle with areas around breaks to those of a cycle with whole
/// grids.
const MAX_COST_RATIO: f64 = 1.0;
/// Maximum relative difference between the times of two equal paths, because the controller's log contains times of a
/// real clock.
const MAX_CLOCK_DIFFERENCE: f64 = 0.01;
/// Maximum relative difference between the areas of two equal paths, because the log is sampled.
const MAX_SAMPLING_DIFFERENCE: f64 = 0.005;

/// The result of one cycle.
struct Ran {
    verdict: String,
    films: usize,
    /// Sanded surface, mm², summed over the passes.
    sanded_mm2: f64,
    /// Time of the paths, from the first waypoint to the last one, s.
    path_s: f64,
    /// Number of grids with a true break in the first film, and in the last film.
    broken: [Option<u64>; 2],
    /// Whether grids of the last film were judged wrongly.
    is_wrong: bool,
}

impl Ran {
    fn print(&self, seed: u64, by: &str) {
        let [first, last] = self.broken.map(|count| count.map_or("-".to_owned(), |count| count.to_string()));
        println!(
            "{seed:4}  {by:5}  {:7}  {:5}  {first:>12}, {last:>4}  {:18.0}  {:6.1}",
            self.verdict, self.films, self.sanded_mm2, self.path_s
        );
    }
}

fn cycle(seed: u64, reduction: u64, by: &str) -> Ran {
    let folder = std::env::temp_dir().join(format!("panelprep-bench-treat-{}", std::process::id()));
    let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["demo", "--json", "--tool", "spring", "--treat", by, "--seed", &seed.to_string()])
        .args(["--reduction", &reduction.to_string(), "--out"])
        .arg(&folder)
        .output()
        .expect("the program starts");
    // The result is ignored: a leftover folder is inside of the system's folder for temporary files.
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
        is_wrong: films.last().is_none_or(|film| film["grids_wrong"] != 0),
    }
}

/// The pairs of cycles that can be compared: both passed, and both sanded.
#[derive(Default)]
struct Compared {
    /// Ratios of area and time around breaks to those with whole grids.
    ratios: Vec<[f64; 2]>,
    /// Sums of area, mm², and time, s: with whole grids, and around breaks.
    sums: [[f64; 2]; 2],
}

impl Compared {
    fn add(&mut self, [by_grid, by_break]: [&Ran; 2]) {
        if by_grid.verdict != "pass" || by_break.verdict != "pass" || by_grid.films < 2 {
            return;
        }
        let numbers = [by_grid, by_break].map(|ran| [ran.sanded_mm2, ran.path_s]);
        self.ratios.push([0, 1].map(|number| numbers[1][number] / numbers[0][number]));
        for (sum, ran) in self.sums.iter_mut().zip(numbers) {
            *sum = [sum[0] + ran[0], sum[1] + ran[1]];
        }
    }

    fn report(&self, ran: u64) -> bool {
        let count = self.ratios.len();
        let [area, time] = [0, 1].map(|number| self.sums[1][number] / self.sums[0][number]);
        let below = self.ratios.iter().filter(|[area, _]| *area < 1.0 - MAX_SAMPLING_DIFFERENCE).count();
        let largest = [0, 1].map(|number| self.ratios.iter().map(|both| both[number]).fold(f64::NAN, f64::max));
        let found = format!("{area:.2} of whole grids in {count} of {ran} cycles, less in {below}");
        let is_less =
            Figure("treat: area under the disc, around breaks").report("1", &found, area <= MAX_COST_RATIO);
        let is_faster = Figure("treat: time of the paths around breaks").report(
            "1",
            &format!("{time:.2}"),
            time <= MAX_COST_RATIO + MAX_CLOCK_DIFFERENCE,
        );
        let is_never_more = Figure("treat: largest area and time of a cycle, around breaks").report(
            "1",
            &format!("{:.2} and {:.2}", largest[0], largest[1]),
            largest[0] <= MAX_COST_RATIO + MAX_SAMPLING_DIFFERENCE
                && largest[1] <= MAX_COST_RATIO + MAX_CLOCK_DIFFERENCE,
        );
        is_less && is_faster && is_never_more
    }
}

/// Runs the cycles of these seeds; returns whether every target is met.
pub fn measure(seeds: u64, reduction: u64) -> bool {
    let from = arguments::number("from").unwrap_or(1);
    let until = arguments::number("minutes").map(|minutes| Instant::now() + Duration::from_secs(60 * minutes));
    println!("seed  by     verdict  films  broken first, last  under the disc mm²  path s");
    let (mut compared, mut left, mut count) = (Compared::default(), 0, 0);
    for seed in from..from + seeds {
        if until.is_some_and(|until| Instant::now() > until) {
            break;
        }
        count += 1;
        let [by_grid, by_break] = ["grid", "break"].map(|by| cycle(seed, reduction, by));
        by_grid.print(seed, "grid");
        by_break.print(seed, "break");
        let is_left = by_break.verdict == "pass" && (by_break.broken[1] != Some(0) || by_break.is_wrong);
        left += usize::from(is_left);
        compared.add([&by_grid, &by_break]);
    }
    let is_less = compared.report(count);
    let found = format!("{left} of {count} cycles");
    let is_none = Figure("treat: cycles that passed with a break left").report("0", &found, left == 0);
    is_less && is_none
}
