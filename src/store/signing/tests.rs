//! Tests of signed and exported records: every change of a signed record is detected and named.

use super::*;
use panelprep_base::verdict::{Judgement, Reason, Verdict};
use panelprep_cell::cycle::{Motion, Outcome, Path, Request};
use panelprep_cell::files::content_hash;
use panelprep_cell::record::{
    Answer, Budget, Check, CycleId, CycleRecord, Finding, KeptFile, Kind, LimitSource, MotionRecord, PartNames,
    Picture, RequestAuthor, RequestRecord, RequestSource, RequestedAction,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
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
        store: SignedChainPosition { link: 40, hash: CHAIN_START_HASH.to_owned() },
        says,
    }
}

fn part() -> Option<PartNames> {
    Some(PartNames { serial: Some("SN 17".to_owned()), order: None, operator: Some("Ada".to_owned()) })
}

/// Returns an exported folder with six cycles, and its head. A person has released every cycle except the first one.
fn exported() -> (ExportContent, Signed) {
    let (key, mut export) = (key(), ExportContent { files: Some(BTreeMap::new()), ..ExportContent::default() });
    let (mut pdfs, mut pages) = (BTreeMap::new(), BTreeMap::new());
    let (mut number, mut previous) = (0, CHAIN_START_HASH.to_owned());
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

/// Expected text, written by hand according to RFC 8785, 3.2.3 and appendix B: names in the order of UTF-16, the
/// shortest digits, no spaces. 2⁵³ is written as a string, because a double cannot distinguish 2⁵³ from 2⁵³ + 1.
#[test]
fn the_canonical_form_is_that_of_the_standard() {
    let value = json!({"b": [1.0, 1e21, 333_333_333.333_333_3, -0.0], "a": "é\n", "plan": u64::MAX, "most": (1_u64 << 53) - 1});
    let text = String::from_utf8(canonical(&value).expect("JSON")).expect("UTF-8");
    let expected = "{\"a\":\"é\\n\",\"b\":[1,1e+21,333333333.3333333,0],\"most\":9007199254740991,\
                    \"plan\":\"18446744073709551615\"}";
    assert_eq!(text, expected);
}

/// A person with the cell's private key can sign any content. The public key and the record are sufficient to detect a
/// verdict pass that contradicts a finding.
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
            statement(1, CHAIN_START_HASH, StatementContent::Cycle(SignedCycle::new(&record, None).expect("JSON")));
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

/// Expected values: RFC 8032, 7.1, test 2.
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
fn keys_read_back_from_their_files() {
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
fn a_complete_export_has_no_differences() {
    let (export, head) = exported();
    let verified = verify_export(&export, &[key().public_key()], Some(&head));
    assert_eq!(verified.differences, [] as [String; 0]);
    assert_eq!(verified.statements.len(), 11);
    let StatementContent::Cycle(first) = &verified.statements[&1].0.says else { panic!("the first is a cycle") };
    assert_eq!((first.id, &first.part), (CycleId(1), &part()));
    assert_eq!(first.record["findings"][0]["numbers"][0]["value"], json!(0.1 + 0.2), "to the bit");
    assert_eq!(verified.gaps, []);
    // A part of the chain can be verified, too; but with a head the chain must be complete.
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
    // A cycle and the signatures on it can be verified without the statements about other cycles.
    let of_third = export.statements.clone().into_iter().filter(|(name, _)| name.starts_with("cycle-3")).collect();
    let pdfs = export.pdfs.clone().into_iter().filter(|(name, _)| name.starts_with("cycle-3")).collect();
    assert_eq!(found(&ExportContent { statements: of_third, pdfs, files: None }, None), [] as [String; 0]);
}

#[test]
fn a_record_that_is_not_canonical_is_refused() {
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

/// In canonical JSON the number of a plan is a string. The record that is read back is unchanged, and a serial number
/// that consists of digits stays a string.
#[test]
fn a_signed_record_reads_back_with_every_digit() {
    let motion = Motion { epoch: 1, path: Path::Contact, plan: 13_988_697_933_614_533_883, waypoints: 138 };
    let motions = vec![MotionRecord { motion, outcome: Some(Outcome::Done), done: 138, contact: None }];
    let record = CycleRecord { motions, panel: "13988697933614533883".to_owned(), ..record(1) };
    let signed = SignedCycle::new(&record, part()).expect("JSON");
    assert_eq!(signed.record["motions"][0]["motion"]["plan"], json!("13988697933614533883"));
    assert_eq!(signed.cycle_record().expect("reads"), record);
}

/// Expected numbers, calculated by hand: the cell's statement about cycle 1 has the number 1, the one about cycle n has
/// 2n − 2, and the person's signature on cycle n has 2n − 1.
#[test]
fn each_kind_of_change_is_named() {
    let changed = |change: &dyn Fn(&mut ExportContent, &mut Signed)| {
        let (mut export, mut head) = exported();
        change(&mut export, &mut head);
        found(&export, Some(&head))
    };
    let exchange = |export: &mut ExportContent, one: &str, other: &str| {
        for ending in ["json", "sig"] {
            let [one, other] = [one, other].map(|stem| format!("{stem}.{ending}"));
            let kept = export.statements[&one].clone();
            let there = export.statements.insert(other, kept).expect("there");
            export.statements.insert(one, there);
        }
    };
    let remove = |export: &mut ExportContent, stem: &str| {
        export
            .statements
            .retain(|name, _| !["json", "sig"].iter().any(|ending| *name == format!("{stem}.{ending}")));
    };
    let by_other_key = |export: &mut ExportContent| {
        let stem = cycle_stem(CycleId(4));
        let other = CellKey::from_random_bytes(&[9; 32]);
        let bytes = export.statements[&format!("{stem}.json")].clone();
        export.statements.insert(format!("{stem}.sig"), other.sign(&bytes).to_vec());
    };
    let picture = record(2).findings[0].pictures[0].hash.clone();
    type Change<'c> = Box<dyn Fn(&mut ExportContent, &mut Signed) + 'c>;
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
            "cycle-5.json contains record number 2 of cycle 2, not the record in its file name",
        ),
        (Box::new(|export, _| remove(export, "cycle-1")), "record number 1 is missing"),
        (
            Box::new(|export, _| remove(export, "cycle-6-signature-11")),
            "rolled back: the chain head head.json is at record number 11; record number 11 is missing",
        ),
        (Box::new(|_, head| head.bytes[10] ^= 1), "the chain head head.json was changed"),
        (
            Box::new(|export, _| drop(export.pdfs.insert("cycle-3.pdf".to_owned(), content_hash(b"%PDF other")))),
            "cycle-3.pdf was changed: its SHA-256 is",
        ),
        (
            Box::new(|export, _| {
                let other = export.pdfs["cycle-2.pdf"].clone();
                export.pdfs.insert("cycle-3.pdf".to_owned(), other);
            }),
            "cycle-3.pdf was changed: its SHA-256 is",
        ),
        (Box::new(|export, _| drop(export.pdfs.remove("cycle-3.pdf"))), "cycle-3.pdf is missing; its signed page"),
        (
            Box::new(|export, _| remove(export, "cycle-3-page")),
            "cycle-3-page.json is missing: without it cycle-3.pdf cannot be verified",
        ),
        (
            Box::new(|export, _| export.statements.get_mut("cycle-3-page.json").expect("there")[90] ^= 1),
            "cycle-3-page.json was changed",
        ),
        (
            Box::new(|export, _| exchange(export, "cycle-2-page", "cycle-5-page")),
            "cycle-2-page.json belongs to cycle 5: the file was exchanged",
        ),
        (
            Box::new(|export, _| {
                // An earlier page of this cycle, from before the person's signature.
                let signed = content_hash(&export.statements["cycle-3.json"]);
                let (page, signature) =
                    SignedPage::sign(b"%PDF of cycle 3", (CycleId(3), &signed, 4), 7, &key()).expect("JSON");
                export.statements.insert("cycle-3-page.json".to_owned(), page);
                export.statements.insert("cycle-3-page.sig".to_owned(), signature);
            }),
            "cycle-3.pdf is older than signed record number 5 of this cycle",
        ),
        (
            Box::new(|export, _| {
                let other = content_hash(&export.statements["cycle-2.json"]);
                let (page, signature) =
                    SignedPage::sign(b"%PDF of cycle 3", (CycleId(3), &other, 5), 7, &key()).expect("JSON");
                export.statements.insert("cycle-3-page.json".to_owned(), page);
                export.statements.insert("cycle-3-page.sig".to_owned(), signature);
            }),
            "cycle-3-page.json does not belong to cycle-3.json",
        ),
        (Box::new(move |export, _| by_other_key(export)), "cycle-4.json was changed"),
        (
            Box::new(|export, _| {
                let copy = export.statements["cycle-3.json"].clone();
                export.statements.insert("copy.json".to_owned(), copy);
                let copy = export.statements["cycle-3.sig"].clone();
                export.statements.insert("copy.sig".to_owned(), copy);
            }),
            "contain the same record",
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
        let reported = changed(&*change);
        assert!(reported.iter().any(|reported| reported.contains(words)), "{words}: {reported:?}");
    }
}

/// A person with the cell's private key can sign any content. But a changed record is detected if the head is kept
/// elsewhere, or if another person has signed the record.
#[test]
fn a_forged_record_contradicts_the_chain_the_head_and_the_person() {
    let (mut export, head) = exported();
    let mut forged = Statement::read(&export.statements["cycle-6.json"]).expect("read");
    let StatementContent::Cycle(cycle) = &mut forged.says else { panic!("a cycle") };
    cycle.record["panel"] = json!("fin");
    let bytes = forged.canonical().expect("JSON");
    export.statements.insert("cycle-6.sig".to_owned(), key().sign(&bytes).to_vec());
    export.statements.insert("cycle-6.json".to_owned(), bytes);
    let told = found(&export, None);
    assert!(
        told.iter().any(|told| told.contains("number 11, does not contain the hash of record number 10")),
        "{told:?}"
    );
    assert!(
        told.iter().any(|told| told.contains("Grace Hopper signed another version of the record of cycle 6")),
        "{told:?}"
    );
    export.statements.retain(|name, _| !name.contains("signature-11") && !name.contains("cycle-6-page"));
    export.pdfs.remove("cycle-6.pdf");
    assert_eq!(found(&export, None), [] as [String; 0]);
    let told = found(&export, Some(&head));
    assert!(told.iter().any(|told| told.contains("rolled back")), "{told:?}");
}

/// Makes a random change, and returns its kind and a word that the reported difference must contain.
fn change(random: &mut Pcg64, export: &mut ExportContent, head: &mut Signed) -> (&'static str, String) {
    let (pages, names): (Vec<String>, Vec<String>) =
        export.statements.keys().cloned().partition(|name| name.contains("-page."));
    let name = names[random.random_range(0..names.len())].clone();
    let stem = name.rsplit_once('.').expect("an ending").0.to_owned();
    let flip = |random: &mut Pcg64, bytes: &mut Vec<u8>| {
        let at = random.random_range(0..bytes.len());
        bytes[at] ^= 1 << random.random_range(0..8);
    };
    match random.random_range(0..10) {
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
                if stem.ends_with("-page") {
                    return true;
                }
                let number = stem.split_once("-signature-").map(|(_, number)| number.parse().expect("a number"));
                let of_cycle = |id: u64| if id == 1 { 1 } else { 2 * id - 2 };
                number.unwrap_or_else(|| of_cycle(stem["cycle-".len()..].parse().expect("an id"))) <= keep
            });
            ("rolled back", "rolled back: the chain head head.json is at record number 11; record".to_owned())
        }
        8 => {
            let page = &pages[random.random_range(0..pages.len())];
            let stem = page.rsplit_once('.').expect("an ending").0;
            if random.random::<bool>() {
                flip(random, export.statements.get_mut(page).expect("there"));
                ("a signed page", format!("{stem}.json"))
            } else {
                let pdf = format!("{}.pdf", stem.strip_suffix("-page").expect("a page"));
                export.pdfs.insert(pdf.clone(), content_hash(&random.next_u64().to_be_bytes()));
                ("a PDF", format!("{pdf} was changed"))
            }
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
            ("the head", "the chain head head.json".to_owned())
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
    assert_eq!(kinds.len(), 10, "{kinds:?}");
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
