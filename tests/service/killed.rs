//! Tests a killed service: the next one finds a complete store, is idle, and moves nothing until it receives a request.

use super::super::commands::json;
use super::{START, Service, journal, taught};
use panelprep::cycle::Path::Corner;
use panelprep::cycle::{At, Event, Report, State};
use panelprep::store::Store;
use rand::{RngExt, SeedableRng};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Returns the duration of a whole cycle on this machine, from its start.
fn whole_cycle(folder: &Path) -> Duration {
    let service = Service::start(folder);
    service.reset();
    let since = Instant::now();
    service.done(START);
    service.reach("complete");
    let took = since.elapsed();
    service.kill_and_wait();
    took
}

/// Kills a service after this time of its cycle, and checks that the next service is idle with a complete store;
/// returns whether a motion was open.
fn kill_and_restart(folder: &Path, after: Duration) -> bool {
    let service = Service::start(folder);
    service.reset();
    service.done(START);
    std::thread::sleep(after);
    service.kill_and_wait();
    let before = journal(folder);
    let expected = panelprep::cycle::recover(before.iter().copied());

    let service = Service::start(folder);
    let found = service.done("state");
    assert_eq!(found["state"], expected.at.keyword(), "after {after:?}: {found}");
    assert!(matches!(expected.at, At::Aborted { .. } | At::Stopped), "{expected:?}");
    // The service only receives reports: a start, the robot's condition and override, and that its outputs are off.
    std::thread::sleep(Duration::from_millis(300));
    let since = journal(folder)[before.len()..].to_vec();
    assert!(since.contains(&Event::Reported(Report::Boot)), "{since:?}");
    let hears = |event: &Event| {
        let Event::Reported(report) = event else { return false };
        matches!(report, Report::Boot | Report::Robot(_) | Report::FullOverride(_) | Report::OutputsOff)
    };
    assert!(since.iter().all(hears), "it acts unasked: {since:?}");
    if expected.intent.is_some() {
        let (exit, cycle) = json(folder, "cycle --cell cell/cell.toml --recipe cell/recipe.toml");
        assert!(exit == 2, "a second writer is refused: {cycle}");
    }
    if found["state"] == "aborted" {
        let words = found["reasons"][0]["message"].as_str().unwrap_or_default();
        assert!(words.contains("ctl clear"), "{found}");
        service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
        service.reach("stopped");
    }
    service.reset();
    service.signal(rustix::process::Signal::TERM);
    assert_eq!(service.wait_for_end().code(), Some(0));
    let mut store = Store::create(&folder.join("cell/store")).expect("it is not in use");
    assert_eq!(store.recover().expect("it is whole").intent, None);
    assert_eq!(store.open_cycles().expect("cycles"), [], "every cycle has its end");
    expected.intent.is_some()
}

fn kills(moments: u32, seed: u64) {
    let folder = taught("good");
    let folder = folder.path();
    let whole = whole_cycle(folder);
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let shares = (0..moments).map(|moment| (f64::from(moment) + random.random::<f64>()) / f64::from(moments));
    let open = shares.map(|share| kill_and_restart(folder, whole.mul_f64(share))).filter(|open| *open).count();
    eprintln!("{open} of {moments} kills left a motion open; a cycle takes {whole:?}");
}

/// A process may end at any moment. The store can be opened, and the next process is idle and moves nothing until it
/// receives a request.
#[test]
fn a_killed_service_leaves_a_cell_at_rest() {
    kills(3, 1);
}

/// Kills the service at more moments: `cargo test -- --ignored killed`.
#[test]
#[ignore = "some minutes"]
fn a_service_killed_anywhere_leaves_a_cell_at_rest() {
    kills(24, 2);
}

/// Returns the store, in a separate folder, of a cycle that was interrupted on its way to the corner.
fn store_with_interrupted_cycle(folder: &Path) -> PathBuf {
    let (store, left) = (folder.join("cell/store"), folder.join("left"));
    std::fs::create_dir_all(left.join("blobs")).expect("a folder");
    for part in ["", "blobs"] {
        for entry in std::fs::read_dir(store.join(part)).expect("the store") {
            let entry = entry.expect("an entry");
            if entry.path().is_file() {
                std::fs::copy(entry.path(), left.join(part).join(entry.file_name())).expect("copied");
            }
        }
    }
    let cycle = "cycle --cell cell/cell.toml --recipe cell/recipe.toml --seed 3";
    let (exit, whole) = json(folder, cycle);
    assert_eq!(exit, 0, "{whole}");
    let mut state = State::INITIAL;
    let mut copy = Store::create(&left).expect("it is not in use");
    for event in journal(folder) {
        copy.append(&event, None).expect("written");
        state = panelprep::cycle::step(state, event).0;
        if state.intent.is_some_and(|intent| matches!(intent.motion.path, Corner { .. })) {
            return left;
        }
    }
    panic!("no way to the corner in {:?}", journal(folder));
}

/// The command that runs one cycle refuses a store with an open motion and names the service as the remedy. Clearing
/// through the service works.
#[test]
fn a_motion_that_was_left_open_is_cleared_through_the_service_alone() {
    let folder = taught("clean");
    let folder = folder.path();
    let left = store_with_interrupted_cycle(folder);
    let (exit, refused) = json(folder, "cycle --cell cell/cell.toml --store left --recipe cell/recipe.toml");
    let words = refused["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(exit == 2 && words.contains("motion is open") && words.contains("panelprep clear"), "{refused}");

    std::fs::remove_dir_all(folder.join("cell/store")).expect("removed");
    std::fs::rename(left, folder.join("cell/store")).expect("in its place");
    let service = Service::start(folder);
    let found = service.done("state");
    let words = found["reasons"][0]["message"].as_str().unwrap_or_default();
    assert!(found["state"] == "aborted" && words.contains("before a motion was reported as finished"), "{found}");
    service.refused("reset", 2, "possible now: clear");
    service.wait("a clear is taken", |service| service.ctl("clear").0 == 0);
    service.reach("stopped");
    service.reset();
}
