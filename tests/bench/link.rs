//! The robot link: the number of commands per second, the time from a lost acknowledgement to STOP on the wire, and
//! long paths without a stop. Also measures the time of an abort while hostile clients use the service, and runs
//! 200,000 random walks over the controller's programs. Prints a table; exit code 1 if a target is missed. `cargo bench
//! --bench link -- [TRIALS]`, only the aborts with `-- socket`, `-- page` or `-- disk`, only the walks with `--
//! programs [WALKS]`.

#[path = "../link/cell.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod cell;
#[path = "../hostile/clients.rs"]
mod clients;
#[path = "../link/damage.rs"]
mod damage;
#[path = "goal.rs"]
mod goal;
#[path = "../link/loopback.rs"]
mod loopback;
#[path = "../link/oracles.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod oracles;
#[path = "../link/programs/mod.rs"]
#[allow(dead_code, unused_imports, reason = "the tests use the rest")]
mod programs;
#[path = "../link/walks.rs"]
#[allow(dead_code, unused_imports, reason = "the tests use the rest")]
mod walks;
mod link {
    pub mod peer;
    pub mod socket;
}

use cell::{BASE, Blind, Cell, pass, sanding_tool, setup, speed};
use goal::Figure;
use link::peer::Peer;
use loopback::served;
use panelprep::devices::mock::Clock;
use panelprep::devices::robot::{Address, BlockingLink};
use panelprep::eki::{ClockMode, Command, LinkLimits, MoveLin, Report, Signal};
use panelprep::geometry::statistics::{QuantileRank, quantile};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Commands per second with 8 commands in each tick of 12 ms.
const TICK_COMMANDS_S: f64 = 8.0 / 0.012;
const LOOPBACK_SHARE: f64 = 0.95;
const VIRTUAL_COMMANDS_S: f64 = 100_000.0;
const WATCHDOG_TIMEOUT: Duration = Duration::from_millis(40);
const MAX_IDLE_DELAY: Duration = Duration::from_millis(20);
const MAX_BUSY_DELAY: Duration = Duration::from_millis(50);
/// Time limit from the service's socket to the wire.
const MAX_SOCKET_DELAY: Duration = Duration::from_millis(100);
const SOCKET_TRIALS: usize = 500;
/// Number of trials with a disk that hangs; each takes longer than the disk hangs.
const HANGING_TRIALS: usize = 20;
/// Number of clients that watch the page.
const VIEWERS: usize = 20;
/// Number of links that run at the same time, each in its own thread.
const LINKS: usize = 8;
const TIMEOUT: Duration = Duration::from_secs(20);
/// Number of random walks after which a progress line is printed.
const PROGRESS_WALKS: usize = 5_000;
/// Number of random walks over the controller's shipped programs.
const PROGRAM_WALKS: u64 = 200_000;

fn main() -> ExitCode {
    let trials = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(10_000);
    let arguments: Vec<String> = std::env::args().collect();
    if arguments.iter().any(|argument| argument == "socket") {
        return if abort_by_socket() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    if arguments.iter().any(|argument| argument == "disk") {
        return if abort_on_a_hanging_disk() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    if arguments.iter().any(|argument| argument == "page") {
        return if abort_on_the_page() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    if arguments.iter().any(|argument| argument == "programs") {
        let walks = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(PROGRAM_WALKS);
        return if walks_of_the_programs(walks) { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    }
    let reached = [
        abort_by_socket(),
        abort_on_the_page(),
        abort_on_a_hanging_disk(),
        virtual_rate(),
        loopback_rate(),
        stop_latency(
            ("idle", Figure("link: lost acknowledgement to STOP, p99.9, idle")),
            trials,
            0,
            MAX_IDLE_DELAY,
        ),
        stop_latency(
            ("both cores busy", Figure("link: both cores busy")),
            trials,
            std::thread::available_parallelism().map_or(2, usize::from),
            MAX_BUSY_DELAY,
        ),
        long_virtual_path(),
        path_over_sockets(),
        walks_of_the_programs(PROGRAM_WALKS),
    ];
    let missed = reached.iter().filter(|reached| !**reached).count();
    println!("{missed} of {} missed their target", reached.len());
    if missed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Runs seeded random walks of the client against the controller's programs as shipped, which are executed.
fn walks_of_the_programs(walks: u64) -> bool {
    let (shipped, started) = (programs::texts("config/kuka"), Instant::now());
    let loaded = programs::load(&shipped);
    let (mut found, mut covered) = (Vec::new(), programs::Coverage::default());
    for first in (0..walks).step_by(PROGRESS_WALKS) {
        let seeds = first..walks.min(first + PROGRESS_WALKS as u64);
        let last = seeds.end;
        let (more, executed) = programs::run_walks(seeds, u64::MAX, &loaded);
        more.iter().for_each(|(seed, violation)| println!("    {seed}: {violation}"));
        found.extend(more);
        covered = covered.with(&executed);
        let elapsed_s = started.elapsed().as_secs_f64();
        println!("  {last} of {walks} walks, {} violate a rule, {elapsed_s:.0} s", found.len());
    }
    let missing = covered.print(&loaded, &shipped);
    let reached = found.is_empty() && missing.is_empty();
    let violations = format!("{} in {walks}", found.len());
    Figure("link: violations in walks over the programs").report("0", &violations, found.is_empty() && walks > 0);
    println!(
        "{walks} walks over the controller's programs: {} violate a rule, {} lines never executed, {:.0} s {}",
        found.len(),
        missing.len(),
        started.elapsed().as_secs_f64(),
        verdict(reached)
    );
    reached
}

fn verdict(reached: bool) -> &'static str {
    if reached { "ok" } else { "MISSED" }
}

/// Measures an abort from the service's socket to the wire, with two hundred hostile clients.
fn abort_by_socket() -> bool {
    let (found, done) = link::socket::aborts(SOCKET_TRIALS);
    let among = format!("{} hostile clients ({done} requests of theirs)", link::socket::CLIENTS);
    let figure = Figure("link: abort with 200 hostile clients");
    report(("abort by the service's socket to the frame", figure), &among, &found)
}

/// Measures an abort from the service's socket to the wire while the disk of the journal hangs.
fn abort_on_a_hanging_disk() -> bool {
    let found = link::socket::aborts_on_a_hanging_disk(HANGING_TRIALS);
    let disk = format!("a disk that hangs for {} s", link::socket::HANG_TIME.as_secs());
    let figure = Figure("link: with a hanging disk, p99");
    report(("abort by the service's socket to the frame", figure), &disk, &found)
}

/// Measures an abort from the operator's page to the wire, while others watch the page and one client reads nothing.
fn abort_on_the_page() -> bool {
    let found = link::socket::aborts_on_the_page(SOCKET_TRIALS, VIEWERS);
    let figure = Figure("link: abort on the operator's page to the STOP frame, p99");
    report(("abort on the operator's page to the frame", figure), &format!("{VIEWERS} who look on"), &found)
}

/// Returns the time up to which this share of the times lies.
fn share(times: &[Duration], share: f64) -> Duration {
    quantile(&mut times.to_vec(), share, QuantileRank::Covering).expect("times")
}

fn report((what, figure): (&str, Figure), among: &str, found: &[Duration]) -> bool {
    let at = |part: f64| share(found, part);
    let ms = |share: f64| at(share).as_secs_f64() * 1e3;
    let reached = at(0.99) <= MAX_SOCKET_DELAY;
    figure.report(&format!("{} ms", MAX_SOCKET_DELAY.as_millis()), &format!("{:.1} ms", ms(0.99)), reached);
    println!(
        "{what}, {among}, {} trials: median {:.1} ms, p99 {:.1} ms (target {} ms), most {:.1} ms {}",
        found.len(),
        ms(0.5),
        ms(0.99),
        MAX_SOCKET_DELAY.as_millis(),
        ms(1.0),
        verdict(reached)
    );
    reached
}

fn output(index: usize) -> Command {
    Command::SetDigout(Signal { number: 1, on: index.is_multiple_of(2) })
}

/// Measures the rate of commands without motion: client and controller in one thread, in virtual time, without sockets.
fn virtual_rate() -> bool {
    const COMMANDS: usize = 400_000;
    let mut cell = Cell::new(setup(Clock::Free), LinkLimits::default(), 1);
    cell.delay_ms = (0, 0);
    cell.open(0.1);
    let (started, began_s) = (Instant::now(), processor_s());
    for index in 0..COMMANDS {
        cell.session.queue(output(index)).expect("good");
        if index % 400 == 399 {
            cell.run(600, &mut Blind);
        }
    }
    while cell.controller.counts().1 < COMMANDS as i32 + 3 {
        cell.run(12, &mut Blind);
    }
    let elapsed_s = started.elapsed().as_secs_f64();
    // The thread's processor time is used if it is known, because other processes may use the machine.
    let core_s = processor_s().zip(began_s).map_or(elapsed_s, |(now_s, began_s)| now_s - began_s);
    let rate = COMMANDS as f64 / core_s;
    let reached = rate >= VIRTUAL_COMMANDS_S;
    let goal = format!("{VIRTUAL_COMMANDS_S:.0} a second");
    Figure("link: in virtual time").report(&goal, &format!("{rate:.0} a second"), reached);
    println!(
        "virtual time: {rate:.0} commands/s and core (target {VIRTUAL_COMMANDS_S:.0}), in {core_s:.1} s of a core and {elapsed_s:.1} s \
         by the clock {}",
        verdict(reached)
    );
    reached
}

/// Returns the processor time that this thread has used, s, as reported by Linux.
fn processor_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? / 1e9)
}

fn wait(link: &mut BlockingLink, found: impl Fn(&Report) -> bool) {
    loop {
        let report = link.next(TIMEOUT).expect("the link continues");
        if found(&report) {
            return;
        }
    }
}

fn open(link: &mut BlockingLink) {
    wait(link, |report| matches!(report, Report::Connected { .. }));
    link.open_epoch().expect("connected");
    wait(link, |report| matches!(report, Report::EpochOpened { .. }));
}

/// Measures the rate of commands over loopback with the controller's own tick.
fn loopback_rate() -> bool {
    const COMMANDS: usize = 6_000;
    let (_server, mut link) = served("");
    open(&mut link);
    let started = Instant::now();
    for index in 0..COMMANDS {
        link.send(output(index)).expect("good");
    }
    wait(&mut link, |report| matches!(report, Report::Progress { done } if done.0 as usize == COMMANDS));
    let rate = COMMANDS as f64 / started.elapsed().as_secs_f64();
    let reached = rate >= LOOPBACK_SHARE * TICK_COMMANDS_S;
    let (goal, found) = (100.0 * LOOPBACK_SHARE, 100.0 * rate / TICK_COMMANDS_S);
    let figure = Figure("link: commands over loopback, share of the controller's tick");
    figure.report(&format!("{goal:.0} %"), &format!("{found:.1} %"), reached);
    println!(
        "loopback: {rate:.1} commands/s, {:.1} % of what the tick allows (target {:.0} %) {}",
        100.0 * rate / TICK_COMMANDS_S,
        100.0 * LOOPBACK_SHARE,
        verdict(reached)
    );
    reached
}

/// Measures the time from a command whose acknowledgement is lost to the abort at the other end, with this number of
/// busy cores.
fn stop_latency((name, figure): (&str, Figure), trials: usize, busy: usize, spare: Duration) -> bool {
    let ends = AtomicBool::new(false);
    let found: Vec<Duration> = std::thread::scope(|scope| {
        for _ in 0..busy {
            scope.spawn(|| {
                while !ends.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let links: Vec<_> =
            (0..LINKS).map(|_| scope.spawn(|| lose_acknowledgements(trials.div_ceil(LINKS)))).collect();
        let found = links.into_iter().flat_map(|link| link.join().expect("ends")).collect();
        ends.store(true, Ordering::Relaxed);
        found
    });
    let at = |part: f64| share(&found, part);
    let (worst, limit) = (at(0.999), WATCHDOG_TIMEOUT + spare);
    let reached = worst <= limit;
    let ms = |time: Duration| time.as_secs_f64() * 1_000.0;
    figure.report(&format!("{:.0} ms", ms(limit)), &format!("{:.1} ms", ms(worst)), reached);
    println!(
        "lost acknowledgement to STOP, {name}: {} trials, timeout {} ms: median {:.1} ms, p99 {:.1}, p99.9 {:.1} (target {:.0}), \
         most {:.1} {}",
        found.len(),
        WATCHDOG_TIMEOUT.as_millis(),
        ms(at(0.5)),
        ms(at(0.99)),
        ms(worst),
        ms(limit),
        ms(at(1.0)),
        verdict(reached)
    );
    reached
}

fn lose_acknowledgements(trials: usize) -> Vec<Duration> {
    let peer = Peer::start();
    let (command_port, state_port) = peer.ports();
    let address = Address { host: "127.0.0.1".to_owned(), command_port, state_port };
    // The timeout is much longer than a heartbeat and its reply, so that only the missing acknowledgement can cause the
    // abort.
    let limits =
        LinkLimits { watchdog: WATCHDOG_TIMEOUT, heartbeat: Duration::from_millis(8), ..LinkLimits::default() };
    let mut link = BlockingLink::start(address, limits, ClockMode::Wall).expect("starts");
    let mut found = Vec::with_capacity(trials);
    wait(&mut link, |report| matches!(report, Report::Connected { .. }));
    while found.len() < trials {
        if link.open_epoch().is_err() {
            // Busy cores may have caused a loss of the connection: wait until it is restored.
            wait(&mut link, |report| matches!(report, Report::Connected { .. } | Report::State(_)));
            continue;
        }
        wait(&mut link, |report| {
            matches!(report, Report::EpochOpened { .. } | Report::EpochNotOpened { .. } | Report::LinkLost { .. })
        });
        peer.lose_acknowledgements();
        let sent = Instant::now();
        if link.send(output(0)).is_err() {
            continue;
        }
        let is_over = |report: &Report| matches!(report, Report::Standstill { .. } | Report::LinkLost { .. });
        wait(&mut link, is_over);
        if let Some(stopped) = peer.stopped() {
            found.push(stopped.saturating_duration_since(sent));
        }
    }
    found
}

/// Returns points back and forth over 120 mm in steps of 3 mm at 150 mm/s: 20 ms per step.
fn meander(points: usize) -> Vec<MoveLin> {
    let row = pass(41, 3.0, false);
    let point = |index: usize| {
        let column = if (index / 40).is_multiple_of(2) { index % 40 } else { 39 - index % 40 };
        let mut point = row[column];
        point.pose.y_mm += 3.0 * (index / 40 % 20) as f64;
        (point.pose.z_mm, point.blend_mm) = (-10.0, if index + 1 == points { 0.0 } else { 1.2 });
        point
    };
    (0..points).map(point).collect()
}

/// Runs a path of 10,000 points in virtual time with a round trip of 20 ms.
fn long_virtual_path() -> bool {
    let started = Instant::now();
    let mut cell = Cell::ready(setup(Clock::Free), 0.15);
    cell.delay_ms = (10, 10);
    let last = cell.session.queue_path(&meander(10_000)).expect("a good path");
    let done = cell.until(300_000, |report| *report == Report::PathDone { last });
    let (underruns, stops) = (cell.controller.underrun_count(), cell.controller.program_stops().len());
    let reached = done && underruns == 0 && stops == 0 && cell.executed().len() == 10_000;
    let found = format!("{underruns} and {stops}");
    Figure("link: underruns and stops on 10,000 points in virtual time").report("0", &found, reached);
    println!(
        "10,000 points in virtual time, 20 ms round trip: {} executed, {underruns} underruns, {stops} stops, {:.1} s of path in \
         {:.1} s {}",
        cell.executed().len(),
        cell.now_ms as f64 / 1_000.0,
        started.elapsed().as_secs_f64(),
        verdict(reached)
    );
    reached
}

/// Runs a path of 500 points over sockets with a round trip of 20 ms and fragmented messages.
fn path_over_sockets() -> bool {
    let (server, mut link) = served("seed=3,delay=10ms,fragment");
    open(&mut link);
    for command in [Command::SetBase(BASE), sanding_tool(), speed(0.15)] {
        link.send(command).expect("good");
    }
    let last = link.send_path(meander(500)).expect("a good path");
    wait(&mut link, |report| *report == Report::PathDone { last });
    let (executed, underruns, stops) = server.handle().with_controller(|controller| {
        (controller.executed_motions().len(), controller.underrun_count(), controller.program_stops().len())
    });
    let reached = (executed, underruns, stops) == (500, 0, 0);
    Figure("link: on 500 points over sockets").report("0", &format!("{underruns} and {stops}"), reached);
    println!(
        "500 points over sockets, 20 ms round trip, in pieces: {executed} executed, {underruns} underruns, {stops} stops {}",
        verdict(reached)
    );
    reached
}
