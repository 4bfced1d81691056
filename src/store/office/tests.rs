use super::*;
use crate::signing::{
    self, CellKey, Meaning, PersonSignature, STATEMENT_FORMAT, SignedChainPosition, Statement, StatementContent,
};
use panelprep_cell::cell::CellName;
use panelprep_cell::record::CycleId;
use proptest::prelude::*;

const EPOCH: &str = "0123456789abcdef0123456789abcdef";

fn cell() -> CellName {
    CellName::new("cell-1").expect("a name")
}

fn at(number: u64) -> Position {
    Position { epoch: EPOCH.to_owned(), number }
}

fn end_of_cycle() -> Message {
    let end = CycleEnd {
        cycle: CycleId(7),
        started_unix_s: 1_700_000_000,
        ended_unix_s: Some(1_700_000_100),
        panel: "wing".to_owned(),
        taught_version: "0011223344556677".to_owned(),
        recipe_hash: "ab".repeat(32),
        program_version: "0.1.0".to_owned(),
        verdict: "pass".to_owned(),
        reasons: serde_json::json!([]),
        part: None,
    };
    let body = Body::Cycle(signing::canonical(&end).expect("JSON"));
    Message { cell: cell(), envelope: ItemEnvelope { position: at(1), unix_ms: 5, body } }
}

fn signature() -> Message {
    let key = CellKey::from_random_bytes(&[7; 32]);
    let person = PersonSignature {
        cycle: CycleId(7),
        record_hash: "cd".repeat(32),
        name: "Ada".to_owned(),
        user: "ada".to_owned(),
        meaning: Meaning::Reviewed,
        remark: None,
        values: signing::StatedValues::default(),
    };
    let statement = Statement {
        form: STATEMENT_FORMAT.to_owned(),
        number: 2,
        previous: "ef".repeat(32),
        unix_ms: 6,
        public_key: key.public_key().hex(),
        store: SignedChainPosition { link: 1, hash: "01".repeat(32) },
        says: StatementContent::Person(person),
    };
    let statement = statement.canonical().expect("JSON");
    let body = Body::Signature {
        signature: key.sign(&statement).to_vec(),
        statement,
        public_key: key.public_key().hex(),
        files: vec![NamedFile { name: "recipe".to_owned(), hash: "ab".repeat(32), gone: None }],
    };
    Message { cell: cell(), envelope: ItemEnvelope { position: at(2), unix_ms: 6, body } }
}

#[test]
fn a_message_reads_back_and_each_changed_byte_is_detected() {
    for message in [end_of_cycle(), signature()] {
        let bytes = message.bytes().expect("bytes");
        assert_eq!(Message::read(&bytes), Ok(message.clone()));
        let content = bytes.iter().position(|byte| *byte == b'\n').expect("a line") + 1;
        for index in content..bytes.len() {
            let mut changed = bytes.clone();
            changed[index] ^= 1;
            assert!(Message::read(&changed).is_err(), "byte {index} of the content");
        }
    }
}

/// A message that is signed with another key is refused, although the hash of its content is correct.
#[test]
fn a_statement_of_another_writer_is_refused() {
    let message = signature();
    let Body::Signature { statement, signature, public_key, files } = message.envelope.body.clone() else {
        unreachable!()
    };
    let text = String::from_utf8(statement).expect("text").replace("Ada", "Eve");
    let body = Body::Signature { statement: text.into_bytes(), signature, public_key, files };
    let forged = Message { envelope: ItemEnvelope { body, ..message.envelope }, ..message };
    let refused = Message::read(&forged.bytes().expect("bytes")).expect_err("refused").to_string();
    assert!(
        refused.starts_with(
            "record 2 does not match the signature of its cell: the signature does not match the content"
        ),
        "{refused}"
    );
}

#[test]
fn a_large_message_is_joined_from_parts_in_any_order() {
    let bytes: Vec<u8> = (0..1_300_000_u32).map(|index| (index % 251) as u8).collect();
    let what = ChunkOwner::File(panelprep_cell::files::content_hash(&bytes));
    let parts = chunks(&cell(), &what, &bytes).expect("parts");
    assert_eq!(parts.iter().map(|part| part.bytes.len()).collect::<Vec<_>>(), [524_288, 524_288, 251_424]);
    let mut assembly = PartAssembly::default();
    for (receipt, index) in [2, 0, 0, 2].into_iter().enumerate() {
        let sent = parts[index].bytes().expect("bytes");
        assert_eq!(assembly.add(Chunk::read(&sent).expect("a part"), receipt), Ok(None));
    }
    let whole = assembly.add(parts[1].clone(), 9).expect("no contradiction").expect("whole");
    // Expected receipts: the newest one of each part, in the order of the parts.
    assert_eq!(whole, AssembledItem { cell: cell(), what: what.clone(), bytes, receipts: vec![2, 9, 3] });
    assert_eq!(assembly.add(parts[1].clone(), 10), Ok(None), "it begins anew");
}

#[test]
fn parts_that_contradict_each_other_are_refused_and_dropped() {
    let what = ChunkOwner::Message(at(3));
    let part = |part, parts| Chunk { cell: cell(), what: what.clone(), part, parts, bytes: vec![1] };
    let mut assembly = PartAssembly::default();
    assert_eq!(assembly.add(part(1, 2), "first"), Ok(None));
    let unfit = assembly.add(part(1, 3), "second").expect_err("a contradiction");
    assert_eq!(unfit.error, OfficeError::Parts { part: 1, found: 3, before: 2 });
    assert_eq!(unfit.receipts, ["first", "second"], "neither is waited for");
    assert_eq!(assembly.add(part(1, 3), "third"), Ok(None), "it begins anew");
    let wrong = Chunk { what: ChunkOwner::File("ab".repeat(32)), ..part(1, 1) };
    let unfit = assembly.add(wrong, "file").expect_err("another content");
    assert!(unfit.error.to_string().contains("its name states abab") && unfit.receipts == ["file"]);
}

#[test]
fn an_invalid_part_is_refused_with_the_limits() {
    let head = |what: &str| format!("{{\"form\":\"panelprep-part-1\",\"cell\":\"cell-1\",{what}}}\nx");
    let file = "ab".repeat(32);
    for (bytes, problem) in [
        (String::new(), "the end of the line is missing"),
        (head("\"file\":\"../etc/passwd\",\"part\":1,\"parts\":1"), "valid: a SHA-256"),
        (
            head(&format!("\"file\":\"{file}\",\"part\":2,\"parts\":1")),
            "invalid message part 2 of 1: a message or file has 1 to 4096 parts",
        ),
        (head(&format!("\"file\":\"{file}\",\"part\":0,\"parts\":5000")), "part 0 of 5000"),
        (head("\"part\":1,\"parts\":1"), "either a message or a file"),
        (
            head(&format!("\"file\":\"{file}\",\"part\":1,\"parts\":1")).replace("cell-1", "a.*"),
            "valid: 1 to 40 letters",
        ),
        (head(&format!("\"file\":\"{file}\",\"part\":1,\"parts\":1")).replace("part-1", "part-2"), "expected"),
    ] {
        let found = Chunk::read(bytes.as_bytes()).expect_err("refused").to_string();
        assert!(found.contains(problem), "{found}");
    }
}

#[test]
fn the_report_of_the_office_decides_what_is_sent() {
    let mut progress = Progress::default();
    progress.set_stream("one");
    progress.record_accepted(&at(9));
    assert_eq!(progress.process_archived(EPOCH, 5, 9), ReportOutcome::Known);
    assert_eq!(
        (progress.last_sent(EPOCH), progress.last_archived(EPOCH), progress.missing_count(&[at(12)])),
        (9, 5, 7)
    );
    // A new stream does not contain the items that were sent before. Items that the office server has are not sent
    // again.
    progress.set_stream("two");
    assert_eq!(progress.last_sent(EPOCH), 5);
    progress.record_accepted(&at(12));
    // The office server has restored its database and has fewer items.
    assert_eq!(progress.process_archived(EPOCH, 2, 12), ReportOutcome::HasLess);
    assert_eq!(progress.last_sent(EPOCH), 2);
    // More items than in the store are a contradiction, which does not change the progress.
    assert_eq!(progress.process_archived(EPOCH, 13, 12), ReportOutcome::HasMore);
    assert_eq!((progress.last_sent(EPOCH), progress.last_archived(EPOCH)), (2, 2));
    // Another process has sent the items.
    assert_eq!(progress.process_archived(EPOCH, 12, 12), ReportOutcome::Known);
    assert_eq!((progress.last_sent(EPOCH), progress.missing_count(&[at(12)])), (12, 0));
}

#[test]
fn two_lists_are_compared_by_name_and_hash() {
    let line = |number, hash: &str| ListEntry { position: at(number), kind: Kind::Cycle, hash: hash.repeat(32) };
    let cell = [line(1, "aa"), line(2, "bb"), line(3, "cc")];
    assert_eq!(compare(&cell, &cell), Comparison { equal_items: 3, differences: Vec::new() });
    let office = [line(1, "aa"), line(2, "b0"), line(9, "dd")];
    let compared = compare(&cell, &office);
    assert_eq!(compared.equal_items, 1);
    for (words, part) in compared.differences.iter().zip([
        "number 2 of epoch 0123456789abcdef0123456789abcdef differs: the cell has a cycle with the SHA-256 bb",
        "number 3 of epoch 0123456789abcdef0123456789abcdef has not been received by the office server yet and is sent again automatically: cycle",
        "number 9 of epoch 0123456789abcdef0123456789abcdef is on the office server, but not in the cell; run panelprep store verify on the cell",
    ]) {
        assert!(words.starts_with(part), "{words}");
    }
    assert_eq!(compared.differences.len(), 3);
}

proptest! {
    #[test]
    fn no_bytes_cause_a_panic_of_a_reader(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = (Chunk::read(&bytes), Message::read(&bytes));
    }

    #[test]
    fn a_part_reads_back(number in 1_u64..1 << 40, part in 1_u32..=4_096, more in 0_u32..4_096, bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let parts = (part + more).min(4_096);
        let chunk = Chunk { cell: cell(), what: ChunkOwner::Message(at(number)), part, parts, bytes };
        prop_assert_eq!(Chunk::read(&chunk.bytes().expect("bytes")), Ok(chunk));
    }
}

/// The broker drops a message with a known id. Without a new id, items that the office server has lost would never be
/// received again.
#[test]
fn a_part_that_is_sent_again_has_another_name() {
    let part = chunks(&cell(), &ChunkOwner::Message(at(3)), b"x").expect("parts").remove(0);
    assert_eq!(part.message_id(0), format!("cell-1/{EPOCH}/3/1"));
    let mut progress = Progress::default();
    progress.process_archived(EPOCH, 5, 9);
    progress.process_archived(EPOCH, 2, 9);
    assert_eq!(part.message_id(progress.resend_count()), format!("cell-1/{EPOCH}/3/1/1"));
}

#[test]
fn an_offer_reads_back_and_unprintable_texts_are_refused() {
    let offer = RecipeOffer::new("door", "panel = \"door\"\n", ("Anna", "finer film"), 5).expect("an offer");
    assert_eq!(RecipeOffer::read(&offer.bytes().expect("bytes")), Ok(offer.clone()));
    assert_eq!(offer.hash(), panelprep_cell::files::content_hash(b"panel = \"door\"\n"));
    let refused = |by, why, text| RecipeOffer::new("door", text, (by, why), 5).expect_err("refused").to_string();
    assert!(refused("An\u{0}na", "why", "").contains("its name"));
    assert!(refused("Anna", "", "").contains("its reason"));
    assert!(refused("Anna", "why", &"x".repeat(300_000)).contains("262144"));
    // The name of a panel may contain characters that are invalid in a subject.
    assert!(
        subject::offer_subject("left *.> door")
            .strip_prefix("panelprep.offers.")
            .is_some_and(|rest| rest.len() == 16)
    );
}
