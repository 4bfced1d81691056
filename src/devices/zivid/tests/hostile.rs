//! Tests with bytes that are corrupted in transit between a correct worker and the daemon.

use super::super::*;
use super::TIMEOUT;
use super::played::{Plan, in_thread, setup};
use crate::zivid::process::WorkerLauncher;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Number of frames before the first scan: the worker's first message, connect, two settings, and the warm-up.
const FRAMES_BEFORE_SHOT: usize = 5;

/// A function that changes the worker's n-th frame, counted over all workers, before it is forwarded. Returns what
/// happens to the rest of the frame.
type Tamper = dyn Fn(usize, &mut Vec<u8>) -> Rest + Send + Sync;

enum Rest {
    GoesOn,
    Stalls,
    HangsUp,
}

/// Reads a whole frame, whose lengths are in its opening.
fn frame(worker: &mut UnixStream) -> Option<Vec<u8>> {
    let mut bytes = vec![0; 24];
    worker.read_exact(&mut bytes).ok()?;
    let head = u32::from_le_bytes(bytes[12..16].try_into().ok()?) as usize;
    let payload = u64::from_le_bytes(bytes[16..24].try_into().ok()?) as usize;
    bytes.resize(24 + 4 + head + 4 + payload + 4, 0);
    worker.read_exact(&mut bytes[24..]).ok()?;
    Some(bytes)
}

/// Returns a launcher of correct workers whose frames are changed in transit.
fn tampered(tamper: impl Fn(usize, &mut Vec<u8>) -> Rest + Send + Sync + 'static) -> WorkerLauncher {
    let (frames, tamper): (_, Arc<Tamper>) = (Arc::new(AtomicUsize::new(0)), Arc::new(tamper));
    let inner = Mutex::new(super::played::played(Plan::default()));
    in_thread(move |mut daemon| {
        let (mut worker, _peer) = inner.lock().expect("one at a time")().expect("started");
        let (mut asks, mut passes) = (daemon.try_clone().expect("a socket"), worker.try_clone().expect("a socket"));
        std::thread::spawn(move || std::io::copy(&mut asks, &mut passes));
        while let Some(mut bytes) = frame(&mut worker) {
            let rest = tamper(frames.fetch_add(1, Ordering::Relaxed), &mut bytes);
            if daemon.write_all(&bytes).is_err() {
                return;
            }
            match rest {
                Rest::GoesOn => {}
                Rest::HangsUp => return,
                // Nothing more is sent, but the connection stays open until the daemon closes it.
                Rest::Stalls => drop(worker.shutdown(std::net::Shutdown::Write)),
            }
        }
        let _ = daemon.read(&mut [0]);
    })
}

/// Changes the first scan in transit and returns the fault; checks that the next scan is accepted.
fn first_shot(tamper: impl Fn(&mut Vec<u8>) -> Rest + Send + Sync + 'static) -> ZividFault {
    let mut setup = setup();
    setup.timeouts.scan = Duration::from_millis(400);
    let launch =
        tampered(move |number, bytes| if number == FRAMES_BEFORE_SHOT { tamper(bytes) } else { Rest::GoesOn });
    let mut scanner = ZividScanner::start(setup, launch).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("ready");
    let fault = scanner.take_scan().expect_err("tampered with");
    scanner.wait_ready(TIMEOUT).expect("started again");
    scanner.take_scan().expect("the next one is good");
    assert_eq!((scanner.history().0, scanner.history().1), (vec![fault.clone()], 1));
    fault
}

/// Runs all cases in parallel, because each case waits until its own worker is restarted.
fn each<const N: usize>(cases: [usize; N], check: impl Fn(usize) + Sync) {
    let check = &check;
    std::thread::scope(|scope| cases.into_iter().for_each(|case| drop(scope.spawn(move || check(case)))));
}

/// The worker ends while it sends a frame, in each part of the frame.
#[test]
fn a_shot_that_is_cut_off_is_reported_as_an_ended_worker() {
    each([0, 10, 26, 40, 300, 900], |keep| {
        let fault = first_shot(move |bytes| {
            bytes.truncate(keep);
            Rest::HangsUp
        });
        let words = "C11 the 3D camera's worker ended (it hung up) during a 3D shot; the program restarts the worker, \
                     restart 1 of 3";
        assert!(fault.to_string().starts_with(words), "{keep}: {fault}");
    });
}

#[test]
fn a_shot_that_stalls_in_transit_is_abandoned_in_time() {
    each([0, 20, 500], |keep| {
        let since = Instant::now();
        let fault = first_shot(move |bytes| {
            bytes.truncate(keep);
            Rest::Stalls
        });
        assert!(
            fault.to_string().starts_with(
                "C3 the 3D camera did not respond within 0.4 s to a 3D shot, and its worker was ended"
            ),
            "{fault}"
        );
        assert!(since.elapsed() >= Duration::from_millis(400));
    });
}

/// One byte is changed in the opening, the head, the payload or a checksum.
#[test]
fn a_changed_shot_is_discarded() {
    each([0, 12, 26, 40, 700, usize::MAX], |at| {
        let fault = first_shot(move |bytes| {
            let at = at.min(bytes.len() - 1);
            bytes[at] ^= 0x20;
            Rest::GoesOn
        });
        assert!(
            fault.to_string().starts_with("C4 the data received for a 3D shot are damaged and were discarded"),
            "{at}: {fault}"
        );
    });
}

/// The checksums are correct, but the payload has fewer values than the head states.
#[test]
fn a_short_payload_is_discarded() {
    let fault = first_shot(|bytes| {
        let head = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        let sequence = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]);
        let (head, payload) = (bytes[28..28 + head].to_vec(), bytes[28 + head + 4..bytes.len() - 4 - 19].to_vec());
        bytes.clear();
        wire::write(bytes, (wire::FrameKind::Reply, sequence), &head, &[&payload]).expect("written");
        Rest::GoesOn
    });
    let words = "C4 the data received for a 3D shot are damaged and were discarded: a frame's payload has 893 bytes, \
                 but its head states 912 bytes";
    assert!(fault.to_string().starts_with(words), "{fault}");
}

/// The previous reply is sent once more.
#[test]
fn an_answer_to_another_request_is_discarded() {
    let kept = Mutex::new(Vec::new());
    let launch = tampered(move |number, bytes| {
        let mut kept = kept.lock().expect("one at a time");
        if number == FRAMES_BEFORE_SHOT {
            bytes.clone_from(&kept);
        }
        kept.clone_from(bytes);
        Rest::GoesOn
    });
    let mut scanner = ZividScanner::start(setup(), launch).expect("a thread");
    scanner.wait_ready(TIMEOUT).expect("ready");
    let fault = scanner.take_scan().expect_err("the warm-up's").to_string();
    assert!(fault.contains("found a response to request 4, but the last request was 5"), "{fault}");
}

/// The worker is not restarted, because a restart would not help.
#[test]
fn a_worker_of_another_version_stays_down() {
    let launch = tampered(|number, bytes| {
        if number == 0 {
            bytes[4] = 9;
        }
        Rest::GoesOn
    });
    let mut scanner = ZividScanner::start(setup(), launch).expect("a thread");
    let fault = scanner.wait_ready(TIMEOUT).expect_err("refused").to_string();
    let words = "C5 the version of the 3D camera's worker is protocol 9, but the version of this program is 2; restart \
                 the service after an upgrade";
    assert_eq!(fault, words);
    assert_eq!(scanner.take_scan().expect_err("down").to_string(), words);
    assert_eq!(scanner.history().1, 0, "no restart was used");
    scanner.temperatures().expect("a person's reset looks again, and the second worker is of this version");
}

#[test]
fn a_worker_of_another_program_stays_down() {
    let other = in_thread(|mut daemon| {
        let hello = br#"{"program":"0.0.7","sdk":{"Ok":"played"}}"#;
        wire::write(&mut daemon, (wire::FrameKind::Hello, 0), hello, &[]).expect("written");
        let _ = daemon.read(&mut [0]);
    });
    let scanner = ZividScanner::start(setup(), other).expect("a thread");
    let fault = scanner.wait_ready(TIMEOUT).expect_err("refused").to_string();
    assert!(
        fault.starts_with("C5 the version of the 3D camera's worker is 0.0.7, but the version of this program is "),
        "{fault}"
    );
}

#[test]
fn a_worker_without_its_library_reports_it() {
    let bare = in_thread(|mut daemon| {
        worker::send_hello(&mut daemon, Err("libpanelprep_zivid.so: not found".to_owned())).expect("told");
    });
    let scanner = ZividScanner::start(setup(), bare).expect("a thread");
    let fault = scanner.wait_ready(TIMEOUT).expect_err("none").to_string();
    assert_eq!(fault, "C1 the 3D camera's worker cannot run: libpanelprep_zivid.so: not found");
}

/// A worker that ends during each first scan is restarted three times and then stays down.
#[test]
fn a_worker_stays_down_after_its_fourth_end() {
    let launch = tampered(|number, bytes| {
        // Each worker sends hello, the replies to connect and to two settings, and half a scan.
        if number % FRAMES_BEFORE_SHOT == FRAMES_BEFORE_SHOT - 1 {
            bytes.truncate(100);
            return Rest::HangsUp;
        }
        Rest::GoesOn
    });
    let mut scanner = ZividScanner::start(setup(), launch).expect("a thread");
    let fault = scanner.wait_ready(TIMEOUT).expect_err("down").to_string();
    let words =
        "C11 the 3D camera's worker stays down: it ended 4 times within 10 min (limit 3 restarts). Last: C11";
    assert!(fault.starts_with(words) && fault.contains("reset after"), "{fault}");
    let (faults, lost, worker) = scanner.history();
    assert_eq!((faults.len(), lost, worker), (5, 4, None), "each end, and that it stays down: {faults:#?}");
    assert!(faults[2].to_string().ends_with("restart 3 of 3 in 10 min"), "{}", faults[2]);
    assert!(
        faults[3].to_string().ends_with("the worker stays down, because its restarts are used up"),
        "{}",
        faults[3]
    );
    let refused = scanner.temperatures().expect_err("a reset does not make more of it");
    assert!(matches!(refused, ZividFault::Down { .. }), "{refused}");
    assert!(matches!(scanner.take_scan(), Err(ZividFault::Down { .. })));
}

/// The budget in virtual time is tested in `budget`. In this test the period is short, and a person's reset restarts
/// the worker after the period.
#[test]
fn a_persons_reset_starts_the_worker_after_the_period() {
    let restarts = Restarts { max_restarts: 1, within: Duration::from_millis(300) };
    // The first two workers end before their reply to the warm-up arrives.
    let launch = tampered(|number, bytes| {
        if [FRAMES_BEFORE_SHOT - 1, 2 * FRAMES_BEFORE_SHOT - 1].contains(&number) {
            bytes.clear();
            return Rest::HangsUp;
        }
        Rest::GoesOn
    });
    let mut scanner = ZividScanner::start(CameraSetup { restarts, ..setup() }, launch).expect("a thread");
    let fault = scanner.wait_ready(TIMEOUT).expect_err("down").to_string();
    assert!(fault.contains("it ended 2 times within 0 min (limit 1 restarts)"), "{fault}");
    std::thread::sleep(restarts.within);
    assert!(matches!(scanner.take_scan(), Err(ZividFault::Down { .. })), "time alone does not start it");
    scanner.temperatures().expect("a person does");
    scanner.take_scan().expect("and it delivers");
}
