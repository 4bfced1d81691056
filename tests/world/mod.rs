//! One simulation of everything between a person's request and the panel: table, loop, link, robot program, arm, cameras,
//! water, people, store and disk, in one process and one thread, by one seed and in virtual time.
//!
//! ```text
//! people ── requests ──┐                     ┌── record ── the real store, on a folder in memory
//!                      ├─ the product's loop ┤
//! cameras ── stages ───┘                     └── session ── four ways for bytes ── controller ── arm, outputs
//! ```
//!
//! - `fixture`: the cell, its recipe, what was taught · `script`: what goes wrong and when, drawn from a seed, printed and read
//! - `inside`: link, controller, arm and terminals in one time, and the faults that strike · `tamper`: bytes and meanings ·
//!   `terminals`: light, water, lens, extraction, tool · `clock`: the wall clock
//! - `robot`, `cameras`, `people`: the loop's ports in it · `judges`: what must hold at every moment
//!
//! The loop is the service's own (`daemon::run`, by the wall clock) with ports of this world, so that heartbeats, watchdogs and
//! deadlines are those of the service. Results of computing come to the loop after some virtual time, and what happens
//! meanwhile happens to the loop.

mod cameras;
mod clock;
mod fixture;
mod inside;
mod judges;
#[path = "../link/cell.rs"]
#[allow(dead_code, reason = "the link's tests use the rest")]
mod link_cell;
#[path = "../link/oracles.rs"]
#[allow(dead_code, reason = "the link's tests use the rest")]
mod oracles;
mod people;
mod record;
mod robot;
mod script;
mod tamper;
mod terminals;
// `oracles` names its cell so, as it does among the link's tests.
use link_cell as cell;

pub use inside::{Counts, Violation};
pub use script::{Entry, parse, print};

use cameras::Cameras;
use fixture::{Fixture, Stands};
use inside::Shared;
use panelprep::cycle::State;
use panelprep::daemon::{self, Computing, LoopStart, Ports, StoreRecord};
use panelprep::store::Store;
use panelprep::tape::Begin;
use people::{Aim, People};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use record::Record;
use robot::Robot;
use script::Odds;
use std::path::PathBuf;

/// After so much virtual time no more faults strike, ms.
const LONGEST_MS: u64 = 120_000;
/// Processes that a world sees at most.
const MOST_LIVES: u64 = 30;

/// A world before it begins.
#[derive(Debug, Clone)]
pub struct World {
    /// Its seed, which says what stands in the cell and how long bytes take.
    pub seed: u64,
    /// What goes wrong.
    pub script: Vec<Entry>,
}

/// What came of a world.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// What was counted.
    pub counts: Counts,
    /// The first thing that was wrong.
    pub violation: Option<Violation>,
    /// A hash of the journal and the times of its lines: two runs of one world have the same.
    pub trace: u64,
}

impl World {
    /// The world of a seed.
    pub fn of(seed: u64) -> Self {
        let odds = Odds { most: 6, disk: false };
        World { seed, script: script::draw(seed, odds) }
    }

    /// The same world with this script.
    pub fn with(seed: u64, script: Vec<Entry>) -> Self {
        World { seed, script }
    }

    /// Runs it.
    pub fn run(&self) -> Outcome {
        let mut draw = Pcg64::seed_from_u64(self.seed ^ 0x5eed);
        let stands = [Stands::Greasy, Stands::Greasy, Stands::Greasy, Stands::Clean, Stands::Nothing][draw.random_range(0..5)];
        let delay_ms = [(0, 0), (1, 3), (2, 25), (10, 10)][draw.random_range(0..4)];
        clock::right();
        let world = Shared::new(stands, delay_ms, self.script.clone());
        let folder = fixture::folder(&format!("world-{:?}", std::thread::current().id()));
        let mut running = Running { people: People::new(world.clone(), 2, LONGEST_MS), world, folder, trace: 0 };
        running.whole();
        clock::right();
        let Running { world, trace, .. } = running;
        let world = world.lock();
        let counts = Counts { time_ms: world.now_ms(), ..world.counts.clone() };
        Outcome { counts, violation: world.violation.clone(), trace }
    }
}

/// A world that runs.
struct Running {
    world: Shared,
    people: People,
    folder: PathBuf,
    trace: u64,
}

impl Running {
    fn whole(&mut self) {
        // What an earlier world of this thread left.
        let _ = std::fs::remove_dir_all(&self.folder);
        Fixture::get().put_store(&self.folder);
        loop {
            let lives = {
                let mut world = self.world.lock();
                world.counts.lives += 1;
                world.counts.lives
            };
            let ended = self.life();
            let mut world = self.world.lock();
            match ended {
                Ok(_) if self.people.aim == Aim::Leave => break,
                Ok(_) => {}
                Err(problem) => world.wrong("the loop ends", problem),
            }
            if world.violation.is_some() {
                break;
            }
            if lives >= MOST_LIVES {
                world.wrong("lives", format!("{lives} processes and no end"));
                break;
            }
            world.cell.restart_client(inside::session(), false);
            world.without_process(700);
            drop(world);
            self.people.forget();
        }
    }

    /// One process, from its start to its end.
    fn life(&mut self) -> Result<State, String> {
        let words = |error: &dyn std::error::Error| error.to_string();
        let mut store = Store::create(&self.folder).map_err(|error| words(&error))?;
        store.recover().map_err(|error| words(&error))?;
        let state = store.state().map_err(|error| words(&error))?;
        let left_open = store.open_cycles().map_err(|error| words(&error))?.pop();
        let mut record = Record::new(StoreRecord::new(&mut store, left_open));
        let mut robot = Robot::new(self.world.clone());
        let ports = Ports {
            robot: &mut robot,
            record: &mut record,
            requests: &mut self.people,
            computing: Computing::inline(Box::new(Cameras::new(self.world.clone())), false),
            lock_step: false,
        };
        let start = LoopStart { cell: Fixture::get().setup.clone(), cycle: None, state, before: Begin::Boot };
        let ended = daemon::run(start, ports).map_err(|error| words(&error))?;
        Ok(ended.state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worlds_of_many_seeds_violate_nothing() {
        let begun = std::time::Instant::now();
        let mut counts = Counts::default();
        let count = std::env::var("WORLD_SEEDS").ok().and_then(|count| count.parse().ok()).unwrap_or(20);
        let from: u64 = std::env::var("WORLD_FROM").ok().and_then(|count| count.parse().ok()).unwrap_or(0);
        for seed in from..from + count {
            let world = World::of(seed);
            let outcome = world.run();
            counts.add(&outcome.counts);
            if let Some(violation) = &outcome.violation {
                println!("{seed}: {violation:?}\n   {}", print(&world.script));
            }
        }
        println!("{counts:#?} {:.1} s", begun.elapsed().as_secs_f64());
    }
}
