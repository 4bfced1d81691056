//! Tests that a signature is complete or does not exist, and that it contradicts later changes.

use super::super::head;
use super::journal::until_killed;
use super::*;
use crate::signing::{CellKey, Meaning, StatedValues};
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::record::{CycleId, Finding, Kind, PartNames};
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

fn key() -> CellKey {
    CellKey::from_random_bytes(&[7; 32])
}

fn cycle(store: &mut Store, serial: Option<&str>) -> CycleId {
    let mut start = super::cycles::start();
    if let Some(serial) = serial {
        let part = PartNames { serial: Some(serial.to_owned()), ..PartNames::default() };
        start.file_texts.push((PartNames::FILE.to_owned(), toml::to_string(&part).expect("TOML")));
    }
    let id = store.begin_cycle(&start).expect("begun");
    let judgement = Judgement { verdict: Verdict::Review, reasons: vec![] };
    store.store_finding(id, &Finding::new(Kind::Locate, 0, judgement)).expect("kept");
    store.conclude(id, Verdict::Fail, &[]).expect("over");
    id
}

/// Creates a closed store with three signed cycles; for the second cycle, a person signed that the part is not
/// released.
fn signed() -> (TempDir, PathBuf) {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    for _ in 0..3 {
        let id = cycle(&mut store, Some("SN 1"));
        store.sign_cycle(&key(), id).expect("signed");
    }
    drop(store);
    let path = folder.path().join("store");
    Store::sign_by_person(&path, &key(), &signs(2)).expect("signed");
    (folder, path)
}

fn signs(cycle: i64) -> PersonSigningRequest {
    let (name, user) = ("Grace Hopper".to_owned(), "grace".to_owned());
    PersonSigningRequest {
        cycle: CycleId(cycle),
        name,
        user,
        meaning: Meaning::InspectedAndNotReleased,
        remark: None,
        values: StatedValues::default(),
    }
}

fn found(path: &Path) -> Vec<String> {
    let found = Store::verify(path, true).expect("verified").differences;
    found.into_iter().filter(|words| !words.contains("after the program closed it")).collect()
}

#[test]
fn each_cycle_is_signed_once_in_order_also_beside_a_writer() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    let path = folder.path().join("store");
    let ids = [cycle(&mut store, None), cycle(&mut store, Some("SN 1"))];
    let running = store.begin_cycle(&super::cycles::start()).expect("begun");
    let told = std::cell::RefCell::new(Vec::new());
    for _ in 0..2 {
        Store::sign_missing(&path, &key(), &|cycle, row| {
            told.borrow_mut().push((cycle, row.expect("signed").number))
        })
        .expect("signed");
    }
    assert_eq!(*told.borrow(), [(ids[0], 1), (ids[1], 2)], "the running one is not signed");
    let refused = store.sign_cycle(&key(), running).expect_err("it runs").to_string();
    assert!(refused.contains("no concluded cycle 3"), "{refused}");
    let rows = store.signatures().expect("read");
    assert_eq!(rows[1].previous_hash, rows[0].record_hash);
    assert_eq!(store.cycle_signatures(ids[1]).expect("read"), rows[1..]);
    drop(store);
    let verified = Store::verify(&path, true).expect("verified");
    assert_eq!((verified.differences, verified.signatures), (vec![], 2));
}

#[test]
fn a_person_signs_a_record_once_for_each_meaning() {
    let (_folder, path) = signed();
    let persons = Store::open(&path).expect("opens").person_signatures(CycleId(2)).expect("read");
    assert_eq!(persons.len(), 1);
    assert_eq!(
        (persons[0].1.name.as_str(), persons[0].1.meaning.printed_text()),
        ("Grace Hopper", "inspected and not released")
    );
    let refused = Store::sign_by_person(&path, &key(), &signs(2)).expect_err("signed already").to_string();
    assert!(
        refused.contains("has already signed the record of cycle 2 as inspected and not released, 20"),
        "{refused}"
    );
    Store::sign_by_person(&path, &key(), &PersonSigningRequest { meaning: Meaning::Reviewed, ..signs(2) })
        .expect("another meaning");
    let bad = PersonSigningRequest { name: "Grace\nHopper".to_owned(), ..signs(1) };
    let refused = Store::sign_by_person(&path, &key(), &bad).expect_err("refused").to_string();
    assert!(
        refused.contains("the signature's name is \"Grace\\nHopper\": the text contains control characters"),
        "{refused}"
    );
    assert!(
        Store::sign_by_person(&path, &key(), &signs(9))
            .expect_err("no cycle")
            .to_string()
            .contains("has no cycle 9")
    );
    assert_eq!(found(&path), [] as [String; 0]);
}

/// Two persons, with a stated reason, can release a part whose cycle did not pass; a release can be withdrawn.
#[test]
fn a_cycle_that_failed_is_released_by_two_persons_with_a_reason() {
    let (_folder, path) = signed();
    let sign = |user: &str, meaning: Meaning, remark: Option<&str>| {
        let (user, remark) = (user.to_owned(), remark.map(str::to_owned));
        let signs = PersonSigningRequest { user, meaning, remark, ..signs(1) };
        Store::sign_by_person(&path, &key(), &signs).map(|row| row.number).map_err(|error| error.to_string())
    };
    let refused = |came: Result<u64, String>, words: &str| {
        let told = came.expect_err("refused");
        assert!(told.contains(words), "{words}: {told}");
    };
    let released = Meaning::InspectedAndReleased;
    refused(sign("ada", released, Some("clean")), "the cycle's verdict is review: another person must first sign");
    sign("ada", Meaning::DeviationAccepted, None).expect("one person");
    refused(sign("ada", released, Some("clean")), "another person must first sign");
    refused(sign("grace", released, None), "state the reason of the release in the remark");
    refused(sign("grace", Meaning::ReleaseWithdrawn, Some("an error")), "no person has released it");
    sign("grace", released, Some("cleaned by hand, tested again in cycle 3")).expect("another person");
    refused(sign("ada", Meaning::ReleaseWithdrawn, None), "state the reason");
    sign("ada", Meaning::ReleaseWithdrawn, Some("the wrong part")).expect("with a reason");
    assert_eq!(found(&path), [] as [String; 0]);
}

#[test]
fn a_cycle_that_passed_is_released_by_one_and_one_without_a_part_by_none() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    let mut ended = |kind: Kind, verdict: Verdict, code: &'static str| {
        let id = store.begin_cycle(&super::cycles::start()).expect("begun");
        let reasons = if verdict == Verdict::Pass { vec![] } else { vec![Reason::new(code, "as measured")] };
        store.store_finding(id, &Finding::new(kind, 0, Judgement { verdict, reasons })).expect("kept");
        store.conclude(id, verdict, &[]).expect("over");
    };
    ended(Kind::Inspect, Verdict::Pass, "");
    ended(Kind::Locate, Verdict::Reject, "no_panel");
    ended(Kind::Locate, Verdict::Reject, "shift_limit");
    let counts = store.verdict_counts().expect("read");
    assert_eq!(counts, [(Verdict::Pass, 1), (Verdict::Reject, 1)], "an empty cell is no failed part");
    drop(store);
    let path = folder.path().join("store");
    let values = StatedValues { water: Some("deionised, 2 µS/cm, 21 °C".to_owned()), ..StatedValues::default() };
    let release = |cycle: i64| PersonSigningRequest {
        meaning: Meaning::InspectedAndReleased,
        values: values.clone(),
        ..signs(cycle)
    };
    Store::sign_by_person(&path, &key(), &release(1)).expect("passed");
    let kept = Store::open(&path).expect("opens").person_signatures(CycleId(1)).expect("read");
    assert_eq!(kept[0].1.values, values, "the values are signed, too");
    let refused = Store::sign_by_person(&path, &key(), &release(2)).expect_err("refused").to_string();
    assert!(refused.contains("this cycle tested no part"), "{refused}");
    let bad = StatedValues { lamp: Some("a\nb".to_owned()), ..StatedValues::default() };
    let refused = Store::sign_by_person(&path, &key(), &PersonSigningRequest { values: bad, ..signs(1) });
    assert!(refused.expect_err("refused").to_string().contains("the signature's lamp is"));
}

/// A person who knows the program changes rows, and rewrites the chain and the head to match. The signed records
/// contradict the changed rows.
#[test]
fn rows_changed_with_their_chain_contradict_the_signed_records() {
    let (_folder, path) = signed();
    let connection = Connection::open(path.join(DATABASE)).expect("opens");
    let sql =
        "UPDATE findings SET finding = replace(finding, 'review', 'accept') WHERE cycle_id = 2; DELETE FROM chain";
    connection.execute_batch(sql).expect("changed");
    let last = chain_all_rows(&connection);
    connection.close().expect("closed");
    head::HeadFile::open(&path).and_then(|head| head.close(last, None)).expect("written anew");
    let told = found(&path);
    let words = "cycle 2 differs from its signed record at /findings/0/judgement/verdict: signed value \"review\", present value \"accept\"";
    assert!(told.iter().any(|told| told == words), "{told:?}");
    assert!(told.iter().any(|told| told.contains("differs from the link that signature 2 names")), "{told:?}");
}

#[test]
fn a_changed_statement_signature_or_row_is_named() {
    let (_folder, path) = signed();
    let rows = Store::open(&path).expect("opens").signatures().expect("read");
    let planted = [
        ("UPDATE signatures SET signature = zeroblob(64) WHERE id = 2", "signature 2 was changed"),
        ("UPDATE signatures SET unix_ms = 0 WHERE id = 3", "signature 3 does not match its signed record"),
        ("UPDATE signatures SET kind = 'cycle' WHERE id = 4", "signature 4 does not match its signed record"),
        ("DELETE FROM signatures WHERE id = 2", "record number 2 is missing"),
        ("DELETE FROM signatures WHERE id = 1", "signatures 1 to 1 are missing"),
        ("DELETE FROM signatures WHERE id = 4", "deleted: signature 4 is missing"),
    ];
    for (sql, words) in planted {
        let (_folder, path) = signed();
        let connection = Connection::open(path.join(DATABASE)).expect("opens");
        connection.execute_batch(sql).expect("changed");
        drop(connection);
        let reported = found(&path);
        assert!(reported.iter().any(|reported| reported.contains(words)), "{sql}: {reported:?}");
    }
    let file = path.join("blobs").join(&rows[1].record_hash);
    let mut bytes = fs::read(&file).expect("there");
    bytes[100] ^= 1;
    fs::write(&file, bytes).expect("changed");
    let reported = found(&path);
    assert!(
        reported.iter().any(|reported| reported.contains("signature 2: ") && reported.contains("is damaged")),
        "{reported:?}"
    );
}

/// If the head contradicts the rows, signing does not write a new head, so that the next start detects the rollback.
#[test]
fn a_store_that_was_rolled_back_is_not_signed() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    cycle(&mut store, None);
    drop(store);
    let path = folder.path().join("store");
    let yesterday = fs::read(path.join(DATABASE)).expect("read");
    let mut store = Store::create(&path).expect("opens");
    cycle(&mut store, None);
    drop(store);
    fs::write(path.join(DATABASE), yesterday).expect("rolled back");
    let refused = Store::sign_missing(&path, &key(), &|_, _| panic!("signed")).expect_err("refused").to_string();
    assert!(refused.contains("rolled back: "), "{refused}");
    let store = Store::create(&path).expect("opens");
    assert!(store.changed().iter().any(|words| words.contains("rolled back")), "{:?}", store.changed());
}

/// A finding that is stored after the end of a cycle does not change its verdict. If it contradicts the verdict pass,
/// the verification reports this.
#[test]
fn a_signed_pass_over_a_rejected_finding_does_not_verify() {
    let (folder, mut store) = new_store();
    store.recover().expect("recovers");
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    let judged = |verdict| Judgement { verdict, reasons: vec![Reason::new("removal_too_deep", "64 µm")] };
    let film = Finding::new(Kind::Inspect, 1, Judgement { verdict: Verdict::Pass, reasons: vec![] });
    store.store_finding(id, &film).expect("kept");
    assert_eq!(store.conclude(id, Verdict::Pass, &[]).expect("over").verdict, Verdict::Pass);
    store.store_finding(id, &Finding::new(Kind::Abrade, 1, judged(Verdict::Reject))).expect("kept");
    store.sign_cycle(&key(), id).expect("signed");
    drop(store);
    let told = found(&folder.path().join("store"));
    let words = "signature 1: cycle 1 has the verdict pass, but its finding 2 (abrade, pass 1) is reject: 64 µm \
                 (removal_too_deep)";
    let no_film = "signature 1: cycle 1 has the verdict pass, but 1 sanding passes followed the last film (limit 0): do \
                   not release the part, and inspect the part again";
    assert_eq!(told, [words, no_film]);
}

/// The stored verdict is never better than the findings of the cycle, and contains all of their reasons.
#[test]
fn a_cycle_is_concluded_by_its_worst_finding() {
    let (_folder, mut store) = new_store();
    store.recover().expect("recovers");
    let id = store.begin_cycle(&super::cycles::start()).expect("begun");
    let judged = |verdict, code| Judgement { verdict, reasons: vec![Reason::new(code, "words")] };
    store
        .store_finding(id, &Finding::new(Kind::Abrade, 1, judged(Verdict::Reject, "removal_too_deep")))
        .expect("kept");
    store.store_finding(id, &Finding::new(Kind::Robot, 1, judged(Verdict::Review, "feedback"))).expect("kept");
    let judgement = store.conclude(id, Verdict::Pass, &[]).expect("over");
    let codes: Vec<&str> = judgement.reasons.iter().map(|reason| &*reason.code).collect();
    assert_eq!((judgement.verdict, codes), (Verdict::Reject, vec!["removal_too_deep", "feedback"]));
    assert_eq!(store.cycle(id).expect("read").judgement, Some(judgement));
}

#[test]
fn the_key_is_created_once_and_only_its_owner_can_read_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = folder.path();
    let first = cell_key(store, &KeyLocation::InStore).expect("made");
    assert_eq!(cell_key(store, &KeyLocation::InStore).expect("read").public_key(), first.public_key());
    let file = store.join("record-key.pem");
    let mode = |file: &Path| fs::metadata(file).expect("there").permissions().mode() & 0o777;
    assert_eq!(mode(&file), 0o600);
    let elsewhere = KeyLocation::File(store.join("keys/cell.pem"));
    let second = cell_key(store, &elsewhere).expect("made");
    assert_ne!(first.public_key(), second.public_key(), "random");
    assert_eq!(public_keys(store).expect("both"), [second.public_key(), first.public_key()]);
    fs::set_permissions(&file, fs::Permissions::from_mode(0o644)).expect("set");
    let refused = cell_key(store, &KeyLocation::InStore).expect_err("others read it").to_string();
    assert!(refused.contains("(mode 644, valid: 600)"), "{refused}");
    let provided = KeyLocation::Provided(file.clone());
    assert_eq!(cell_key(store, &provided).expect("read").public_key(), first.public_key());
    let none = KeyLocation::Provided(store.join("none"));
    assert!(cell_key(store, &none).is_err() && !store.join("none").exists(), "it is not made");
    fs::write(&file, "x").expect("spoilt");
    assert!(
        cell_key(store, &provided).expect_err("no key").to_string().contains("not a valid private ed25519 key")
    );
}

/// Expected passes, calculated by hand: passes 1 and 2 in the first cycle, and pass 1 in the third; the second cycle
/// had another part.
#[test]
fn passes_of_a_serial_are_counted_over_its_cycles() {
    let (_folder, mut store) = new_store();
    store.recover().expect("recovers");
    for (serial, passes) in [("SN 1", 2), ("SN 2", 1), ("SN 1", 1), ("SN 1", 0)] {
        let part = PartNames { serial: Some(serial.to_owned()), ..PartNames::default() };
        let mut start = super::cycles::start();
        start.file_texts.push((PartNames::FILE.to_owned(), toml::to_string(&part).expect("TOML")));
        let id = store.begin_cycle(&start).expect("begun");
        for pass in 1..=passes {
            let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
            let found = Finding::new(Kind::Abrade, pass, judgement);
            store.store_finding(id, &found.with_detail("grids", vec!["r1c1", "r1c2"])).expect("kept");
        }
        store.conclude(id, Verdict::Pass, &[]).expect("over");
    }
    let of = |serial: &str, before: Option<i64>| -> Vec<(i64, usize)> {
        let all = store.sanding_passes_by_serial(serial, before.map(CycleId)).expect("read");
        all.into_iter().map(|passes| (passes.cycle.0, passes.passes)).collect()
    };
    assert_eq!(of("SN 1", None), [(1, 2), (3, 1)]);
    assert_eq!(of("SN 1", Some(3)), [(1, 2)]);
    assert_eq!(of("SN 2", None), [(2, 1)]);
    assert_eq!(of("SN 3", None), []);
}

const FOLDER: &str = "PANELPREP_TEST_SIGNS_IN";

/// The child process of another test: signs, and reports each signature, until it is killed.
#[test]
#[ignore = "run by the tests below as a process of its own"]
fn signs_until_killed() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let mut store = Store::create(Path::new(&folder)).expect("the lease of a killed process is free");
    store.recover().expect("recovers");
    loop {
        let id = cycle(&mut store, Some("SN 1"));
        let row = store.sign_cycle(&key(), id).expect("signed");
        println!("signed {}", row.number);
    }
}

fn no_kill_leaves_half_a_record(kills: u64) {
    let mut stores = 0;
    let (mut folder, mut before) = (tempfile::tempdir().expect("a folder"), 0);
    for kill in 0..kills {
        if kill % 25 == 24 {
            (folder, before, stores) = (tempfile::tempdir().expect("a folder"), 0, stores + 1);
        }
        let path = folder.path().join("store");
        let mut child = until_killed("store::tests::signatures::signs_until_killed", (FOLDER, &path));
        let reported = BufReader::new(child.stdout.take().expect("its output"));
        let mut signed = before;
        for line in reported.lines().map_while(Result::ok) {
            let number = line.strip_prefix("signed ").and_then(|number| number.parse::<u64>().ok());
            if number.is_some_and(|number| number == before + 1 + kill % 3) {
                // The child is killed at an arbitrary moment.
                std::thread::sleep(std::time::Duration::from_micros(37 * (kill * 131 % 400)));
                child.kill().expect("killed");
            }
            signed = number.unwrap_or(signed);
        }
        assert!(!child.wait().expect("ended").success());
        let verified = Store::verify(&path, true).expect("verified");
        assert_eq!(verified.differences, [] as [String; 0], "kill {kill}");
        assert!((signed..=signed + 1).contains(&verified.signatures), "kill {kill}: {signed} told, {verified:?}");
        before = verified.signatures;
    }
    eprintln!("{kills} kills while signing in {} stores: no half record", stores + 1);
}

#[test]
fn a_kill_while_signing_leaves_no_half_record() {
    no_kill_leaves_half_a_record(10);
}

#[test]
#[ignore = "a thousand kills: make test-long"]
fn a_thousand_kills_while_signing_leave_no_half_record() {
    no_kill_leaves_half_a_record(1_000);
}
