//! Tests contradictions to a record: another record with its number, a change in the database, invalid messages. Each
//! is reported, and none replaces the record.

use super::offices::{Cell, Plant, TIMEOUT, publish, runtime, sql};
use panelprep::cell::CellName;
use panelprep::office::{Body, Chunk, ChunkOwner, Message, Position, chunks};
use std::time::{Duration, Instant};

/// Another cell with the same name, a record that a person changes in the database, and invalid messages: each is
/// reported, and none replaces a record.
#[test]
fn contradictions_changes_and_garbage_are_reported_and_replace_nothing() {
    let Some(plant) = Plant::start() else { return };
    let mut cell = Cell::new();
    cell.send(plant.office("cell-1"));
    cell.cycles(3);
    plant.wait_until_archived("cell-1", &cell.path());
    publish_invalid_messages(&plant);
    // A sender that uses the cell's name, epoch and number without its key.
    let mut forged =
        cell.store.outbox_rows_after(&cell.store.outbox_epochs().expect("epochs")[0], 1).expect("none");
    assert!(forged.is_empty());
    let begin = Position { number: 0, ..cell.store.outbox_epochs().expect("epochs")[0].clone() };
    forged = cell.store.outbox_rows_after(&begin, 1).expect("the first");
    let Body::Cycle(content) = &mut forged[0].body else { panic!("a cycle") };
    *content = String::from_utf8(content.clone()).expect("text").replace("\"pass\"", "\"fail\"").into_bytes();
    let name = CellName::new("cell-1").expect("a name");
    let message = Message { cell: name.clone(), envelope: forged[0].clone() };
    let what = ChunkOwner::Message(message.envelope.position.clone());
    let parts = chunks(&name, &what, &message.bytes().expect("bytes")).expect("parts");
    publish_without_names(&plant, &parts);
    let since = Instant::now();
    let reported = loop {
        let (exit, found) = plant.check(&format!("cell-1={}", cell.path().display()));
        if exit == 1 {
            break found.to_string();
        }
        assert!(since.elapsed() < TIMEOUT, "{found}\n{}", plant.log());
        std::thread::sleep(Duration::from_millis(100));
    };
    assert!(reported.contains("was received a second time with other content, SHA-256"), "{reported}");
    assert!(reported.contains("\"same\":6"), "the first one stands: {reported}");
    assert!(plant.log().contains("refused"), "{}", plant.log());
    // A person changes a record in the database.
    sql(
        &plant,
        "DELETE FROM contradictions; UPDATE records SET content = convert_to(replace(convert_from(content, 'UTF8'), 'wing', 'tail'), 'UTF8') WHERE number = 2",
    );
    let (exit, found) = plant.check("");
    let found = found.to_string();
    assert!(exit == 1 && found.contains("number 2 of epoch") && found.contains("was changed"), "{found}");
    assert!(found.contains("does not match the signature of its cell"), "{found}");
}

/// Publishes without message IDs, like a sender whose message IDs the broker deleted after an hour, or a sender that
/// never sends any.
fn publish_without_names(plant: &Plant, parts: &[Chunk]) {
    runtime().block_on(async {
        let client = async_nats::connect(format!("127.0.0.1:{}", plant.broker_port)).await.expect("connected");
        for part in parts {
            let subject = panelprep::office::subject::records(&part.cell);
            client.publish(subject, part.bytes().expect("bytes").into()).await.expect("sent");
        }
        client.flush().await.expect("sent");
    });
}

/// Publishes messages that are not message parts, and message parts that contradict each other.
fn publish_invalid_messages(plant: &Plant) {
    let name = CellName::new("cell-1").expect("a name");
    let part = |hash: &str, part, parts| Chunk {
        cell: name.clone(),
        what: ChunkOwner::File(hash.repeat(32)),
        part,
        parts,
        bytes: b"nothing".to_vec(),
    };
    publish(plant, &[part("ab", 1, 1), part("cd", 1, 2), part("cd", 2, 3)]);
    let other = CellName::new("cell-2").expect("a name");
    // A message part with the name of another cell.
    publish(plant, &[Chunk { cell: other, ..part("ef", 1, 1) }]);
}
