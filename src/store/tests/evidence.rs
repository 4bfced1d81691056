//! What is changed behind the program's back is found; what a crash leaves is no alarm.

use super::super::chain::{self, PARTS};
use super::super::head;
use super::super::steps::Step;
use super::journal::progress;
use super::*;
use crate::cycle::{At, Cause, Event, Motion, Outcome, Path as MotionPath, Report, Request};
use crate::record::{Budget, Finding, Kind};
use crate::verdict::{Judgement, Verdict};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A store in which every table has rows, closed.
fn whole() -> TempDir {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    store.teach(&teaching("wing")).expect("taught");
    for number in 0..4_u32 {
        let id = store.begin_cycle(&super::cycles::start()).expect("begun");
        let judgement = Judgement { verdict: Verdict::Review, reasons: vec![] };
        let picture = store.put_blob(format!("picture {number}").as_bytes()).expect("kept");
        let mut finding = Finding::new(Kind::Locate, 0, judgement);
        finding.shots.push(crate::record::KeptFile { name: "scan".to_owned(), hash: picture });
        store.note(id, &finding).expect("kept");
        let motion = Motion { epoch: 1 + number, path: MotionPath::Park, plan: 0, waypoints: 1 };
        store.open_intent(&motion, Some(id)).expect("opened");
        for done in 0..30 {
            store.append(&progress(100 * number + done), Some(id)).expect("written");
        }
        store.close_intent(&motion, Outcome::Done, 1).expect("closed");
        store.wear_disc(Some(id), 2.5).expect("kept");
        store.set_budget(id, &Budget { locate_mm: Some(0.1), ..Budget::default() }).expect("kept");
        store.set_budget(id, &Budget { locate_mm: Some(0.2), ..Budget::default() }).expect("replaced");
        store.conclude(id, Verdict::Fail, &[]).expect("kept");
    }
    store.keep_verification(&super::verifications::verified("scanner", 0.1)).expect("kept");
    drop(store);
    let strike = crate::calib::health::Strike { by: "A".to_owned(), why: "mistyped".to_owned(), at_unix_s: 9 };
    Store::strike_in(&folder.path().join("store"), 1, &strike).expect("struck out");
    folder
}

fn store_in(folder: &TempDir) -> std::path::PathBuf {
    folder.path().join("store")
}

fn verify(folder: &TempDir) -> Verified {
    Store::verify(&store_in(folder), true).expect("verified")
}

/// Another program writes to the database; its file's own hash is not what gives it away.
fn behind_its_back(folder: &TempDir, sql: &str) {
    let connection = Connection::open(store_in(folder).join(DATABASE)).expect("opens");
    connection.pragma_update(None, "foreign_keys", "OFF").expect("set");
    connection.execute_batch(sql).unwrap_or_else(|error| panic!("{sql}: {error}"));
}

fn rows_alone(found: &Verified) -> Vec<&str> {
    found.found.iter().map(String::as_str).filter(|words| !words.contains("after the program closed it")).collect()
}

/// Whoever adds a table or a column must take it into the chain. The table of parts is an index over texts that are in it, and is
/// compared with them.
#[test]
fn every_column_of_every_table_is_in_the_chain() {
    let (_folder, store) = new_store();
    let sql = "SELECT m.name, c.name FROM sqlite_master m, pragma_table_info(m.name) c
        WHERE m.type = 'table' AND m.name NOT LIKE 'sqlite_%' AND m.name NOT IN ('chain', 'cycle_parts')";
    let mut statement = store.connection.prepare(sql).expect("prepared");
    let columns = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).expect("read");
    let columns: Vec<(String, String)> = columns.collect::<Result<_, _>>().expect("read");
    assert!(columns.len() > 40, "{columns:?}");
    for (table, column) in columns {
        let parts = PARTS.iter().filter(|part| part.table == table);
        let held = parts.clone().any(|part| part.key == column || part.columns.contains(&column.as_str()));
        assert!(held, "{table}.{column} is in no part of the chain");
    }
}

#[test]
fn a_store_that_nobody_touched_is_whole() {
    let folder = whole();
    let found = verify(&folder);
    assert_eq!((found.found.clone(), found.known.len()), (vec![], 0));
    assert!(found.links > 150 && found.files > 5, "{found:?}");
    for _ in 0..3 {
        let mut store = Store::create(&store_in(&folder)).expect("opens");
        assert_eq!(store.changed(), [] as [String; 0]);
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        store.append(&progress(1), None).expect("written");
    }
    assert_eq!(verify(&folder).found, [] as [String; 0]);
}

/// Each with a word that is told of it.
#[test]
fn every_deletion_edit_and_exchange_is_named() {
    let exchange =
        "UPDATE journal SET sequence = -1 WHERE sequence = 7; UPDATE journal SET sequence = 7 WHERE sequence = 9;
        UPDATE journal SET sequence = 9 WHERE sequence = -1";
    let planted = [
        ("DELETE FROM journal WHERE sequence > 20", "deleted: journal line 21 to 120 is missing"),
        ("DELETE FROM findings", "deleted: finding 1 to 4 is missing"),
        ("UPDATE cycles SET verdict = 'pass'", "changed: end of cycle 1 to 4"),
        ("UPDATE cycles SET budget = NULL WHERE id = 2", "changed: error budget of cycle 2"),
        ("UPDATE cycles SET panel = 'fin' WHERE id = 3", "changed: cycle 3"),
        ("UPDATE findings SET finding = replace(finding, 'review', 'accept') WHERE id = 2", "changed: finding 2"),
        ("UPDATE motions SET done = 0 WHERE id = 1", "changed: end of motion 1"),
        ("UPDATE motions SET outcome = NULL, done = 0 WHERE id = 4", "changed: end of motion 4"),
        ("UPDATE discs SET swept_mm2 = 0.0 WHERE id = 1", "entry of the disc's wear 1"),
        ("UPDATE verifications SET error_mm = 0.01", "changed: verification 1"),
        ("UPDATE verification_strikes SET by = 'B'", "changed: strike of verification 1"),
        ("UPDATE taught_corners SET picture_hash = '0' WHERE position = 1", "taught corner 65537"),
        ("UPDATE taught_panels SET name = 'fin'", "changed: taught panel 1"),
        (exchange, "reordered: journal line 7 holds what was written as journal line 9"),
        ("INSERT INTO findings VALUES (9, 1, 'locate', 0, '{}')", "put in: finding 9"),
        (
            "INSERT INTO journal SELECT sequence + 1, NULL, unix_ms, event, chain FROM journal WHERE sequence = 120",
            "put in: journal line 121",
        ),
        ("DELETE FROM chain WHERE link > 100", "rolled back"),
        ("DELETE FROM chain WHERE link = 100", "links 100 to 100 of the chain are missing"),
        (
            "UPDATE chain SET row_key = row_key + 1 WHERE link = 100",
            "link 100 of the chain is not what was written",
        ),
        ("DELETE FROM chain", "rolled back"),
        ("DROP TABLE discs", "cannot be read"),
        (
            "CREATE TRIGGER t AFTER INSERT ON journal BEGIN DELETE FROM findings; END",
            "trigger t is not of this program",
        ),
        ("DROP INDEX findings_by_cycle", "index findings_by_cycle was changed or is gone"),
    ];
    for (sql, words) in planted {
        let folder = whole();
        behind_its_back(&folder, sql);
        let found = verify(&folder);
        let told = rows_alone(&found);
        assert!(told.iter().any(|found| found.contains(words)), "{sql}: {told:?}");
    }
}

/// Somebody who knows how rows are linked still does not know the head outside.
#[test]
fn a_chain_that_was_written_anew_contradicts_its_head() {
    let folder = whole();
    behind_its_back(&folder, "UPDATE cycles SET verdict = 'pass'");
    let connection = Connection::open(store_in(&folder).join(DATABASE)).expect("opens");
    connection.execute("DELETE FROM chain", []).expect("forged");
    let forged = chain::adopt(&connection).expect("forged");
    drop(connection);
    let found = verify(&folder);
    let told = rows_alone(&found);
    assert!(matches!(told[..], [words] if words.contains("rolled back")), "{forged:?} {told:?}");
    // The same number of links, another verdict.
    let folder = whole();
    let connection = Connection::open(store_in(&folder).join(DATABASE)).expect("opens");
    let sql = "UPDATE cycles SET verdict = 'pass' WHERE id = 4";
    connection.execute(sql, []).expect("changed");
    let links: Vec<(String, i64)> = {
        let mut read = connection.prepare("SELECT part, row_key FROM chain ORDER BY link").expect("prepared");
        let rows = read.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).expect("read");
        rows.collect::<Result<_, _>>().expect("read")
    };
    connection.execute("DELETE FROM chain", []).expect("forged");
    let mut place = chain::ChainPosition::BEGIN;
    for (part, key) in links {
        place = chain::add(&connection, place, chain::part(&part).expect("ours"), key).expect("forged");
    }
    drop(connection);
    let found = verify(&folder);
    assert!(matches!(rows_alone(&found)[..], [words] if words.contains("written anew")), "{found:?}");
}

/// One bit in every page, at many places: the file's own hash gives each away; rows, links and SQLite name most.
#[test]
fn a_flipped_bit_in_any_page_is_found() {
    let folder = whole();
    let path = store_in(&folder).join(DATABASE);
    let bytes = fs::read(&path).expect("the database");
    let (pages, mut flips, mut named) = (bytes.len() / 4096, 0, 0);
    for page in 0..pages {
        for offset in [3, 24, 100, 700, 2_000, 3_000, 3_900, 4_090] {
            let mut spoilt = bytes.clone();
            spoilt[page * 4096 + offset] ^= 0x04;
            fs::write(&path, spoilt).expect("spoilt");
            let found = Store::verify(&store_in(&folder), false).map_or(1, |found| {
                named += usize::from(!rows_alone(&found).is_empty());
                found.found.len()
            });
            assert!(found > 0, "page {page}, byte {offset} is silent");
            flips += 1;
        }
    }
    eprintln!("{flips} flips in {pages} pages, all found; {named} of them in what rows, links and pages say");
    assert!(pages > 10 && named > flips / 4);
    fs::write(&path, bytes).expect("as it was");
    assert_eq!(verify(&folder).found, [] as [String; 0]);
}

/// A bit in any byte of the head is told, and the store still opens where the other copy explains it.
#[test]
fn a_flipped_bit_in_the_head_is_found() {
    let folder = whole();
    let path = store_in(&folder).join(head::FILE);
    let bytes = fs::read(&path).expect("the head");
    for place in 0..bytes.len() {
        let mut spoilt = bytes.clone();
        spoilt[place] ^= 0x01;
        fs::write(&path, spoilt).expect("spoilt");
        let found = Store::verify(&store_in(&folder), false).expect("verified");
        assert!(!found.found.is_empty(), "byte {place} is silent");
    }
}

/// A copy without its log: what it says is old, and the start rests until a person clears it.
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
    // As a killed process leaves it; the log is lost on the way.
    std::mem::forget(store);
    let copy = tempfile::tempdir().expect("a folder");
    let lost = copy.path().join("store");
    fs::create_dir_all(lost.join("blobs")).expect("made");
    fs::write(lost.join(DATABASE), before).expect("copied");
    fs::copy(path.join(head::FILE), lost.join(head::FILE)).expect("copied");
    let found = Store::verify(&lost, false).expect("verified").found;
    assert!(found.iter().any(|words| words.starts_with("rolled back: 2 writings")), "{found:?}");

    let mut store = Store::create(&lost).expect("opens");
    assert!(store.changed()[0].contains("rolled back: 2 writings"), "{:?}", store.changed());
    assert_eq!(store.recover().expect("recovers").at, At::Aborted { cause: Cause::StoreChanged });
    drop(store);
    // The next start finds nothing new, and rests where it was.
    let mut store = Store::create(&lost).expect("opens");
    assert_eq!(store.changed(), [] as [String; 0]);
    assert_eq!(store.recover().expect("recovers").at, At::Aborted { cause: Cause::StoreChanged });
    assert_eq!(store.incidents().expect("kept").len(), 1);
    let waits = Store::verify(&lost, false).expect("verified");
    assert!(waits.found.iter().any(|words| words.contains("rolled back")), "{waits:?}");
    for event in [
        Event::Told(Report::Boot),
        Event::Told(Report::Robot(crate::cycle::Robot::Ready)),
        Event::Asked(Request::Clear),
    ] {
        store.append(&event, None).expect("written");
    }
    for _ in 0..12 {
        let state = store.state().expect("known");
        let Some(due) = state.due else { break };
        let answer = super::journal::answer(due.act, 0);
        store.append(&Event::Told(Report::Answered { id: due.id, answer }), None).expect("written");
    }
    assert_eq!(store.recover().expect("recovers").at, At::Stopped);
    drop(store);
    let cleared = Store::verify(&lost, false).expect("verified");
    assert_eq!((cleared.found.len(), cleared.known.len()), (0, 1), "{cleared:?}");
}

#[test]
fn a_head_that_is_gone_and_a_database_that_is_gone_are_told() {
    let folder = whole();
    fs::remove_file(store_in(&folder).join(head::FILE)).expect("removed");
    assert!(verify(&folder).found[0].contains("is missing"));
    let mut store = Store::create(&store_in(&folder)).expect("opens");
    assert!(matches!(store.recover().expect("recovers").at, At::Aborted { .. }));
    drop(store);
    let folder = whole();
    fs::remove_file(store_in(&folder).join(DATABASE)).expect("removed");
    let mut store = Store::create(&store_in(&folder)).expect("a new one");
    assert!(store.changed()[0].contains("rolled back"), "{:?}", store.changed());
    assert!(matches!(store.recover().expect("recovers").at, At::Aborted { .. }));
}

/// The files as a kill leaves them at each of 200 moments around commits, every one in a folder of its own.
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
            // Through another process: closing a file here would take SQLite's locks along.
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
        let found = Store::verify(&path, false).expect("verified").found;
        assert_eq!(found, [] as [String; 0], "{}", path.display());
        let mut store = Store::create(&path).expect("opens");
        assert_eq!(store.changed(), [] as [String; 0], "{}", path.display());
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        store.append(&progress(7), None).expect("goes on");
        drop(store);
        assert_eq!(Store::verify(&path, false).expect("verified").found, [] as [String; 0]);
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

/// One transaction less than a settled head is not what a crash leaves.
#[test]
fn the_last_line_alone_cannot_be_cut_off() {
    let folder = whole();
    behind_its_back(
        &folder,
        "DELETE FROM chain WHERE link = (SELECT max(link) FROM chain); DELETE FROM verification_strikes",
    );
    let found = verify(&folder);
    assert!(found.found.iter().any(|words| words.contains("rolled back: 1 writings")), "{found:?}");
}

/// What a store of an earlier program holds is taken into a chain, once.
#[test]
fn a_store_without_a_chain_is_taken_into_one() {
    let folder = whole();
    let drop_all = "DROP TABLE chain; DROP TABLE checkpoints; DROP TABLE incidents; DROP TABLE pruned; DROP TABLE permits; \
                    DROP TABLE contacts; DROP TABLE cycle_facts; DROP TABLE requests; DROP TABLE cycle_parts; \
                    DROP TABLE finding_times; DROP TABLE acknowledgements; DROP TABLE accounts; DROP TABLE audit; DROP TABLE signatures; \
                    DROP TABLE outbox; DROP TABLE outbox_epochs; PRAGMA user_version = 5";
    behind_its_back(&folder, drop_all);
    let path = store_in(&folder);
    // Beside a head that knows better it was rolled back, not left by an earlier program.
    let store = Store::create(&path).expect("opens");
    assert!(store.changed().iter().any(|words| words.contains("rolled back")), "{:?}", store.changed());
    drop(store);
    behind_its_back(&folder, drop_all);
    fs::remove_file(path.join(head::FILE)).expect("removed");
    let mut store = Store::create(&path).expect("opens");
    assert_eq!(store.changed(), [] as [String; 0]);
    assert_eq!(store.recover().expect("recovers").at, At::Stopped);
    drop(store);
    let found = verify(&folder);
    assert!(found.found.is_empty() && found.links > 130, "{found:?}");
    behind_its_back(&folder, "UPDATE cycles SET verdict = 'pass' WHERE id = 1");
    assert!(verify(&folder).found.iter().any(|words| words.contains("end of cycle 1")));
}

/// A lock does not live by a file that somebody may remove.
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

/// A label is kept as the clock says it, also before 1970.
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
    assert_eq!(verify(&folder).found, [] as [String; 0]);
}

/// A start reads the journal from the last checkpoint on, and comes to the same.
#[test]
fn a_checkpoint_folds_as_the_whole_journal() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    for done in 0..2_500 {
        store.append(&progress(done), None).expect("written");
    }
    drop(store);
    let path = store_in(&folder);
    let mut store = Store::create(&path).expect("opens");
    let whole = store.recover().expect("recovers");
    let checkpoint = store.checkpoint().expect("read").expect("a long tail was read");
    assert_eq!((checkpoint.sequence, checkpoint.settled.state()), (2_500, store.state().expect("known")));
    drop(store);
    let mut store = Store::create(&path).expect("opens");
    assert_eq!(store.recover().expect("recovers"), whole);
    store.append(&Event::Told(Report::Boot), None).expect("written");
    let folded = store.state().expect("known");
    assert_eq!(folded, crate::cycle::fold(store.journal().expect("whole")));
}

/// How long a start takes with so many lines in the journal: `cargo test -- --ignored --nocapture a_million`.
fn started(lines: u32) -> [std::time::Duration; 3] {
    let (folder, mut store) = new_store();
    super::super::journal::fill(&mut store, lines).expect("filled");
    drop(store);
    // The first start finds no checkpoint, folds all and leaves one.
    std::array::from_fn(|_| {
        let since = std::time::Instant::now();
        let mut store = Store::create(&store_in(&folder)).expect("opens");
        assert_eq!(store.recover().expect("recovers").at, At::Stopped);
        let took = since.elapsed();
        assert_eq!(store.lines().expect("counted"), i64::from(lines));
        took
    })
}

#[test]
#[ignore = "a minute: it writes a million lines"]
fn a_start_at_a_million_lines_reads_the_last_of_them() {
    let took = started(1_000_000);
    eprintln!("start at a million lines: {took:?} (the first one folds all of them)");
    assert!(took[2].as_secs_f64() < 2.0, "{took:?}");
}

/// A start reads as many lines as came since the last checkpoint, however many there are.
#[test]
fn a_start_does_not_read_the_whole_journal() {
    let (folder, mut store) = new_store();
    super::super::journal::fill(&mut store, 30_000).expect("filled");
    store.recover().expect("recovers");
    store.append(&progress(1), None).expect("written");
    drop(store);
    // What only a reader of everything would see.
    behind_its_back(&folder, "UPDATE journal SET event = '{}' WHERE sequence = 7");
    let mut store = Store::create(&store_in(&folder)).expect("opens");
    assert_eq!(store.recover().expect("the tail alone").at, At::Stopped);
    assert!(store.journal().is_err());
    drop(store);
    assert!(verify(&folder).found.iter().any(|words| words.contains("journal line 7 ")));
    // What came lately is seen at once.
    behind_its_back(&folder, "UPDATE checkpoints SET folded = replace(folded, 'stopped', 'idle')");
    let store = Store::create(&store_in(&folder)).expect("opens");
    assert!(store.changed().iter().any(|words| words.contains("checkpoint 30000")), "{:?}", store.changed());
}
