//! Tests the Zivid camera with real worker processes and an emulated camera: the effect of each fault of the camera and
//! of the process.

mod kills;
mod service;
pub mod stub;

use panelprep::daemon::{CameraPort, Cameras};
use panelprep::devices::cameras::{Conditions, RecordedFlangeCamera, Scanner};
use panelprep::devices::zivid::{
    CameraSetup, Flicker, Restarts, Source, WarmUpState, WorkerLauncher, ZividFault, ZividScanner, command_launcher,
};
use panelprep::geometry::PinholeCamera;
use rand::SeedableRng;
use std::path::Path;
use std::time::{Duration, Instant};

const SMALL: [usize; 2] = [162, 100];
const TIMEOUT: Duration = Duration::from_secs(60);

fn ready(
    lines: &str,
    patience: impl Fn(&mut panelprep::devices::zivid::CameraSetup),
) -> (tempfile::TempDir, ZividScanner) {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut setup, launch) = stub::camera(folder.path(), SMALL, lines);
    patience(&mut setup);
    let scanner = ZividScanner::start(setup, launch).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("ready");
    (folder, scanner)
}

/// Each fault is injected at the camera's second exposure, which is the first after the warm-up exposure.
#[test]
fn each_injected_fault_of_the_camera_is_named() {
    let cases = [
        (
            "hang",
            "C3 the 3D camera did not respond within 0.5 s to a 3D shot, and its worker was ended; the program \
             restarts the worker, restart 1 of 3",
        ),
        ("crash", "C11 the 3D camera's worker ended (signal: 6 (SIGABRT)"),
        ("gone", "C2 the 3D camera was lost during a 3D shot: the camera does not answer"),
        ("missing", "C6 no 3D data: 0.00 % of the shot's pixels have a point"),
        ("infinite", "C4 the scan was discarded, because 1 points have an infinite coordinate"),
        ("half", "C5 a 3D shot: 81×50 px, but the camera's calibration is for 162×100"),
    ];
    for (fault, words) in cases {
        let (_folder, mut scanner) =
            ready(&format!("fault 2 {fault}\n"), |setup| setup.timeouts.scan = Duration::from_millis(500));
        let message = scanner.take_scan().expect_err(fault).to_string();
        assert!(message.starts_with(words), "{fault}: {message}");
        let since = Instant::now();
        // A restarted worker process counts its exposures from one, so its second exposure fails again.
        while !["hang", "crash"].contains(&fault) && scanner.take_scan().is_err() {
            assert!(since.elapsed() < TIMEOUT, "{fault}: {:?}", scanner.history());
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    let (_folder, mut scanner) = ready("fault 2 throw\nfault 3 throw\nfault 5 throttled\n", |_| ());
    scanner.take_scan().expect("the third try");
    let message = scanner.take_picture().expect_err("hot").to_string();
    assert!(message.starts_with("C3 the 3D camera is hot and paused for 2500 ms during a picture"), "{message}");
}

/// Returns an emulated camera on the network, described by these lines, and the launcher of its worker processes.
fn on_the_network(folder: &Path, [width, height]: [usize; 2], lines: &str) -> (CameraSetup, WorkerLauncher) {
    let (setup, _) = stub::camera(folder, [width, height], lines);
    let named = format!("PANELPREP_ZIVID_STUB={}", folder.join("camera.zfc").display());
    let program = env!("CARGO_BIN_EXE_panelprep");
    let arguments =
        [named.into(), program.into(), "zivid-worker".into(), "--library".into(), stub::library().into()];
    (CameraSetup { source: Source::Only, ..setup }, command_launcher("/usr/bin/env".into(), arguments.into()))
}

/// The message about a camera that is connected and cannot be opened does not ask for its cable.
#[test]
fn a_connected_camera_that_cannot_be_opened_states_why() {
    let cases = [
        (
            "firmwareUpdateRequired",
            "C5 the 3D camera needs other firmware: camera STUB0001 has firmware 2.17.0+played",
        ),
        ("busy", "C1 the 3D camera is in use: camera STUB0001 is connected to another program or computer"),
        ("inaccessible", "C1 the 3D camera cannot be reached: camera STUB0001 was detected on the network"),
    ];
    for (status, words) in cases {
        let folder = tempfile::tempdir().expect("a folder");
        let (setup, launch) = on_the_network(folder.path(), SMALL, &format!("status {status}\n"));
        let scanner = ZividScanner::start(setup, launch).expect("a thread");
        let message = scanner.wait_ready(TIMEOUT).expect_err(status).to_string();
        assert!(
            message.starts_with(words) && message.contains("Message of the SDK: the camera cannot be connected"),
            "{message}"
        );
        assert!(!message.contains("cable"), "{message}");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (setup, launch) = on_the_network(folder.path(), SMALL, "");
    let mut scanner = ZividScanner::start(setup, launch).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("this one opens");
    scanner.take_scan().expect("and delivers");
}

/// Expected temperature, calculated by hand: 30 °C at the first exposure, which is the warm-up, and half a degree more
/// at each later one. The samples expose for 10 ms in 3D and 20 ms for the film.
#[test]
fn each_shot_states_its_own_temperature_and_exposure() {
    let (_folder, mut scanner) = ready("lens 30\nwarms 0.5\nfault 4 throttled\nlight grid50hz 100\n", |_| ());
    assert_eq!(scanner.conditions(), Conditions::default(), "no shot yet that anybody asked for");
    scanner.take_scan().expect("a shot");
    let told = |exposure_us, camera_c, throttled_ms| Conditions {
        exposure_us: Some(exposure_us),
        camera_c: Some(camera_c),
        throttled_ms: Some(throttled_ms),
    };
    assert_eq!(scanner.conditions(), told(10_000.0, 30.5, 0.0));
    scanner.take_picture().expect("a picture");
    assert_eq!(scanner.conditions(), told(20_000.0, 31.0, 0.0));
    scanner.take_scan().expect("a scene that stands bears a pause");
    assert_eq!(scanner.conditions(), told(10_000.0, 31.5, 2_500.0));
    assert!(matches!(scanner.temperature_state(), WarmUpState::NoReadings { followed_s } if followed_s < 600.0));
    let light = scanner.measure_ambient_light().expect("a look at the light");
    assert_eq!((light.flicker, light.frequency.as_str()), (Flicker::Grid50Hz, "100"));
}

/// The pictures of a film have the times of the camera's clock. After a pause, the reader receives the newest three
/// pictures, after a gap as long as the pause.
#[test]
fn a_film_that_is_not_read_has_a_gap() {
    let (folder, scanner) = ready("", |_| ());
    let flange = RecordedFlangeCamera::open(folder.path(), lens()).expect("it has no pictures");
    let mut eyes = Cameras { scanner, flange };
    let dry_s = eyes.picture().expect("a picture").time_s;
    eyes.begin_film(50.0).expect("begun");
    let mut next = || eyes.next_film_picture().expect("it continues").expect("it is waited for").time_s;
    let before: Vec<f64> = (0..5).map(|_| next()).collect();
    assert!(before[0] > dry_s && before.is_sorted_by(|a, b| a < b), "{dry_s} {before:?}");
    std::thread::sleep(Duration::from_millis(500));
    let after: Vec<f64> = (0..3).map(|_| next()).collect();
    // Three pictures were waiting; the last of them was captured just before this.
    assert!(after[0] - before[4] > 0.2 && after.is_sorted_by(|a, b| a < b), "{before:?} {after:?}");
    assert!(eyes.end_film().expect("ended") >= 3, "of twenty-five in that time; a busy machine takes fewer");
}

fn lens() -> PinholeCamera {
    let (k1, k2, p1, p2, k3) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let [width_px, height_px] = SMALL;
    PinholeCamera { width_px, height_px, fx_px: 150.0, fy_px: 150.0, cx_px: 80.5, cy_px: 49.5, k1, k2, p1, p2, k3 }
}

/// The camera crashes at each first shot: after three restarts it is not restarted any more and reports this, also
/// after a reset by a person.
#[test]
fn a_camera_that_crashes_each_time_stays_down() {
    let folder = tempfile::tempdir().expect("a folder");
    let (setup, launch) = stub::camera(folder.path(), SMALL, "fault 1 crash\n");
    let mut scanner = ZividScanner::start(setup, launch).expect("a thread");
    let down = scanner.wait_ready(TIMEOUT).expect_err("down");
    assert!(matches!(down, ZividFault::Down { ended: 4, allowed: 3, .. }), "{down}");
    assert!(down.to_string().contains("Last: C11 the 3D camera's worker ended (signal: 6 (SIGABRT)"), "{down}");
    assert!(matches!(scanner.temperatures(), Err(ZividFault::Down { .. })));
    assert_eq!((scanner.history().1, scanner.history().2), (4, None));
}

#[test]
fn a_worker_without_its_library_states_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let (setup, _) = stub::camera(folder.path(), SMALL, "");
    let arguments = ["zivid-worker".into(), "--library".into(), folder.path().join("none.so").into()];
    let launch =
        panelprep::devices::zivid::command_launcher(env!("CARGO_BIN_EXE_panelprep").into(), arguments.into());
    let scanner = ZividScanner::start(setup, launch).expect("a thread");
    let told = scanner.wait_ready(TIMEOUT).expect_err("none").to_string();
    assert!(told.starts_with("C1 the 3D camera's worker cannot run: ") && told.contains("`make zivid`"), "{told}");
}

/// Runs five of the two hundred kills of `make bench-worker`, at full size, so that half of them occur during a
/// transfer or a capture.
#[test]
fn five_kills_are_five_named_faults() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut setup, launch) = stub::camera(folder.path(), [1944, 1200], "");
    setup.restarts = Restarts { max_restarts: 1_000, ..Restarts::default() };
    let scanner = ZividScanner::start(setup, launch).expect("a thread");
    let killed = kills::kill_repeatedly(scanner, 5, &mut rand_pcg::Pcg64::seed_from_u64(9));
    assert_eq!(killed.named.values().sum::<usize>(), 5, "{killed:?}");
    assert!(killed.delivered >= 1, "{killed:?}");
}

/// A person cannot start the worker process, because its standard input is then not a socket.
#[test]
fn the_worker_cannot_be_started_by_hand() {
    let ran = std::process::Command::new(env!("CARGO_BIN_EXE_panelprep"))
        .args(["zivid-worker", "--library", "x.so"])
        .stdin(std::process::Stdio::null())
        .output()
        .expect("it starts");
    assert!(!ran.status.success());
    let words = String::from_utf8_lossy(&ran.stderr);
    assert!(words.contains("only the panelprep service may start this command"), "{words}");
    let help = std::process::Command::new(env!("CARGO_BIN_EXE_panelprep")).arg("--help").output().expect("help");
    assert!(!String::from_utf8_lossy(&help.stdout).contains("zivid-worker"));
}
