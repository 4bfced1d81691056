//! Runs simulated worlds of many seeds: see `tests/world`. Prints a table of the counts; exit code 1 if a check found a
//! violation. `cargo bench --bench world -- [seeds=N] [from=N] [imagine_every=N]` (power cuts are simulated in each nth
//! world only), one seed with `-- seed=N`, one script with `-- seed=N script='[…]'`; inserted errors: `-- sabotage
//! [seeds=N]`, one of them with `-- mistake='NAME' …`; processes of the system that are killed at any moment: `--
//! kills=N [from=N]`; each nth seed until a check finds a violation or the time is over, without a search for the
//! shortest script, as `tests/bench/mutations.rs` runs it: `-- until-wrong [seeds=N] [from=N] [step=N] [limit_s=N]`,
//! with an inserted error if one is named.

#[path = "arguments.rs"]
mod arguments;
#[path = "goal.rs"]
mod goal;
#[allow(dead_code, reason = "the link's tests use the rest")]
mod link {
    #[path = "../../link/cell.rs"]
    pub mod cell;
    #[path = "../../link/oracles.rs"]
    pub mod oracles;
}
#[path = "../world/mod.rs"]
#[allow(dead_code, unused_imports, reason = "the tests use the rest")]
mod world;

use arguments::{argument, number};
use goal::Figure;
use std::process::ExitCode;
use std::time::Instant;
use world::{Counts, SABOTAGES, Sabotage, World};

/// Goal for the number of cycles per second; it is reported but not enforced, because it depends on the machine.
const CYCLES_A_SECOND: f64 = 200.0;

/// Returns the error to be inserted, if one is requested.
fn requested_mistake() -> Option<Sabotage> {
    let name = argument("mistake")?;
    let known = SABOTAGES.iter().find(|(known, _)| *known == name);
    let (_, sabotage) =
        known.unwrap_or_else(|| panic!("mistake={name}: known are {:?}", SABOTAGES.map(|(known, _)| known)));
    Some(*sabotage)
}

fn main() -> ExitCode {
    use_one_thread();
    if std::env::args().any(|argument| argument == "log") {
        tracing_subscriber::fmt().with_max_level(tracing::Level::DEBUG).without_time().init();
    }
    let (from, count) = match number("seed") {
        Some(seed) => (seed, 1),
        None => (number("from").unwrap_or(0), number("seeds").unwrap_or(2_000)),
    };
    if std::env::args().any(|argument| argument == "sabotage") {
        return sabotage(from, number("seeds").unwrap_or(400));
    }
    if let Some(count) = number("kills") {
        return kills(from, count);
    }
    if std::env::args().any(|argument| argument == "until-wrong") {
        return until_wrong((from, count), number("step").unwrap_or(1), number("limit_s"));
    }
    let begun = Instant::now();
    let mut counts = Counts::default();
    let mut wrong = 0;
    let sabotage = requested_mistake();
    let imagine_every = number("imagine_every").unwrap_or(1).max(1);
    // The pictures and results that all worlds share are computed in the first half of the worlds.
    let warm = from + count / 2;
    let mut before = memory_and_descriptors();
    for seed in from..from + count {
        if seed == warm {
            before = memory_and_descriptors();
        }
        let world = match argument("script") {
            Some(text) => World::with(seed, world::parse(&text).unwrap_or_else(|error| panic!("{error}"))),
            None => World::from_seed(seed),
        };
        let world = World { sabotage, imagines: seed.is_multiple_of(imagine_every), ..world };
        let since = Instant::now();
        let outcome = world.run();
        if argument("times").is_some() {
            println!(
                "seed {seed}: {:.0} ms, {} ms virtual, {} cycles, {} processes",
                since.elapsed().as_secs_f64() * 1e3,
                outcome.counts.time_ms,
                outcome.counts.cycles,
                outcome.counts.lives
            );
        }
        counts.add(&outcome.counts);
        if let Some(violation) = &outcome.violation {
            wrong += 1;
            let shortest = world.shortest(violation.judge);
            let script = world::print(&shortest.script);
            println!("{}: {}\n   seed={seed} script='{script}'", violation.judge, violation.what);
        }
    }
    let wall_s = begun.elapsed().as_secs_f64();
    println!("{counts:#?}");
    let (memory_kb, descriptors) = memory_and_descriptors();
    println!(
        "from the middle on: memory {} to {memory_kb} kB, descriptors {} to {descriptors}",
        before.0, before.1
    );
    let (pictures, bytes) = world::stored_pictures();
    println!("pictures that are kept for all worlds: {pictures}, {} MB", bytes / 1_000_000);
    let grows = count >= 1_000 && (memory_kb > before.0 + before.0 / 4 || descriptors > before.1);
    let (cpu_s, cycles) = (cpu_s(), counts.cycles);
    // Runs with a single seed, a given script or an inserted error measure no figure of the table.
    if number("seed").is_none() && argument("script").is_none() && sabotage.is_none() {
        let found = format!("{wrong} in {count} worlds, {cycles} cycles");
        Figure("world: violations").report("0", &found, wrong == 0 && cycles > 0);
        let rate = cycles as f64 / cpu_s;
        let figure = Figure("world: cycles a second and core");
        figure.report(&CYCLES_A_SECOND.to_string(), &format!("{rate:.0}"), rate >= CYCLES_A_SECOND);
    }
    println!(
        "{wrong} of {count} seeds; {cycles} cycles in {wall_s:.1} s, {cpu_s:.1} s of processor: {:.1} cycles/s and core",
        cycles as f64 / cpu_s
    );
    if wrong == 0 && !grows { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs this number of seeds, each a step above the previous one, until a check finds a violation or the time is over.
fn until_wrong((from, count): (u64, u64), step: u64, limit_s: Option<u64>) -> ExitCode {
    let (begun, sabotage) = (Instant::now(), requested_mistake());
    let is_over = || limit_s.is_some_and(|limit_s| begun.elapsed().as_secs() >= limit_s);
    for seed in (0..count).map(|n| from + n * step).take_while(|_| !is_over()) {
        println!("seed {seed}");
        if let Some(violation) = (World { sabotage, ..World::from_seed(seed) }).run().violation {
            println!("wrong: {}: {}", violation.judge, violation.what);
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

/// Makes parallel loops run in the calling thread, so that a world is one thread and its processor time can be
/// measured.
fn use_one_thread() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().unwrap_or_else(|error| panic!("{error}"));
}

/// Returns the processor time that the process has used so far, s.
fn cpu_s() -> f64 {
    // The 12th and 13th field after the name in brackets, in hundredths of a second.
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// Returns the process's memory, kB, and the number of its open descriptors.
fn memory_and_descriptors() -> (u64, usize) {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kb =
        status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.trim().strip_suffix("kB")?.trim().parse().ok());
    let descriptors = std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count);
    (kb.unwrap_or(0), descriptors)
}

/// Number of worlds that compute the shared pictures and results before the first process is copied.
const KEPT_WORLDS: u64 = 200;

/// Kills processes at random moments.
fn kills(from: u64, count: u64) -> ExitCode {
    // OpenCV's loops would run in threads, which a copy of the process does not have.
    opencv::core::set_num_threads(0).unwrap_or_else(|error| panic!("{error}"));
    for seed in 0..KEPT_WORLDS.min(count) {
        World::from_seed(seed).run();
    }
    let begun = Instant::now();
    let killed = world::kills(from, count, requested_mistake());
    for (seed, violation) in &killed.violations {
        println!("seed {seed}: {}: {}", violation.judge, violation.what);
    }
    if requested_mistake().is_none() {
        let found = format!("{} in {}", killed.violations.len(), killed.kills);
        let is_met = killed.violations.is_empty() && killed.kills > 0;
        Figure("world: violations in killed processes").report("0", &found, is_met);
    }
    println!(
        "{} kills, {} processes that ended before; {} stores, {} acknowledgements; {:.1} s; {} wrong",
        killed.kills,
        killed.ended,
        killed.stores,
        killed.acknowledged,
        begun.elapsed().as_secs_f64(),
        killed.violations.len()
    );
    if killed.violations.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs worlds with each inserted error; prints the number of seeds until it was found.
fn sabotage(from: u64, seeds: u64) -> ExitCode {
    let mut missed = 0;
    for (name, sabotage) in SABOTAGES {
        let found = (from..from + seeds).find_map(|seed| {
            let violation = World::from_seed(seed).sabotaged(sabotage).run().violation?;
            Some((seed, violation))
        });
        match found {
            Some((seed, violation)) => {
                println!("found after {} seeds: {name} ({}: {})", seed - from + 1, violation.judge, violation.what);
            }
            None => {
                missed += 1;
                println!("not found in {seeds} seeds: {name}");
            }
        }
    }
    println!("{} of {} found", SABOTAGES.len() - missed, SABOTAGES.len());
    ExitCode::SUCCESS
}
