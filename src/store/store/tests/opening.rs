//! Opening: for reading, for writing, with a store of an earlier version of this program, and with a damaged store.

use super::*;
use panelprep_cell::cycle::{Event, Report};

/// The tables of the first schema; frozen.
const SCHEMA_1: &str = "
    CREATE TABLE taught_panels (
        id INTEGER PRIMARY KEY, name TEXT NOT NULL, version TEXT NOT NULL, taught_at_unix_s INTEGER NOT NULL,
        scan_hash TEXT NOT NULL, recipe_text TEXT NOT NULL, scanner_calibration_text TEXT NOT NULL,
        base_from_camera_text TEXT NOT NULL, flange_camera_text TEXT NOT NULL, flange_from_camera_text TEXT NOT NULL
    ) STRICT;
    CREATE INDEX taught_panels_by_name ON taught_panels (name);
    CREATE TABLE taught_corners (
        panel_id INTEGER NOT NULL REFERENCES taught_panels (id), position INTEGER NOT NULL,
        picture_hash TEXT NOT NULL, base_from_flange TEXT NOT NULL, PRIMARY KEY (panel_id, position)
    ) STRICT;
    PRAGMA user_version = 1;
";

/// Converts the store in this folder to the state of the first version of this program.
pub fn become_the_first_schema(path: &std::path::Path) {
    let old = path.join("old.sqlite");
    let connection = Connection::open(&old).expect("made");
    connection.execute_batch(SCHEMA_1).expect("the first schema");
    connection.execute("ATTACH ?1 AS new", [path.join(DATABASE).to_str()]).expect("attached");
    for table in ["taught_panels", "taught_corners"] {
        connection.execute(&format!("INSERT INTO {table} SELECT * FROM new.{table}"), []).expect("copied");
    }
    drop(connection);
    fs::rename(&old, path.join(DATABASE)).expect("in its place");
}

#[test]
fn a_store_of_the_first_schema_keeps_its_panels_and_gets_the_new_tables() {
    let (folder, mut store) = new_store();
    let version = store.teach(&teaching("wing")).expect("taught");
    drop(store);
    let path = folder.path().join("store");
    become_the_first_schema(&path);

    // Reading changes nothing; opening for writing updates the tables.
    let reader = Store::open(&path).expect("the earlier store");
    assert_eq!(reader.taught("wing", None).expect("there").teaching, teaching("wing"));
    assert!(reader.journal().is_err(), "no journal yet");
    drop(reader);
    let store = Store::create(&path).expect("the same store");
    assert_eq!(store.taught("wing", Some(&version)).expect("there").teaching, teaching("wing"));
    // The head of the newer store contradicts the older tables: the journal states that the store was changed.
    assert_eq!(store.journal().expect("a journal"), [Event::Reported(Report::StoreChanged)]);
    let found: i64 =
        store.connection.pragma_query_value(None, "user_version", |row| row.get(0)).expect("a version");
    assert_eq!(found, 9);
}

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

/// One byte of each page is changed: the store is refused, or all data that are read are the written data.
#[test]
fn a_flipped_byte_is_found_or_harms_nothing() {
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
