//! Sends records to the office server while all processes are repeatedly killed: `make bench-office`.
//!
//! 50 cells, each a separate process with a real store and the service's sender, write the cycles of a day (144 each,
//! one every ten minutes) as fast as possible. During this time broker, database, archive and cells are killed 1,000
//! times in all, as by a power cut, and their network is cut and delayed. Afterwards `archive check` compares the
//! archive with every store: no record is lost, none is stored twice, and all are in order. Then a single cell sends a
//! backlog of 10,000 records at once, and 200 cycles with pictures as large as those of a real camera. Finally the
//! response time of the office server's pages is measured with a database of 1,000,000 records.
//!
//! `CELLS`, `KILLS`, `CYCLES`, `RECORDS` and `SEED` change these numbers. The cells' clock is not simulated; only the
//! time between cycles is shorter.

#[path = "office/cell.rs"]
mod cell;
#[path = "office/fleet.rs"]
mod fleet;
#[path = "goal.rs"]
mod goal;
#[path = "office/network.rs"]
mod network;
#[path = "../plant/mod.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod plant;

use goal::Figure;
use network::Network;
use plant::{Server, archive_settings, broker, database, free_port, nats_server, postgres_programs};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

const CATCH_UP: usize = 10_000;
const CATCH_UP_S: f64 = 60.0;
const LOST: Figure = Figure("office: records lost in 1,000 kills");
const CAUGHT_UP: Figure = Figure("office: catch-up of 10,000");
/// Backlog of a cell with full-size cameras: number of cycles, and bytes of pictures in each.
const LARGE_BACKLOG: (usize, usize) = (200, 10_000_000);

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    if arguments.get(1).is_some_and(|word| word == "--cell") {
        return cell::run(&arguments[2..]);
    }
    let (Some(_), Some(programs)) = (nats_server(), postgres_programs()) else {
        println!("not run: nats-server or PostgreSQL is not installed");
        LOST.not_run("0");
        CAUGHT_UP.not_run(&format!("{CATCH_UP_S} s"));
        fleet::SLOWEST_PAGE.not_run(&format!("{} ms", fleet::P95_MAX_MS));
        return ExitCode::SUCCESS;
    };
    let number =
        |name: &str, usual: usize| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual);
    let (cells, kills, cycles) = (number("CELLS", 50), number("KILLS", 1_000), number("CYCLES", 144));
    let seed = number("SEED", 1) as u64;
    let mut all_met = killed(&programs, (cells, kills, cycles), seed);
    all_met &= caught_up(&programs, (CATCH_UP, cell::PICTURE_BYTES), Some(CATCH_UP_S));
    all_met &= caught_up(&programs, (2 * LARGE_BACKLOG.0, LARGE_BACKLOG.1), None);
    all_met &= fleet::pages(&programs, number("RECORDS", 1_000_000));
    if all_met { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

struct Plant {
    folder: tempfile::TempDir,
    settings: PathBuf,
    broker: Server,
    broker_port: u16,
    database: Server,
    archive: Child,
}

fn archive(settings: &Path) -> Child {
    let log = fs::OpenOptions::new().create(true).append(true).open(settings.with_extension("log")).expect("a log");
    let mut command = Command::new(env!("CARGO_BIN_EXE_panelprep"));
    command.args(["archive", "run", "--settings"]).arg(settings).stdout(Stdio::null()).stderr(log);
    command.spawn().expect("the archive starts")
}

impl Plant {
    fn start(programs: &Path) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (broker_port, database_port) = (free_port(), free_port());
        let broker = broker(folder.path(), broker_port);
        let database = database(programs, folder.path(), database_port);
        let settings = archive_settings(folder.path(), broker_port, database_port);
        let archive = archive(&settings);
        Plant { folder, settings, broker, broker_port, database, archive }
    }

    /// Returns the report of `archive check` for these cells; an error if it finds a problem.
    fn check(&self, cells: &[(String, PathBuf)]) -> Result<serde_json::Value, String> {
        let output = Command::new(env!("CARGO_BIN_EXE_panelprep"))
            .args(["--json", "archive", "check", "--settings"])
            .arg(&self.settings)
            .args(cells.iter().map(|(name, store)| format!("{name}={}", store.display())))
            .output()
            .expect("it runs");
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        if output.status.success() { Ok(found) } else { Err(format!("{}", found["reasons"])) }
    }
}

impl Drop for Plant {
    fn drop(&mut self) {
        let _ = self.archive.kill();
        let _ = self.archive.wait();
    }
}

fn sum(found: &serde_json::Value, what: &str) -> u64 {
    found["cells"].as_array().into_iter().flatten().filter_map(|cell| cell[what].as_u64()).sum()
}

/// Cell processes that are killed when this value is dropped.
struct Cells(Vec<Child>);

impl Drop for Cells {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Kills cells while they write, and also kills all other processes in turn.
fn killed(programs: &Path, (count, kills, cycles): (usize, usize, usize), seed: u64) -> bool {
    let mut plant = Plant::start(programs);
    let network = Network::to(plant.broker_port, seed);
    let names: Vec<(String, PathBuf)> = (0..count)
        .map(|number| (format!("cell-{number}"), plant.folder.path().join(format!("cell-{number}"))))
        .collect();
    let start = |(name, folder): &(String, PathBuf)| cell::start(name, folder, network.port, cycles);
    let mut running = Cells(names.iter().map(start).collect());
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (begun, mut killed) = (Instant::now(), [0_usize; 4]);
    for _ in 0..kills {
        std::thread::sleep(Duration::from_millis(random.random_range(50..400)));
        let which = random.random_range(0..4_usize);
        killed[which] += 1;
        match which {
            0 => plant.broker.begin(),
            1 => plant.database.start(),
            2 => {
                let _ = plant.archive.kill();
                let _ = plant.archive.wait();
                plant.archive = archive(&plant.settings);
            }
            _ => {
                let one = random.random_range(0..count);
                let _ = running.0[one].kill();
                let _ = running.0[one].wait();
                running.0[one] = start(&names[one]);
            }
        }
    }
    let under_fire_s = begun.elapsed().as_secs_f64();
    network.heal();
    plant.broker.start();
    let stores: Vec<(String, PathBuf)> = names.clone();
    let found = loop {
        let all_written = names.iter().all(|(_, folder)| cell::has_written(folder, cycles));
        let waited_s = begun.elapsed().as_secs_f64() - under_fire_s;
        if all_written {
            match plant.check(&stores) {
                Ok(found) => break Ok(found),
                Err(problem) if waited_s > 600.0 => break Err(problem),
                Err(_) => {}
            }
        } else if waited_s > 1_200.0 {
            break Err("the cells did not write all of their cycles".to_owned());
        }
        std::thread::sleep(Duration::from_secs(2));
    };
    drop(running);
    let [brokers, databases, archives, cells] = killed;
    println!(
        "{count} cells with at least {cycles} cycles each, {kills} kills in {under_fire_s:.0} s: broker {brokers}, database {databases}, \
              archive {archives}, cells {cells}; {} connections cut, {} delayed",
        network.cut(),
        network.held_up()
    );
    match found {
        Ok(found) => {
            let (records, same) = (sum(&found, "records"), sum(&found, "same"));
            println!(
                "  {records} records in the archive, {same} the same in the cells; {} signatures are valid, {} files are complete; lost 0, twice 0, \
                      out of order 0 (archive check)",
                sum(&found, "signatures"),
                sum(&found, "files")
            );
            println!(
                "  everything was in the archive {:.0} s after the last kill",
                begun.elapsed().as_secs_f64() - under_fire_s
            );
            // `archive check` ends with an error if a record is missing, so all records agree here.
            let found = format!("{} of {records} after {kills} kills", records - same.min(records));
            LOST.report("0", &found, records == same && records > 0)
        }
        Err(problem) => {
            LOST.report("0", "the archive check failed", false);
            println!("  NOT MET: {problem}");
            false
        }
    }
}

/// Tests one cell that had no connection to the office server for a long time: this number of records, two for each
/// cycle, with pictures of this size.
fn caught_up(programs: &Path, (records, picture_bytes): (usize, usize), wanted_s: Option<f64>) -> bool {
    let folder = tempfile::tempdir().expect("a folder");
    let store = folder.path().join("store");
    let written = Instant::now();
    cell::write(&store, records / 2, picture_bytes);
    println!(
        "a store with {records} records and pictures of {:.2} MB a cycle was written in {:.0} s",
        picture_bytes as f64 / 1e6,
        written.elapsed().as_secs_f64()
    );
    let plant = Plant::start(programs);
    let begun = Instant::now();
    let mut sender = cell::start("cell-1", &store, plant.broker_port, 0);
    while cell::archived(&store) < records as u64 && begun.elapsed() < Duration::from_secs(900) {
        std::thread::sleep(Duration::from_millis(100));
    }
    let took_s = begun.elapsed().as_secs_f64();
    let _ = sender.kill();
    let _ = sender.wait();
    let is_met = wanted_s.is_none_or(|wanted_s| took_s <= wanted_s);
    println!(
        "  the archive had all of them after {took_s:.1} s: {:.0} records and {:.1} MB a second{}{}",
        records as f64 / took_s,
        (records / 2 * picture_bytes) as f64 / took_s / 1e6,
        wanted_s.map(|wanted_s| format!(" ({wanted_s:.0} s wanted)")).unwrap_or_default(),
        if is_met { "" } else { "  NOT MET" }
    );
    if let Some(wanted_s) = wanted_s {
        CAUGHT_UP.report(&format!("{wanted_s} s"), &format!("{took_s:.1} s for {records} records"), is_met);
    }
    let proven = plant.check(&[("cell-1".to_owned(), store)]);
    println!(
        "  archive check: {}",
        proven.as_ref().map_or_else(Clone::clone, |found| format!("{} the same", sum(found, "same")))
    );
    is_met && proven.is_ok()
}
