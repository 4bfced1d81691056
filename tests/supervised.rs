//! Tests threads of the service that panic or hang: the process ends in a safe way, and the next process does not move
//! the robot.

use super::service::{START, Service, taught};
use panelprep::cycle::{At, recover};
use panelprep::store::Store;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::{Duration, Instant};

/// Name of the file that states which thread a debug build lets fail.
const FAULT_FILE_NAME: &str = "inject";

fn service(folder: &Path) -> Service {
    std::fs::write(folder.join(FAULT_FILE_NAME), "").expect("written");
    Service::start_with(folder, &[("PANELPREP_INJECT", FAULT_FILE_NAME)])
}

fn inject_fault(folder: &Path, failure: &str) {
    std::fs::write(folder.join(FAULT_FILE_NAME), failure).expect("written");
}

/// Each thread fails in both ways during a cycle. The message at the end names the thread. The state of the next
/// service follows from the journal: Aborted if a motion was open.
#[test]
fn a_thread_that_fails_ends_the_service() {
    let folder = taught("good");
    let folder = folder.path();
    for thread in ["robot link", "socket", "computing", "recording", "loop"] {
        for failure in ["panic", "hang"] {
            if (failure, thread) == ("hang", "loop") {
                continue; // systemd ends that one: see below
            }
            let running = service(folder);
            if running.state() == "aborted" {
                // The robot may not be connected yet.
                running.wait("a clear is taken", |running| running.ctl("clear").0 == 0);
                running.reach("stopped");
            }
            running.reset();
            running.done(&format!("{START} --record"));
            running.wait("work", |running| running.state() == "execute");
            inject_fault(folder, &format!("{failure} {thread}"));
            let status = running.wait_for_end();
            let log = std::fs::read_to_string(folder.join("run.log")).expect("a log");
            let panics = (failure, thread) == ("panic", "loop");
            assert_eq!(status.code(), Some(if panics { 101 } else { 3 }), "{failure} {thread}: {status}\n{log}");
            let reported = if failure == "panic" { "panicked" } else { "has not responded for" };
            assert!(
                panics || log.contains(&format!("the thread \"{thread}\" {reported}")),
                "{failure} {thread}\n{log}"
            );
            let journal =
                Store::open(&folder.join("cell/store")).expect("the store opens").journal().expect("whole");
            let rests = recover(journal).at;
            assert!(matches!(rests, At::Stopped | At::Aborted { .. }), "{rests:?}");
            let next = service(folder);
            assert_eq!(next.state(), rests.keyword(), "{failure} {thread}");
            std::fs::remove_file(folder.join("run.log")).expect("the log of one failure at a time");
        }
    }
}

/// systemd receives heartbeats from a loop that works, and no heartbeat from a loop that hangs. It therefore ends the
/// process; the robot controller has already stopped automatically.
#[test]
fn a_loop_that_hangs_sends_no_heartbeat() {
    let folder = taught("clean");
    let folder = folder.path();
    std::fs::write(folder.join(FAULT_FILE_NAME), "").expect("written");
    let systemd = UnixDatagram::bind(folder.join("notify")).expect("a socket");
    systemd.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
    let notify = folder.join("notify").display().to_string();
    let running = Service::start_with(
        folder,
        &[("PANELPREP_INJECT", FAULT_FILE_NAME), ("NOTIFY_SOCKET", &notify), ("WATCHDOG_USEC", "1000000")],
    );
    let feeds = |within: Duration| {
        let (since, mut bytes) = (Instant::now(), [0; 512]);
        while since.elapsed() < within {
            systemd.set_read_timeout(Some(within)).expect("set");
            let Ok(count) = systemd.recv(&mut bytes) else { return false };
            if String::from_utf8_lossy(&bytes[..count]).contains("WATCHDOG=1") {
                return true;
            }
        }
        false
    };
    assert!(feeds(Duration::from_secs(30)), "a loop that works feeds it");
    inject_fault(folder, "hang loop");
    running.wait("it hangs", |running| running.ctl("state").0 != 0);
    while feeds(Duration::from_millis(10)) {} // what was sent before
    assert!(!feeds(Duration::from_secs(3)), "a loop that hangs does not");
}
