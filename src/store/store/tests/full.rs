//! Tests of a full disk: pictures are dropped, the journal is written with the help of its reserve, and a start reports
//! which files to delete.
//!
//! Also tests of which old files are removed and which are never removed.

use super::journal::progress;
use super::*;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cell::{Retention, RetentionTime};
use panelprep_cell::cycle::{Motion, Outcome, Path as MotionPath};
use panelprep_cell::record::{CycleId, Finding, KeptFile, Kind, Picture};
use std::process::Command;
use std::time::{Duration, SystemTime};

/// A small separate disk, if the user who runs the tests may mount one.
pub struct SmallDisk(TempDir);

impl SmallDisk {
    pub fn mount(mb: u32) -> Option<Self> {
        let folder = tempfile::tempdir().expect("a folder");
        let size = format!("size={mb}m");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "none"]).arg(folder.path()).output();
        match mounted {
            Ok(said) if said.status.success() => Some(SmallDisk(folder)),
            said => {
                eprintln!("not run: no disk can be mounted here: {said:?}");
                None
            }
        }
    }

    /// Returns the folder at which the disk is mounted.
    pub fn folder(&self) -> &std::path::Path {
        self.0.path()
    }

    /// Fills the free space of the disk.
    fn fill(&self) {
        let mut ballast =
            fs::OpenOptions::new().create(true).append(true).open(self.0.path().join("ballast")).expect("made");
        let block = vec![7; 1 << 16];
        while std::io::Write::write_all(&mut ballast, &block).is_ok() {}
        while std::io::Write::write_all(&mut ballast, &block[..1]).is_ok() {}
    }

    fn empty(&self) {
        fs::remove_file(self.0.path().join("ballast")).expect("removed");
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0.path()).status();
    }
}

/// Another program fills the disk during contact: the retract, the hold and the stop are written to the journal, and
/// pictures are dropped. A start on the full disk reports which files to delete.
#[test]
fn the_journal_continues_on_a_full_disk() {
    let Some(disk) = SmallDisk::mount(140) else { return };
    let path = disk.0.path().join("store");
    let mut store = Store::create(&path).expect("a new store");
    store.recover().expect("recovers");
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    let picture = store.store_picture(b"jpeg").expect("kept").expect("there is room");
    let motion = Motion { epoch: 3, path: MotionPath::Contact, plan: 7, waypoints: 200 };
    store.open_intent(&motion, Some(id)).expect("opened");

    disk.fill();
    assert_eq!(store.store_picture(b"another").expect("no error"), None, "pictures first");
    assert!(store.is_disk_full());
    assert!(matches!(store.store_blob(b"a recipe"), Err(StoreError::Full { .. })), "what must be kept is an error");
    for done in 0..1_000 {
        store.append(&progress(done), Some(id)).expect("the journal continues");
    }
    let finding = Finding::new(Kind::Abrade, 1, Judgement { verdict: Verdict::Review, reasons: vec![] });
    store.store_finding(id, &finding).expect("kept");
    store.close_intent(&motion, Outcome::Held, 17).expect("closed");
    store.conclude(id, Verdict::Aborted, &[]).expect("concluded");
    assert_eq!(store.dropped_pictures(), 1);
    assert!(!store.has_free_space());
    drop(store);

    // The store is opened in the space of the released reserve.
    let mut store = Store::create(&path).expect("opens on a full disk");
    assert_eq!(store.changed(), [] as [String; 0]);
    let recovered = store.recover().expect("recovers");
    assert!(store.is_disk_full());
    drop(store);
    // Every start without free space returns the error of a full disk, and causes no damage.
    disk.fill();
    for _ in 0..40 {
        match Store::create(&path) {
            Err(error @ StoreError::Full { .. }) => {
                let words = error.to_string();
                assert!(
                    words.contains("is full (0 MB free, minimum 96 MB)") && words.contains("delete"),
                    "{words}"
                );
            }
            other => panic!("a start without room for a journal: {:?}", other.map(drop)),
        }
    }
    disk.empty();
    let mut store = Store::create(&path).expect("opens");
    assert_eq!((store.recover().expect("recovers"), store.changed().len()), (recovered, 0));
    assert!(store.has_free_space() && !store.is_disk_full());
    assert_eq!(store.blob(&picture).expect("kept"), b"jpeg");
    assert_eq!(store.journal().expect("whole").len(), 1_000);
    drop(store);
    assert_eq!(Store::verify(&path, true).expect("verified").differences, [] as [String; 0]);
}

/// Creates a cycle with a scan, a clip of three pictures, and a picture on its page; returns the hashes of the scan and
/// of the clip's pictures.
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
fn only_old_clips_and_scans_are_removed() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let ended = [Verdict::Pass, Verdict::Fail, Verdict::Review, Verdict::Pass, Verdict::Aborted, Verdict::Pass];
    let cycles: Vec<_> =
        (0..).zip(ended).map(|(number, verdict)| cycle(&mut store, number, Some(verdict))).collect();
    assert_eq!(Store::prune(&path, &Retention::default()).expect("nothing"), PrunedFiles::default());
    let there = |number: usize| kept(&folder, &cycles[number].1);

    // Files are removed while another process has the store open for writing.
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
    // All records and the pictures on their pages can still be read.
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

/// A file that two cycles name is kept as long as one of the cycles is kept.
#[test]
fn a_file_of_two_cycles_stays_while_one_is_kept() {
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
fn days_are_counted_back_from_the_newest_cycle() {
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

/// A process was killed after it recorded files as removed and before it deleted them; the next process deletes them.
#[test]
fn files_left_by_a_killed_process_are_removed_by_the_next() {
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
