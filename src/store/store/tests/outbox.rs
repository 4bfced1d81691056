use super::*;
use crate::office::{Kind, Position};
use crate::signing::CellKey;
use panelprep_base::verdict::{Judgement, Verdict};
use panelprep_cell::record::{CycleId, Finding};
use panelprep_vision::calib::health::Verification;

fn concluded(store: &mut Store) -> CycleId {
    let start = CycleStart {
        panel: "wing".to_owned(),
        taught_version: "0011223344556677".to_owned(),
        recipe_text: "panel = \"wing\"\n".to_owned(),
        file_texts: vec![("cell".to_owned(), "x = 1\n".to_owned())],
        recording: None,
        is_air_run: false,
    };
    let id = store.begin_cycle(&start).expect("begun");
    let film = Finding::new(
        panelprep_cell::record::Kind::Inspect,
        1,
        Judgement { verdict: Verdict::Pass, reasons: vec![] },
    );
    store.store_finding(id, &film).expect("kept");
    store.conclude(id, Verdict::Pass, &[]).expect("over");
    id
}

fn verified(store: &mut Store) {
    let verification = Verification {
        subject: "scanner".to_owned(),
        error: 0.1,
        limit: 0.5,
        calibration_hash: "ab".repeat(32),
        at_unix_s: 1_700_000_000,
        struck: None,
    };
    store.store_verification(&verification).expect("kept");
}

fn kinds(store: &Store) -> Vec<(u64, Kind)> {
    store.outbox_list().expect("a list").into_iter().map(|line| (line.position.number, line.kind)).collect()
}

#[test]
fn the_end_of_a_cycle_a_signature_and_a_verification_are_numbered_as_they_are_written() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    assert_eq!(kinds(&store), []);
    let id = concluded(&mut store);
    verified(&mut store);
    Store::sign_missing(&path, &CellKey::from_random_bytes(&[7; 32]), &|_, row| assert!(row.is_ok()))
        .expect("signed");
    assert_eq!(kinds(&store), [(1, Kind::Cycle), (2, Kind::Verification), (3, Kind::Signature)]);
    let [last] = &store.outbox_epochs().expect("epochs")[..] else { panic!("one epoch") };
    let begin = Position { number: 0, ..last.clone() };
    let [first, second, third] = &store.outbox_rows_after(&begin, 10).expect("all")[..] else { panic!("three") };
    let end: serde_json::Value = serde_json::from_slice(first.body.content()).expect("JSON");
    assert_eq!((&end["cycle"], &end["verdict"]), (&serde_json::json!(id.0), &serde_json::json!("pass")));
    assert!(String::from_utf8_lossy(second.body.content()).contains("\"error\":0.1"));
    let crate::office::Body::Signature { files, .. } = &third.body else { panic!("a signature") };
    assert_eq!(
        files.iter().map(|file| (file.name.as_str(), &file.gone)).collect::<Vec<_>>(),
        [("recipe", &None), ("cell", &None)]
    );
    // Only the items after this position are returned.
    assert_eq!(
        store.outbox_rows_after(&second.position, 10).expect("the rest").as_slice(),
        std::slice::from_ref(third)
    );
    assert_eq!(store.outbox_waits_since(&third.position).expect("read"), None);
    assert_eq!(store.outbox_waits_since(&second.position).expect("read"), Some(third.unix_ms));
    // All rows are in the hash chain, and the tables contain no other rows.
    drop(store);
    assert_eq!(Store::verify(&path, true).expect("verified").differences, Vec::<String>::new());
}

#[test]
fn a_row_that_a_person_deletes_is_found_and_a_new_epoch_begins() {
    let (folder, mut store) = new_store();
    let path = folder.path().join("store");
    concluded(&mut store);
    verified(&mut store);
    drop(store);
    let connection = Connection::open(path.join(DATABASE)).expect("opened");
    connection.execute_batch("DELETE FROM outbox WHERE number = 2").expect("deleted");
    drop(connection);
    let mut store = Store::create(&path).expect("opened");
    assert!(
        store.changed().iter().any(|words| words.contains("entry of the office's outbox 2 is missing")),
        "{:?}",
        store.changed()
    );
    verified(&mut store);
    let numbers: Vec<u64> = store.outbox_epochs().expect("epochs").iter().map(|last| last.number).collect();
    assert_eq!(numbers, [1, 1], "no number is used twice under one epoch");
}
