//! Tests that an invalid value is reported with the valid values, and that nothing is created or executed.

use super::commands::{json, panelprep};
use std::fs;
use std::path::Path;

const CELL: &str = "store = \"store\"\n[robot]\nkind = \"mock\"\n[limits]\nmax_speed_mm_s = 250.0\n\
    box_min_mm = [100.0, -450.0, 50.0]\nbox_max_mm = [700.0, 450.0, 900.0]\n\
    [poses]\npark = { a1_deg = -120.0, a2_deg = -75.0, a3_deg = 110.0, a4_deg = 0.0, a5_deg = 55.0, a6_deg = 90.0 }\n\
    [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
    [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\nlight_on = 5\n";

/// A valid public key: that of RFC 8032, 7.1, test 2.
const KEY: &str = "-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEAPUAXw+hDiVqStwqnTRt+vJyYLM8uxJaMwM1V8Sr0Zgw=\n-----END PUBLIC KEY-----\n";

fn expect_refused(folder: &Path, arguments: &str, words: &[&str]) {
    let output = panelprep(folder, arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.code() == Some(2) && words.iter().all(|words| told.contains(words)),
        "{arguments}: {words:?}: {told}"
    );
}

/// A number that is out of range is reported with its range, also if it is negative.
#[test]
fn a_number_out_of_range_is_reported_with_what_is_allowed() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("cell.toml"), CELL).expect("written");
    fs::write(folder.join("key.pem"), KEY).expect("written");
    for (arguments, words) in [
        ("robot move-lin 1,2,3,4,5,6 --speed-mm-s 0", ["--speed-mm-s \"0\"", "1 to 250 mm/s"]),
        ("robot move-lin 1,2,3,4,5,6 --speed-mm-s -5", ["--speed-mm-s \"-5\"", "1 to 250 mm/s"]),
        ("robot set-speed 1000", ["\"1000\"", "1 to 250 mm/s ([limits] max_speed_mm_s"]),
        ("robot set-speed -1", ["\"-1\"", "1 to 250 mm/s"]),
        ("shoot film --out f --seconds -1", ["'-1'", "the limits are 0.1 to 600 s"]),
        ("shoot scan --out f --line-parts 3", ["--line-parts is for a whole cycle", "omit the option"]),
        ("shoot scan --out f --tool-fault silent@40", ["--tool-fault is for a whole cycle", "omit the option"]),
        ("render --out r --clips 100000", ["100000", "0..=1000"]),
        ("new recipe --yes --panel door --rows 0 --out n.toml", ["--rows \"0\"", "1 to 50"]),
        ("new recipe --yes --panel door --columns -2 --out n.toml", ["--columns \"-2\"", "1 to 50"]),
        ("new recipe --yes --out n.toml", ["give --panel", "has no answer"]),
        ("record verify nofile --public-key key.pem", ["nofile", "does not exist"]),
        ("store renew --why=", ["--why", "must not be empty"]),
    ] {
        expect_refused(folder, &format!("{arguments} --cell cell.toml"), &words);
    }
    let reported = panelprep(folder, "new recipe --yes --out n.toml --cell cell.toml").stderr;
    assert!(!String::from_utf8_lossy(&reported).contains("or --yes"), "--yes was given");
    for file in ["f", "r", "n.toml", "store"] {
        assert!(!folder.join(file).exists(), "{file}");
    }
}

/// The error for a file that is not text, or does not exist, states this; XML is mentioned only for XML files.
#[test]
fn a_file_that_cannot_be_read_is_reported_by_its_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("cell.toml"), CELL).expect("written");
    fs::write(folder.join("bad.toml"), b"[cell]\n# gr\xfcn\n").expect("written");
    fs::write(folder.join("bad.xml"), b"<a>\n\xfc</a>\n").expect("written");
    fs::write(folder.join("empty.toml"), "").expect("written");
    let check = |file: &str| String::from_utf8(panelprep(folder, &format!("check {file}")).stdout).expect("UTF-8");
    let (toml, xml, missing) = (check("bad.toml"), check("bad.xml"), check("nothere.toml"));
    assert!(toml.contains("  line 2 is not UTF-8; save the file as UTF-8\n") && !toml.contains("XML"), "{toml}");
    assert!(
        xml.contains("warning, line 2: encoding: the file is not UTF-8, the encoding of XML without a declaration"),
        "{xml}"
    );
    assert!(missing.contains("  nothere.toml: ") && !missing.contains("line 1"), "{missing}");
    expect_refused(
        folder,
        "robot state --cell bad.toml",
        &["bad.toml", "line 2 is not UTF-8; save the file as UTF-8"],
    );
    expect_refused(folder, "calibrate tcp --poses empty.toml --cell cell.toml", &["empty.toml"]);
}

/// In a mistyped folder, only the command that adds an account creates a store.
#[test]
fn listing_accounts_creates_no_store() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    fs::write(folder.join("cell.toml"), CELL).expect("written");
    for task in ["list", "password ada", "role ada operator", "disable ada", "enable ada"] {
        let (exit, told) = json(folder, &format!("user {task} --cell cell.toml --store typo"));
        assert!(exit == 2 && told["reasons"].to_string().contains("no store found in typo"), "{task}: {told}");
        assert!(!folder.join("typo").exists(), "{task}");
    }
}
