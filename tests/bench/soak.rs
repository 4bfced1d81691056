//! Runs a service for hours under all loads at once. Cycles run one after the other, each recorded, and an operator
//! holds, stops and aborts some of them. Other clients read the page and its events, poll the socket, or open
//! connections that are silent or send half a request. The service's memory and descriptors must not grow, and it must
//! report to systemd's watchdog at least twice as often as required. Exit code 1 if one of these fails, a request was
//! never answered, or the service ended by itself. `cargo bench --bench soak -- [minutes=120] [report_s=60]
//! [pace=wall|line] [program=FILE]`
//!
//! In real time (`pace=wall`) the robot's controller is another process (`panelprep mock-robot`), and its panel is
//! greasy only in the first cycle. With `pace=line` a simulated production line brings greasy parts in lock step, so
//! that there are many more cycles, each with sanding. These cannot be recorded. The simulated controller is then a
//! part of the service and keeps the log of all its motions (0.3 MB per cycle), so its memory is reported but not
//! checked. `program` is another build of the program.

#[path = "arguments.rs"]
mod arguments;
#[path = "service/asking.rs"]
mod asking;
#[path = "service/cell.rs"]
#[allow(dead_code, reason = "the bench of the cable uses the rest")]
mod cell;
#[path = "soak/clients.rs"]
mod clients;
#[path = "goal.rs"]
mod goal;
#[path = "soak/http.rs"]
mod http;
#[path = "soak/numbers.rs"]
mod numbers;
#[path = "soak/operator.rs"]
mod operator;
#[path = "../commands/taught.rs"]
mod taught;
#[path = "service/watchdog.rs"]
mod watchdog;

use arguments::{argument, number};
use cell::{Pace, Running};
use clients::Counts;
use goal::Figure;
use numbers::{Growth, Period, Sample};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Interval between two samples of the process. It is short because memory is freed at the end of a cycle, and the next
/// cycle may begin at once.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(100);
/// Maximum growth of the memory that the process keeps, as a fraction of its size per hour. If a picture of 400 kB
/// remained in memory from each of about 180 cycles, the growth would be more than thirty times as large. The store's
/// page cache and the allocator's free lists are full after the first half, which is not checked.
const MAX_GROWTH_PER_HOUR: f64 = 0.01;
/// Minimum slope that is treated as growth, in units of its standard error.
const MIN_SLOPE_ERRORS: f64 = 3.0;

fn main() -> ExitCode {
    let (minutes, report_s) = (number("minutes").unwrap_or(120), number("report_s").unwrap_or(60).max(1));
    let program = argument("program").unwrap_or_else(|| env!("CARGO_BIN_EXE_panelprep").to_owned());
    let pace = match argument("pace").as_deref() {
        None | Some("wall") => Pace::Wall,
        Some("line") => Pace::Line,
        Some(other) => panic!("pace={other}: valid: wall, line"),
    };
    let prepared = cell::prepare(program.as_ref(), pace);
    let counts = Counts::default();
    let (mut running, watchdog) = Running::start(&prepared);
    println!(
        "{minutes} minutes; the watchdog allows {:.1} s without a signal",
        watchdog::WATCHDOG_TIMEOUT.as_secs_f64()
    );
    let periods = std::thread::scope(|scope| {
        let _ends = counts.ends_with_this();
        operator::spawn(scope, &prepared, &counts);
        clients::spawn(scope, &prepared, &counts);
        let begun = Instant::now();
        let mut periods = Vec::new();
        while begun.elapsed() < Duration::from_secs(minutes * 60) && running.is_alive() {
            let since = Instant::now();
            let mut samples = Vec::new();
            while since.elapsed() < Duration::from_secs(report_s) && running.is_alive() {
                samples.extend(Sample::read(running.id()));
                std::thread::sleep(SAMPLE_INTERVAL);
            }
            let Some(period) = Period::from_samples(begun.elapsed(), &samples) else { break };
            println!(
                "{period}, {} cycles, largest watchdog gap {:.2} s, store {:.0} MB",
                counts.cycles(),
                watchdog.largest_gap().as_secs_f64(),
                prepared.store_bytes() as f64 / 1e6
            );
            periods.push(period);
        }
        periods
    });
    judge((&periods, pace), &counts, &watchdog, running.ended_by_itself())
}

/// Prints the results, each with its limit.
fn judge(
    (periods, pace): (&[Period], Pace),
    counts: &Counts,
    watchdog: &watchdog::Watchdog,
    ended: Option<String>,
) -> ExitCode {
    println!("{counts}");
    let settled = &periods[periods.len() / 2..];
    let mut holds = true;
    let mut reported = |is_met: bool, text: String| {
        holds &= is_met;
        println!("{text}{}", if is_met { "" } else { "  NOT MET" });
    };
    for (name, unit, least, value) in Period::LOWEST {
        let Some(growth) = Growth::fit(settled, value) else {
            reported(false, format!("{name}: there are too few periods for a slope"));
            continue;
        };
        // Memory may grow by a fraction of its size; for descriptors and threads, a single one that is not released is
        // too many.
        let most = least.unwrap_or(MAX_GROWTH_PER_HOUR * growth.mean);
        let grows = growth.an_hour > most && growth.an_hour > MIN_SLOPE_ERRORS * growth.standard_error;
        let text = format!(
            "{name}, smallest value of each period of the second half: {:.0} {unit}, slope {:+.2} ± {:.2} {unit} an hour (most {most:.2})",
            growth.mean, growth.an_hour, growth.standard_error
        );
        if least.is_none() && pace == Pace::Wall {
            let (an_hour, error, mean) = (growth.an_hour / 1e3, growth.standard_error / 1e3, growth.mean / 1e3);
            let found = format!("{an_hour:+.1} ± {error:.1} MB at {mean:.0} MB");
            let goal = format!("{} %", 100.0 * MAX_GROWTH_PER_HOUR);
            Figure("service: growth of memory in an hour").report(&goal, &found, !grows);
        }
        reported(!grows || (least.is_none() && pace == Pace::Line), text);
    }
    let (gap, half) = (watchdog.largest_gap().as_secs_f64(), watchdog::WATCHDOG_TIMEOUT.as_secs_f64() / 2.0);
    reported(watchdog.signs() > 0 && gap <= half, format!("largest watchdog gap {gap:.3} s (most {half:.3} s)"));
    let unanswered = counts.unanswered();
    let is_met = unanswered == 0 && counts.cycles() > 0;
    Figure("service: under load: unanswered requests").report("0", &unanswered.to_string(), is_met);
    let is_fed = watchdog.signs() > 0 && gap <= half;
    Figure("service: watchdog gap").report(&format!("{half} s"), &format!("{gap:.2} s"), is_fed);
    reported(counts.unanswered() == 0, format!("requests that were never answered: {}", counts.unanswered()));
    reported(ended.is_none(), ended.unwrap_or_else(|| "the service ran until the end".to_owned()));
    reported(counts.cycles() > 0, format!("cycles: {}", counts.cycles()));
    if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
