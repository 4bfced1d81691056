//! A full disk: pictures are dropped, the journal continues with its reserve, and a start reports what to delete.

use super::journal::progress;
use super::*;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::cycle::{Motion, Outcome, Path as MotionPath};
use panelprep_cell::record::{Finding, Kind};
use std::process::Command;

/// A small disk of its own, if this user may mount one.
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

    /// Its folder.
    pub fn folder(&self) -> &std::path::Path {
        self.0.path()
    }

    /// Fills all free space.
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

/// Another program fills the disk during contact: the retract, the hold and the stop are journaled, and pictures
/// are dropped. A person who starts the program on the full disk is informed what to delete.
#[test]
fn the_journal_continues_where_the_disk_is_full() {
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

    // Starts in the space that the reserve has freed.
    let mut store = Store::create(&path).expect("opens on a full disk");
    assert_eq!(store.changed(), [] as [String; 0]);
    let recovered = store.recover().expect("recovers");
    assert!(store.is_disk_full());
    drop(store);
    // A start without any space gives an error that reports this, each time, and causes no damage.
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
