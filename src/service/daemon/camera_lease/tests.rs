//! Tests the client and the service of the cameras over a real socket.

use super::super::protocol::read_request;
use super::super::request::RequestKind;
use super::super::tests::standing_state;
use super::*;
use crate::daemon::ports::{CameraPort as _, Cameras, LastState};
use panelprep_base::geometry::{Camera, ColorPicture, Joints, OrganizedCloud};
use panelprep_cell::cycle::{At, Phase, State};
use panelprep_devices::cameras::{
    CameraError, CameraRole, Conditions, FlangeCamera, FlangePicture, Picture, Scanner, Shot,
};
use panelprep_kuka::eki;
use std::io::{BufRead, BufReader};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

const CONDITIONS: Conditions =
    Conditions { exposure_us: Some(10_000.0), camera_c: Some(41.5), throttled_ms: Some(0.0) };

/// Number of calls of each function of the fake cameras.
#[derive(Default)]
struct Counts {
    pictures: AtomicU64,
    films_ended: AtomicU64,
}

struct FakeScanner(Arc<Counts>);

fn cloud() -> OrganizedCloud<Camera> {
    let points = vec![[1.5, -2.25, 700.0], [f32::NAN; 3], [0.1, 0.2, 0.3], [4.0, 5.0, 6.0]];
    OrganizedCloud::new(2, 2, points, vec![[10, 20, 30], [0; 3], [1, 2, 3], [255; 3]]).expect("counts agree")
}

impl Scanner for FakeScanner {
    fn capture_3d(&mut self) -> Result<Shot, CameraError> {
        Ok(Shot { cloud: cloud(), time_s: 7.25 })
    }

    fn capture_2d(&mut self) -> Result<Picture, CameraError> {
        Err(CameraError::Timeout { which: CameraRole::Scanner, waited_ms: 900 })
    }

    fn begin_clip(&mut self, pictures_per_second: f64) -> Result<f64, CameraError> {
        assert_eq!(pictures_per_second, 5.0);
        Ok(3.5)
    }

    fn next_clip_picture(&mut self) -> Result<Option<Picture>, CameraError> {
        let number = self.0.pictures.fetch_add(1, Ordering::Relaxed);
        // Only every second call returns a picture.
        let due = number % 2 == 1;
        let picture = ColorPicture::uniform(3, 2, [number as u8; 3]);
        Ok(due.then_some(Picture { picture, time_s: number as f64 }))
    }

    fn end_clip(&mut self) -> Result<u64, CameraError> {
        self.0.films_ended.fetch_add(1, Ordering::Relaxed);
        Ok(4)
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        Ok(())
    }

    fn conditions(&self) -> Conditions {
        CONDITIONS
    }
}

struct FakeFlange;

impl FlangeCamera for FakeFlange {
    fn capture(&mut self) -> Result<FlangePicture, CameraError> {
        let rgb = (0..6).map(|number| [number, 2 * number, 3 * number]).collect();
        let picture = ColorPicture { width: 3, height: 2, rgb };
        Ok(FlangePicture { picture, base_from_flange: None, time_s: 1.0 })
    }

    fn check_ready(&mut self) -> Result<(), CameraError> {
        Ok(())
    }
}

/// Test bench: a camera service on a socket, with fake cameras.
struct Bench {
    cameras: SharedCameras,
    last: LastState,
    counts: Arc<Counts>,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let (counts, last) = (Arc::new(Counts::default()), LastState::default());
        let both =
            Cameras { scanner: Box::new(FakeScanner(counts.clone())) as _, flange: Box::new(FakeFlange) as _ };
        let bench = Bench {
            cameras: SharedCameras::new(both, last.clone()),
            last,
            counts,
            folder: tempfile::tempdir().expect("a folder"),
        };
        let listener = UnixListener::bind(bench.socket()).expect("a socket");
        let cameras = bench.cameras.clone();
        thread::spawn(move || {
            for stream in listener.incoming() {
                let stream = stream.expect("a connection");
                let mut line = String::new();
                BufReader::new(&stream).read_line(&mut line).expect("a line");
                let Ok(RequestKind::Shoot(shot)) = read_request(line.as_bytes()) else { panic!("{line}") };
                let cameras = cameras.clone();
                thread::spawn(move || serve(stream, shot, &cameras));
            }
        });
        bench.rests();
        bench
    }

    fn socket(&self) -> PathBuf {
        Path::join(self.folder.path(), "socket")
    }

    fn rests(&self) {
        self.cameras.set_cell_state(&State { at: At::Idle, ..State::INITIAL });
    }

    fn scanner(&self) -> RemoteScanner {
        RemoteScanner::new(self.socket())
    }
}

fn refused<T: std::fmt::Debug>(taken: Result<T, CameraError>, words: &str) {
    let error = taken.expect_err("refused").to_string();
    assert!(error.contains(words), "{error}");
}

#[test]
fn shots_are_transferred_unchanged() {
    let bench = Bench::new();
    let mut scanner = bench.scanner();
    let shot = scanner.capture_3d().expect("a scan");
    assert_eq!(shot.time_s, 7.25);
    let bits = |cloud: &OrganizedCloud<Camera>| panelprep_cell::files::write_pcd(cloud);
    assert_eq!(bits(&shot.cloud), bits(&cloud()));
    assert_eq!(scanner.conditions(), CONDITIONS);
    refused(scanner.capture_2d(), "no picture from the scanner within 900 ms");

    let taken = BorrowedFlangeCamera::new(bench.socket()).capture().expect("a picture");
    assert_eq!((taken.picture.width, taken.picture.rgb[5], taken.time_s), (3, [5, 10, 15], 1.0));
}

/// The operator's page captures one picture at a time, and only while no cycle is running.
#[test]
fn a_picture_is_taken_while_the_cell_rests_and_not_in_a_cycle() {
    let bench = Bench::new();
    let code = |eye| bench.cameras.capture(eye).expect_err("none").code.into_owned();
    bench.cameras.reserve();
    assert_eq!(code(CameraEye::Flange), "at_work");
    bench.cameras.set_cell_state(&State::INITIAL);
    let taken = bench.cameras.capture(CameraEye::Flange).expect("a picture");
    assert_eq!((taken.picture.width, taken.picture.rgb[5], taken.time_s), (3, [5, 10, 15], 1.0));
    assert_eq!(code(CameraEye::Scanner), "camera", "it delivers none");
    let lent = bench.cameras.lend().expect("no person has them");
    assert_eq!(code(CameraEye::Flange), "busy");
    drop(lent);
    assert!(bench.cameras.capture(CameraEye::Flange).is_ok());
    assert_eq!(bench.cameras.check_cameras().expect("looked at"), []);
    bench.cameras.reserve();
    assert_eq!(bench.cameras.check_cameras(), None, "a cycle is not disturbed");
}

#[test]
fn the_axes_are_reported_only_while_the_arm_is_at_rest() {
    let bench = Bench::new();
    assert_eq!(bench.cameras.resting_joints(), None, "no robot has said where it stands");
    let joints = Joints::from([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]);
    bench.last.set(Some(&eki::State { joints, ..standing_state() }));
    assert_eq!(bench.cameras.resting_joints(), Some(joints));
    bench.last.set(Some(&eki::State { joints, moving: true, ..standing_state() }));
    assert_eq!(bench.cameras.resting_joints(), None, "it moves");
    bench.last.set(Some(&eki::State { joints, ..standing_state() }));
    bench.last.set(None);
    assert_eq!(bench.cameras.resting_joints(), None, "the link is lost");
}

#[test]
fn a_film_lasts_until_the_client_ends_it() {
    let bench = Bench::new();
    let mut scanner = bench.scanner();
    assert_eq!(scanner.begin_clip(5.0).expect("begun"), 3.5);
    for number in [1_u8, 3, 5] {
        let picture = scanner.next_clip_picture().expect("a picture").expect("one is waited for");
        assert_eq!((picture.picture.rgb[0], picture.time_s), ([number; 3], f64::from(number)));
    }
    assert_eq!(scanner.end_clip().expect("ended"), 4);
    assert_eq!(bench.counts.films_ended.load(Ordering::Relaxed), 1);
    refused(scanner.next_clip_picture(), "no clip was started with the scanner");
    refused(scanner.begin_clip(0.0), "valid: more than 0, at most 100");
    assert!(scanner.capture_3d().is_ok(), "the cameras are free again");
}

/// If a client disconnects, the service ends its film.
#[test]
fn a_film_ends_if_its_client_disconnects() {
    let bench = Bench::new();
    let mut scanner = bench.scanner();
    scanner.begin_clip(5.0).expect("begun");
    scanner.next_clip_picture().expect("a picture");
    drop(scanner);
    while bench.counts.films_ended.load(Ordering::Relaxed) == 0 {
        thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_cycle_ends_the_film_of_a_client() {
    let bench = Bench::new();
    let mut scanner = bench.scanner();
    scanner.begin_clip(5.0).expect("begun");
    scanner.next_clip_picture().expect("a picture");
    refused(bench.scanner().capture_3d(), "another client is capturing pictures now");
    bench.cameras.reserve();
    let end = (0..1_000).find_map(|_| scanner.next_clip_picture().err()).expect("the film ends");
    assert!(end.to_string().contains("the service is using the cameras for a cycle"), "{end}");
    assert_eq!(bench.counts.films_ended.load(Ordering::Relaxed), 1, "before the cycle's own first shot");
    refused(bench.scanner().capture_3d(), "try again when the cycle has ended");

    let held = State { at: At::Idle, ..State::INITIAL };
    let mut running = held;
    running.job.running = true;
    bench.cameras.set_cell_state(&running);
    refused(bench.scanner().capture_3d(), "the service is using the cameras for a cycle");
    bench.cameras.set_cell_state(&State { at: At::Execute(Phase::Inspect), ..held });
    refused(bench.scanner().capture_3d(), "the service is using the cameras for a cycle");
    bench.rests();
    assert!(bench.scanner().capture_3d().is_ok());

    // The loop needs the cameras before the thread has sent the film.
    let mut scanner = bench.scanner();
    scanner.begin_clip(5.0).expect("begun");
    bench.cameras.clone().scan().expect("the cycle's scan");
    assert_eq!(bench.counts.films_ended.load(Ordering::Relaxed), 2, "the film has ended once, before the scan");
}
