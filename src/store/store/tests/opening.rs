//! Opening: for reading, for writing, and with a damaged store.
//!
//! After a crash, a copy or a lost file, missing data are reported, and nothing is reported if no data are missing.
//! Copies are made during writing, of a store that was changed, and before the tables of an earlier version of this
//! program are updated.

use super::super::copy::keep_earlier_version;
use super::super::database::Step;
use super::super::{head, schema};
use super::evidence::{filled_store, store_in, verify};
use super::journal::progress;
use super::*;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{At, Cause, Event, Motion, Path as MotionPath, Report, Request};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

#[test]
fn one_process_writes_and_others_read() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let refused = Store::create(&path).expect_err("taken").to_string();
    assert!(refused.contains(&format!("process {} is writing to the store", std::process::id())), "{refused}");
    store.teach(&teaching("wing")).expect("taught");
    let mut reader = Store::open(&path).expect("beside the writer");
    assert_eq!(reader.taught("wing", None).expect("there").teaching, teaching("wing"));
    assert!(matches!(reader.store_blob(b"new"), Err(StoreError::ReadOnly { .. })));
    assert!(matches!(reader.teach(&teaching("fin")), Err(StoreError::ReadOnly { .. })));
    assert!(matches!(reader.recover().map(drop), Ok(())), "nothing to write");
    drop(store);
    Store::create(&path).expect("free again");
}

#[test]
fn a_mistyped_folder_is_named_and_stays_absent() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sotre");
    let refused = Store::open(&path).expect_err("absent").to_string();
    assert!(refused.contains("no store found in") && refused.contains("sotre"), "{refused}");
    assert!(!path.exists());
}

/// If one byte of a page is changed, either the store is refused, or all data that are read are unchanged.
#[test]
fn a_flipped_byte_is_detected_or_changes_no_data() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    store.teach(&teaching("wing")).expect("taught");
    let events: Vec<_> = (1..=200).map(super::journal::progress).collect();
    for event in &events {
        store.append(event, None).expect("written");
    }
    drop(store);
    let whole = fs::read(path.join(DATABASE)).expect("the database");
    let pages = whole.len() / 4096;
    let mut found = 0;
    for page in 0..pages {
        for offset in [3, 700, 2_000, 3_900, 4_090] {
            let mut spoilt = whole.clone();
            spoilt[page * 4096 + offset] ^= 0x04;
            fs::write(path.join(DATABASE), spoilt).expect("spoilt");
            let read = Store::open(&path).and_then(|store| Ok((store.journal()?, store.taught("wing", None)?)));
            match read {
                Ok((journal, taught)) => {
                    assert_eq!(taught.teaching, teaching("wing"), "page {page}, byte {offset}");
                    assert_eq!(journal, events, "page {page}, byte {offset}");
                }
                Err(_) => found += 1,
            }
        }
    }
    assert!(pages > 5 && found > pages, "{found} found in {pages} pages");
}

/// A command that writes one row opens an older database with a newer head. The state after the next start is still
/// Aborted, and the verification continues to report the change.
#[test]
fn a_change_found_by_a_command_keeps_the_cell_in_aborted() {
    let folder = filled_store();
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

/// A copy without the write-ahead log contains old data: after the start, the state is Aborted until a person clears
/// it.
#[test]
fn a_store_without_its_log_starts_in_aborted_until_a_person_clears_it() {
    let folder = filled_store();
    let path = store_in(&folder);
    let mut store = Store::create(&path).expect("opens");
    store.recover().expect("recovers");
    let before = fs::read(path.join(DATABASE)).expect("the database");
    let motion = Motion { epoch: 9, path: MotionPath::Contact, plan: 1, waypoints: 100 };
    store.append(&progress(1), None).expect("written");
    store.open_intent(&motion, None).expect("opened");
    // The files are as a killed process leaves them; then the log is removed.
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
    // The next start finds no new change, and has the same state.
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
fn a_missing_head_and_a_missing_database_are_reported() {
    let folder = filled_store();
    fs::remove_file(store_in(&folder).join(head::FILE)).expect("removed");
    assert!(verify(&folder).differences[0].contains("is missing"));
    let mut store = Store::create(&store_in(&folder)).expect("opens");
    assert!(matches!(store.recover().expect("recovers").at, At::Aborted { .. }));
    drop(store);
    let folder = filled_store();
    fs::remove_file(store_in(&folder).join(DATABASE)).expect("removed");
    let mut store = Store::create(&store_in(&folder)).expect("a new one");
    assert!(store.changed()[0].contains("rolled back"), "{:?}", store.changed());
    assert!(matches!(store.recover().expect("recovers").at, At::Aborted { .. }));
}

/// The files are copied like those of a killed process, at 200 moments around commits, each time into a separate
/// folder.
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
            // Another process makes the copy, because closing a file in this process would release SQLite's locks.
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

/// The lock does not depend on the lock file, which a person may remove.
#[test]
fn a_second_writer_is_refused_without_the_lock_file() {
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

/// The times in rows are those of the clock, even before 1970.
#[test]
fn a_clock_before_1970_is_accepted() {
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

/// While a thread writes lines, each copy contains the state of the store at one moment, and the stated number of
/// links.
#[test]
fn a_copy_beside_a_writer_has_the_state_of_one_moment() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let version = store.teach(&teaching("wing")).expect("taught");
    let is_over = AtomicBool::new(false);
    let lines = std::thread::scope(|scope| {
        let copier = scope.spawn(|| {
            let (mut lines, mut links) = (0, 0);
            for number in 0..20 {
                let to = folder.path().join(format!("copy{number}"));
                let copied = Store::copy_rows(&path, &to).expect("copied");
                assert_eq!(copied.deviations, [] as [String; 0]);
                assert!(copied.links >= links && copied.files.len() == 3, "{copied:?}");
                let copy = Store::open(&to).expect("a store");
                let journal = copy.journal().expect("whole");
                assert!(journal.len() >= lines);
                assert_eq!(journal, (0..journal.len() as u32).map(progress).collect::<Vec<_>>());
                (lines, links) = (journal.len(), copied.links);
                assert!(!to.join("panelprep.sqlite-wal").exists(), "one file holds it");
            }
            is_over.store(true, Ordering::Relaxed);
            lines
        });
        for done in 0.. {
            store.append(&progress(done), None).expect("written");
            // Without a pause between writes, the copy could never read the head.
            std::thread::sleep(std::time::Duration::from_millis(5));
            if is_over.load(Ordering::Relaxed) || copier.is_finished() {
                break;
            }
        }
        copier.join().expect("each copy is whole")
    });
    assert!(lines > 0, "it wrote meanwhile");
    // The copy and its files together are a complete store.
    let to = folder.path().join("copy19");
    fs::rename(path.join("blobs"), to.join("blobs")).expect("moved");
    assert_eq!(Store::verify(&to, true).expect("verified").differences, [] as [String; 0]);
    let store = Store::create(&to).expect("opens for writing");
    assert_eq!(store.changed(), [] as [String; 0]);
    assert_eq!(store.taught("wing", None).expect("there").version, version);
}

/// A store with contradictions is not copied, because the new head of the copy would hide them.
#[test]
fn a_store_that_was_changed_is_reported_and_not_copied() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    for done in 0..5 {
        store.append(&progress(done), None).expect("written");
    }
    drop(store);
    let whole = fs::read(path.join(DATABASE)).expect("read");
    let mut store = Store::create(&path).expect("opens");
    store.append(&progress(5), None).expect("written");
    drop(store);
    fs::write(path.join(DATABASE), whole).expect("rolled back");
    let copied = Store::copy_rows(&path, &folder.path().join("copy")).expect("looked at");
    assert!(copied.deviations.iter().any(|words| words.contains("rolled back")), "{copied:?}");
    assert!(!folder.path().join("copy").exists());

    // A changed row that does not contradict the head is detected as well, because the copy is verified.
    drop(Store::create(&path).expect("opens"));
    let connection = Connection::open(path.join(DATABASE)).expect("opens");
    connection.execute("UPDATE journal SET unix_ms = 7 WHERE sequence = 3", []).expect("changed");
    drop(connection);
    let copied = Store::copy_rows(&path, &folder.path().join("copy")).expect("looked at");
    assert!(copied.deviations.iter().any(|words| words.contains("changed: journal line 3")), "{copied:?}");
}

/// Before an update, the database and its head are copied beside the store. The copy is made once and opens as the
/// store did; a different database of the same schema gets a copy with another name.
#[test]
fn an_earlier_database_is_copied_once() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let version = store.teach(&teaching("wing")).expect("taught");
    let copy = |store: &Store| keep_earlier_version(&store.connection, &path, 1).expect("copied");
    let names = || {
        let names = fs::read_dir(&path).expect("listed").map(|file| file.expect("a file").file_name());
        let mut names: Vec<String> = names.filter_map(|name| name.into_string().ok()).collect();
        names.retain(|name| name.contains("schema"));
        names.sort();
        names
    };
    let kept = copy(&store);
    assert_eq!(kept, path.join("panelprep.schema-1.sqlite"));
    assert_eq!(copy(&store), kept, "once is enough");
    assert_eq!(names(), ["panelprep.schema-1.head", "panelprep.schema-1.sqlite"]);

    let former = folder.path().join("former");
    fs::create_dir_all(former.join("blobs")).expect("made");
    // The taught data are files beside the database, which no update changes.
    for blob in fs::read_dir(path.join("blobs")).expect("listed").map(|file| file.expect("a file")) {
        fs::copy(blob.path(), former.join("blobs").join(blob.file_name())).expect("copied");
    }
    fs::copy(&kept, former.join(DATABASE)).expect("put back");
    fs::copy(path.join("panelprep.schema-1.head"), former.join(head::FILE)).expect("put back");
    let restored = Store::create(&former).expect("opens");
    assert_eq!(restored.changed(), [] as [String; 0]);
    assert_eq!(restored.taught("wing", None).expect("there").version, version);

    store.append(&progress(1), None).expect("written");
    assert_eq!(copy(&store), path.join("panelprep.schema-1-2.sqlite"));
    assert_eq!(names().len(), 4, "{:?}", names());
}

/// Without space for the copy, the update is refused before anything is changed.
#[test]
fn without_space_for_the_copy_there_is_no_copy() {
    let Some(disk) = super::full::SmallDisk::mount(40) else { return };
    let (_folder, store) = new_store();
    // The database is larger than the free space.
    store.connection.execute_batch("CREATE TABLE large (bytes BLOB)").expect("made");
    store.connection.execute("INSERT INTO large VALUES (zeroblob(50000000))", []).expect("grown");
    let path = disk.folder().join("store");
    fs::create_dir(&path).expect("made");
    let refused = keep_earlier_version(&store.connection, &path, 1).expect_err("no room").to_string();
    assert!(refused.contains("full"), "{refused}");
    assert_eq!(fs::read_dir(&path).expect("listed").count(), 0);
}

/// Only a start of the service updates the tables.
#[test]
fn a_store_of_an_earlier_schema_is_refused_for_reading() {
    assert!(schema::require_current(schema::SCHEMA, "store".as_ref()).is_ok());
    let refused = schema::require_current(0, "store".as_ref()).expect_err("earlier").to_string();
    assert!(refused.contains("has schema 0, this program needs schema 1. Start the service once"), "{refused}");
}
