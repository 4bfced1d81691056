//! Tests the daemon's side with correct and faulty workers. The workers are threads instead of processes, so that each
//! byte in transit can be delayed, changed or dropped.

mod built;
mod hostile;
mod library;
mod played;

use self::played::{Plan, SIZE, played, setup};
use super::*;
use std::time::{Duration, Instant};

const TIMEOUT: Duration = Duration::from_secs(60);

/// Creates a camera that behaves according to this plan, and waits until it is ready.
fn ready(plan: Plan) -> ZividScanner {
    let scanner = ZividScanner::start(setup(), played(plan)).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("ready");
    scanner
}

/// Waits until the camera delivers scans again without a request for a restart.
fn delivers_again(scanner: &mut ZividScanner) {
    let since = Instant::now();
    while scanner.take_scan().is_err() {
        assert!(since.elapsed() < TIMEOUT, "{:?}", scanner.history());
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_good_camera_answers_all_requests() {
    let mut scanner = ready(Plan::default());
    let shot = scanner.take_scan().expect("a shot");
    assert_eq!((shot.cloud.width(), shot.cloud.height(), shot.snr.len()), (SIZE.width, SIZE.height, 48));
    assert_eq!(shot.cloud.point(0, 0), None, "the first pixel sees nothing");
    let point = shot.cloud.point(1, 0).expect("there").mm;
    assert_eq!((point.x, point.y, point.z), (1.0, 2.0, 702.0), "shot 2; the first one was to warm up");
    assert_eq!((shot.cloud.color_at(3), shot.metadata.number), ([3, 2, 1], 2));
    assert_eq!(shot.metadata.settings, super::worker::settings_hash(&setup().scan_yaml));
    assert!(shot.crossed_ms < 1_000.0, "{}", shot.crossed_ms);

    let photo = scanner.take_picture().expect("a picture");
    assert_eq!((photo.picture.rgb[5], photo.metadata.number), ([5, 3, 0], 3));
    assert_eq!(scanner.intrinsics().expect("a lens").matrix_px, [2.0, 2.0, 4.0, 3.0]);
    assert_eq!(scanner.temperatures().expect("well").lens_c, Some(36.0));
    assert_eq!(scanner.history().0, [], "nothing went wrong");
}

/// The times of a clip are real and increase. If the reader sleeps, the oldest pictures are dropped, and their number
/// is reported.
#[test]
fn a_clip_has_true_times_and_drops_the_oldest() {
    let mut scanner = ready(Plan::default());
    scanner.begin_clip(200.0).expect("begun");
    let mut last_ns = 0;
    for _ in 0..5 {
        let taken = scanner.next_clip_picture().expect("a picture").metadata;
        assert!(taken.begun_ns > last_ns && taken.begun_ns <= taken.exposed_ns, "{taken:?}");
        last_ns = taken.begun_ns;
    }
    std::thread::sleep(Duration::from_millis(150));
    let late = scanner.next_clip_picture().expect("a picture").metadata;
    // 30 pictures were due, and three are in the queue. A busy computer captures fewer, so the limit is low.
    assert!(late.dropped >= 3, "{late:?}");
    let end = scanner.end_clip().expect("over");
    assert!(end.taken >= end.dropped + 6 && end.dropped >= late.dropped, "{end:?}");
    let none = scanner.next_clip_picture().expect_err("no clip").to_string();
    assert_eq!(none, "C11 the 3D camera's worker refused a picture of a clip: no clip is being recorded");
    scanner.begin_clip(200.0).expect("begun");
    scanner.take_scan().expect("a shot ends the clip");
    assert!(scanner.next_clip_picture().is_err());
    assert!(scanner.begin_clip(0.0).is_err() && scanner.begin_clip(f64::NAN).is_err());
}

/// Each case is the behaviour of the sensor at its n-th exposure, and the expected message.
#[test]
fn each_trouble_of_the_camera_has_its_message() {
    let cases: [(Plan, &str); 8] = [
        (Plan { missing: vec![2], ..Plan::default() }, "C6 no 3D data: 0.00 % of the shot's pixels"),
        (
            Plan { infinite: vec![2], ..Plan::default() },
            "C4 the scan was discarded, because 1 points have an infinite coordinate",
        ),
        (
            Plan { half: vec![2], ..Plan::default() },
            "C5 a 3D shot: 4×3 px, but the camera's calibration is for 8×6",
        ),
        (Plan { old: vec![2, 3], ..Plan::default() }, "C9 the 3D camera delivered old data: a shot started at"),
        (
            Plan { frozen: vec![3, 4], ..Plan::default() },
            "C9 the 3D camera delivered old data: shot 4 has exactly the same data as the previous shot",
        ),
        (Plan { gone: vec![2], ..Plan::default() }, "C2 the 3D camera was lost during a 3D shot: unplugged"),
        (
            Plan { no_shot: vec![2, 3, 4], ..Plan::default() },
            "C3 the 3D camera delivered nothing for a 3D shot in 3 attempts: no exposure",
        ),
        (
            Plan { panics: vec![2], ..Plan::default() },
            "C11 the 3D camera's worker ended (it hung up) during a 3D shot",
        ),
    ];
    for (plan, words) in cases {
        let frozen = !plan.frozen.is_empty();
        let mut scanner = ready(plan);
        if frozen {
            scanner.take_scan().expect("the one that is repeated");
        }
        let fault = scanner.take_scan().expect_err(words);
        assert!(fault.to_string().starts_with(words), "{fault}");
        assert!(fault.to_string().starts_with(fault.row()), "{fault}");
        delivers_again(&mut scanner);
        assert_eq!(scanner.history().0, [fault], "told once");
    }
}

#[test]
fn a_shot_that_fails_sometimes_is_requested_again() {
    let mut scanner = ready(Plan { no_shot: vec![2, 3], frozen: vec![5], ..Plan::default() });
    assert_eq!(scanner.take_scan().expect("the third try").metadata.number, 2, "shots that were none do not count");
    scanner.take_scan().expect("one that came twice is thrown away");
    assert_eq!(scanner.history().0, []);
}

/// A clip of the film with a pause cannot be used; a 3D scan of a static scene tolerates the pause.
#[test]
fn a_pause_to_cool_invalidates_a_film_but_not_a_shot() {
    let mut scanner = ready(Plan { hot: vec![2, 3], ..Plan::default() });
    assert!((scanner.take_scan().expect("stands").metadata.throttled_ms - 900.0).abs() < 1e-9);
    let fault = scanner.take_picture().expect_err("too late").to_string();
    let words =
        "C3 the 3D camera is hot and paused for 900 ms during a picture (limit 500 ms), lens temperature 36 °C";
    assert!(fault.starts_with(words), "{fault}");
}

/// A text that was changed in transit does not match the hash that was sent with it.
#[test]
fn settings_with_a_wrong_hash_are_refused() {
    let (stream, _peer) = played(Plan::default())().expect("a worker");
    let mut link = process::Link::new(stream, std::sync::Arc::default());
    link.receive_hello(TIMEOUT).expect("its first words");
    let hash = worker::settings_hash("scan, before");
    let (usage, yaml, expected) = (message::Use::Scan, "scan".to_owned(), format!("expected {hash}"));
    let answer =
        link.send_and_receive(&message::Request::Settings { usage, yaml, hash }, TIMEOUT).expect("an answer");
    let process::Answer::Words(message::Reply::Refused(refusal)) = answer else { panic!("{answer:?}") };
    assert!(refusal.message.contains(&expected), "{refusal:?}");
}

/// If the lamp is off, two black pictures are equal. The evaluation of the pictures reports this; it is not a frozen
/// camera.
#[test]
fn two_black_pictures_are_not_a_frozen_camera() {
    let mut scanner = ready(Plan { dark: vec![2, 3], ..Plan::default() });
    for _ in 0..2 {
        assert!(scanner.take_picture().expect("dark").picture.rgb.iter().all(|pixel| *pixel == [0; 3]));
    }
    assert_eq!(scanner.history().0, []);
}

/// A person's reset starts a search for an absent camera immediately, even if the next search is due only much later.
#[test]
fn a_check_searches_for_an_absent_camera() {
    let mut setup = setup();
    setup.timeouts.search = Duration::from_secs(3_600);
    let mut scanner =
        ZividScanner::start(setup, played(Plan { absent_for: 1, ..Plan::default() })).expect("a thread");
    assert!(scanner.wait_ready(TIMEOUT).is_err(), "absent");
    scanner.temperatures().expect("it is there by now");
    scanner.take_scan().expect("and delivers");
}

#[test]
fn an_absent_camera_is_reported_once_and_found_automatically() {
    let plan = Plan { absent_for: 3, ..Plan::default() };
    let mut scanner = ZividScanner::start(setup(), played(plan)).expect("a thread");
    let fault = scanner.wait_ready(TIMEOUT).expect_err("absent");
    assert!(
        fault.to_string().starts_with("C1 the 3D camera is not found: no such camera; check its power"),
        "{fault}"
    );
    delivers_again(&mut scanner);
    assert_eq!((scanner.history().0, scanner.history().1), (vec![fault], 0), "and no worker was lost");
}

#[test]
fn another_camera_or_other_settings_are_refused_before_a_shot() {
    let told = |setup: CameraSetup| {
        let scanner = ZividScanner::start(setup, played(Plan::default())).expect("a thread");
        scanner.wait_ready(TIMEOUT).expect_err("refused").to_string()
    };
    let other = told(CameraSetup { serial: Some("77".to_owned()), ..setup() });
    let words = "C5 found the 3D camera with serial STUB1, but the calibration is for serial 77; ";
    assert!(other.starts_with(words), "{other}");
    let other = told(CameraSetup { source: Source::Serial("STUB2".to_owned()), ..setup() });
    assert!(
        other.starts_with("C5 found the 3D camera with serial STUB1, but the calibration is for serial STUB2"),
        "{other}"
    );
    let size = told(CameraSetup { size: Size { width: 16, height: 12 }, ..setup() });
    let words = "C5 the settings for 3D shots: 8×6 px, but the camera's calibration is for 16×12";
    assert!(size.starts_with(words), "{size}");
    let settings = told(CameraSetup { picture_yaml: "nonsense".to_owned(), ..setup() });
    assert_eq!(
        settings,
        "C5 the settings for pictures are not accepted: these are no settings; correct them with Zivid Studio"
    );
}
