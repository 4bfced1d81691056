//! Tests the C++ library with the SDK stub. It is opened as the worker opens it, but in a thread. The list of the SDK's
//! calls, `cpp/CALLS.md`, is compared with the declarations and with the source that makes the calls.

use super::super::library::{LibraryError, Sdk};
use super::super::message::Source;
use super::super::*;
use super::TIMEOUT;
use super::built::{PICTURE, SCAN, library};
use super::played::in_thread;
use crate::cameras::{Scanner, conform};
use panelprep_base::geometry::PinholeCamera;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Writes a camera file with these lines, and returns the camera that is simulated from it.
fn file_camera(folder: &Path, lines: &str) -> (CameraSetup, WorkerLauncher) {
    let file = folder.join("camera.zfc");
    std::fs::write(&file, lines).expect("written");
    let setup = CameraSetup {
        source: Source::File(file),
        size: Size { width: 162, height: 100 },
        scan_yaml: SCAN.to_owned(),
        picture_yaml: PICTURE.to_owned(),
        ..super::played::setup()
    };
    // The library is built here, so that no worker has to wait for the build.
    let library = library();
    let launch = in_thread(move |stream| {
        let sdk = Sdk::open(library).expect("the library");
        worker::serve(stream, Box::new(sdk)).expect("served");
    });
    (setup, launch)
}

/// The lens of the simulated camera, as defined at the top of `play.cpp`: f = 1785 · 162 / 1944.
fn lens() -> PinholeCamera {
    let f_px = 1785.0 * 162.0 / 1944.0;
    let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let (width_px, height_px, cx_px, cy_px) = (162, 100, 80.5, 49.5);
    PinholeCamera { width_px, height_px, fx_px: f_px, fy_px: f_px, cx_px, cy_px, k1, k2, p1, p2, k3 }
}

#[test]
fn the_camera_behind_the_sdk_passes_the_tests_of_all_scanners() {
    let folder = tempfile::tempdir().expect("a folder");
    let (setup, launch) = file_camera(folder.path(), "width 162\nheight 100\nserial 2127A0F3\nlens 35.5\n");
    let mut scanner = ZividScanner::start(setup, launch).expect("a thread");
    conform::check_shot(&mut scanner, &lens());
    conform::check_pictures(&mut scanner, &lens());
    scanner.capture_3d().expect("a shot after pictures");
    let found = scanner.intrinsics().expect("a lens");
    assert_eq!(found.matrix_px, [lens().fx_px, lens().fy_px, 80.5, 49.5]);
    assert_eq!(found.distortion, [-0.08, 0.1, 0.0002, -0.0001, -0.02], "k1, k2, p1, p2, k3");
    let state = scanner.temperatures().expect("well");
    assert_eq!((state.lens_c, state.led_c), (Some(35.5), Some(47.5)));
    let taken = scanner.take_scan().expect("a shot").metadata;
    assert_eq!((taken.serial.as_str(), taken.lens_c), ("2127A0F3", Some(35.5)));
    assert_eq!(scanner.history().0, []);
    // This check also makes requests that must be refused.
    conform::check_clips(&mut scanner, &lens(), || ());
}

/// Expected values, calculated by hand, for pixel (81, 50) of 162×100: z = 700 + 25 sin 3 + 15 · 50/162 = 708.158, plus
/// up to 0.05; x = 0.5 z / f.
#[test]
fn numbers_pass_the_interface_unchanged() {
    let folder = tempfile::tempdir().expect("a folder");
    let (setup, launch) = file_camera(folder.path(), "width 162\nheight 100\n");
    let mut scanner = ZividScanner::start(setup, launch).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("ready");
    let shot = scanner.take_scan().expect("a shot");
    let point = shot.cloud.point(81, 50).expect("there").mm;
    assert!((708.157..708.209).contains(&point.z), "{point}");
    assert!((point.x - 0.5 * point.z / 148.75).abs() < 1e-3 && (point.y - point.x).abs() < 1e-6, "{point}");
    assert_eq!(shot.cloud.point(7, 50), None, "in the shadow: the leftmost twentieth, 8 columns");
    assert!(shot.cloud.point(8, 50).is_some());
    let [red, green, blue] = shot.cloud.color_at(50 * 162 + 81);
    assert!(
        (100..=103).contains(&red) && (100..=103).contains(&green) && (60..=63).contains(&blue),
        "40+60, 50+50, 60"
    );
    assert_eq!((shot.snr[0], shot.snr[8]), (10.0, 11.0));
}

#[test]
fn settings_that_the_sdk_refuses_are_reported_in_its_words() {
    let folder = tempfile::tempdir().expect("a folder");
    let reported = |change: &dyn Fn(&mut CameraSetup)| {
        let (mut setup, launch) = file_camera(folder.path(), "width 162\nheight 100\n");
        change(&mut setup);
        ZividScanner::start(setup, launch).expect("a thread").wait_ready(TIMEOUT).expect_err("refused").to_string()
    };
    let swapped = reported(&|setup| setup.scan_yaml = PICTURE.to_owned());
    assert_eq!(
        swapped,
        "C5 the settings for 3D shots are not accepted: this is no Settings file; correct them with Zivid Studio"
    );
    let empty =
        reported(&|setup| setup.picture_yaml = "__version__: {}\nSettings2D:\n  Acquisitions: []\n".to_owned());
    assert!(empty.starts_with("C5 the settings for pictures are not accepted"), "{empty}");
    let colorless =
        reported(&|setup| setup.scan_yaml = "__version__: {}\nSettings:\n  Acquisitions: [x]\n".to_owned());
    assert!(
        colorless.ends_with(
            "these settings have no Color part: a 3D shot is taken with its colours; correct them with Zivid Studio"
        ),
        "{colorless}"
    );
    let halved =
        reported(&|setup| setup.picture_yaml = format!("{PICTURE}  Sampling:\n    Pixel: blueSubsample2x2\n"));
    assert!(
        halved.starts_with("C5 the settings for pictures: 81×50 px, but the camera's calibration is for 162×100"),
        "{halved}"
    );
    let absent = reported(&|setup| setup.source = Source::Serial("2127A0F3".to_owned()));
    assert!(
        absent.starts_with("C1 the 3D camera is not found: no camera with serial number 2127A0F3 was found"),
        "{absent}"
    );
    let no_file = reported(&|setup| setup.source = Source::File("/nowhere.zfc".into()));
    assert!(
        no_file.starts_with("C1 the 3D camera is not found: there is no camera file /nowhere.zfc"),
        "{no_file}"
    );
}

#[test]
fn a_file_that_is_no_library_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let gone = Sdk::open(&folder.path().join("gone.so")).err().expect("none").to_string();
    assert!(gone.contains("build it with `make zivid` on a computer that has the Zivid SDK"), "{gone}");
    let source = folder.path().join("other.c");
    let built = |text: &str, name: &str| {
        std::fs::write(&source, text).expect("written");
        let file = folder.path().join(name);
        let made = Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&file, &source]).status().expect("cc");
        assert!(made.success());
        Sdk::open(&file).err().expect("refused")
    };
    let newer = built("unsigned pz_interface(void) { return 7; }", "newer.so");
    assert!(matches!(newer, LibraryError::Interface { found: 7, .. }), "{newer}");
    let other = built("int x;", "other.so");
    assert!(other.to_string().contains("pz_interface"), "{other}");
}

fn cpp() -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("src/devices/zivid/cpp")
}

fn text(file: &str) -> String {
    std::fs::read_to_string(cpp().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// Returns the public names in the namespace Zivid of a header: types, functions and constants.
fn declared(text: &str) -> BTreeSet<String> {
    let from = text.find("\nnamespace Zivid").unwrap_or_else(|| panic!("no such namespace"));
    let (mut found, mut is_private) = (BTreeSet::new(), false);
    for line in text[from..].lines().map(|line| line.split("//").next().unwrap_or_default()) {
        match line.trim() {
            "private:" => is_private = true,
            "public:" | "};" => is_private = false,
            _ if is_private => {}
            line => {
                let line = line.replace("std::move(", " ");
                let named = |before: &str| words(before).last().unwrap_or_default().to_owned();
                let ends: Vec<_> = line.match_indices('(').filter(|(at, _)| !line[..*at].ends_with('>')).collect();
                found.extend(ends.into_iter().map(|(at, _)| named(&line[..at])));
                for kind in ["class ", "struct ", "constexpr ValueType "] {
                    let rest = line.find(kind).map(|at| &line[at + kind.len()..]);
                    found.extend(rest.and_then(|rest| words(rest).next()).map(str::to_owned));
                }
            }
        }
    }
    found.retain(|name| {
        !name.is_empty() && name != "operator" && name.chars().next().is_some_and(char::is_alphabetic)
    });
    found
}

/// Returns the names in backquotes in the first column of the list.
fn listed() -> BTreeSet<String> {
    let list = text("CALLS.md");
    let rows: Vec<&str> = list.lines().filter(|line| line.starts_with("| `")).collect();
    assert!(rows.len() > 30, "{rows:?}");
    let first = |row: &&str| row[2..].split(" | ").next().unwrap_or_default().to_owned();
    let quoted = |column: &String| column.split('`').skip(1).step_by(2).collect::<Vec<_>>().join(" ");
    let calls: Vec<String> = rows.iter().map(first).map(|column| quoted(&column)).collect();
    calls.iter().flat_map(|call| words(call)).map(str::to_owned).collect()
}

/// The library is built with these declarations only, so it makes no other calls of the SDK. Each declaration must be
/// in the list.
#[test]
fn each_call_of_the_sdk_is_listed_and_each_listed_one_is_made() {
    let files =
        ["stub/Zivid/Zivid.h", "stub/Zivid/Experimental/SettingsInfo.h", "stub/Zivid/Experimental/Calibration.h"];
    let declared: BTreeSet<String> = files.iter().flat_map(|file| declared(&text(file))).collect();
    assert!(["capture2D3D", "isUpToDate", "inaccessible", "k3", "SNR"].iter().all(|name| declared.contains(*name)));
    let listed = listed();
    let unlisted: Vec<_> = declared.iter().filter(|name| !listed.contains(*name) && *name != "ValueType").collect();
    assert!(unlisted.is_empty(), "CALLS.md does not list {unlisted:?}");
    let adapter = text("panelprep_zivid.cpp");
    let made: BTreeSet<&str> = words(&adapter).collect();
    // Types are excluded, because the type of a returned value is not written at the call.
    let is_made = |name: &String| made.contains(name.as_str()) || name.starts_with(char::is_uppercase);
    let stale: Vec<_> = listed.iter().filter(|name| !is_made(name)).collect();
    assert!(stale.is_empty(), "CALLS.md lists {stale:?}, which nothing calls");
}

/// With an older SDK the build of the library fails, and the compiler reports the reason.
#[test]
fn the_build_with_an_older_sdk_fails_with_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let older = |major: u32, minor: u32| {
        let version = folder.path().join("Zivid/Version.h");
        std::fs::create_dir_all(folder.path().join("Zivid")).expect("made");
        let text = format!("#define ZIVID_CORE_VERSION_MAJOR {major}\n#define ZIVID_CORE_VERSION_MINOR {minor}\n");
        std::fs::write(version, text).expect("written");
        let includes =
            [folder.path().to_owned(), cpp().join("stub")].map(|folder| format!("-I{}", folder.display()));
        let mut compiler = Command::new("c++");
        let compiler = compiler.args(["-std=c++17", "-fsyntax-only"]).args(includes);
        let made = compiler.arg(cpp().join("panelprep_zivid.cpp")).output().expect("a compiler is here");
        (made.status.success(), String::from_utf8_lossy(&made.stderr).into_owned())
    };
    for (major, minor) in [(2, 16), (1, 20)] {
        let (is_built, says) = older(major, minor);
        assert!(!is_built && says.contains("Panelprep needs the Zivid SDK 2.17.0 or newer"), "{says}");
    }
    for (major, minor) in [(2, 17), (2, 18), (3, 0)] {
        let (is_built, says) = older(major, minor);
        assert!(is_built, "{says}");
    }
}
