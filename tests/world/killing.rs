//! Kills processes of the system at any moment. The loop of a world runs in a separate process, which is killed
//! (SIGKILL) during its work, also within a system call. The acknowledgements that the process received from the store
//! are sent through a pipe. Then another process starts on the store, which must contain everything that was
//! acknowledged; it continues with this store, until one of the processes reaches its end.
//!
//! The disk is that of the system and not `disk`, so no power failure is simulated here, and a world's own kills and
//! disk faults are omitted. Each process is a copy of this one (`fork`), so that pictures and results that are stored
//! for all worlds need not be computed again. This process must have only one thread.
#![allow(unsafe_code, reason = "a copy of the process is made by the system's own call")]

use super::fixture::{self, Fixture};
use super::inside::Violation;
use super::ledger::Ledger;
use super::sabotage::Sabotage;
use super::script::{self, Fault, Odds};
use super::{World, disk};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::{FromRawFd, RawFd};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Maximum time after which a process is killed; most worlds take less time.
const MAX_KILL_DELAY: Duration = Duration::from_millis(45);
/// Maximum number of processes on one store.
const MAX_PROCESSES: u64 = 12;
/// Prefix of the line with which a process reports a violation; `END` is the line of a process that ended without a
/// violation.
const WRONG: &str = "wrong ";
const END: &str = "end";

/// The counts and the violations of all runs with killed processes.
#[derive(Debug, Default)]
pub struct Killed {
    /// Number of processes that were killed.
    pub kills: u64,
    /// Number of processes that ended before they could be killed.
    pub ended: u64,
    /// Number of commands that their stores acknowledged.
    pub acknowledged: u64,
    /// Number of stores whose last process reached its end.
    pub stores: u64,
    /// The violations, each with its seed.
    pub violations: Vec<(u64, Violation)>,
}

/// Runs the worlds of these seeds, until this number of processes were killed; with an injected error, if one is given.
pub fn kills(from: u64, count: u64, sabotage: Option<Sabotage>) -> Killed {
    let mut killed = Killed::default();
    let mut seed = from;
    while killed.kills < count {
        if let Err(violation) = one_store(seed, sabotage, &mut killed) {
            killed.violations.push((seed, violation));
        }
        seed += 1;
    }
    killed
}

fn wrong(judge: &'static str, what: String) -> Violation {
    Violation { judge, what }
}

/// Runs processes on one store, one after the other, until one of them reaches its end.
fn one_store(seed: u64, sabotage: Option<Sabotage>, killed: &mut Killed) -> Result<(), Violation> {
    let folder = fixture::folder("killed");
    let _ = std::fs::remove_dir_all(&folder);
    let store = folder.join("store-0");
    Fixture::shared().put_store(&store);
    let mut draw = Pcg64::seed_from_u64(seed);
    let mut ledger = Ledger::default();
    for process in 0..MAX_PROCESSES {
        let world_seed = seed * MAX_PROCESSES + process;
        let mut script = script::draw(world_seed, Odds { most: 3, disk: false });
        script.retain(|entry| {
            !matches!(entry.fault, Fault::Power { .. } | Fault::Disk { .. } | Fault::Backup | Fault::Restore)
        });
        let world = World { sabotage, ..World::with(world_seed, script) };
        // The last process is not killed.
        let patience = (process + 1 < MAX_PROCESSES).then(|| MAX_KILL_DELAY.mul_f64(draw.random()));
        let reported = run_and_kill(&world, &folder, &ledger, patience);
        let mut has_ended = false;
        for line in reported.lines() {
            match line.strip_prefix(WRONG) {
                Some(what) => return Err(wrong("a process that is killed later", what.to_owned())),
                None if line == END => has_ended = true,
                None => {
                    killed.acknowledged += 1;
                    ledger.take_line(line).map_err(|what| wrong("the pipe", what))?;
                }
            }
        }
        *if has_ended { &mut killed.ended } else { &mut killed.kills } += 1;
        ledger.check_start(&store).map_err(|what| wrong("nothing acknowledged is lost by a kill", what))?;
        if has_ended {
            break;
        }
    }
    killed.stores += 1;
    let closed = ledger.close(&store).map_err(|what| wrong("record and page", what));
    let _ = std::fs::remove_dir_all(&folder);
    closed
}

/// Returns the output of a process until it is killed, or until its end if it is not killed.
fn run_and_kill(world: &World, folder: &Path, ledger: &Ledger, patience: Option<Duration>) -> String {
    assert_eq!(std::fs::read_dir("/proc/self/task").map_or(1, Iterator::count), 1, "a copy has one thread only");
    let mut ends: [RawFd; 2] = [0; 2];
    // SAFETY: the call writes two descriptors to this address.
    assert_eq!(unsafe { libc::pipe(ends.as_mut_ptr()) }, 0, "a pipe");
    // SAFETY: both are new and have no other owner. The pipe has space for all output of a world.
    let (mut reads, writes) = unsafe {
        libc::fcntl(ends[1], libc::F_SETPIPE_SZ, 1 << 20);
        (File::from_raw_fd(ends[0]), File::from_raw_fd(ends[1]))
    };
    // SAFETY: this process has only one thread, so no other thread holds a lock in the copy.
    match unsafe { libc::fork() } {
        0 => in_the_copy(world, folder, ledger, writes),
        copy => {
            assert!(copy > 0, "a copy of the process");
            drop(writes);
            if let Some(patience) = patience {
                std::thread::sleep(patience);
                // SAFETY: the copy is a child of this process, and was not waited for yet.
                unsafe { libc::kill(copy, libc::SIGKILL) };
            }
            let mut reported = String::new();
            reads.read_to_string(&mut reported).expect("lines");
            // SAFETY: as above.
            unsafe { libc::waitpid(copy, std::ptr::null_mut(), 0) };
            reported
        }
    }
}

fn in_the_copy(world: &World, folder: &Path, ledger: &Ledger, writes: File) -> ! {
    let writes = Arc::new(writes);
    let mut ledger = ledger.clone();
    ledger.told_to = Some(writes.clone());
    let mut running = world.begin(folder.to_owned(), ledger);
    let ended = running.life();
    let violation = running.world.lock().violation.clone();
    let line = match (ended, violation) {
        (_, Some(Violation { judge, what })) => format!("{WRONG}{judge}: {what}\n"),
        (Err((judge, what)), None) => format!("{WRONG}{judge}: {what}\n"),
        (Ok(()), None) => format!("{END}\n"),
    };
    let _ = (&*writes).write_all(line.as_bytes());
    disk::leave();
    // SAFETY: ends the copy immediately, so that resources shared with the original process are not closed twice.
    unsafe { libc::_exit(0) }
}
