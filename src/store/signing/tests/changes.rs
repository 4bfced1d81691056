//! Every change of a signed record is found and named.

use super::*;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Calculated by hand: cycle 1 has number 1, cycle n has 2n − 2, and the person's signature on cycle n has 2n − 1.
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
                // An earlier version of this cycle's page, made before the person signed.
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

/// A person with the cell's key can sign anything. This person still cannot replace a record if its head is kept
/// elsewhere, or a record that another person has signed.
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

/// Changes one element at random; returns the kind of change and a word that the finding must contain.
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
