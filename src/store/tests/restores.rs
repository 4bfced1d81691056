//! After a restore no number of a cycle is used again, and no part is abraded on a count that may be too low.

use super::contacts::{cut_short, film, start_of};
use super::*;
use crate::cycle::{At, Cause};
use crate::record::{CycleId, LostPasses};
use crate::verdict::Verdict;

/// A restore after which nothing is known about the time since the backup, except the last number of a cycle.
fn lost(last_cycle: i64) -> Restore {
    Restore { last_cycle: CycleId(last_cycle), made_unix_s: Some(1_800_000_000), is_nothing_abraded: false }
}

/// Copies a store that no program has open, as a backup does.
fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to.join(BLOBS)).expect("a folder");
    for folder in ["", BLOBS] {
        for entry in fs::read_dir(from.join(folder)).expect("listed").map(|entry| entry.expect("an entry").path()) {
            if entry.is_file() {
                fs::copy(&entry, to.join(folder).join(entry.file_name().expect("a name"))).expect("copied");
            }
        }
    }
}

fn with_lost_passes(serial: &str, passes: u8) -> CycleStart {
    let mut start = start_of(serial, false);
    start.file_texts.push((LostPasses::FILE.to_owned(), format!("passes = {passes}\n")));
    start
}

fn refused(store: &mut Store, start: &CycleStart) -> String {
    match store.begin_cycle(start) {
        Err(error @ StoreError::CountUnknown(_)) => error.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_restored_store_begins_a_new_epoch_once() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let id = store.begin_cycle(&start_of("", false)).expect("begun");
    film(&mut store, id, Verdict::Pass);
    drop(store);
    Store::mark_restored(&path, &lost(1)).expect("marked");
    drop(Store::create(&path).expect("opened"));
    let store = Store::create(&path).expect("opened again");
    assert_eq!(store.outbox_epochs().expect("epochs").iter().map(|last| last.number).collect::<Vec<_>>(), [1, 0]);
}

/// There is a backup of cycle 1; the store that it replaces had reached cycle 12. At every start the cell rests in
/// Aborted until a person has checked it. No number is used twice, by this restore or by another one.
#[test]
fn a_restored_store_asks_a_person_and_continues_above_the_last_number() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let id = store.begin_cycle(&start_of("", false)).expect("begun");
    film(&mut store, id, Verdict::Pass);
    drop(store);
    Store::mark_restored(&path, &lost(12)).expect("marked");
    for _ in 0..2 {
        let mut store = Store::create(&path).expect("opened");
        assert_eq!(store.recover().expect("recovers").at, At::Aborted { cause: Cause::StoreRestored });
        assert_eq!(store.changed(), Vec::<String>::new());
    }
    let mut store = Store::create(&path).expect("opened");
    for wanted in [13, 14] {
        assert_eq!(store.begin_cycle(&start_of("", true)).expect("begun"), CycleId(wanted));
        store.conclude(CycleId(wanted), Verdict::Aborted, &[]).expect("concluded");
    }
    drop(store);
    Store::mark_restored(&path, &lost(3)).expect("marked again");
    let mut store = Store::create(&path).expect("opened");
    assert_eq!(store.begin_cycle(&start_of("", true)).expect("begun"), CycleId(15));
}

/// SN1 had one pass before the backup and may have had more after it. No cycle of SN1 begins on the count of 1, neither
/// does one of any other part, until a start states what happened to this part. An air-run abrades nothing.
#[test]
fn no_part_begins_on_the_count_of_a_restored_store() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    let one = cut_short(&mut store, ("SN1", 3), false);
    drop(store);
    Store::mark_restored(&path, &lost(7)).expect("marked");
    let mut store = Store::create(&path).expect("opened");
    let reported = refused(&mut store, &start_of("SN1", false));
    assert!(
        reported.contains("how often the part SN1 was abraded") && reported.contains("2027-01-15"),
        "{reported}"
    );
    assert!(reported.contains("--another-part") && reported.contains("--lost-passes"), "{reported}");
    assert!(refused(&mut store, &start_of("", false)).contains("a part without a serial number"));
    store.begin_cycle(&CycleStart { is_air_run: true, ..start_of("SN1", false) }).expect("an air-run");
    refused(&mut store, &start_of("SN1", false));

    // One known pass of one grid, and two stated ones of every grid. They count for later cycles as well.
    let two = store.begin_cycle(&with_lost_passes("sn1 ", 2)).expect("stated");
    store.conclude(two, Verdict::Aborted, &[]).expect("concluded");
    let three = store.begin_cycle(&start_of("SN1", false)).expect("it is known now");
    for cycle in [two, three] {
        let counted = store.earlier_abrasions(cycle).expect("read");
        let stated =
            counted.iter().filter(|pass| pass.is_stated && pass.grid.is_none() && pass.cycle == two).count();
        assert_eq!((counted.len(), stated, counted[0].cycle), (3, 2, one), "{counted:?}");
    }
    let of_serial = store.passes_by_serial("SN1", None).expect("read");
    assert_eq!(of_serial.iter().map(|cycle| (cycle.cycle, cycle.passes)).collect::<Vec<_>>(), [(one, 1), (two, 2)]);
    assert_eq!(of_serial[1].removed_um, None, "its depth is not known");

    refused(&mut store, &start_of("SN2", false));
    store.begin_cycle(&start_of("SN2", true)).expect("another part");
    store.begin_cycle(&start_of("SN2", false)).expect("stated before");
    refused(&mut store, &start_of("", false));

    // A second restore loses cycles again.
    drop(store);
    Store::mark_restored(&path, &lost(20)).expect("marked again");
    let mut store = Store::create(&path).expect("opened");
    refused(&mut store, &start_of("SN2", false));
}

/// A person wrote 300 passes, or another program wrote the text: it is not a statement.
#[test]
fn a_statement_that_cannot_be_read_is_none() {
    let (folder, store) = new_store();
    drop(store);
    let path = folder.path().join("store");
    Store::mark_restored(&path, &lost(0)).expect("marked");
    let mut store = Store::create(&path).expect("opened");
    for text in ["passes = 300\n", "passes = -1\n", "", "passes = 1\nmore = 2\n"] {
        let mut start = start_of("SN1", false);
        start.file_texts.push((LostPasses::FILE.to_owned(), text.to_owned()));
        refused(&mut store, &start);
    }
}

/// The replaced store shows its last number, and whether anything was abraded since the backup. Another store, an empty
/// one and one that cannot be read show nothing.
#[test]
fn the_replaced_store_shows_what_is_known() {
    let (folder, mut store) = new_store();
    let (path, backup) = (folder.path().join("store"), folder.path().join("backup"));
    cut_short(&mut store, ("SN1", 3), false);
    drop(store);
    copied(&path, &backup);
    let shown = |replaced: &Path| Store::compute_restore(replaced, &backup, 1_800_000_000);
    let mut store = Store::create(&path).expect("opened");
    let two = store.begin_cycle(&start_of("SN1", false)).expect("begun");
    film(&mut store, two, Verdict::Pass);
    drop(store);
    let nothing = Restore { is_nothing_abraded: true, ..lost(2) };
    assert_eq!(shown(&path), Some(nothing), "a film alone abrades nothing");
    let mut store = Store::create(&path).expect("opened");
    cut_short(&mut store, ("SN1", 5), false);
    drop(store);
    assert_eq!(shown(&path), Some(lost(3)), "a contact after the backup");

    let other = folder.path().join("other");
    drop(Store::create(&other).expect("a new store"));
    assert_eq!(shown(&other), None, "the new computer's empty store");
    assert_eq!(shown(&folder.path().join("none")), None);
    fs::write(path.join(DATABASE), b"no database").expect("spoilt");
    assert_eq!(shown(&path), None);

    // If it is proven that nothing was abraded, the counts continue.
    Store::mark_restored(&backup, &nothing).expect("marked");
    let mut store = Store::create(&backup).expect("opened");
    let three = store.begin_cycle(&start_of("SN1", false)).expect("begun");
    assert_eq!((three, store.earlier_abrasions(three).expect("read").len()), (CycleId(3), 1));
}
