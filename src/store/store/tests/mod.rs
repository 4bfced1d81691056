mod contacts;
mod cycles;
mod evidence;
pub(crate) mod full;
mod journal;
mod opening;
mod outbox;
mod restores;
mod search;
mod signatures;

use super::database::{DATABASE, unix_ms};
use super::*;
use panelprep_base::geometry::KukaPose;
use rusqlite::Connection;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

fn new_store() -> (TempDir, Store) {
    let folder = tempfile::tempdir().expect("a folder");
    let store = Store::create(&folder.path().join("store")).expect("a new store");
    (folder, store)
}

fn teaching(name: &str) -> TeachingInputs {
    let pose = KukaPose { x_mm: 0.1 + 0.2, a_deg: -0.0, b_deg: 1.0 / 3.0, ..KukaPose::default() };
    TeachingInputs {
        name: name.to_owned(),
        scan: b"scan".to_vec(),
        recipe_text: "panel = \"wing\"\n".to_owned(),
        scanner_calibration_text: "fx_px = 1785\n".to_owned(),
        base_from_camera_text: "x_mm = 1\n".to_owned(),
        corners: vec![
            TaughtCorner { picture: b"first".to_vec(), base_from_flange: pose },
            TaughtCorner { picture: b"second".to_vec(), base_from_flange: KukaPose::default() },
        ],
        flange_camera_text: "fx_px = 2400\n".to_owned(),
        flange_from_camera_text: "z_mm = 80\n".to_owned(),
    }
}

#[test]
fn a_taught_panel_reads_back_bit_for_bit_after_a_restart() {
    let (folder, mut store) = new_store();
    let version = store.teach(&teaching("wing")).expect("taught");
    drop(store);
    let store = Store::open(&folder.path().join("store")).expect("the same store");
    let taught = store.taught("wing", None).expect("there");
    assert_eq!((&taught.version, &taught.teaching), (&version, &teaching("wing")));
    assert!(taught.teaching.corners[0].base_from_flange.a_deg.is_sign_negative());
    assert!(version.len() == 16 && taught.taught_at_unix_s > 1_700_000_000);
}

/// The newest version is the one that was taught last, even if the same version was taught before.
#[test]
fn the_latest_version_is_the_default_and_older_ones_stay() {
    let (_folder, mut store) = new_store();
    let first = store.teach(&teaching("wing")).expect("taught");
    let changed = TeachingInputs { scan: b"another".to_vec(), ..teaching("wing") };
    let second = store.teach(&changed).expect("taught");
    let latest = |store: &Store| store.taught("wing", None).expect("there").version;
    assert_eq!(latest(&store), second);
    assert_eq!(store.taught("wing", Some(&first)).expect("there").teaching, teaching("wing"));
    assert_eq!(store.teach(&teaching("wing")).expect("taught"), first);
    assert_eq!(latest(&store), first);
}

#[test]
fn every_part_is_in_the_version() {
    let (_folder, mut store) = new_store();
    let changes: [fn(&mut TeachingInputs); 8] = [
        |_| {},
        |t| t.scan.push(0),
        |t| t.recipe_text += "\n",
        |t| std::mem::swap(&mut t.scanner_calibration_text, &mut t.base_from_camera_text),
        |t| t.flange_camera_text.clear(),
        |t| t.flange_from_camera_text += "\n",
        |t| t.corners[1].base_from_flange.c_deg = 1e-12,
        |t| t.corners.swap(0, 1),
    ];
    let mut versions: Vec<String> = Vec::new();
    for change in changes {
        let mut changed = teaching("wing");
        change(&mut changed);
        versions.push(store.teach(&changed).expect("taught"));
    }
    versions.sort();
    versions.dedup();
    assert_eq!(versions.len(), changes.len());
}

#[test]
fn an_unknown_panel_or_version_lists_the_known_ones() {
    let (_folder, mut store) = new_store();
    let refusal = |store: &Store, name, version| store.taught(name, version).expect_err("unknown").to_string();
    assert!(refusal(&store, "wing", None).contains("run panelprep teach first"));
    let version = store.teach(&teaching("wing")).expect("taught");
    store.teach(&teaching("fairing")).expect("taught");
    let expected = "no panel 'wnig' was taught; did you mean 'wing'? Taught panels: fairing, wing";
    assert_eq!(refusal(&store, "wnig", Some("0123")), expected);
    assert!(
        refusal(&store, "wing", Some("0123"))
            .ends_with(&format!("no version 0123; versions, oldest first: {version}"))
    );
}

#[test]
fn a_damaged_blob_is_named_and_never_returned() {
    let (folder, mut store) = new_store();
    store.teach(&teaching("wing")).expect("taught");
    let hash = store.store_blob(b"second").expect("there already");
    let path = folder.path().join("store/blobs").join(&hash);
    fs::write(&path, b"sec0nd").expect("spoilt");
    for error in
        [store.taught("wing", None).expect_err("damaged"), store.store_blob(b"second").expect_err("damaged")]
    {
        assert!(matches!(&error, StoreError::DamagedBlob { path: named, .. } if *named == path), "{error}");
        assert!(error.to_string().contains(&hash));
    }
    fs::remove_file(&path).expect("removed");
    assert!(store.taught("wing", None).expect_err("missing").to_string().contains(&hash));
    store.store_blob(b"second").expect("written again");
    assert_eq!(store.taught("wing", None).expect("whole again").teaching, teaching("wing"));
}

#[test]
fn a_row_changed_outside_the_program_is_refused() {
    let (_folder, mut store) = new_store();
    store.teach(&teaching("wing")).expect("taught");
    store.connection.execute("UPDATE taught_panels SET recipe_text = 'rows = 2'", []).expect("changed");
    let error = store.taught("wing", None).expect_err("damaged").to_string();
    assert!(error.contains("of the taught panel 'wing' is damaged"), "{error}");
}

#[test]
fn an_incomplete_write_leaves_no_rows() {
    let (folder, mut store) = new_store();
    let mut broken = teaching("wing");
    broken.corners[1].base_from_flange.b_deg = f64::NAN;
    assert!(store.teach(&broken).expect_err("NaN").to_string().contains("corner 2"));
    assert!(store.taught("wing", None).is_err());
    // A transaction that fails after it has inserted the panel's row leaves no row.
    store.connection.execute("DROP TABLE taught_corners", []).expect("dropped");
    assert!(
        store.teach(&teaching("wing")).expect_err("no table").to_string().starts_with("cannot write the store")
    );
    let rows: i64 =
        store.connection.query_row("SELECT count(*) FROM taught_panels", [], |row| row.get(0)).expect("counted");
    assert_eq!(rows, 0);
    let parts = fs::read_dir(folder.path().join("store/blobs")).expect("listed");
    let names: Vec<String> =
        parts.map(|part| part.expect("a file").file_name().into_string().expect("text")).collect();
    assert!(!names.is_empty() && names.iter().all(|name| name.len() == 64), "{names:?}");
}

/// The thread that stores a clip, and the record of the cycle, may store the same picture.
#[test]
fn two_threads_can_store_the_same_content() {
    let (_folder, store) = new_store();
    let picture = vec![7_u8; 2_000_000];
    let start = std::sync::Barrier::new(8);
    let kept: Vec<String> = std::thread::scope(|scope| {
        let writer = || {
            let writer = store.blob_writer().expect("a writer");
            let (picture, started) = (&picture, &start);
            scope.spawn(move || {
                started.wait();
                writer.store_picture(picture).expect("kept").expect("there is room")
            })
        };
        let writers: Vec<_> = (0..8).map(|_| writer()).collect();
        writers.into_iter().map(|writer| writer.join().expect("no panic")).collect()
    });
    assert!(kept.iter().all(|hash| *hash == panelprep_cell::files::content_hash(&picture)), "{kept:?}");
    assert_eq!(store.blob(&kept[0]).expect("whole"), picture);
}

#[test]
fn a_newer_store_and_a_foreign_database_are_refused() {
    let (folder, store) = new_store();
    store.connection.pragma_update(None, "user_version", 2).expect("set");
    drop(store);
    let error = Store::open(&folder.path().join("store")).expect_err("newer").to_string();
    assert!(
        error.contains(
            "has schema 2, this program supports schemas up to 1: a newer version wrote it, or a build before the \
             first release. Use the program that wrote it, or another folder"
        ),
        "{error}"
    );

    let other = folder.path().join("other");
    fs::create_dir(&other).expect("made");
    let foreign = Connection::open(other.join(DATABASE)).expect("made");
    foreign.execute("CREATE TABLE cats (name TEXT)", []).expect("made");
    drop(foreign);
    assert!(matches!(Store::open(&other), Err(StoreError::Foreign { .. })));
    fs::write(other.join(DATABASE), vec![7; 5_000]).expect("spoilt");
    assert!(Store::open(&other).expect_err("no database").to_string().starts_with("cannot open the store"));
}

#[test]
fn the_database_is_set_to_survive_a_power_cut() {
    let (_folder, store) = new_store();
    let setting =
        |name: &str| store.connection.pragma_query_value(None, name, |row| row.get::<_, rusqlite::types::Value>(0));
    assert_eq!(setting("journal_mode"), Ok(rusqlite::types::Value::Text("wal".to_owned())));
    assert_eq!(setting("synchronous"), Ok(rusqlite::types::Value::Integer(2)));
}

/// Writes a new chain over all rows, as a person would who changes rows together with the chain.
fn chain_all_rows(connection: &Connection) -> super::chain::ChainPosition {
    let mut place = super::chain::ChainPosition::START;
    for part in &super::chain::HASHED_TABLES {
        let sql = format!("SELECT {} FROM {} WHERE {} ORDER BY 1", part.key, part.table, part.is_written_sql);
        let mut statement = connection.prepare(&sql).expect("a query");
        let mut rows = statement.query([]).expect("rows");
        while let Some(row) = rows.next().expect("a row") {
            place = super::chain::add_link(connection, place, part, row.get(0).expect("its key")).expect("a link");
        }
    }
    place
}
