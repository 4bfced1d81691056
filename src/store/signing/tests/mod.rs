//! Records as they are signed and exported. `changes` tests manipulations, `differences` tests which later additions
//! to a record are allowed.

mod changes;
mod differences;

use super::*;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Motion, Outcome, Path, Request};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::{
    Answer, Budget, Check, CycleId, CycleRecord, Finding, KeptFile, Kind, LimitSource, MotionRecord, PartNames,
    Picture, RequestAuthor, RequestRecord, RequestSource, RequestedAction,
};
use serde_json::json;
use std::collections::BTreeMap;

fn key() -> CellKey {
    CellKey::from_random_bytes(&[7; 32])
}

fn record(id: i64) -> CycleRecord {
    let judgement = Judgement { verdict: Verdict::Accept, reasons: vec![] };
    let check = Check::new("residual", "mm", 0.1 + 0.2).with_max(0.35, LimitSource::Program);
    let mut finding = Finding::new(Kind::Locate, 0, judgement.clone()).with_checks([check]);
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

fn statement(number: u64, previous: &str, says: StatementContent) -> Statement {
    Statement {
        form: STATEMENT_FORMAT.to_owned(),
        number,
        previous: previous.to_owned(),
        unix_ms: 1_700_000_100_000,
        public_key: key().public_key().hex(),
        store: SignedChainPosition { link: 40, hash: CHAIN_BEGIN.to_owned() },
        says,
    }
}

fn part() -> Option<PartNames> {
    Some(PartNames { serial: Some("SN 17".to_owned()), order: None, operator: Some("Ada".to_owned()) })
}

/// Returns six cycles as an exported folder with its head. A person released each cycle except the first.
fn exported() -> (ExportContent, Signed) {
    let (key, mut export) = (key(), ExportContent { files: Some(BTreeMap::new()), ..ExportContent::default() });
    let (mut pdfs, mut pages) = (BTreeMap::new(), BTreeMap::new());
    let (mut number, mut previous) = (0, CHAIN_BEGIN.to_owned());
    let mut add = |stem: &dyn Fn(u64) -> String, says: StatementContent| {
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
        let record_hash = add(&|_| cycle_stem(CycleId(id)), StatementContent::Cycle(cycle));
        let signs = record_hash.clone();
        if id > 1 {
            let (name, user) = ("Grace Hopper".to_owned(), "grace".to_owned());
            let meaning = Meaning::InspectedAndReleased;
            let says = PersonSignature {
                cycle: CycleId(id),
                record_hash,
                name,
                user,
                meaning,
                remark: None,
                values: StatedValues::default(),
            };
            add(&|number| person_signature_stem(CycleId(id), number), StatementContent::Person(says));
        }
        let (cycle, shows) = (CycleId(id), if id > 1 { 2 * id - 1 } else { 1 } as u64);
        let (pdf, stem) = (format!("%PDF of cycle {id}"), page_stem(cycle));
        let (page, signature) = SignedPage::sign(pdf.as_bytes(), (cycle, &signs, shows), 7, &key).expect("JSON");
        pages.extend([(format!("{stem}.json"), page), (format!("{stem}.sig"), signature)]);
        pdfs.insert(pdf_name(cycle), content_hash(pdf.as_bytes()));
    }
    export.statements.extend(pages);
    export.pdfs = pdfs;
    let head = SignedHead {
        form: HEAD_FORMAT.to_owned(),
        number,
        hash: previous,
        unix_ms: 1,
        public_key: key.public_key().hex(),
    };
    let bytes = canonical(&head).expect("JSON");
    let signature = key.sign(&bytes).to_vec();
    export.files = Some(files);
    (export, Signed { name: "head.json".to_owned(), bytes, signature, claim: NameClaim::Nothing })
}

fn found(export: &ExportContent, head: Option<&Signed>) -> Vec<String> {
    verify_export(export, &[key().public_key()], head).differences
}

/// RFC 8785, 3.2.3 and its appendix B, calculated by hand: names in the order of UTF-16, the shortest digits, no
/// spaces. 2⁵³ is written as a text: a double can hold 2⁵³ but cannot distinguish it from its neighbour.
#[test]
fn the_canonical_form_is_that_of_the_standard() {
    let value = json!({"b": [1.0, 1e21, 333_333_333.333_333_3, -0.0], "a": "é\n", "plan": u64::MAX, "most": (1_u64 << 53) - 1});
    let text = String::from_utf8(canonical(&value).expect("JSON")).expect("UTF-8");
    let expected = "{\"a\":\"é\\n\",\"b\":[1,1e+21,333333333.3333333,0],\"most\":9007199254740991,\
                    \"plan\":\"18446744073709551615\"}";
    assert_eq!(text, expected);
}

/// The key of a cell signs any content. The public key and the record are enough to detect a pass in spite of a
/// finding that forbids it.
#[test]
fn a_pass_that_its_findings_forbid_is_refused() {
    let judged = |verdict, code: &'static str| {
        let reasons = if code.is_empty() { vec![] } else { vec![Reason::new(code, "words")] };
        Judgement { verdict, reasons }
    };
    let reported = |worst: Verdict, accepted: Option<u64>| {
        let mut record = record(1);
        record.findings.push(Finding::new(Kind::Abrade, 2, judged(worst, "removal_too_deep")));
        record.findings.push(Finding::new(Kind::Inspect, 2, judged(Verdict::Pass, "")));
        record.judgement = Some(judged(Verdict::Pass, ""));
        record.asked.extend(accepted.map(|findings| RequestRecord {
            unix_ms: 1,
            wanted: RequestedAction::For(Request::Accept),
            who: Some(RequestAuthor::from_source(RequestSource::Socket)),
            answer: Some(Answer::Done),
            reasons: vec![],
            findings: Some(findings),
        }));
        let bytes =
            statement(1, CHAIN_BEGIN, StatementContent::Cycle(SignedCycle::new(&record, None).expect("JSON")));
        let bytes = bytes.canonical().expect("JSON");
        let signature = key().sign(&bytes).to_vec();
        let statements = [("cycle-1.json".to_owned(), bytes), ("cycle-1.sig".to_owned(), signature)].into();
        found(&ExportContent { statements, ..ExportContent::default() }, None)
    };
    for (worst, what) in [(Verdict::Reject, "reject"), (Verdict::Invalid, "invalid")] {
        for accepted in [None, Some(3)] {
            let words = format!(
                "cycle-1.json: cycle 1 has the verdict pass, but its finding 2 (abrade, pass 2) is {what}: words \
                 (removal_too_deep)"
            );
            assert_eq!(reported(worst, accepted), [words], "an accept does not help");
        }
    }
    let unaccepted = "its finding 2 (abrade, pass 2) is a review that no person accepted";
    for accepted in [None, Some(1)] {
        let reported = reported(Verdict::Review, accepted);
        assert!(reported.len() == 1 && reported[0].contains(unaccepted), "{reported:?}");
    }
    assert_eq!(reported(Verdict::Review, Some(2)), [] as [String; 0]);
    assert_eq!(reported(Verdict::Accept, None), [] as [String; 0]);
}

/// RFC 8032, 7.1, test 2.
#[test]
fn a_signature_is_that_of_the_standard() {
    let bytes = |hex: &str| -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex")).collect()
    };
    let secret = bytes("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb");
    let key = CellKey::from_random_bytes(&secret.try_into().expect("32 bytes"));
    assert_eq!(key.public_key().hex(), "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c");
    let expected = "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da\
                    085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00";
    assert_eq!(key.sign(&[0x72]).to_vec(), bytes(expected));
    assert!(
        key.public_key().is_valid_signature(&[0x72], &bytes(expected))
            && !key.public_key().is_valid_signature(&[0x73], &bytes(expected))
    );
    assert!(!format!("{key:?}").contains("4ccd"), "the secret stands in no message");
}

#[test]
fn keys_come_back_from_their_files() {
    let pem = key().to_pem().expect("PEM");
    assert!(pem.starts_with("-----BEGIN PRIVATE KEY-----\n"), "{pem}");
    assert_eq!(CellKey::read(&pem).expect("read").public_key(), key().public_key());
    let other = CellKey::from_random_bytes(&[8; 32]).public_key();
    let both = format!("{}{}", key().public_key().to_pem().expect("PEM"), other.to_pem().expect("PEM"));
    assert_eq!(PublicKey::parse_all(&both).expect("two"), [key().public_key(), other.clone()]);
    assert_eq!(PublicKey::from_hex(&other.hex()).expect("hex"), other);
    let refused = PublicKey::parse_all(&pem).expect_err("a private one").to_string();
    assert!(refused.contains("no PUBLIC KEY block") && refused.contains("valid: the PEM file"), "{refused}");
    assert!(CellKey::read("x").expect_err("no key").to_string().contains("openssl genpkey -algorithm ed25519"));
}

#[test]
fn a_whole_export_is_found_whole() {
    let (export, head) = exported();
    let verified = verify_export(&export, &[key().public_key()], Some(&head));
    assert_eq!(verified.differences, [] as [String; 0]);
    assert_eq!(verified.statements.len(), 11);
    let StatementContent::Cycle(first) = &verified.statements[&1].0.says else { panic!("the first is a cycle") };
    assert_eq!((first.id, &first.part), (CycleId(1), &part()));
    assert_eq!(first.record["findings"][0]["numbers"][0]["value"], json!(0.1 + 0.2), "to the bit");
    assert_eq!(verified.gaps, []);
    // A part of the chain can also be verified; if the head is given, the chain must be complete.
    let mut part = export.clone();
    let is_in_part = |name: &String| ["cycle-2", "cycle-5"].iter().any(|stem| name.starts_with(stem));
    part.statements.retain(|name, _| is_in_part(name));
    part.pdfs.retain(|name, _| is_in_part(name));
    let reported = verify_export(&part, &[key().public_key()], None);
    assert_eq!((reported.differences, reported.gaps), (vec![], vec![(1, 1), (4, 7)]));
    let reported = verify_export(&part, &[key().public_key()], Some(&head));
    let expected = ["record number 1 is missing", "records number 4 to 7 are missing", "rolled back"];
    assert!(
        reported.differences.iter().zip(expected).all(|(found, words)| found.contains(words)),
        "{:?}",
        reported.differences
    );
    assert_eq!((reported.differences.len(), reported.gaps), (3, vec![]));
    // A cycle and the persons' signatures on it can be verified without other records.
    let of_third = export.statements.clone().into_iter().filter(|(name, _)| name.starts_with("cycle-3")).collect();
    let pdfs = export.pdfs.clone().into_iter().filter(|(name, _)| name.starts_with("cycle-3")).collect();
    assert_eq!(found(&ExportContent { statements: of_third, pdfs, files: None }, None), [] as [String; 0]);
}

#[test]
fn what_is_no_canonical_record_is_refused() {
    let (export, _) = exported();
    let bytes = &export.statements["cycle-1.json"];
    let spaced = [bytes.as_slice(), b"\n"].concat();
    assert!(Statement::read(&spaced).expect_err("refused").to_string().contains("not in canonical form"));
    assert!(Statement::read(b"{}").is_err() && Statement::read(b"\xff").is_err());
    assert!(SignedHead::read(bytes).is_err());
    let other = String::from_utf8(bytes.clone()).expect("UTF-8").replace(STATEMENT_FORMAT, "panelprep-record-9");
    let refused = Statement::read(other.as_bytes()).expect_err("refused").to_string();
    assert!(refused.contains("\"panelprep-record-9\", expected \"panelprep-record-1\""), "{refused}");
}

/// Canonical JSON stores a plan's number as a text. The record reads back unchanged, and a serial number of digits
/// stays a text.
#[test]
fn a_signed_record_reads_back_with_every_digit() {
    let motion = Motion { epoch: 1, path: Path::Contact, plan: 13_988_697_933_614_533_883, waypoints: 138 };
    let motions = vec![MotionRecord { motion, outcome: Some(Outcome::Done), done: 138, contact: None }];
    let record = CycleRecord { motions, panel: "13988697933614533883".to_owned(), ..record(1) };
    let signed = SignedCycle::new(&record, part()).expect("JSON");
    assert_eq!(signed.record["motions"][0]["motion"]["plan"], json!("13988697933614533883"));
    assert_eq!(signed.cycle_record().expect("reads"), record);
}
