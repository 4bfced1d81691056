//! Injects faults into the messages between two processes, the service and the controller. A TCP proxy of this bench
//! carries both channels, and at one moment of a cycle it changes messages: the injected fault. Whole cycles run in
//! real time, in several cells in parallel. Exit code 1 on any violation; a scenario whose fault was never injected is
//! counted as such and never as passed. `cargo bench --bench cable -- [scenarios=316] [cells=6] [seed=1] [net=77]
//! [only=N] [keep=FOLDER] [tried=WORD] [program=FILE]`
//!
//! All checks are based on the controller's own reports or on facts outside of the service. `cable/judges.rs` checks
//! the arm, its outputs, the stops that a person requests and the verdicts. This file checks the rest. After the fault,
//! `clear`, `reset` and `start` succeed, and a whole cycle without a fault reaches the state complete. Each verdict has
//! its signed record and its page, and `panelprep store verify` finds no problem. The service continues to run, has not
//! panicked and reports to its watchdog.
//!
//! Not every fault can be detected: the messages contain counts and epochs, and each number has its range, but a
//! message has no checksum. TCP has a checksum, so a real cable does not produce a value that is wrong but valid
//! (another waypoint within range, an input's bit). Such faults are injected nevertheless, because they must not do any
//! harm: the requirements of the checks must be met, and the cell must recover. A fault that a cycle does not detect is
//! counted as unnoticed, which is not a violation.
//!
//! Each cell has two addresses of its own, 127.net.place.1 and .2; parallel runs therefore need different values of
//! `net`. `tried` tests the checks themselves (its values are in `cable/tried.rs`): the controller's reports are
//! changed before they are checked, and each change must be found. `keep` writes all messages to a folder.

#[path = "arguments.rs"]
mod arguments;
#[path = "service/asking.rs"]
mod asking;
#[path = "service/cell.rs"]
#[allow(dead_code, reason = "the soak uses the rest")]
mod cell;
#[path = "cable/course.rs"]
mod course;
#[path = "cable/draw.rs"]
mod draw;
#[path = "goal.rs"]
mod goal;
#[path = "cable/judges.rs"]
mod judges;
#[path = "cable/liar.rs"]
mod liar;
#[path = "cable/lie.rs"]
mod lie;
#[path = "cable/message.rs"]
mod message;
#[path = "cable/person.rs"]
mod person;
#[path = "cable/proxy.rs"]
mod proxy;
#[path = "cable/table.rs"]
mod table;
#[path = "../commands/taught.rs"]
mod taught;
#[path = "cable/tried.rs"]
mod tried;
#[path = "cable/truth.rs"]
mod truth;
#[path = "service/watchdog.rs"]
mod watchdog;

use arguments::{argument, number};
use cell::{OTHER_PORTS, Pace, Prepared, Running};
use course::Course;
use goal::Figure;
use liar::FaultInjector;
use lie::{Moment, Scenario};
use person::Person;
use proxy::Proxy;
use std::fmt::Write as _;
use std::net::{IpAddr, Ipv4Addr};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use table::{Outcome, Table};
use tried::ReportChange;
use truth::{Side, Truth};

/// Number of scenarios: all pairs of kinds of faults and moments, and more than a hundred additional ones.
const SCENARIOS: u64 = 316;
/// Interval between the starts of the cells, so that they do not all compute at the same moment.
const START_INTERVAL: Duration = Duration::from_millis(2_500);

fn main() -> ExitCode {
    let seed = number("seed").unwrap_or(1);
    let numbers = number("only").map_or_else(|| 0..number("scenarios").unwrap_or(SCENARIOS), |only| only..only + 1);
    let program = argument("program").unwrap_or_else(|| env!("CARGO_BIN_EXE_panelprep").to_owned());
    let prepared = cell::prepare(program.as_ref(), Pace::Wall);
    let (next, table, begun) = (AtomicU64::new(numbers.start), Mutex::new(Table::default()), Instant::now());
    std::thread::scope(|scope| {
        for place in 0..number("cells").unwrap_or(6).clamp(1, 100) as u8 {
            let (next, table, prepared, end) = (&next, &table, &prepared, numbers.end);
            scope.spawn(move || {
                std::thread::sleep(START_INTERVAL * u32::from(place));
                loop {
                    let number = next.fetch_add(1, Ordering::SeqCst);
                    if number >= end {
                        return;
                    }
                    let scenario = Scenario::drawn(seed, number);
                    let outcome = run_scenario(prepared, place, &scenario);
                    println!("{:6.1} min {}", begun.elapsed().as_secs_f64() / 60.0, line(&scenario, &outcome));
                    table.lock().unwrap_or_else(PoisonError::into_inner).add(scenario.lie.kind, &outcome);
                }
            });
        }
    });
    let table = table.into_inner().unwrap_or_else(PoisonError::into_inner);
    // With `tried`, the changed reports test the checks; the findings are not figures of the service.
    if argument("tried").is_none() {
        let (violations, scenarios, worst_ms) = (table.violations(), table.scenarios(), table.worst_stop_ms());
        let found = format!("{violations} in {scenarios} scenarios");
        Figure("service: cable: violations").report("0", &found, violations == 0 && scenarios > 0);
        let goal = format!("{:.0} ms", judges::STOP_MS);
        let is_met = worst_ms > 0.0 && worst_ms <= judges::STOP_MS;
        Figure("service: longest stop").report(&goal, &format!("{worst_ms:.0} ms"), is_met);
    }
    println!("{table}a stop must stop within {:.0} ms", judges::STOP_MS);
    if table.violations() == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Returns one line for the scenario, and one line for each of its violations.
fn line(scenario: &Scenario, outcome: &Outcome) -> String {
    let sent = if outcome.sent == 0 { "NOT SENT".to_owned() } else { format!("sent {}", outcome.sent) };
    let stop = outcome.worst_stop_ms.map(|ms| format!(", stop {ms:.0} ms")).unwrap_or_default();
    let mut text = format!("{scenario}: {sent}, {}{stop}", outcome.verdicts.join(" "));
    for violation in &outcome.violations {
        let _ = write!(text, "\n    VIOLATION {scenario}: {violation}");
    }
    text
}

/// Runs one scenario in a cell of its own.
fn run_scenario(prepared: &Prepared, place: u8, scenario: &Scenario) -> Outcome {
    let net = number("net").unwrap_or(77) as u8;
    let [sought, controller] = [1, 2].map(|last| IpAddr::V4(Ipv4Addr::new(127, net, place, last)));
    let cell = prepared.copied(sought, controller);
    let truth = Arc::new(Truth::new());
    let liar = Arc::new(FaultInjector::new(scenario.draw.clone()));
    let proxy = Proxy::start(sought, controller, OTHER_PORTS, &liar, &truth);
    let mut course =
        Course { person: Person::new(&cell, &truth), truth: &truth, liar: &liar, proxy: &proxy, scenario };
    if scenario.moment == Moment::Connect && !course.begins_late() {
        liar.begin(&scenario.lie);
    }
    let scene = if scenario.needs_contact() { "--scene good" } else { "--scene clean" };
    let (mut running, watchdog) = Running::start_with(&cell, scene);
    let ran = course.run();
    let mut violations: Vec<String> = ran.err().into_iter().chain(running.ended_by_itself()).collect();
    let gap = watchdog.largest_gap();
    if gap > watchdog::WATCHDOG_TIMEOUT {
        violations.push(format!("no watchdog signal was sent for {:.1} s", gap.as_secs_f64()));
    }
    violations.extend(check_store(&cell, &course));
    let (mut events, mut stops_ms) = (truth.events(), judges::logged_stops(&cell.controller_log()));
    if let Some(folder) = argument("keep") {
        write_messages(&folder, scenario, &events, &course, &cell);
    }
    if let Some(tried) = argument("tried").map(|word| ReportChange::named(&word)) {
        events = tried.changed(events);
        stops_ms.retain(|_| tried != ReportChange::Stop);
    }
    let judged = judges::judge((&events, &stops_ms), &scenario.lie, &course.person.orders, &course.person.cycles);
    violations.extend(judged.violations);
    Outcome {
        sent: liar.count(),
        verdicts: course.person.cycles.values().filter_map(|cycle| cycle.verdict.clone()).collect(),
        pressed: u64::from(scenario.press.is_some()),
        worst_stop_ms: judged.worst_stop_ms,
        unnoticed: judged.unnoticed,
        violations,
    }
}

/// Checks the records, the pages, the chain of the store, and the service's log.
fn check_store(cell: &Prepared, course: &Course<'_>) -> Vec<String> {
    // The page of a cycle is created after the end of the cycle.
    let patience = Instant::now();
    let missing = || {
        let log = cell.log();
        let ended = course.person.cycles.iter().filter(|(_, cycle)| cycle.verdict.is_some());
        let lacks = ended.flat_map(|(id, _)| {
            let page = cell.in_folder(&format!("cell/store/reports/cycle-{id:06}.html")).is_file();
            let record = log.contains(&format!("the record of cycle {id} was signed"));
            [
                (!page).then(|| format!("cycle {id} has no page")),
                (!record).then(|| format!("cycle {id} has no record")),
            ]
        });
        lacks.flatten().collect::<Vec<_>>()
    };
    while !missing().is_empty() && patience.elapsed() < Duration::from_secs(5) {
        std::thread::sleep(Duration::from_millis(100));
    }
    let mut found = missing();
    found.extend(cell.run("store verify --cell cell/cell.toml").err());
    if cell.log().contains("panicked") {
        found.push("the service has panicked".to_owned());
    }
    found
}

/// Writes all messages, the person's requests, and the logs of service and controller.
fn write_messages(
    folder: &str,
    scenario: &Scenario,
    events: &[truth::Event],
    course: &Course<'_>,
    cell: &Prepared,
) {
    let mut text = format!("{scenario}\n{:?}\n", scenario.lie);
    for order in &course.person.orders {
        let _ = writeln!(text, "{:10.1} person {} {}", order.at_ms, order.word, order.done);
    }
    for truth::Event { at_ms, side, text: said } in events {
        let arrow = match side {
            Side::Said => "said",
            Side::Given => "given",
            Side::True => "true",
            Side::Shown => "shown",
        };
        let _ = writeln!(text, "{at_ms:10.1} {arrow:5} {said}");
    }
    let _ = write!(text, "\n{}\n{}", cell.log(), cell.controller_log());
    std::fs::write(format!("{folder}/{}.txt", scenario.number), text).expect("the folder is there");
}
