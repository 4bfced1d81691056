//! Reports the figures of `tests/bench/README.md`: one line for each figure, which `make bench-table` writes into the
//! table of that page.

use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of figures of this run that missed their goal.
static MISSED: AtomicUsize = AtomicUsize::new(0);

/// Environment variables that change the conditions of a bench. The command of a figure contains those that are set.
const SETTINGS: [&str; 12] = [
    "CELLS",
    "CORRELATED",
    "CYCLES",
    "HELD",
    "INSPECT",
    "KILLS",
    "KRL_WALKS",
    "LINK_WALKS",
    "PANELPREP_REDUCTION",
    "RAYON_NUM_THREADS",
    "RECORDS",
    "SEED",
];

/// A figure of the table, by its name "area: figure". Each name is a literal, because a test compares the names with
/// the rows of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Figure(pub &'static str);

impl Figure {
    /// Reports the measured value with its goal; the goal "–" means that there is no goal. Returns `is_met`.
    pub fn report(self, goal: &str, found: &str, is_met: bool) -> bool {
        self.write(goal, found, if is_met { "ok" } else { "MISSED" });
        is_met
    }

    /// Reports that the figure was not measured because a prerequisite is missing.
    #[allow(dead_code, reason = "most benches need nothing that can be missing")]
    pub fn not_run(self, goal: &str) {
        self.write(goal, "not run", "not run");
    }

    fn write(self, goal: &str, found: &str, state: &str) {
        MISSED.fetch_add(usize::from(state == "MISSED"), Ordering::Relaxed);
        // The build is stated so that times of a debug build are not compared with those of a release build.
        let build = if cfg!(debug_assertions) { " (debug build)" } else { "" };
        let line = format!("GOAL\t{}\t{goal}\t{found}{build}\t{state}\t{}", self.0, command());
        println!("{line}");
        let Some(path) = std::env::var_os("GOALS") else { return };
        // A long bench must not end because its figures cannot be written to the file; each line is also printed.
        if let Err(error) = add(path.as_ref(), &line) {
            eprintln!("{}: the figure cannot be kept for the table: {error}", path.to_string_lossy());
        }
    }
}

/// Returns the number of figures that have missed their goal so far, for the exit code of a bench.
#[allow(dead_code, reason = "most benches count what they miss themselves")]
pub fn missed() -> usize {
    MISSED.load(Ordering::Relaxed)
}

/// Adds a line to the file of figures.
fn add(path: &Path, line: &str) -> std::io::Result<()> {
    std::fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
    writeln!(std::fs::OpenOptions::new().create(true).append(true).open(path)?, "{line}")
}

/// Returns the larger number, or NaN if one of them is NaN, so that a missing number misses its goal.
#[allow(dead_code, reason = "not every bench looks for a worst number")]
pub fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

/// Returns the command that repeats this measurement, in the short form of the table: `NAME -- arguments` is `cargo
/// bench --locked --bench NAME -- arguments`.
fn command() -> String {
    let mut arguments = std::env::args();
    let program = arguments.next().unwrap_or_default();
    let file = program.rsplit('/').next().unwrap_or_default();
    let name = file.rsplit_once('-').map_or(file, |(name, _)| name);
    let rest: Vec<String> = arguments.filter(|argument| argument != "--bench").collect();
    let settings = SETTINGS.iter().filter_map(|name| Some(format!("{name}='{}' ", std::env::var(name).ok()?)));
    let settings: String = settings.collect();
    match (name, rest.is_empty()) {
        ("all", _) => format!("{settings}cargo test --locked --test all -- {}", rest.join(" ")),
        (_, true) => format!("{settings}{name}"),
        _ => format!("{settings}{name} -- {}", rest.join(" ")),
    }
}
