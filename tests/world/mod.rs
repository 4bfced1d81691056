//! A simulation of everything between a person's request and the panel: state table, loop, connection, robot program,
//! arm, cameras, water, people, store and disk, in one process and one thread, from one seed and in virtual time.
//!
//! ```text
//! people ── requests ──┐                     ┌── record ── the real store, on a folder in memory
//!                      ├─ the product's loop ┤
//! cameras ── stages ───┘                     └── session ── bytes in four directions ── controller ── arm, outputs
//! ```
//!
//! - `fixture`: the cell, its recipe, its taught panel · `script`: the faults and their times, drawn from a seed,
//!   printed and read · `pairs`: faults that have an effect only in combination · `elsewhere`: override, measured
//!   poses, jogs, restores, a second screen
//! - `inside`: client, controller, arm and terminals in one time, and the injected faults · `tamper`: changed bytes and
//!   values · `terminals`: light, water, lens, extraction, tool · `clock`: the wall clock
//! - `robot`, `record`, `cameras`, `people`: the ports of the loop · `desk`: the service's queue and request handler in
//!   front of the loop · `judges`: requirements at every moment · `in_time`: time limits · `ledger`: the
//!   acknowledgements of the store · `touched`: the grids that the arm touched, which must stay counted · `restoring`:
//!   backups and restores of the store · `wear`, `aims`: the requirements on contact, and the ends of lines ·
//!   `killing`: real processes that are killed
//! - `disk`: the disk, its possible faults, and the files that a power failure leaves, or would have left ·
//!   `libc_calls`: the calls by which the disk is written
//!
//! - `sabotage`: errors that are injected to check that a world detects them
//!
//! The loop is the service's own loop (`daemon::run`, by the wall clock) with the ports of this world, so that
//! heartbeats, watchdogs and deadlines are those of the service. Results of computations reach the loop after some
//! virtual time, and events in this time affect the loop.

mod aims;
mod cameras;
mod clock;
mod desk;
mod disk;
mod elsewhere;
mod fixture;
mod in_time;
mod inside;
mod judges;
mod killing;
mod ledger;
mod libc_calls;
mod pairs;
mod people;
mod record;
mod restoring;
mod robot;
mod sabotage;
mod script;
mod tamper;
mod terminals;
mod touched;
mod wear;

pub use cameras::stored_pictures;
pub use inside::{Counts, Violation};
pub use killing::{Killed, kills};
pub use sabotage::{ALL as SABOTAGES, Sabotage};
pub use script::{Entry, parse, print};

use crate::link::{cell as link_cell, oracles};
use cameras::Cameras;
use fixture::{CellContents, Fixture};
use inside::Shared;
use ledger::Ledger;
use panelprep::cycle::At;
use panelprep::daemon::{self, Computing, LoopPorts, LoopStart, Memory, StoreRecord};
use panelprep::devices::mock::Programs;
use panelprep::store::{Store, StoreError};
use panelprep::tape::LoopMemoryStart;
use people::{AFTERMATH_MS, Aim, People};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use record::Record;
use robot::Robot;
use script::{Odds, Power};
use std::path::PathBuf;
use std::sync::LazyLock;

/// Virtual time after which no further faults are injected, ms.
const MAX_FAULT_TIME_MS: u64 = 120_000;
/// Time from the end of a process to the start of the next one, ms.
const RESTART_DELAY_MS: u64 = 2_000;
/// Time between two processes after a power failure, in half of the worlds, ms: longer than a controller waits for a
/// client that disappeared without a message.
const LONG_RESTART_DELAY_MS: u64 = 5_000;
/// Worlds whose controller executes the shipped programs: divisor of the seed, and remainder.
const INTERPRETED: (u64, u64) = (8, 5);
/// A power failure is simulated at one in this number of writes.
const IMAGINES_ONE_IN: u32 = 300;
/// Time for the effect of a fault while the cycle continues, in a quarter of the worlds, ms.
const LONG_AFTERMATH_MS: u64 = 40_000;
/// In one of this number of worlds with grease and a complete last cycle, the disc does not remove the grease.
const STUBBORN_ONE_IN: u32 = 3;
/// Maximum number of processes in a world.
const MAX_PROCESS_COUNT: u64 = 60;

/// Results of the stages in all worlds of this process: equal inputs give equal results.
static MEMORY: LazyLock<Memory> = LazyLock::new(|| Memory::new(record::shrunk));

/// A world before its run.
#[derive(Debug, Clone)]
pub struct World {
    /// The world's seed, which determines the contents of the cell and the delay of bytes.
    pub seed: u64,
    /// The planned faults.
    pub script: Vec<Entry>,
    /// The error that is injected to check that it is detected, if any.
    pub sabotage: Option<Sabotage>,
    /// Whether power failures are simulated; this changes nothing in the world and takes a third of its time.
    pub imagines: bool,
}

/// The result of a world.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The counts.
    pub counts: Counts,
    /// The first violated requirement.
    pub violation: Option<Violation>,
    /// A hash of the journal: two runs of the same world have the same hash.
    pub trace: u64,
}

impl World {
    /// Returns the world of a seed.
    pub fn from_seed(seed: u64) -> Self {
        let odds = Odds { most: 6, disk: !seed.is_multiple_of(3) };
        World::with(seed, script::draw(seed, odds))
    }

    /// Returns the world of a seed with this script.
    pub fn with(seed: u64, script: Vec<Entry>) -> Self {
        World { seed, script, sabotage: None, imagines: true }
    }

    /// Returns the world with an injected error.
    pub fn sabotaged(self, sabotage: Sabotage) -> Self {
        World { sabotage: Some(sabotage), ..self }
    }

    /// Runs the world.
    pub fn run(&self) -> Outcome {
        clock::reset();
        let folder = fixture::folder(&format!("world-{:?}", std::thread::current().id()));
        let mut running = self.begin(folder, Ledger::default());
        running.whole();
        clock::reset();
        let Running { world, ledger, .. } = running;
        let world = world.lock();
        let trace = ledger.trace();
        let counts = Counts { time_ms: world.now_ms(), ..world.counts.clone() };
        Outcome { counts, violation: world.violation.clone(), trace }
    }

    /// Returns the controller's shipped programs, which some worlds execute instead of the model. The seed determines
    /// how the two interpreters are scheduled.
    fn programs(&self) -> Option<Programs> {
        static SHIPPED: LazyLock<Programs> = LazyLock::new(|| Programs::shipped().expect("right programs"));
        if self.seed % INTERPRETED.0 != INTERPRETED.1 || matches!(self.sabotage, Some(Sabotage::Controller(_))) {
            return None;
        }
        let mut programs = SHIPPED.clone();
        (programs.seed, programs.is_adverse_scheduling) = (self.seed, true);
        Some(programs)
    }

    /// Creates the world in its state before the first process. Its store is or will be in this folder.
    fn begin(&self, folder: PathBuf, ledger: Ledger) -> Running {
        let mut draw = Pcg64::seed_from_u64(self.seed ^ 0x5eed);
        let stands = [
            CellContents::Greasy,
            CellContents::Greasy,
            CellContents::Greasy,
            CellContents::Clean,
            CellContents::Nothing,
        ][draw.random_range(0..5)];
        // A cycle detects that the grease is not removed only if it runs to its end without faults.
        let is_whole = self.seed.is_multiple_of(4);
        let is_stubborn =
            is_whole && Pcg64::seed_from_u64(self.seed ^ 0x57ab).random_range(0..STUBBORN_ONE_IN) == 0;
        let stands = if is_stubborn && stands == CellContents::Greasy { CellContents::Stubborn } else { stands };
        let delay_ms = [(0, 0), (1, 3), (2, 25), (10, 10)][draw.random_range(0..4)];
        let link = (delay_ms, self.programs());
        let world = Shared::new(stands, link, self.script.clone(), self.sabotage);
        // Most worlds have one cycle and the start of another one.
        let cycles = if self.seed.is_multiple_of(3) { 2 } else { 1 };
        let mut people = People::new(world.clone(), (cycles, is_whole), MAX_FAULT_TIME_MS);
        people.dries = self.seed % 5 == 2;
        let is_long = self.seed / INTERPRETED.0 % 4 == 1;
        world.lock().aftermath_ms = if is_long { LONG_AFTERMATH_MS } else { AFTERMATH_MS };
        Running {
            people,
            world,
            seed: self.seed,
            folder,
            sabotage: self.sabotage,
            imagines: self.imagines,
            stores: 0,
            ledger,
            left_on: false,
            is_restored: false,
        }
    }
}

impl World {
    /// Returns the world with the shortest script with which the same check still finds a violation. Entries are
    /// removed one at a time, as long as this is the case.
    pub fn shortest(&self, judge: &str) -> World {
        let mut shortest = self.clone();
        let mut index = 0;
        while index < shortest.script.len() {
            let mut shorter = shortest.clone();
            shorter.script.remove(index);
            let is_same = shorter.run().violation.is_some_and(|violation| violation.judge == judge);
            if is_same {
                (shortest, index) = (shorter, 0);
            } else {
                index += 1;
            }
        }
        shortest
    }
}

/// A world during its run.
struct Running {
    world: Shared,
    people: People,
    seed: u64,
    sabotage: Option<Sabotage>,
    imagines: bool,
    /// The folder of its stores, and the number of the present store: a power failure leaves another folder.
    folder: PathBuf,
    stores: u32,
    ledger: Ledger,
    /// Whether tool or water was on when the last process ended.
    left_on: bool,
    /// Whether the store was restored since the last start.
    is_restored: bool,
}

impl Running {
    fn store(&self) -> PathBuf {
        self.folder.join(format!("store-{}", self.stores))
    }

    fn watch(&self) {
        disk::watch(&self.store(), self.sabotage);
        if self.imagines {
            disk::simulate_one_power_failure_in(IMAGINES_ONE_IN, self.seed ^ (u64::from(self.stores) << 32));
        }
    }

    fn whole(&mut self) {
        // Removes the folder that an earlier world of this thread left.
        let _ = std::fs::remove_dir_all(&self.folder);
        Fixture::shared().put_store(&self.store());
        self.watch();
        loop {
            let lives = {
                let mut world = self.world.lock();
                world.counts.lives += 1;
                world.counts.lives
            };
            let ended = self.life();
            if self.is_end(ended) {
                break;
            }
            if lives >= MAX_PROCESS_COUNT {
                self.world.lock().wrong("lives", format!("{lives} processes and no end"));
                break;
            }
            self.ends();
        }
        if self.world.lock().violation.is_none() {
            self.power_cut_at_the_end();
        }
        disk::leave();
        if self.world.lock().violation.is_none() {
            let closed = self.ledger.close(&self.store());
            let mut world = self.world.lock();
            world.counts.judged("record and page");
            if let Err(problem) = closed {
                world.wrong("record and page", problem);
            }
        }
        // The folder is in memory, so removing it frees memory.
        let _ = std::fs::remove_dir_all(&self.folder);
        // The last world of the process also removes the folder of all worlds; for others it is not empty.
        let _ = self.folder.parent().map(std::fs::remove_dir);
    }

    /// Simulates a power failure just after the last process has ended: the contents of a closed store must be on the
    /// disk.
    fn power_cut_at_the_end(&mut self) {
        if !self.seed.is_multiple_of(3) {
            return;
        }
        self.world.lock().counts.judged("a power cut at the end");
        let left = self.folder.join("left");
        disk::after_power_cut(&left, self.seed);
        disk::leave();
        let start = |error: StoreError| error.to_string();
        let held = Store::create(&left).map_err(start).and_then(|mut store| {
            let rested = store.recover().map_err(start)?;
            self.ledger.check(&store, &rested)
        });
        if let Err(problem) = held {
            self.world.lock().wrong("a power cut at the end", problem);
        }
    }

    /// Returns whether this was the last process; a process that ended because of its disk is not the last one.
    fn is_end(&self, ended: Result<(), (&'static str, String)>) -> bool {
        let mut world = self.world.lock();
        match ended {
            Ok(()) => self.people.aim == Aim::Leave || world.violation.is_some(),
            Err(_) if disk::is_over() || disk::had_io_error() => world.violation.is_some(),
            Err((judge, problem)) => {
                world.wrong(judge, problem);
                true
            }
        }
    }

    /// Handles the end of a process: a normal end, a kill, or a power failure. Some time later another process starts.
    fn ends(&mut self) {
        let mut world = self.world.lock();
        let power = world.power.take().filter(|_| disk::is_over());
        self.left_on =
            (world.is_on(2) || world.is_on(5)) && !world.is_strange() && world.lock_around().stuck.is_none();
        world.cell.restart_client(inside::session(self.sabotage), matches!(power, Some(Power::Cut { .. })));
        let is_long = matches!(power, Some(Power::Cut { seed }) if seed.is_multiple_of(2));
        world.without_process(if is_long { LONG_RESTART_DELAY_MS } else { RESTART_DELAY_MS });
        match power {
            Some(Power::Cut { seed }) => {
                world.counts.cuts += 1;
                world.cell.close_dead_connections();
                drop(world);
                self.stores += 1;
                disk::after_power_cut(&self.store(), seed);
                self.watch();
            }
            Some(Power::Kill) => {
                world.counts.kills += 1;
                drop(world);
                disk::resume();
            }
            None => {
                drop(world);
                disk::resume();
            }
        }
        self.touches();
        self.restores();
        self.people.forget();
    }

    /// Runs one process from its start to its end.
    fn life(&mut self) -> Result<(), (&'static str, String)> {
        let start = |error: StoreError| ("start", error.to_string());
        let mut store = Store::create(&self.store()).map_err(start)?;
        let rested = store.recover().map_err(start)?;
        let state = store.state().map_err(start)?;
        if std::mem::take(&mut self.left_on) && rested.at == At::Stopped {
            return Err(("off at a start", "Stopped, tool or water was on when the last process ended".to_owned()));
        }
        self.world.lock().counts.judged("nothing acknowledged is lost");
        let checked = self.ledger.check(&store, &rested);
        checked.map_err(|problem| ("nothing acknowledged is lost", problem))?;
        self.asks_after_a_restore(&rested)?;
        let left_open = store.open_cycles().map_err(start)?.pop();
        self.ledger.cycle = left_open;
        self.people.begin(&self.store(), left_open);
        let store = StoreRecord::new(&mut store, left_open);
        let at = self.store();
        let mut record = Record::new((store, &at), &mut self.ledger, self.world.clone());
        let mut robot = Robot::new(self.world.clone());
        let cameras = Box::new(Cameras::new(self.world.clone()));
        let looks = self.world.clone();
        let sees = Box::new(move |act| cameras::view_hash(&looks, act));
        let ports = LoopPorts {
            robot: &mut robot,
            tool: &mut daemon::LinkedTool::default(),
            record: &mut record,
            requests: &mut self.people,
            computing: Computing::remembering(cameras, (MEMORY.clone(), sees), false),
            lock_step: false,
        };
        let start =
            LoopStart { cell: Fixture::shared().setup.clone(), cycle: None, state, before: LoopMemoryStart::Boot };
        let left = daemon::run(start, ports).map_err(|error| ("the loop continues", error.to_string()))?.state;
        if left.at.is_at_rest() {
            Ok(())
        } else {
            Err(("the loop continues", format!("it was left in {:?}", left.at)))
        }
    }
}
