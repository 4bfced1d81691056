//! Every change of a signed record is found and named.

use super::*;
use crate::cycle::{Motion, Outcome, Path};
use crate::files::content_hash;
use crate::record::{
    Budget, Check, CycleId, CycleRecord, Finding, KeptFile, Kind, MotionRecord, PartNames, Picture, SetBy,
};
use crate::verdict::{Judgement, Verdict};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::json;
use std::collections::BTreeMap;

fn key() -> CellKey {
    CellKey::of_random(&[7; 32])
}

fn record(id: i64) -> CycleRecord {
    let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
    let check = Check::new("residual", "mm", 0.1 + 0.2).at_most(0.25, SetBy::Program);
    let mut finding = Finding::new(Kind::Locate, 0, judgement.clone()).with([check]);
    let hash = |name: &str| content_hash(format!("{name} of cycle {id}").as_bytes());
    finding.pictures =
        vec![Picture { name: "located".to_owned(), caption: "outline".to_owned(), hash: hash("located") }];
    finding.shots = vec![KeptFile { name: "scan".to_owned(), hash: hash("scan") }];
    CycleRecord {
        id: CycleId(id),
        started_unix_s: 1_700_000_000 + id,
        ended_unix_s: Some(1_700_000_090 + id),
        panel: "wing".to_owned(),
        taught_version: "0123456789abcdef".to_owned(),
        recipe_hash: hash("recipe"),
        files: vec![KeptFile { name: "scanner".to_owned(), hash: hash("scanner") }],
        program_version: "0.1.0".to_owned(),
        judgement: Some(judgement),
        budget: Some(Budget::default()),
        findings: vec![finding],
        motions: vec![],
        asked_before: vec![],
        asked: vec![],
        clocks: [None, None],
        recording: None,
        events: 12,
    }
}

fn statement(number: u64, previous: &str, says: Said) -> Statement {
    Statement {
        form: FORM.to_owned(),
        number,
        previous: previous.to_owned(),
        unix_ms: 1_700_000_100_000,
        public_key: key().public().hex(),
        store: StorePlace { link: 40, hash: BEGIN.to_owned() },
        says,
    }
}

fn part() -> Option<PartNames> {
    Some(PartNames { serial: Some("SN 17".to_owned()), order: None, operator: Some("Ada".to_owned()) })
}

/// Six cycles, each but the first released by a person, as a folder with its head.
fn exported() -> (Export, Signed) {
    let (key, mut export) = (key(), Export { files: Some(BTreeMap::new()), ..Export::default() });
    let (mut number, mut previous) = (0, BEGIN.to_owned());
    let mut add = |stem: &dyn Fn(u64) -> String, says: Said| {
        number += 1;
        let bytes = statement(number, &previous, says).canonical().expect("JSON");
        export.statements.insert(format!("{}.sig", stem(number)), key.sign(&bytes).to_vec());
        previous = content_hash(&bytes);
        export.statements.insert(format!("{}.json", stem(number)), bytes);
        previous.clone()
    };
    let mut files = BTreeMap::new();
    for id in 1..=6 {
        let cycle = SignedCycle::new(&record(id), part()).expect("JSON");
        files.extend(exported_files(&cycle).into_iter().map(|(_, hash)| (hash.clone(), hash)));
        let record_hash = add(&|_| cycle_stem(CycleId(id)), Said::Cycle(cycle));
        if id > 1 {
            let (name, user) = ("Grace Hopper".to_owned(), "grace".to_owned());
            let meaning = Meaning::InspectedAndReleased;
            let says = PersonSignature { cycle: CycleId(id), record_hash, name, user, meaning, remark: None };
            add(&|number| person_stem(CycleId(id), number), Said::Person(says));
        }
    }
    let head = SignedHead {
        form: HEAD_FORM.to_owned(),
        number,
        hash: previous,
        unix_ms: 1,
        public_key: key.public().hex(),
    };
    let bytes = canonical(&head).expect("JSON");
    let signature = key.sign(&bytes).to_vec();
    export.files = Some(files);
    (export, Signed { name: "head.json".to_owned(), bytes, signature, place: Place::Any })
}

fn found(export: &Export, head: Option<&Signed>) -> Vec<String> {
    verify_export(export, &[key().public()], head).found
}

/// RFC 8785, 3.2.3 and its appendix B by hand: names in order of UTF-16, the shortest digits, no spaces; and 2⁵³, which a double
/// holds, but not apart from its neighbour, as a text.
#[test]
fn the_canonical_form_is_that_of_the_standard() {
    let value = json!({"b": [1.0, 1e21, 333_333_333.333_333_3, -0.0], "a": "é\n", "plan": u64::MAX, "most": (1_u64 << 53) - 1});
    let text = String::from_utf8(canonical(&value).expect("JSON")).expect("UTF-8");
    let expected = "{\"a\":\"é\\n\",\"b\":[1,1e+21,333333333.3333333,0],\"most\":9007199254740991,\
                    \"plan\":\"18446744073709551615\"}";
    assert_eq!(text, expected);
}

/// RFC 8032, 7.1, test 2.
#[test]
fn a_signature_is_that_of_the_standard() {
    let bytes = |hex: &str| -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex")).collect()
    };
    let secret = bytes("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb");
    let key = CellKey::of_random(&secret.try_into().expect("32 bytes"));
    assert_eq!(key.public().hex(), "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c");
    let expected = "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da\
                    085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00";
    assert_eq!(key.sign(&[0x72]).to_vec(), bytes(expected));
    assert!(key.public().verifies(&[0x72], &bytes(expected)) && !key.public().verifies(&[0x73], &bytes(expected)));
    assert!(!format!("{key:?}").contains("4ccd"), "the secret stands in no message");
}

#[test]
fn keys_come_back_from_their_files() {
    let pem = key().pem().expect("PEM");
    assert!(pem.starts_with("-----BEGIN PRIVATE KEY-----\n"), "{pem}");
    assert_eq!(CellKey::read(&pem).expect("read").public(), key().public());
    let other = CellKey::of_random(&[8; 32]).public();
    let both = format!("{}{}", key().public().pem().expect("PEM"), other.pem().expect("PEM"));
    assert_eq!(PublicKey::read_all(&both).expect("two"), [key().public(), other.clone()]);
    assert_eq!(PublicKey::of_hex(&other.hex()).expect("hex"), other);
    let refused = PublicKey::read_all(&pem).expect_err("a private one").to_string();
    assert!(refused.contains("no block PUBLIC KEY") && refused.contains("allowed is the PEM file"), "{refused}");
    assert!(CellKey::read("x").expect_err("no key").to_string().contains("openssl genpkey -algorithm ed25519"));
}

#[test]
fn a_whole_export_is_found_whole() {
    let (export, head) = exported();
    let verified = verify_export(&export, &[key().public()], Some(&head));
    assert_eq!(verified.found, [] as [String; 0]);
    assert_eq!(verified.statements.len(), 11);
    let Said::Cycle(first) = &verified.statements[&1].0.says else { panic!("the first is a cycle") };
    assert_eq!((first.id, &first.part), (CycleId(1), &part()));
    assert_eq!(first.record["findings"][0]["numbers"][0]["value"], json!(0.1 + 0.2), "to the bit");
    // A cycle and what a person said of it stand for themselves.
    let of_third = export.statements.clone().into_iter().filter(|(name, _)| name.starts_with("cycle-3")).collect();
    assert_eq!(found(&Export { statements: of_third, files: None }, None), [] as [String; 0]);
}

/// Numbers by hand: cycle 1 is 1, cycle n is 2n − 2, its person's signature 2n − 1.
#[test]
fn each_kind_of_change_is_named() {
    let changed = |change: &dyn Fn(&mut Export, &mut Signed)| {
        let (mut export, mut head) = exported();
        change(&mut export, &mut head);
        found(&export, Some(&head))
    };
    let exchange = |export: &mut Export, one: &str, other: &str| {
        for ending in ["json", "sig"] {
            let [one, other] = [one, other].map(|stem| format!("{stem}.{ending}"));
            let kept = export.statements[&one].clone();
            let there = export.statements.insert(other, kept).expect("there");
            export.statements.insert(one, there);
        }
    };
    let remove = |export: &mut Export, stem: &str| {
        export
            .statements
            .retain(|name, _| !["json", "sig"].iter().any(|ending| *name == format!("{stem}.{ending}")));
    };
    let by_other_key = |export: &mut Export| {
        let stem = cycle_stem(CycleId(4));
        let other = CellKey::of_random(&[9; 32]);
        let bytes = export.statements[&format!("{stem}.json")].clone();
        export.statements.insert(format!("{stem}.sig"), other.sign(&bytes).to_vec());
    };
    let picture = record(2).findings[0].pictures[0].hash.clone();
    type Change<'c> = Box<dyn Fn(&mut Export, &mut Signed) + 'c>;
    let cases: Vec<(Change<'_>, &str)> = vec![
        (
            Box::new(|export, _| export.statements.get_mut("cycle-3.json").expect("there")[200] ^= 1),
            "cycle-3.json was changed",
        ),
        (
            Box::new(|export, _| export.statements.get_mut("cycle-3.sig").expect("there")[5] ^= 1),
            "cycle-3.json was changed",
        ),
        (Box::new(|export, _| remove(export, "cycle-3")), "record number 4 is missing"),
        (
            Box::new(|export, _| drop(export.statements.remove("cycle-3.sig"))),
            "cycle-3.sig, the signature of cycle-3.json, is missing",
        ),
        (Box::new(|export, _| drop(export.statements.remove("cycle-3.json"))), "cycle-3.json is missing"),
        (
            Box::new(|export, _| exchange(export, "cycle-2", "cycle-5")),
            "cycle-5.json holds record number 2, of cycle 2: it was exchanged",
        ),
        (Box::new(|export, _| remove(export, "cycle-1")), "record number 1 is missing"),
        (
            Box::new(|export, _| remove(export, "cycle-6-signature-11")),
            "rolled back: the head head.json is at record number 11; record number 11 is missing",
        ),
        (Box::new(|_, head| head.bytes[10] ^= 1), "the head head.json was changed"),
        (Box::new(move |export, _| by_other_key(export)), "cycle-4.json was changed"),
        (
            Box::new(|export, _| {
                let copy = export.statements["cycle-3.json"].clone();
                export.statements.insert("copy.json".to_owned(), copy);
                let copy = export.statements["cycle-3.sig"].clone();
                export.statements.insert("copy.sig".to_owned(), copy);
            }),
            "are the same record",
        ),
        (
            Box::new(|export, _| drop(export.files.as_mut().expect("files").remove(&picture))),
            "picture located of cycle 2, is missing",
        ),
        (
            Box::new(|export, _| {
                drop(export.files.as_mut().expect("files").insert(picture.clone(), "0".to_owned()))
            }),
            "picture located of cycle 2, was changed",
        ),
    ];
    for (change, words) in cases {
        let told = changed(&*change);
        assert!(told.iter().any(|told| told.contains(words)), "{words}: {told:?}");
    }
}

/// Who has the cell's key can sign what he likes; but not a second record in the place of one whose head is kept elsewhere, and
/// not under a person's signature of the first.
#[test]
fn a_forged_record_contradicts_the_chain_the_head_and_the_person() {
    let (mut export, head) = exported();
    let mut forged = Statement::read(&export.statements["cycle-6.json"]).expect("read");
    let Said::Cycle(cycle) = &mut forged.says else { panic!("a cycle") };
    cycle.record["panel"] = json!("fin");
    let bytes = forged.canonical().expect("JSON");
    export.statements.insert("cycle-6.sig".to_owned(), key().sign(&bytes).to_vec());
    export.statements.insert("cycle-6.json".to_owned(), bytes);
    let told = found(&export, None);
    assert!(told.iter().any(|told| told.contains("number 11, does not follow from record number 10")), "{told:?}");
    assert!(told.iter().any(|told| told.contains("Grace Hopper signed another record of cycle 6")), "{told:?}");
    export.statements.retain(|name, _| !name.contains("signature-11"));
    assert_eq!(found(&export, None), [] as [String; 0]);
    let told = found(&export, Some(&head));
    assert!(told.iter().any(|told| told.contains("rolled back")), "{told:?}");
}

#[test]
fn what_is_no_canonical_record_is_refused() {
    let (export, _) = exported();
    let bytes = &export.statements["cycle-1.json"];
    let spaced = [bytes.as_slice(), b"\n"].concat();
    assert!(Statement::read(&spaced).expect_err("refused").to_string().contains("not in canonical form"));
    assert!(Statement::read(b"{}").is_err() && Statement::read(b"\xff").is_err());
    assert!(SignedHead::read(bytes).is_err());
    let other = String::from_utf8(bytes.clone()).expect("UTF-8").replace(FORM, "panelprep-record-9");
    let refused = Statement::read(other.as_bytes()).expect_err("refused").to_string();
    assert!(refused.contains("\"panelprep-record-9\", known is \"panelprep-record-1\""), "{refused}");
}

#[test]
fn differences_name_their_place_and_let_a_later_program_keep_more() {
    let signed = json!({"panel": "wing", "findings": [{"numbers": [1, 2]}], "asked": [1], "events": 5});
    let same = json!({"panel": "wing", "findings": [{"numbers": [1, 2]}], "asked": [1, 2], "events": 7, "new": 1});
    assert_eq!(differences(&signed, &same), [] as [String; 0]);
    let other = json!({"findings": [{"numbers": [1, 3]}], "asked": [], "events": 4});
    let told = differences(&signed, &other).join("; ");
    for words in [
        "/panel: signed was \"wing\", there is null",
        "/findings/0/numbers/1: signed was 2, there is 3",
        "/asked: signed was a list of 1, there is a list of 0",
        "/events: signed was 5, there is 4",
    ] {
        assert!(told.contains(words), "no {words} in {told}");
    }
}

/// After an abort is signed, the robot may still tell the end of a motion, and a request in the journal gets its answer.
#[test]
fn what_comes_after_a_cycle_is_no_difference() {
    let motion =
        |outcome: Option<&str>, done: u32| json!({"motion": {"epoch": 3}, "outcome": outcome, "done": done});
    let asked = |answer: Option<&str>| json!({"wanted": "stop", "who": answer.map(|_| "ada"), "answer": answer});
    let record =
        |motion: serde_json::Value, asked: serde_json::Value| json!({"motions": [motion], "asked": [asked]});
    let signed = record(motion(None, 0), asked(None));
    assert_eq!(differences(&signed, &record(motion(Some("cleared"), 7), asked(Some("done")))), [] as [String; 0]);
    let closed = record(motion(Some("done"), 7), asked(Some("done")));
    let told = differences(&closed, &record(motion(Some("done"), 8), asked(Some("refused")))).join("; ");
    assert!(told.contains("/motions/0/done: signed was 7, there is 8"), "{told}");
    assert!(told.contains("/asked/0/answer: signed was \"done\", there is \"refused\""), "{told}");
    let other = json!({"motions": [{"motion": {"epoch": 4}, "outcome": null, "done": 0}], "asked": []});
    let told = differences(&signed, &other).join("; ");
    assert!(
        told.contains("/motions/0/motion/epoch: signed was 3, there is 4") && told.contains("/asked: "),
        "{told}"
    );
}

/// Changes one thing at random; what it was, and a word that must be told of it.
fn change(random: &mut Pcg64, export: &mut Export, head: &mut Signed) -> (&'static str, String) {
    let names: Vec<String> = export.statements.keys().cloned().collect();
    let name = names[random.random_range(0..names.len())].clone();
    let stem = name.rsplit_once('.').expect("an ending").0.to_owned();
    let flip = |random: &mut Pcg64, bytes: &mut Vec<u8>| {
        let at = random.random_range(0..bytes.len());
        bytes[at] ^= 1 << random.random_range(0..8);
    };
    match random.random_range(0..9) {
        0 | 1 => {
            flip(random, export.statements.get_mut(&name).expect("there"));
            ("a byte", format!("{stem}.json"))
        }
        2 => {
            let (from, bytes) =
                ("\"previous\":\"", export.statements.get_mut(&format!("{stem}.json")).expect("there"));
            let at = bytes.windows(from.len()).position(|part| part == from.as_bytes()).expect("a link");
            let digit = &mut bytes[at + from.len() + random.random_range(0..64)];
            *digit = if *digit == b'0' { b'1' } else { b'0' };
            ("a link", format!("{stem}.json"))
        }
        3 => {
            export.statements.retain(|name, _| name.rsplit_once('.').expect("an ending").0 != stem);
            ("deleted", "missing".to_owned())
        }
        4 => {
            export.statements.remove(&name);
            ("one file deleted", name)
        }
        5 => {
            let other =
                names[random.random_range(0..names.len())].rsplit_once('.').expect("an ending").0.to_owned();
            if other == stem {
                return change(random, export, head);
            }
            for ending in ["json", "sig"] {
                let [one, two] = [&stem, &other].map(|stem| format!("{stem}.{ending}"));
                let kept = export.statements[&one].clone();
                let there = export.statements.insert(two, kept).expect("there");
                export.statements.insert(one, there);
            }
            ("exchanged", format!("{stem}.json"))
        }
        6 => {
            let keep = random.random_range(1..11_u64);
            export.statements.retain(|name, _| {
                let (stem, _) = name.rsplit_once('.').expect("an ending");
                let number = stem.split_once("-signature-").map(|(_, number)| number.parse().expect("a number"));
                let of_cycle = |id: u64| if id == 1 { 1 } else { 2 * id - 2 };
                number.unwrap_or_else(|| of_cycle(stem["cycle-".len()..].parse().expect("an id"))) <= keep
            });
            ("rolled back", "rolled back: the head head.json is at record number 11; record".to_owned())
        }
        7 => {
            let files = export.files.as_mut().expect("files");
            let file = files.keys().nth(random.random_range(0..files.len())).expect("a file").clone();
            if random.random::<bool>() {
                files.remove(&file);
            } else {
                files.insert(file.clone(), content_hash(&random.next_u64().to_be_bytes()));
            }
            ("a picture or input", format!("files/{file}"))
        }
        _ => {
            let bytes = if random.random::<bool>() { &mut head.bytes } else { &mut head.signature };
            flip(random, bytes);
            ("the head", "the head head.json".to_owned())
        }
    }
}

fn every_change_is_named(changes: u64) {
    let mut random = Pcg64::seed_from_u64(23);
    let whole = exported();
    let mut kinds: BTreeMap<&str, u64> = BTreeMap::new();
    for number in 0..changes {
        let (mut export, mut head) = whole.clone();
        let (kind, words) = change(&mut random, &mut export, &mut head);
        let told = found(&export, Some(&head));
        assert!(
            told.iter().any(|told| told.contains(&words)),
            "change {number}, {kind}: no \"{words}\" in {told:?}"
        );
        *kinds.entry(kind).or_default() += 1;
    }
    eprintln!("{changes} changes, each found and named: {kinds:?}");
    assert_eq!(kinds.len(), 8, "{kinds:?}");
}

#[test]
fn random_changes_are_found_and_named() {
    every_change_is_named(500);
}

#[test]
#[ignore = "ten thousand changes: make test-long"]
fn ten_thousand_random_changes_are_found_and_named() {
    every_change_is_named(10_000);
}

/// Canonical JSON holds the number of a plan as a text; the record reads back as it was, and a serial number of digits stays a text.
#[test]
fn a_signed_record_reads_back_with_every_digit() {
    let motion = Motion { epoch: 1, path: Path::Contact, plan: 13_988_697_933_614_533_883, waypoints: 138 };
    let motions = vec![MotionRecord { motion, outcome: Some(Outcome::Done), done: 138, contact: None }];
    let record = CycleRecord { motions, panel: "13988697933614533883".to_owned(), ..record(1) };
    let signed = SignedCycle::new(&record, part()).expect("JSON");
    assert_eq!(signed.record["motions"][0]["motion"]["plan"], json!("13988697933614533883"));
    assert_eq!(signed.cycle_record().expect("reads"), record);
}
