//! Tests records that are lost during the transfer and sent again: after kills, disk faults, a changed name, and a
//! changed office server.

use super::offices::{Cell, Plant, TIMEOUT, count, publish, runtime, sql};
use panelprep::broker::CellLink;
use panelprep::cell::Office;
use panelprep::office::{Body, ChunkOwner, Message, Position, chunks};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

/// Every record arrives exactly once, whatever is killed meanwhile.
#[test]
fn each_record_arrives_once_although_everything_is_killed_in_turn() {
    let Some(mut plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    for round in 0..6 {
        cell.send(plant.office("cell-1"));
        cell.cycles(40);
        match round % 4 {
            0 => plant.broker.kill(),
            1 => plant.database.kill(),
            2 => plant.kill_archive(),
            _ => cell.sender = None,
        }
        cell.cycles(20);
        plant.broker.start();
        plant.database.start();
        if round % 4 == 2 {
            plant.start_archive();
        }
    }
    cell.send(plant.office("cell-1"));
    let found = plant.wait_until_archived("cell-1", &cell.path());
    assert_eq!((count(&found, "records"), count(&found, "same"), count(&found, "signatures")), (720, 720, 360));
}

/// A broker that loses its disk, and a database that is restored without its last records: the cell sends the missing
/// records again.
#[test]
fn what_a_broker_or_a_database_forgets_is_sent_again() {
    let Some(mut plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    cell.send(plant.office("cell-1"));
    cell.cycles(5);
    plant.wait_until_archived("cell-1", &cell.path());
    // The messages in the broker are lost with its disk before the archive has received them.
    plant.kill_archive();
    cell.cycles(5);
    let progress = cell.path().join("office.json");
    wait_until_sent(&progress, 20);
    plant.broker.kill();
    fs::remove_dir_all(plant.folder.path().join("nats")).expect("its disk");
    plant.broker.start();
    plant.start_archive();
    let found = plant.wait_until_archived("cell-1", &cell.path());
    assert_eq!(count(&found, "same"), 20);
    // Restores the database to its state of the day before.
    plant.kill_archive();
    sql(
        &plant,
        "DELETE FROM record_files WHERE number > 7; DELETE FROM records WHERE number > 7; UPDATE epochs SET archived = 7",
    );
    plant.start_archive();
    assert_eq!(count(&plant.wait_until_archived("cell-1", &cell.path()), "same"), 20);
    // A broker that keeps its name has lost some of the messages that it accepted, without a report.
    plant.kill_archive();
    cell.sender = None;
    cell.send(Office { alarm_delay_min: 1, ..plant.office("cell-1") });
    cell.cycles(5);
    wait_until_sent(&progress, 30);
    runtime().block_on(async {
        let client = async_nats::connect(format!("127.0.0.1:{}", plant.broker_port)).await.expect("connected");
        let stream = async_nats::jetstream::new(client).get_stream("PANELPREP").await.expect("it is there");
        stream.purge().await.expect("emptied");
    });
    plant.start_archive();
    assert_eq!(count(&plant.wait_until_archived("cell-1", &cell.path()), "same"), 30);
}

/// A record is reported as transferred only when all of its files have arrived too, in any order of arrival.
#[test]
fn a_record_is_complete_only_with_its_files() {
    let Some(plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    cell.cycles(1);
    let office = plant.office("cell-1");
    let last = cell.store.outbox_epochs().expect("epochs").pop().expect("one");
    let begin = Position { number: 0, ..last.clone() };
    let records = cell.store.outbox_rows_after(&begin, 10).expect("two");
    let Body::Signature { files, .. } = &records[1].body else { panic!("a signature") };
    assert!(files.len() >= 2, "{files:?}");
    for envelope in &records {
        let message = Message { cell: office.cell.clone(), envelope: envelope.clone() };
        let what = ChunkOwner::Message(envelope.position.clone());
        publish(&plant, &chunks(&office.cell, &what, &message.bytes().expect("bytes")).expect("parts"));
    }
    let archived = || {
        let link = async {
            let link = CellLink::connect(&office.broker, &office.cell).await.expect("connected");
            link.archived_number(&last.epoch).await.expect("told")
        };
        runtime().block_on(link)
    };
    let wait_for = |number: u64| {
        let since = Instant::now();
        while archived() != Some(number) {
            assert!(since.elapsed() < TIMEOUT, "{number}: {:?}\n{}", archived(), plant.log());
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    wait_for(1);
    for file in files {
        std::thread::sleep(Duration::from_millis(500));
        assert_eq!(archived(), Some(1), "{} is not there yet", file.name);
        let bytes = cell.store.blob(&file.hash).expect("whole");
        publish(&plant, &chunks(&office.cell, &ChunkOwner::File(file.hash.clone()), &bytes).expect("parts"));
    }
    wait_for(2);
}

/// Waits until the broker has accepted all records up to this number of the only epoch.
fn wait_until_sent(progress: &Path, number: u64) {
    let since = Instant::now();
    loop {
        let read: Value = serde_json::from_slice(&fs::read(progress).unwrap_or_default()).unwrap_or_default();
        if read["sent"].as_object().is_some_and(|all| all.values().any(|sent| sent.as_u64() == Some(number))) {
            return;
        }
        assert!(since.elapsed() < TIMEOUT, "{read}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A cell with a new name, and a cell with a new office server, send all their records.
#[test]
fn a_new_cell_name_or_a_new_office_receives_all_records() {
    let (Some(plant), Some(other)) = (Plant::start(), Plant::start()) else { return };
    let mut cell = Cell::new();
    cell.cycles(4);
    for (plant, name) in [(&plant, "cell-1"), (&plant, "cell-2"), (&other, "cell-2"), (&plant, "cell-1")] {
        cell.send(plant.office(name));
        plant.wait_until_archived(name, &cell.path());
        cell.sender = None;
    }
}
