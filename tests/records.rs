//! Tests signed records as an inspector and an auditor use them: signed by the cell and a person, exported, and
//! verified by the program, by OpenSSL and by the script in the manual.

mod preflight;

use super::commands::{json, rendered, taught_and_verified};
use std::fs;
use std::path::Path;
use std::process::Command;

const CELL: &str = "--cell cell/cell.toml";

/// Returns the text of the manual's code block of this kind after this heading.
fn code_block(heading: &str, kind: &str) -> String {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/manual/records.md");
    let text = fs::read_to_string(page).expect("the manual");
    let rest = text.split(heading).nth(1).expect("the heading");
    let block = rest.split(&format!("```{kind}\n")).nth(1).expect("a block");
    block.split("```").next().expect("its end").to_owned()
}

/// Runs a line of the manual in a folder; returns whether it succeeded.
fn shell(folder: &Path, line: &str) -> bool {
    Command::new("sh").args(["-c", line]).current_dir(folder).output().expect("a shell").status.success()
}

fn script_finds_no_change(folder: &Path) -> (bool, String) {
    script_on(folder, "records", "records/public-key.pem")
}

fn script_on(folder: &Path, records: &str, key: &str) -> (bool, String) {
    fs::write(folder.join("verify_record.py"), code_block("## Without this program", "python")).expect("written");
    let script = Command::new("python3")
        .args(["verify_record.py", records, key])
        .current_dir(folder)
        .output()
        .expect("python3");
    let words = [script.stdout, script.stderr].concat();
    (script.status.success(), String::from_utf8_lossy(&words).into_owned())
}

fn verify(folder: &Path, more: &str) -> (i32, Vec<String>) {
    let (exit, told) = json(folder, &format!("record verify records --public-key records/public-key.pem {more}"));
    let found = told["found"].as_array().expect("found").iter();
    let found: Vec<String> = found.map(|words| words.as_str().expect("words").to_owned()).collect();
    assert_eq!(told["ok"].as_bool(), Some(found.is_empty()), "{told}");
    (exit, found)
}

/// The script is short enough for an auditor to read before running it.
#[test]
fn the_manuals_script_is_short() {
    let lines =
        code_block("## Without this program", "python").lines().filter(|line| !line.trim().is_empty()).count();
    assert!(lines <= 65, "{lines} lines");
}

/// Changes an exported folder and runs both programs on it. Each must name the problem and end with an exit code other
/// than 0.
fn both_refuse(at: &Path, what: &str, change: &dyn Fn(&Path), [program, script]: [&str; 2]) {
    let (records, whole) = (at.join("records"), at.join("whole"));
    copied(&records, &whole);
    change(&records);
    let (exit, found) = verify(at, "");
    assert!(exit == 1 && found.iter().any(|words| words.contains(program)), "{what}: {found:?}");
    let (is_whole, words) = script_finds_no_change(at);
    assert!(!is_whole && words.contains(script), "{what}: {words}");
    fs::remove_dir_all(&records).expect("removed");
    fs::rename(&whole, &records).expect("as it was");
}

fn copied(from: &Path, to: &Path) {
    assert!(Command::new("cp").arg("-r").args([from, to]).status().expect("cp").success());
}

/// Signs these bytes with the cell's key, as a person who has copied the key could.
fn signed_by_the_cell(at: &Path, file: &Path, bytes: &[u8]) {
    use panelprep::store::{KeyLocation, cell_key};
    let key = cell_key(&at.join("cell/store"), &KeyLocation::InStore).expect("the key");
    fs::write(file.with_extension("json"), bytes).expect("written");
    fs::write(file.with_extension("sig"), key.sign(bytes)).expect("written");
}

/// Makes changes that an earlier version of the manual's script accepted. Each must end the script with a line that
/// names the problem.
fn every_change_of_a_folder_is_refused(at: &Path) {
    let flip = |file: &Path| {
        let mut bytes = fs::read(file).expect("a file");
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(file, bytes).expect("changed");
    };
    let picture = |folder: &Path| {
        let file = fs::read_dir(folder.join("files")).expect("files").next().expect("one").expect("read");
        file.path()
    };
    let moved = |folder: &Path, from: &str, to: &str| {
        for ending in ["json", "sig"] {
            let [from, to] = [from, to].map(|stem| folder.join(format!("{stem}.{ending}")));
            fs::rename(from, to).expect("moved");
        }
    };
    both_refuse(
        at,
        "a PDF",
        &|folder| flip(&folder.join("cycle-1.pdf")),
        [
            "cycle-1.pdf was changed: its SHA-256 is ",
            "cycle-1.pdf is missing, was changed, or its signed page is missing",
        ],
    );
    both_refuse(
        at,
        "its hash",
        &|folder| flip(&folder.join("cycle-1-page.json")),
        ["cycle-1-page.json was changed", "cycle-1-page.json was changed, or its signature is missing"],
    );
    let remove = |name: &'static str| move |folder: &Path| fs::remove_file(folder.join(name)).expect("removed");
    both_refuse(at, "no PDF", &remove("cycle-1.pdf"), ["cycle-1.pdf is missing", "cycle-1.pdf is missing"]);
    both_refuse(
        at,
        "no signed page",
        &|folder| {
            remove("cycle-1-page.json")(folder);
            remove("cycle-1-page.sig")(folder);
        },
        ["cycle-1-page.json is missing", "its signed page is missing"],
    );
    both_refuse(
        at,
        "no record",
        &remove("cycle-1.json"),
        ["cycle-1.json is missing; its signature", "cycle-1.json is missing; its signature is there"],
    );
    both_refuse(at, "no signature", &remove("cycle-1.sig"), ["cycle-1.sig", "its signature is missing"]);
    both_refuse(
        at,
        "no picture",
        &|folder| fs::remove_file(picture(folder)).expect("removed"),
        ["is missing", "is missing or was changed"],
    );
    both_refuse(at, "a picture", &|folder| flip(&picture(folder)), ["was changed", "is missing or was changed"]);
    both_refuse(
        at,
        "another name",
        &|folder| moved(folder, "cycle-1", "cycle-7"),
        [
            "cycle-7.json contains record number 1 of cycle 1, not the record in its file name",
            "cycle-7.json holds the record that was cycle-1.json",
        ],
    );
    both_refuse(
        at,
        "a number twice",
        &|folder| {
            for ending in ["json", "sig"] {
                let [one, other] = ["cycle-1", "cycle-9"].map(|stem| folder.join(format!("{stem}.{ending}")));
                fs::copy(one, other).expect("copied");
            }
        },
        ["contain the same record", "both are record number 1"],
    );
    both_refuse(
        at,
        "another first link",
        &|folder| {
            let text = fs::read_to_string(folder.join("cycle-1.json")).expect("a record");
            let zeros = format!("\"previous\":\"{}\"", "0".repeat(64));
            let other = text.replacen(&zeros, &zeros.replace("00\"", "01\""), 1);
            assert_ne!(text, other, "it names the one before it");
            signed_by_the_cell(at, &folder.join("cycle-1"), other.as_bytes());
        },
        [
            "does not contain the hash of record number 0",
            "cycle-1.json is the first record, and names another one before it",
        ],
    );
    both_refuse(
        at,
        "a pass over a reject",
        &|folder| {
            let text = fs::read_to_string(folder.join("cycle-1.json")).expect("a record");
            let at_abrasion = text.find("\"kind\":\"abrade\"").expect("it was abraded");
            let accepted = "\"verdict\":\"accept\"";
            // In canonical order the judgement precedes the kind.
            let at_verdict = text[..at_abrasion].rfind("\"judgement\"").expect("judged");
            let changed = text[at_verdict..].replacen(accepted, "\"verdict\":\"reject\"", 1);
            signed_by_the_cell(at, &folder.join("cycle-1"), format!("{}{changed}", &text[..at_verdict]).as_bytes());
        },
        ["has the verdict pass, but its finding", "is not the signed page of the record cycle-1.json"],
    );
    for (folder, key) in [("empty", "records/public-key.pem"), ("not-there", "records/public-key.pem")] {
        if folder == "empty" {
            fs::create_dir_all(at.join(folder)).expect("made");
        }
        let (is_whole, words) = script_on(at, folder, key);
        assert!(!is_whole && words.contains(&format!("{folder} has no signed record")), "{folder}: {words}");
    }
    let (is_whole, words) = script_on(at, "records", "no-key.pem");
    assert!(!is_whole && words.contains("the key is a file"), "{words}");
}

#[test]
fn a_cycle_is_signed_exported_and_verified_by_three_programs() {
    let folder = rendered("good");
    let at = folder.path();
    taught_and_verified(at);
    let start = format!("cycle {CELL} --recipe cell/recipe.toml --seed 3 --part SN-17 --order W-1 --operator Ada");
    let (exit, ended) = json(at, &start);
    assert_eq!((exit, ended["verdict"].as_str()), (0, Some("pass")), "{ended}");
    let (exit, output) = json(at, &format!("record sign 1 {CELL} --name Grace --meaning released"));
    assert_eq!((exit, output["number"].as_i64()), (0, Some(2)), "{output}");
    let (exit, output) = json(at, &format!("record export 1 {CELL} --out records"));
    assert_eq!(exit, 0, "{output}");
    // If one of several records does not exist, nothing is written.
    let (exit, output) = json(at, &format!("record export 1 99 {CELL} --out half"));
    assert!(exit == 2 && output.to_string().contains("has no cycle 99") && !at.join("half").exists(), "{output}");

    assert_eq!(verify(at, "--head records/head.json"), (0, vec![]));
    let openssl = code_block("OpenSSL (3.0 or newer)", "");
    let records = at.join("records");
    assert!(shell(&records, &openssl), "{openssl}");
    assert!(shell(&records, &openssl.replace("cycle-1.", "cycle-1-page.")), "the signed page likewise");
    assert_eq!(script_finds_no_change(at), (true, "2 records are as they were signed\n".to_owned()));
    let (exit, output) = json(at, &format!("store verify {CELL}"));
    assert_eq!((exit, output["signatures"].as_i64()), (0, Some(2)), "{output}");
    let page = fs::read_to_string(at.join("cell/store/reports/cycle-000001.html")).expect("the page");
    for words in ["SN-17", "W-1", "inspected and released", "Grace (", "failed, sanded, then passed", "ASTM F22"] {
        assert!(page.contains(words), "the page lacks {words}");
    }
    let pdf = fs::read(records.join("cycle-1.pdf")).expect("the PDF");
    assert!(pdf.starts_with(b"%PDF-1.7") && pdf.windows(20).any(|part| part == b"<pdfaid:part>3</pdfa"), "PDF/A-3");
    preflight::accepts(&records.join("cycle-1.pdf"));

    every_change_of_a_folder_is_refused(at);
    // A single file is verified together with the files that belong to it.
    let one = "record verify records/cycle-1.pdf --public-key records/public-key.pem";
    let (exit, output) = json(at, one);
    assert_eq!((exit, output["found"].as_array().map(Vec::len)), (0, Some(0)), "{output}");

    // A word in the verdict is changed; then this file is restored and a picture is changed.
    let file = records.join("cycle-1.json");
    let whole = fs::read_to_string(&file).expect("the record");
    fs::write(&file, whole.replacen("\"pass\"", "\"fail\"", 1)).expect("changed");
    let (exit, found) = verify(at, "");
    assert!(exit == 1 && found[0].contains("cycle-1.json was changed"), "{found:?}");
    assert!(!shell(&records, &openssl));
    let (is_whole, words) = script_finds_no_change(at);
    assert!(!is_whole && words.contains("cycle-1.json was changed"), "{words}");
    fs::write(&file, whole).expect("as it was");
    fs::remove_file(records.join("cycle-1-signature-2.json")).expect("removed");
    let (exit, found) = verify(at, "--head records/head.json");
    assert!(exit == 1 && found.iter().any(|words| words.contains("rolled back")), "{found:?}");

    // The part has reached its maximum number of passes; another part has not.
    let recipe = at.join("cell/recipe.toml");
    let text = fs::read_to_string(&recipe).expect("the recipe");
    let least = text.replace("[process]\n", "[process]\nmax_passes_per_grid = 1\nmax_passes_per_part = 1\n");
    assert_ne!(least, text, "the recipe has [process]");
    fs::write(&recipe, least).expect("written");
    let (exit, output) = json(at, &start);
    let words = output["reasons"][0]["message"].as_str().unwrap_or_default();
    assert_eq!(exit, 2, "{output}");
    assert!(
        words.contains("the part SN-17") && words.contains("cycle 1 of ") && words.contains(": 1 pass"),
        "{words}"
    );
    let (_, output) = json(at, &start.replace("SN-17", "SN-18"));
    assert_eq!(output["cycle_id"].as_i64(), Some(2), "another part begins: {output}");

    // The record of one cycle can be verified, even if the record of another cycle was signed before its last
    // signature.
    let (exit, output) = json(at, &format!("record sign 1 {CELL} --name Ada --meaning reviewed"));
    assert_eq!((exit, output["number"].as_i64()), (0, Some(4)), "{output}");
    fs::remove_dir_all(&records).expect("removed");
    assert_eq!(json(at, &format!("record export 1 {CELL} --out records")).0, 0);
    let one = "record verify records --public-key records/public-key.pem";
    let (exit, output) = json(at, one);
    assert_eq!((exit, output["verdict"].as_str()), (0, Some("pass")), "{output}");
    assert_eq!(output["remarks"], serde_json::json!(["record number 3 is not in this folder"]), "{output}");
    for all in ["--head records/head.json", "--all"] {
        assert_eq!(verify(at, all), (1, vec!["record number 3 is missing".to_owned()]), "{all}");
    }
    let (is_whole, words) = script_finds_no_change(at);
    assert!(is_whole && words.ends_with("not in this folder\n3 records are as they were signed\n"), "{words}");
}
