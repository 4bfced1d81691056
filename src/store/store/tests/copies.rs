//! Copies: during writing, of a store that was changed, and before the tables of an earlier version of this program
//! are updated.

use super::journal::progress;
use super::opening::become_the_first_schema;
use super::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// While a thread writes lines, each copy contains the store at one moment, with the content that
/// it reports.
#[test]
fn a_copy_beside_a_writer_is_the_store_of_one_moment() {
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
            // A writer without any pause would never let the copier read the head.
            std::thread::sleep(std::time::Duration::from_millis(5));
            if is_over.load(Ordering::Relaxed) || copier.is_finished() {
                break;
            }
        }
        copier.join().expect("each copy is whole")
    });
    assert!(lines > 0, "it wrote meanwhile");
    // With its files, the copy is a complete store.
    let to = folder.path().join("copy19");
    fs::rename(path.join("blobs"), to.join("blobs")).expect("moved");
    assert_eq!(Store::verify(&to, true).expect("verified").differences, [] as [String; 0]);
    let store = Store::create(&to).expect("opens for writing");
    assert_eq!(store.changed(), [] as [String; 0]);
    assert_eq!(store.taught("wing", None).expect("there").version, version);
}

/// A copy gets a new head, which would hide contradictions to the store's head.
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

    // A changed row that no head shows: the copy is verified, too.
    drop(Store::create(&path).expect("opens"));
    let connection = Connection::open(path.join(DATABASE)).expect("opens");
    connection.execute("UPDATE journal SET unix_ms = 7 WHERE sequence = 3", []).expect("changed");
    drop(connection);
    let copied = Store::copy_rows(&path, &folder.path().join("copy")).expect("looked at");
    assert!(copied.deviations.iter().any(|words| words.contains("changed: journal line 3")), "{copied:?}");
}

/// The database of an earlier version of this program is copied beside the store before it is changed. The copy is
/// made once and opens unchanged.
#[test]
fn an_earlier_programs_database_is_kept_before_its_tables_are_changed() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    store.teach(&teaching("wing")).expect("taught");
    drop(store);
    become_the_first_schema(&path);
    fs::remove_file(path.join("panelprep.head")).expect("the first program wrote none");
    let refused = Store::copy_rows(&path, &folder.path().join("copy")).expect_err("an earlier one").to_string();
    assert!(refused.contains("has schema 1, this program needs schema 9. Start the service once"), "{refused}");

    let rows = |file: &str| -> (i64, i64) {
        let connection = Connection::open(path.join(file)).expect("opens");
        let version = connection.pragma_query_value(None, "user_version", |row| row.get(0)).expect("a version");
        let panels = connection.query_row("SELECT count(*) FROM taught_panels", [], |row| row.get(0));
        (version, panels.expect("its table"))
    };
    let kept = || {
        let names = fs::read_dir(&path).expect("listed").map(|file| file.expect("a file").file_name());
        let mut names: Vec<String> = names.filter_map(|name| name.into_string().ok()).collect();
        names.retain(|name| name.contains("schema"));
        names.sort();
        names
    };
    let earlier = fs::read(path.join(DATABASE)).expect("read");
    drop(Store::create(&path).expect("brought up to date"));
    assert_eq!(kept(), ["panelprep.schema-1.sqlite"]);
    assert_eq!((rows("panelprep.schema-1.sqlite"), rows(DATABASE)), ((1, 1), (9, 1)));
    drop(Store::create(&path).expect("once is enough"));
    assert_eq!(kept().len(), 1);

    // The old database is restored and updated again: an equal copy is not stored twice, a different copy is stored
    // beside it.
    let put_back = |bytes: &[u8]| {
        fs::write(path.join(DATABASE), bytes).expect("put back");
        fs::remove_file(path.join("panelprep.head")).expect("with its head");
    };
    put_back(&earlier);
    drop(Store::create(&path).expect("brought up to date"));
    assert_eq!(kept().len(), 1);
    put_back(&fs::read(path.join("panelprep.schema-1.sqlite")).expect("read"));
    let connection = Connection::open(path.join(DATABASE)).expect("opens");
    connection.execute("UPDATE taught_panels SET taught_at_unix_s = 7", []).expect("changed");
    drop(connection);
    drop(Store::create(&path).expect("brought up to date"));
    assert_eq!(kept(), ["panelprep.schema-1-2.sqlite", "panelprep.schema-1.sqlite"]);
}

/// Without space for the copy nothing is changed.
#[test]
fn without_room_for_the_copy_the_tables_stay_as_they_are() {
    let Some(disk) = super::full::SmallDisk::mount(40) else { return };
    let (folder, mut store) = new_store();
    store.teach(&teaching("wing")).expect("taught");
    drop(store);
    become_the_first_schema(&folder.path().join("store"));
    // The database is larger than the free space beside it.
    let database = folder.path().join("store").join(DATABASE);
    let connection = Connection::open(&database).expect("opens");
    connection
        .execute("UPDATE taught_panels SET recipe_text = recipe_text || hex(zeroblob(12000000))", [])
        .expect("grown");
    drop(connection);
    let path = disk.folder().join("store");
    fs::create_dir(&path).expect("made");
    fs::copy(&database, path.join(DATABASE)).expect("copied");
    let before = fs::read(path.join(DATABASE)).expect("read");
    let refused = Store::create(&path).expect_err("no room").to_string();
    assert!(refused.contains("full"), "{refused}");
    assert!(fs::read(path.join(DATABASE)).expect("read") == before, "nothing was changed");
    let names: Vec<_> =
        fs::read_dir(&path).expect("listed").map(|file| file.expect("a file").file_name()).collect();
    assert!(!names.iter().any(|name| name.to_string_lossy().contains("schema")), "{names:?}");
}
