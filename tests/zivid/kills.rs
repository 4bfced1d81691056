//! Tests a worker process that is killed at any moment, while its camera receives requests without a pause.

use panelprep::devices::zivid::{ZividFault, ZividScanner, ZividShot};
use rand::RngExt;
use rustix::process::{Pid, Signal, kill_process};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Time limit for a start, longer than any start on a busy machine.
const START_TIMEOUT: Duration = Duration::from_secs(120);

/// The result of the kills.
#[derive(Debug, Default)]
pub struct Killed {
    /// The number of kills that were reported with each row of the fault model, and the activity at that time.
    pub named: BTreeMap<String, usize>,
    /// Number of complete shots and pictures between the kills.
    pub delivered: usize,
}

/// Kills the worker process this number of times, each at a random moment of a capture, a transfer, a rest or a start.
pub fn kill_repeatedly(mut scanner: ZividScanner, times: usize, random: &mut impl RngExt) -> Killed {
    scanner.wait_ready(START_TIMEOUT).expect("ready");
    let (is_over, status) = (AtomicBool::new(false), scanner.monitor());
    thread::scope(|scope| {
        let asks = scope.spawn(|| {
            let (mut delivered, mut turn) = (0, 0);
            while !is_over.load(Ordering::Relaxed) {
                turn += 1;
                // Every fourth request is for a picture, and sometimes there is a pause.
                let asked = if turn % 4 == 0 {
                    scanner.take_picture().map(drop)
                } else {
                    scanner.take_scan().map(|shot| check_shot(&shot))
                };
                delivered += usize::from(asked.is_ok());
                if asked.is_err() || turn % 7 == 0 {
                    thread::sleep(Duration::from_millis(5));
                }
            }
            (scanner, delivered)
        });
        for kill in 1..=times {
            thread::sleep(Duration::from_millis(random.random_range(0..400)));
            let since = Instant::now();
            while !kill_worker(status.worker()) {
                assert!(since.elapsed() < START_TIMEOUT, "no worker comes");
                thread::sleep(Duration::from_millis(2));
            }
            while status.lost_workers() < kill {
                assert!(
                    since.elapsed() < START_TIMEOUT,
                    "kill {kill} was not noticed: {:?}",
                    status.faults().last()
                );
                thread::sleep(Duration::from_millis(2));
            }
        }
        is_over.store(true, Ordering::Relaxed);
        let (mut scanner, mut delivered) = asks.join().expect("who asks is never stopped");
        scanner.wait_ready(START_TIMEOUT).expect("started again");
        check_shot(&scanner.take_scan().expect("it delivers again"));
        delivered += 1;
        let faults = status.faults();
        assert_eq!((faults.len(), status.lost_workers()), (times, times), "each kill is one fault: {faults:#?}");
        let mut killed = Killed { delivered, ..Killed::default() };
        for fault in faults {
            let during = match &fault {
                ZividFault::Ended { during, how, .. } => {
                    assert_eq!(how, "signal: 9 (SIGKILL)");
                    *during
                }
                other => panic!("{other}"),
            };
            assert!(fault.to_string().starts_with(fault.row()), "{fault}");
            *killed.named.entry(format!("{} during {during}", fault.row())).or_default() += 1;
        }
        killed
    })
}

fn kill_worker(worker: Option<u32>) -> bool {
    let id = worker.and_then(|id| Pid::from_raw(i32::try_from(id).ok()?));
    id.is_some_and(|id| kill_process(id, Signal::KILL).is_ok())
}

/// Checks that a complete shot is equal to the sent shot: a few points of the surface, as defined at the top of
/// `play.cpp`.
pub fn check_shot(shot: &ZividShot) {
    let (width, height) = (shot.cloud.width(), shot.cloud.height());
    let (w, f_px) = (width as f64, 1785.0 * width as f64 / 1944.0);
    for (u, v) in [(width / 2, height / 2), (width / 10, height - 1), (width - 1, 0)] {
        let point = shot.cloud.point(u, v).expect("there").mm;
        let z_mm = 700.0 + 25.0 * (6.0 * u as f64 / w).sin() + 15.0 * v as f64 / w;
        let x_mm = (u as f64 + 0.5 - w / 2.0) * point.z / f_px;
        assert!((z_mm - 0.001..z_mm + 0.051).contains(&point.z) && (point.x - x_mm).abs() < 1e-3, "{point}");
    }
    assert_eq!(shot.cloud.point(0, height / 2), None);
    assert_eq!(shot.snr[8], 11.0);
}
