//! Which old files are removed, and which are never removed.

use super::*;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::{Retention, RetentionTime};
use panelprep_cell::record::{CycleId, Finding, KeptFile, Kind, Picture};
use std::time::{Duration, SystemTime};

/// Creates a cycle with a scan, a clip of three pictures and a picture on its page; returns the cameras' shots.
fn cycle(store: &mut Store, number: u32, verdict: Option<Verdict>) -> (CycleId, Vec<String>) {
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    let put = |what: String| store.store_blob(what.as_bytes()).expect("kept");
    let scan = put(format!("scan {number}"));
    let frames: Vec<String> = (0..3).map(|frame| put(format!("frame {number} {frame}"))).collect();
    let lines: String = frames.iter().map(|frame| format!("{frame},0.5,wet\n")).collect();
    let list = put(format!("file,time_s,phase\n{lines}"));
    let shown = put(format!("shown {number}"));
    let mut finding = Finding::new(Kind::Inspect, 0, Judgement { verdict: Verdict::Accept, reasons: vec![] });
    let named = |name: &str, hash: &String| KeptFile { name: name.to_owned(), hash: hash.clone() };
    finding.shots = vec![named("scan", &scan), named("clip.csv of 3 pictures", &list)];
    finding.pictures = vec![Picture { name: "film".to_owned(), caption: String::new(), hash: shown }];
    store.store_finding(id, &finding).expect("kept");
    if let Some(verdict) = verdict {
        store.conclude(id, verdict, &[]).expect("over");
    }
    (id, frames.into_iter().chain([scan]).collect())
}

fn kept(folder: &TempDir, files: &[String]) -> usize {
    files.iter().filter(|hash| folder.path().join("store/blobs").join(hash).exists()).count()
}

fn newest(cycles: usize, failed: usize) -> Retention {
    let of = |cycles| RetentionTime { cycles: Some(cycles), days: None };
    Retention { passed: of(cycles), failed: of(failed) }
}

#[test]
fn old_clips_and_scans_go_and_everything_else_stays() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let ended = [Verdict::Pass, Verdict::Fail, Verdict::Review, Verdict::Pass, Verdict::Aborted, Verdict::Pass];
    let cycles: Vec<_> =
        (0..).zip(ended).map(|(number, verdict)| cycle(&mut store, number, Some(verdict))).collect();
    assert_eq!(Store::prune(&path, &Retention::default()).expect("nothing"), PrunedFiles::default());
    let there = |number: usize| kept(&folder, &cycles[number].1);

    // Removal works while a writer has the store open.
    let pruned = Store::prune(&path, &newest(1, 1)).expect("removed");
    assert_eq!((pruned.files, pruned.bytes), (12, 3 * (6 + 3 * 9)));
    assert_eq!(
        [0, 1, 2, 3, 4, 5].map(there),
        [0, 0, 4, 0, 4, 4],
        "the newest of each kind, and what waits for a person"
    );
    assert_eq!(Store::prune(&path, &newest(1, 1)).expect("again").files, 0);
    let of = store.pruned_files(cycles[0].0).expect("read").expect("some");
    assert_eq!((of.files, store.pruned_files(cycles[2].0).expect("read")), (4, None));
    let found = Store::verify(&path, true).expect("verified");
    assert_eq!((found.differences, found.pruned), (vec![], 12), "removed is not missing");
    // Every record reads back, with its page's pictures.
    for (id, _) in &cycles {
        let record = store.cycle(*id).expect("there");
        assert!(store.blob(&record.findings[0].pictures[0].hash).is_ok());
    }
    fs::remove_file(path.join("blobs").join(&cycles[5].1[0])).expect("removed");
    let found = Store::verify(&path, true).expect("verified").differences;
    assert!(
        matches!(&found[..], [words] if words.contains("is missing, and no removal was recorded")),
        "{found:?}"
    );
    drop(store);
    let connection = Connection::open(path.join(DATABASE)).expect("opens");
    connection.execute("DELETE FROM pruned WHERE id = 3", []).expect("deleted");
    drop(connection);
    let found = Store::verify(&path, true).expect("verified").differences;
    assert!(found.iter().any(|words| words.contains("deleted: entry of a removed file 3 is missing")), "{found:?}");
}

#[test]
fn nothing_is_removed_while_a_cycle_runs() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let (_, first) = cycle(&mut store, 0, Some(Verdict::Pass));
    cycle(&mut store, 1, Some(Verdict::Pass));
    let (running, _) = cycle(&mut store, 2, None);
    assert_eq!(Store::prune(&path, &newest(1, 1)).expect("waits").files, 0);
    assert_eq!(kept(&folder, &first), 4);
    store.conclude(running, Verdict::Pass, &[]).expect("over");
    assert_eq!(Store::prune(&path, &newest(1, 1)).expect("removed").files, 8);
}

/// A file that two cycles name stays while one of the cycles is kept.
#[test]
fn what_is_named_twice_stays() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let (_, first) = cycle(&mut store, 7, Some(Verdict::Pass));
    let (_, second) = cycle(&mut store, 7, Some(Verdict::Pass));
    assert_eq!(first, second);
    assert_eq!(Store::prune(&path, &newest(1, 1)).expect("nothing").files, 0);
    assert_eq!(kept(&folder, &first), 4);
}

/// Days are counted back from the newest cycle; a clock that jumps to the next century removes nothing.
#[test]
fn days_are_counted_to_the_newest_cycle() {
    const DAY: Duration = Duration::from_secs(86_400);
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let keep =
        Retention { passed: RetentionTime { days: Some(30), cycles: None }, failed: RetentionTime::default() };
    store.clock = || SystemTime::now() - 40 * DAY;
    let (_, old) = cycle(&mut store, 0, Some(Verdict::Pass));
    let (_, failed) = cycle(&mut store, 1, Some(Verdict::Fail));
    assert_eq!(Store::prune(&path, &keep).expect("nothing").files, 0, "forty days ago it was the newest");
    store.clock = || SystemTime::now() - 15 * DAY;
    cycle(&mut store, 2, Some(Verdict::Pass));
    assert_eq!(Store::prune(&path, &keep).expect("nothing").files, 0);
    store.clock = SystemTime::now;
    cycle(&mut store, 3, Some(Verdict::Pass));
    assert_eq!(Store::prune(&path, &keep).expect("removed").files, 4);
    assert_eq!((kept(&folder, &old), kept(&folder, &failed)), (0, 4));
}

/// A process that ends between the rows and the files has removed the files only in the chain; the next process
/// removes them from the disk.
#[test]
fn what_a_killed_process_left_is_removed_by_the_next() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let (_, first) = cycle(&mut store, 0, Some(Verdict::Pass));
    cycle(&mut store, 1, Some(Verdict::Pass));
    Store::prune(&path, &newest(1, 1)).expect("removed");
    fs::write(path.join("blobs").join(&first[3]), "scan 0").expect("as if it had not come to it");
    assert_eq!(Store::verify(&path, true).expect("verified").differences, [] as [String; 0]);
    Store::prune(&path, &newest(1, 1)).expect("removed");
    assert_eq!(kept(&folder, &first), 0);
    let rows: i64 =
        store.connection.query_row("SELECT count(*) FROM pruned", [], |row| row.get(0)).expect("counted");
    assert_eq!(rows, 4, "each once");
}
