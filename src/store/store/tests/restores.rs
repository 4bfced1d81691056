//! Tests that after a restore no cycle number is used again, and no part is sanded if its counted number of passes may
//! be too low.

use super::super::chain::{self, ChainPosition};
use super::super::flush::file_hash;
use super::super::head::HeadFile;
use super::contacts::{add_interrupted_cycle, film, start_of};
use super::evidence::change_outside_the_program;
use super::*;
use panelprep_base::verdict::Verdict;
use panelprep_cell::cycle::{At, Cause};
use panelprep_cell::record::{CycleId, LostPasses};
use std::path::PathBuf;

/// Time of the backups, s since 1970: 2027-01-15.
const MADE_UNIX_S: i64 = 1_800_000_000;

/// Returns a restore about which only the last cycle number is known.
fn lost(last_cycle: i64) -> Restore {
    Restore { last_cycle: CycleId(last_cycle), made_unix_s: Some(MADE_UNIX_S), is_nothing_abraded: false }
}

/// Returns a restore about which it is proven that nothing was sanded after the backup.
fn nothing_abraded(last_cycle: i64) -> Restore {
    Restore { is_nothing_abraded: true, ..lost(last_cycle) }
}

/// Returns a closed store with cycle 1, in which one grid of the part SN1 was sanded.
fn after_one() -> (TempDir, PathBuf) {
    let (folder, mut store) = new_store();
    assert_eq!(add_interrupted_cycle(&mut store, ("SN1", 3), false), CycleId(1));
    let path = folder.path().join("store");
    (folder, path)
}

/// Returns the store of [`after_one`] after this restore, open for writing.
fn restored_after_one(restore: &Restore) -> (TempDir, PathBuf, Store) {
    let (folder, path) = after_one();
    let store = restored(&path, restore);
    (folder, path, store)
}

/// Marks a closed store as restored, and opens it.
fn restored(path: &Path, restore: &Restore) -> Store {
    Store::mark_restored(path, restore).expect("marked");
    Store::create(path).expect("opened")
}

/// Adds a cycle that passes with a film, without a sanding pass.
fn add_film(path: &Path) {
    let mut store = Store::create(path).expect("opened");
    let id = store.begin_cycle(&start_of("SN1", false)).expect("begun");
    film(&mut store, id, Verdict::Pass);
}

/// Copies a closed store, as a backup does.
fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to.join(BLOBS)).expect("a folder");
    let blobs = fs::read_dir(from.join(BLOBS)).expect("listed").map(|entry| entry.expect("an entry").path());
    for file in ROW_FILES.map(|name| from.join(name)).into_iter().chain(blobs) {
        let name = file.strip_prefix(from).expect("below");
        fs::copy(&file, to.join(name)).expect("copied");
    }
}

/// Changes a store like a person who knows its format: chain, head and the hash of the file agree with the rows.
fn forge(store: &Path, sql: &str) {
    let file = store.join(DATABASE);
    let connection = Connection::open(&file).expect("opens");
    connection.pragma_update(None, "foreign_keys", "OFF").expect("set");
    connection.execute_batch(sql).expect("changed");
    let links: Vec<(String, i64)> = {
        let mut read = connection.prepare("SELECT part, row_key FROM chain ORDER BY link").expect("prepared");
        let rows = read.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).expect("read");
        rows.collect::<Result<_, _>>().expect("read")
    };
    connection.execute("DELETE FROM chain", []).expect("removed");
    let mut place = ChainPosition::START;
    for (part, key) in links {
        place =
            chain::add_link(&connection, place, chain::hashed_table(&part).expect("ours"), key).expect("forged");
    }
    drop(connection);
    let hash = file_hash(&file).expect("read");
    HeadFile::open(store).and_then(|head| head.close(place, Some(hash))).expect("a forged head");
    assert_eq!(Store::verify(store, false).expect("verified").differences, [] as [String; 0]);
}

fn with_lost_passes(serial: &str, passes: u8) -> CycleStart {
    let mut start = start_of(serial, false);
    start.file_texts.push((LostPasses::FILE.to_owned(), format!("passes = {passes}\n")));
    start
}

fn refused(store: &mut Store, start: &CycleStart) -> UnknownPassCount {
    match store.begin_cycle(start) {
        Err(StoreError::CountUnknown(lost)) => lost,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_restored_store_begins_a_new_epoch_once() {
    let (_folder, path, store) = restored_after_one(&lost(1));
    drop(store);
    let store = Store::create(&path).expect("opened again");
    let epochs = store.outbox_epochs().expect("epochs");
    assert_eq!(epochs.iter().map(|last| last.number).collect::<Vec<_>>(), [1, 0]);
    assert_ne!(epochs[0].epoch, epochs[1].epoch);
}

/// The last cycle of the backup is cycle 1; the last cycle of the replaced store was cycle 12. After every start, the
/// state is Aborted until a person has cleared it. No number is used twice, after this restore or after another one.
#[test]
fn a_restored_store_waits_for_a_person_and_continues_above_the_last_number() {
    let (_folder, path, store) = restored_after_one(&lost(12));
    drop(store);
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
    let mut store = restored(&path, &lost(3));
    assert_eq!(store.begin_cycle(&start_of("", true)).expect("begun"), CycleId(15));
}

/// SN1 had one sanding pass before the backup and may have had more after it. No cycle with SN1 or another part begins
/// until a start request states the passes on this part. An air-run has no contact and may begin.
#[test]
fn no_part_begins_with_an_unknown_pass_count() {
    let (_folder, path, mut store) = restored_after_one(&lost(7));
    let one = CycleId(1);
    let unknown = refused(&mut store, &start_of("SN1", false));
    assert_eq!((unknown.serial.as_str(), unknown.made_unix_s), ("SN1", Some(MADE_UNIX_S)));
    let opened_unix_s = store.unix_s();
    let since_s = opened_unix_s - unknown.restored_unix_s;
    assert!((0..600).contains(&since_s), "restored {since_s} s ago");
    assert_eq!(refused(&mut store, &start_of("", false)).serial, "");
    store.begin_cycle(&CycleStart { is_air_run: true, ..start_of("SN1", false) }).expect("an air-run");
    refused(&mut store, &start_of("SN1", false));

    // One pass on one grid is known, and two passes on all grids were stated. They are also counted in later cycles.
    let two = store.begin_cycle(&with_lost_passes("sn1 ", 2)).expect("stated");
    store.conclude(two, Verdict::Aborted, &[]).expect("concluded");
    let three = store.begin_cycle(&start_of("SN1", false)).expect("it is known now");
    let again = store.begin_cycle(&start_of("SN1", true)).expect("it is known now");
    for cycle in [two, three, again] {
        let counted = store.earlier_abrasions(cycle).expect("read");
        let stated =
            counted.iter().filter(|pass| pass.is_stated && pass.grid.is_none() && pass.cycle == two).count();
        assert_eq!((counted.len(), stated, counted[0].cycle), (3, 2, one), "{counted:?}");
    }
    let of_serial = store.sanding_passes_by_serial("SN1", None).expect("read");
    assert_eq!(of_serial.iter().map(|cycle| (cycle.cycle, cycle.passes)).collect::<Vec<_>>(), [(one, 1), (two, 2)]);
    assert_eq!(of_serial[1].removed_um, None, "its depth is not known");

    // A second restore loses cycles again.
    drop(store);
    let mut store = restored(&path, &lost(20));
    refused(&mut store, &start_of("SN1", false));
}

/// A serial number identifies a part, and the statement "another part" does not contain the number of passes on it;
/// only a number is sufficient. For a part without a serial number, both statements are sufficient.
#[test]
fn another_part_is_sufficient_only_without_a_serial_number() {
    let (_folder, _path, mut store) = restored_after_one(&lost(7));
    for serial in ["SN1", "SN2"] {
        assert_eq!(refused(&mut store, &start_of(serial, true)).serial, serial);
    }
    // The statement at the start of an air-run, which is never refused, is not sufficient either.
    let air_run = CycleStart { is_air_run: true, ..start_of("SN2", true) };
    store.begin_cycle(&air_run).expect("an air-run");
    refused(&mut store, &start_of("SN2", false));
    store.begin_cycle(&with_lost_passes("SN2", 0)).expect("stated");
    store.begin_cycle(&start_of("SN2", false)).expect("stated before");
    refused(&mut store, &start_of("SN1", false));
    refused(&mut store, &start_of("", false));
    store.begin_cycle(&start_of("", true)).expect("another part");
    store.begin_cycle(&start_of("", false)).expect("stated before");
}

/// A number of 300 passes, or the text of another program, is not a valid statement, and no cycle begins.
#[test]
fn an_unreadable_statement_does_not_count() {
    let (_folder, _path, mut store) = restored_after_one(&lost(0));
    for text in ["passes = 300\n", "passes = -1\n", "", "passes = 1\nmore = 2\n"] {
        let mut start = start_of("SN1", false);
        start.file_texts.push((LostPasses::FILE.to_owned(), text.to_owned()));
        refused(&mut store, &start);
    }
    assert_eq!(store.newest_cycle().expect("read"), Some(CycleId(1)));
    assert_eq!(store.begin_cycle(&with_lost_passes("SN1", 255)).expect("the largest number"), CycleId(2));
}

/// The replaced store shows its last cycle number, and whether anything was sanded after the backup.
#[test]
fn the_replaced_store_shows_its_last_number_and_abrasions() {
    let (folder, path) = after_one();
    let backup = folder.path().join("backup");
    copied(&path, &backup);
    let shown = || Store::compute_restore(&path, &backup, MADE_UNIX_S);
    assert_eq!(shown(), Some(nothing_abraded(1)), "the same state");
    add_film(&path);
    assert_eq!(shown(), Some(nothing_abraded(2)), "a film alone abrades nothing");
    add_interrupted_cycle(&mut Store::create(&path).expect("opened"), ("SN1", 5), false);
    assert_eq!(shown(), Some(lost(3)), "a contact after the backup");

    // If it is proven that nothing was sanded, the numbers of passes are still known.
    let mut store = restored(&backup, &nothing_abraded(2));
    let three = store.begin_cycle(&start_of("SN1", false)).expect("begun");
    assert_eq!((three, store.earlier_abrasions(three).expect("read").len()), (CycleId(3), 1));
}

/// A store is accepted as a proof only if it contains the last link of the backup, has no other incidents, and does not
/// contradict its own chain. Even without this proof, a store of this cell shows which numbers may have been used.
#[test]
fn a_store_that_is_no_later_state_shows_nothing() {
    let (folder, path) = after_one();
    let at = |name: &str| folder.path().join(name);
    copied(&path, &at("earlier"));
    add_film(&path);
    copied(&path, &at("backup"));
    let shown = |replaced: &Path| Store::compute_restore(replaced, &at("backup"), MADE_UNIX_S);
    let number = |replaced: &Path| Store::last_readable_number(replaced, &at("backup")).map(|last| last.0);
    assert_eq!((shown(&path), number(&path)), (Some(nothing_abraded(2)), Some(2)));
    assert_eq!((shown(&at("earlier")), number(&at("earlier"))), (None, Some(1)), "an earlier state");

    // This store has the same beginning as the backup, but other cycles after it: it has more links than the backup,
    // and its link with the number of the backup's last link is different.
    copied(&at("earlier"), &at("branch"));
    (0..3).for_each(|_| add_film(&at("branch")));
    assert_eq!((shown(&at("branch")), number(&at("branch"))), (None, Some(4)), "a branch");
    let (_other_folder, other) = after_one();
    (0..3).for_each(|_| add_film(&other));
    assert_eq!((shown(&other), number(&other)), (None, None), "the store of another cell");
    drop(Store::create(&at("new")).expect("a new store"));
    assert_eq!((shown(&at("new")), number(&at("new"))), (None, None), "the empty store of a new computer");
    assert_eq!((shown(&at("none")), number(&at("none"))), (None, None));

    copied(&path, &at("incident"));
    Store::create(&at("incident")).expect("opened").store_incident(&["a change".to_owned()]).expect("kept");
    assert_eq!(shown(&at("incident")), None, "a change was found in it after the backup");
    copied(&path, &at("rewritten"));
    forge(&at("rewritten"), "UPDATE cycles SET panel = 'fin' WHERE id = 1");
    assert_eq!(shown(&at("rewritten")), None, "a row before the backup with a chain and a head of its own");
    add_interrupted_cycle(&mut Store::create(&path).expect("opened"), ("SN1", 5), false);
    assert_eq!(shown(&path), Some(lost(3)));
    change_outside_the_program(&folder, "DELETE FROM permits WHERE id > 1");
    assert_eq!((shown(&path), number(&path)), (None, Some(3)), "the permit of the contact is deleted");
    fs::write(path.join(DATABASE), b"no database").expect("spoilt");
    assert_eq!((shown(&path), number(&path)), (None, None));
}

/// A later state does not prove that it is the newest one, or that its end was not forged. Therefore a restore compares
/// its last number with the number that a person states. An older copy has a lower number than the last one of the
/// cell; a forged end with the correct number is accepted.
#[test]
fn an_older_copy_and_a_forged_end_are_accepted_as_later_state() {
    let (folder, path) = after_one();
    let at = |name: &str| folder.path().join(name);
    copied(&path, &at("backup"));
    add_film(&path);
    copied(&path, &at("older"));
    add_interrupted_cycle(&mut Store::create(&path).expect("opened"), ("SN1", 5), false);
    let shown = |replaced: &Path| Store::compute_restore(replaced, &at("backup"), MADE_UNIX_S);
    assert_eq!(shown(&path), Some(lost(3)));
    assert_eq!(shown(&at("older")), Some(nothing_abraded(2)), "its number is not 3");
    let sql = "DELETE FROM permits WHERE id > 1; DELETE FROM chain WHERE part = 'permits' AND row_key > 1";
    forge(&path, sql);
    assert_eq!(shown(&path), Some(nothing_abraded(3)), "no secret is in the chain");
}
