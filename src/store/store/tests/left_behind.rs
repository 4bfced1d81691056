//! The state after a crash, a copy or a lost file: reported if something is missing, and no alarm if nothing is.

use super::super::head;
use super::super::steps::Step;
use super::evidence::{store_in, verify, whole};
use super::journal::progress;
use super::*;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{At, Cause, Event, Motion, Path as MotionPath, Report, Request};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// An older database under a newer head, first opened by a command that writes one row: the next start still rests
/// in Aborted, and the verification continues to report it.
#[test]
fn a_change_that_a_small_command_finds_waits_for_a_person_too() {
    let folder = whole();
    let path = store_in(&folder);
    drop(Store::create(&path).expect("opens"));
    let before = fs::read(path.join(DATABASE)).expect("the database");
    let mut store = Store::create(&path).expect("opens");
    store.append(&Event::Reported(Report::Boot), None).expect("written");
    drop(store);
    fs::write(path.join(DATABASE), before).expect("rolled back");
    drop(Store::open_for_accounts(&path).expect("opens"));
    let mut store = Store::create(&path).expect("opens");
    assert_eq!(store.changed(), [] as [String; 0], "it is kept as an incident");
    assert_eq!(store.recover().expect("recovers").at, At::Aborted { cause: Cause::StoreChanged });
    drop(store);
    let waits = Store::verify(&path, false).expect("verified");
    assert!(waits.differences.iter().any(|words| words.contains("rolled back")), "{waits:?}");
}

/// A copy without its log: its content is old, and the start rests until a person clears it.
#[test]
fn a_store_without_its_log_starts_in_aborted_until_a_person_clears_it() {
    let folder = whole();
    let path = store_in(&folder);
    let mut store = Store::create(&path).expect("opens");
    store.recover().expect("recovers");
    let before = fs::read(path.join(DATABASE)).expect("the database");
    let motion = Motion { epoch: 9, path: MotionPath::Contact, plan: 1, waypoints: 100 };
    store.append(&progress(1), None).expect("written");
    store.open_intent(&motion, None).expect("opened");
    // The state that a killed process leaves; the log is lost afterwards.
    std::mem::forget(store);
    let copy = tempfile::tempdir().expect("a folder");
    let lost = copy.path().join("store");
    fs::create_dir_all(lost.join("blobs")).expect("made");
    fs::write(lost.join(DATABASE), before).expect("copied");
    fs::copy(path.join(head::FILE), lost.join(head::FILE)).expect("copied");
    let found = Store::verify(&lost, false).expect("verified").differences;
    assert!(found.iter().any(|words| words.starts_with("rolled back: 2 entries")), "{found:?}");

    let mut store = Store::create(&lost).expect("opens");
    assert!(store.changed()[0].contains("rolled back: 2 entries"), "{:?}", store.changed());
    assert_eq!(store.recover().expect("recovers").at, At::Aborted { cause: Cause::StoreChanged });
    drop(store);
    // The next start finds nothing new, and rests in the same state.
    let mut store = Store::create(&lost).expect("opens");
    assert_eq!(store.changed(), [] as [String; 0]);
    assert_eq!(store.recover().expect("recovers").at, At::Aborted { cause: Cause::StoreChanged });
    assert_eq!(store.incidents().expect("kept").len(), 1);
    let waits = Store::verify(&lost, false).expect("verified");
    assert!(waits.differences.iter().any(|words| words.contains("rolled back")), "{waits:?}");
    for event in [
        Event::Reported(Report::Boot),
        Event::Reported(Report::Robot(panelprep_cell::cycle::Robot::Ready)),
        Event::Asked(Request::Clear),
    ] {
        store.append(&event, None).expect("written");
    }
    for _ in 0..12 {
        let state = store.state().expect("known");
        let Some(due) = state.due else { break };
        let answer = super::journal::answer(due.act, 0);
        store.append(&Event::Reported(Report::Answered { id: due.id, answer }), None).expect("written");
    }
    assert_eq!(store.recover().expect("recovers").at, At::Stopped);
    drop(store);
    let cleared = Store::verify(&lost, false).expect("verified");
    assert_eq!((cleared.differences.len(), cleared.earlier_differences.len()), (0, 1), "{cleared:?}");
}

#[test]
fn a_head_that_is_gone_and_a_database_that_is_gone_are_reported() {
    let folder = whole();
    fs::remove_file(store_in(&folder).join(head::FILE)).expect("removed");
    assert!(verify(&folder).differences[0].contains("is missing"));
    let mut store = Store::create(&store_in(&folder)).expect("opens");
    assert!(matches!(store.recover().expect("recovers").at, At::Aborted { .. }));
    drop(store);
    let folder = whole();
    fs::remove_file(store_in(&folder).join(DATABASE)).expect("removed");
    let mut store = Store::create(&store_in(&folder)).expect("a new one");
    assert!(store.changed()[0].contains("rolled back"), "{:?}", store.changed());
    assert!(matches!(store.recover().expect("recovers").at, At::Aborted { .. }));
}

/// The files as a kill leaves them at each of 200 moments around commits, each in its own folder.
#[test]
fn no_kill_between_commit_and_head_is_a_false_alarm() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    let (from, left, count) =
        (store_in(&folder), tempfile::tempdir().expect("a folder"), Arc::new(AtomicUsize::new(0)));
    let (to, counted) = (left.path().to_owned(), count.clone());
    store.steps.told = Some(Box::new(move |step| {
        let number = counted.fetch_add(1, Ordering::Relaxed) + 1;
        let to = to.join(format!("{number:03} {step:?}"));
        fs::create_dir_all(to.join("blobs")).expect("made");
        for name in [DATABASE, "panelprep.sqlite-wal", head::FILE] {
            // Through another process: closing a file here would also release SQLite's locks.
            let copied = std::process::Command::new("cp").arg(from.join(name)).arg(&to).status().expect("cp");
            assert!(copied.success() || name.ends_with("-wal"));
        }
    }));
    for done in 0..67 {
        store.append(&progress(done), None).expect("written");
    }
    store.steps.told = None;
    let mut seen = [0; 3];
    for kill in fs::read_dir(left.path()).expect("listed") {
        let path = kill.expect("a folder").path();
        let found = Store::verify(&path, false).expect("verified").differences;
        assert_eq!(found, [] as [String; 0], "{}", path.display());
        let mut store = Store::create(&path).expect("opens");
        assert_eq!(store.changed(), [] as [String; 0], "{}", path.display());
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        store.append(&progress(7), None).expect("continues");
        drop(store);
        assert_eq!(Store::verify(&path, false).expect("verified").differences, [] as [String; 0]);
        fs::remove_dir_all(&path).expect("removed");
        let step = [Step::Prepared, Step::Committed, Step::Settled];
        let step = step.iter().position(|step| path.display().to_string().ends_with(&format!("{step:?}")));
        seen[step.expect("a step")] += 1;
    }
    eprintln!(
        "{} kill points (prepared, committed, settled: {seen:?}), no false alarm",
        count.load(Ordering::Relaxed)
    );
    assert!(count.load(Ordering::Relaxed) >= 200 && seen == [67; 3]);
}

/// A lock does not depend on a file that a person may remove.
#[test]
fn a_second_writer_is_refused_though_the_lock_file_is_gone() {
    let (folder, mut store) = new_store();
    let path = store_in(&folder);
    store.append(&progress(1), None).expect("written");
    for name in ["panelprep.lock", "panelprep.reserve"] {
        fs::remove_file(path.join(name)).expect("removed");
    }
    let refused = Store::create(&path).expect_err("taken").to_string();
    assert!(refused.contains("another process is writing to the store"), "{refused}");
    drop(store);
    Store::create(&path).expect("free again");
}

/// A label is stored with the clock's time, also before 1970.
#[test]
fn a_clock_of_1960_stops_nothing() {
    let (folder, mut store) = new_store();
    store.clock = || std::time::UNIX_EPOCH - std::time::Duration::from_secs(10 * 365 * 86_400);
    store.teach(&teaching("wing")).expect("taught");
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    store.append(&progress(1), Some(id)).expect("written");
    store.mount_disc().expect("kept");
    store.conclude(id, Verdict::Pass, &[]).expect("concluded");
    let record = store.cycle(id).expect("there");
    assert_eq!((record.started_unix_s, record.ended_unix_s), (-315_360_000, Some(-315_360_000)));
    assert_eq!(store.taught("wing", None).expect("there").taught_at_unix_s, -315_360_000);
    assert_eq!(unix_ms(std::time::UNIX_EPOCH - std::time::Duration::from_millis(1)), -1);
    drop(store);
    assert_eq!(verify(&folder).differences, [] as [String; 0]);
}
