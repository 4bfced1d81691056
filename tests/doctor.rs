//! Tests that `panelprep doctor` reports every problem of a cell, and nothing else.

use super::commands::{TEACH, VERIFY, json, rendered, taught_and_verified};
use super::wall::{Mock, over_sockets};
use panelprep::calib::health::Verification;
use panelprep::store::Store;
use serde_json::Value;
use std::fs;
use std::io::Write;
use std::net::TcpListener;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

const DOCTOR: &str = "doctor --cell cell/cell.toml";
/// Two of the sixteen ports that a controller's firewall opens; no other test uses them.
const PORTS: [u16; 2] = [54_612, 54_613];

/// Returns each problem that the doctor reports: name, value found, advice.
fn reported_problems(folder: &Path, arguments: &str) -> Vec<[String; 3]> {
    let (exit, told) = json(folder, arguments);
    let checks = told["checks"].as_array().expect("checks");
    let text = |check: &Value, key: &str| check[key].as_str().unwrap_or_default().to_owned();
    let is_wrong = |check: &&Value| check["ok"] == Value::Bool(false);
    let wrong: Vec<[String; 3]> = checks
        .iter()
        .filter(is_wrong)
        .map(|check| ["name", "found", "advice"].map(|key| text(check, key)))
        .collect();
    assert_eq!((exit, told["verdict"] == "pass"), (i32::from(!wrong.is_empty()), wrong.is_empty()), "{told}");
    assert!(
        checks.len() >= 2 && wrong.iter().all(|[_, found, advice]| !found.is_empty() && !advice.is_empty()),
        "{told}"
    );
    // A mock controller never has signed acceptance tests; another test checks this row.
    wrong.into_iter().filter(|[name, ..]| name != "proofs").collect()
}

/// Checks that exactly one problem is reported, with these words in its name, in the value found, and in the advice.
fn expect_one_problem(folder: &Path, arguments: &str, words: [&str; 3]) {
    let wrong = reported_problems(folder, arguments);
    let [only] = wrong.as_slice() else { panic!("{words:?}: {wrong:?}") };
    assert!(only.iter().zip(words).all(|(text, word)| text.contains(word)), "{words:?}: {only:?}");
}

/// Injects a fault into a file, runs the check, and restores the file.
fn check_injected_fault(folder: &Path, (file, from, to): (&str, &str, &str), words: [&str; 3]) {
    let file = folder.join(file);
    let text = fs::read_to_string(&file).expect("there");
    assert!(text.contains(from), "{from}: {text}");
    fs::write(&file, text.replacen(from, to, 1)).expect("written");
    expect_one_problem(folder, DOCTOR, words);
    fs::write(&file, text).expect("written");
}

#[test]
fn doctor_reports_each_planted_fault_and_none_in_a_good_cell() {
    let folder = rendered("good");
    let folder = folder.path();
    // Before teaching, the store is missing, and no statement about either calibration is made.
    let names: Vec<String> = reported_problems(folder, DOCTOR).into_iter().map(|[name, ..]| name).collect();
    assert_eq!(names, ["store", "calibration of the scanner", "calibration of the flange_camera"]);
    taught_and_verified(folder);
    assert_eq!(reported_problems(folder, DOCTOR), Vec::<[String; 3]>::new());

    // Faults in the cell's file and in the files that it names.
    fs::rename(folder.join("cell/flange_from_camera.toml"), folder.join("away.toml")).expect("moved");
    expect_one_problem(
        folder,
        DOCTOR,
        ["calibration of the flange_camera", "flange_from_camera.toml", "calibrate"],
    );
    fs::rename(folder.join("away.toml"), folder.join("cell/flange_from_camera.toml")).expect("back");
    check_injected_fault(
        folder,
        ("cell/scanner.toml", "[camera]", "# calibrated again\n[camera]"),
        [
            "calibration of the scanner",
            "calibration files other than the present ones",
            "calibrate verify --camera scanner",
        ],
    );
    check_injected_fault(
        folder,
        ("cell/cell.toml", "[scanner]\nkind = \"simulated\"", "[scanner]\nkind = \"recorded\"\nfolder = \"none\""),
        ["scanner", "none", "folder of a recording"],
    );
    let file = folder.join("cell/cell.toml");
    let text = fs::read_to_string(&file).expect("there");
    fs::write(&file, format!("colour = 3\n{text}")).expect("written");
    let found = reported_problems(folder, DOCTOR);
    assert!(found.len() == 2 && found[0][1].contains("colour") && found[1][1].contains("not checked"), "{found:?}");
    fs::write(&file, &text).expect("written");

    // A value that a cycle would refuse is reported with the same message as by the cycle.
    check_injected_fault(
        folder,
        ("cell/cell.toml", "a1_deg = -120.0", "a1_deg = -320.0"),
        ["cell file", "poses.park.a1_deg: found -320, but the limits of the arm's axis 1 are -170 to 170", "cycle"],
    );
    // The scan in the store is no longer the scan that was taught.
    let taught = Store::open(&folder.join("cell/store")).expect("a store").taught("simulated-panel", None);
    let hash = panelprep::files::content_hash(&taught.expect("taught").teaching.scan);
    let scan = folder.join("cell/store/blobs").join(hash);
    let bytes = fs::read(&scan).expect("there");
    let mut spoilt = bytes.clone();
    *spoilt.last_mut().expect("bytes") ^= 1;
    fs::write(&scan, spoilt).expect("written");
    expect_one_problem(folder, DOCTOR, ["taught panel simulated-panel", "", "teach the panel again"]);
    fs::write(&scan, bytes).expect("written");
    assert_eq!(reported_problems(folder, DOCTOR), Vec::<[String; 3]>::new());

    // The store and the clock.
    let store = folder.join("cell/store");
    let database = fs::File::options().append(true).open(store.join("panelprep.sqlite")).expect("the database");
    let written = database.metadata().expect("known").modified().expect("known");
    database.set_modified(SystemTime::now() + Duration::from_secs(7_200)).expect("set");
    expect_one_problem(folder, DOCTOR, ["clock", "2.0 h ahead", "timedatectl"]);
    database.set_modified(written).expect("set back");
    let last =
        Store::open(&store).expect("a store").newest_verification("scanner").expect("read").expect("verified");
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970").as_secs() as i64;
    Store::store_verification_in(&store, &Verification { at_unix_s: now - 48 * 3_600, ..last }).expect("kept");
    expect_one_problem(
        folder,
        DOCTOR,
        ["calibration of the scanner", "48.0 h ago", "calibrate verify --camera scanner"],
    );
    assert_eq!(json(folder, VERIFY[0]).0, 0);
    fs::rename(store.join("panelprep.sqlite"), folder.join("away.db")).expect("moved");
    fs::write(store.join("panelprep.sqlite"), vec![7; 5_000]).expect("spoilt");
    assert!(reported_problems(folder, DOCTOR)[0][1].contains("cannot open the store"));
}

/// Tests controllers behind two sockets that are absent, silent, send wrong data, or are correct, and checks the files
/// of a controller.
#[test]
fn absent_silent_wrong_and_right_controllers_are_distinguished() {
    let folder = rendered("clean");
    let folder = folder.path();
    assert_eq!(json(folder, TEACH).0, 0);
    VERIFY.iter().for_each(|command| assert_eq!(json(folder, command).0, 0));
    over_sockets(folder, PORTS);
    controller_files(folder);
    let with_files = format!("{DOCTOR} --kuka .");
    expect_one_problem(folder, &with_files, ["robot", "refuses", "submit interpreter"]);
    // No acceptance test is signed: the row states this and the next step. If the cell's file names a signed stage, the
    // row states that the store has no page of this stage.
    let proofs = |words: &str| {
        let (_, told) = json(folder, &with_files);
        let checks = told["checks"].as_array().expect("checks");
        let row = checks.iter().find(|check| check["name"] == "proofs").expect("a row");
        let (found, advice) =
            (row["found"].as_str().unwrap_or_default(), row["advice"].as_str().unwrap_or_default());
        assert!(row["ok"] == false && found.contains(words) && advice.contains("test stage A"), "{row}");
    };
    proofs("signed_stage is missing; permitted: no motion in automatic mode");
    let file = folder.join("cell/cell.toml");
    let text = fs::read_to_string(&file).expect("there");
    fs::write(&file, text.replacen("kind = \"eki\"", "kind = \"eki\"\nsigned_stage = \"C\"", 1)).expect("written");
    proofs("signed_stage is C, but the store contains no readable signed page of the acceptance tests");
    fs::write(&file, text).expect("written");
    let robot = |words: &str| {
        let found = reported_problems(folder, &with_files);
        assert!(found.len() == 1 && found[0][0] == "robot" && found[0][1].contains(words), "{words}: {found:?}");
    };
    {
        let _silent = PORTS.map(|port| TcpListener::bind(("127.0.0.1", port)).expect("a free port"));
        robot("no message was received");
    }
    {
        let web = PORTS.map(|port| TcpListener::bind(("127.0.0.1", port)).expect("a free port"));
        let [_, state] = web;
        state.set_nonblocking(true).expect("set");
        let done = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !done.load(std::sync::atomic::Ordering::Relaxed) {
                    if let Ok((mut stream, _)) = state.accept() {
                        let _ = stream.write_all(b"<html>400 Bad Request</html>");
                        std::thread::sleep(Duration::from_millis(200));
                    }
                    std::thread::sleep(Duration::from_millis(5));
                }
            });
            let found = reported_problems(folder, &with_files);
            done.store(true, std::sync::atomic::Ordering::Relaxed);
            assert!(
                found.len() == 1 && found[0][0] == "robot" && found[0][2].contains("not this cell's"),
                "{found:?}"
            );
        });
    }
    // A mock controller is reported as a mock: its answers prove nothing about the real controller.
    let _mock = Mock::start(folder, PORTS);
    expect_one_problem(folder, &with_files, ["robot", "MOCK", "rehearsal"]);
    let names: Vec<String> = reported_problems(folder, DOCTOR).into_iter().map(|[name, ..]| name).collect();
    assert_eq!(names, ["controller files", "robot"]);
    // Text in the encodings of pendants: in GBK, this comment is the word for commands.
    let channel = fs::read(folder.join("CELLCMD.xml")).expect("there");
    let comment = b"<!-- \xC3\xFC\xC1\xEE -->";
    fs::write(folder.join("CELLCMD.xml"), [&channel[..], comment].concat()).expect("written");
    robot("MOCK");
    for (file, from, to, words) in [
        ("CELLSTAT.xml", "<PORT>54613<", "<PORT>54610<", ["CELLSTAT.xml", "is 54610", "both agree"]),
        ("CELLSTAT.xml", "Tag=\"St/@Done\"", "Tag=\"St/@Made\"", ["CELLSTAT.xml", "St/@Made", "both agree"]),
        ("CELLSTAT.xml", "<PORT>", "<PORT>x", ["CELLSTAT.xml", "line", "both agree"]),
        (
            "cell_config.dat",
            "CELL_OFF[4]=5",
            "CELL_OFF[4]=6",
            ["cell_config.dat", "NO STOP SWITCHES TOOL OFF", "both"],
        ),
        (
            "cell_judge.src",
            "IF CMD.ID<>CELL_RX+1 THEN",
            "IF FALSE THEN",
            ["programs", "CELL_PROGRAM_SUM", "one release"],
        ),
        (
            "cell_config.dat",
            "CELL_RETRACT_ACC=2.0",
            "CELL_RETRACT_ACC=3.0",
            ["programs", "accepted with", "programs_sum"],
        ),
        ("cell_user.src", "WAIT SEC 0.1", "WAIT SEC 0.2", ["cell_config.dat", "CELL_USER_REVISION", "both agree"]),
    ] {
        let file = folder.join(file);
        let text = fs::read_to_string(&file).expect("there");
        assert!(text.contains(from), "{from}");
        fs::write(&file, text.replacen(from, to, 1)).expect("written");
        let found = reported_problems(folder, &with_files);
        let is_named = |found: &[String; 3]| found.iter().zip(words).all(|(text, word)| text.contains(word));
        assert!(found.iter().any(is_named), "{words:?}: {found:?}");
        fs::write(&file, text).expect("written");
    }
}

/// Writes the controller's files as a person would edit them for this cell, beside the cell's folder, and their
/// checksum to the cell's file.
fn controller_files(folder: &Path) {
    let config = include_str!("../config/kuka/cell_config.dat");
    let numbers = (1..=5).flat_map(|place| {
        ["CELL_OUT", "CELL_IN"]
            .map(|list| (format!("{list}[{place}]={}", 16 + place), format!("{list}[{place}]={place}")))
    });
    let off = [
        ("CELL_OFF[1]=17", "CELL_OFF[1]=1"),
        ("CELL_OFF[2]=18", "CELL_OFF[2]=2"),
        ("CELL_OFF[3]=20", "CELL_OFF[3]=4"),
    ];
    let others = [
        ("CELL_OFF[4]=21", "CELL_OFF[4]=5"),
        ("CELL_BOX_MIN[1]=240.0", "CELL_BOX_MIN[1]=90.0"),
        ("CELL_BOX_MAX[1]=760.0", "CELL_BOX_MAX[1]=710.0"),
    ];
    let words = off.into_iter().chain(others).map(|(from, to)| (from.to_owned(), to.to_owned()));
    let config = numbers.chain(words).fold(config.to_owned(), |text, (from, to)| {
        assert!(text.contains(&from), "{from}");
        text.replace(&from, &to)
    });
    let files = [
        ("cell_config.dat", config.as_str()),
        ("cell_data.dat", include_str!("../config/kuka/cell_data.dat")),
        ("cell_judge.src", include_str!("../config/kuka/cell_judge.src")),
        ("cell_link.src", include_str!("../config/kuka/cell_link.src")),
        ("cell_motion.src", include_str!("../config/kuka/cell_motion.src")),
        ("cell_submit.src", include_str!("../config/kuka/cell_submit.src")),
        ("cell_tell.src", include_str!("../config/kuka/cell_tell.src")),
        ("cell_user.src", include_str!("../config/kuka/cell_user.src")),
    ];
    fs::write(folder.join("sps.sub"), include_str!("../fixtures/krl/sps.sub")).expect("written");
    for (name, text) in files {
        fs::write(folder.join(name), text).expect("written");
    }
    for name in ["CELLCMD.xml", "CELLSTAT.xml"] {
        let text = fs::read_to_string(folder.join(name)).expect("there");
        fs::write(folder.join(name), text.replace("<IP>172.31.1.147</IP>", "<IP>127.0.0.1</IP>")).expect("written");
    }
    let sum = panelprep::controller::program_sum(&files).expect("the shipped programs");
    let cell = folder.join("cell/cell.toml");
    let text = fs::read_to_string(&cell).expect("there");
    assert!(text.contains("kind = \"eki\""));
    let kept = format!("kind = \"eki\"\nprograms_sum = {sum}");
    fs::write(&cell, text.replacen("kind = \"eki\"", &kept, 1)).expect("written");
}
