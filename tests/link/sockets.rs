//! Tests the client and the mock controller over loopback in real time, for behaviour that only sockets show. No test
//! depends on the speed of the machine beyond the deadlines of the connection.

use super::cell::{BASE, TOOL_OUTPUT, pass, sanding_tool, speed};
use super::loopback::served;
use panelprep::devices::mock::{Fault, StopCause as Stop};
use panelprep::devices::robot::BlockingLink;
use panelprep::eki::{Command, CommandId, LinkLoss, QueueError, Report, Signal, StopCause};
use std::time::Duration;

/// Waits for the first report for which `found` returns a value, and returns the value.
fn wait<T>(link: &mut BlockingLink, found: impl Fn(&Report) -> Option<T>) -> T {
    for _ in 0..5_000 {
        let report = link.next(Duration::from_secs(20)).expect("the link continues");
        if let Some(found) = found(&report) {
            return found;
        }
    }
    panic!("five thousand reports and not the one");
}

/// Connects, opens an epoch, and sends base, tool and speed.
fn open(link: &mut BlockingLink, speed_m_s: f64) {
    wait(link, |report| matches!(report, Report::Connected { .. }).then_some(()));
    link.open_epoch().expect("connected");
    wait(link, |report| matches!(report, Report::EpochOpened { .. }).then_some(()));
    for command in [Command::SetBase(BASE), sanding_tool(), speed(speed_m_s)] {
        link.send(command).expect("good");
    }
}

fn path_done(link: &mut BlockingLink, last: CommandId) {
    wait(link, |report| match report {
        Report::PathDone { last: done } => {
            assert_eq!(*done, last);
            Some(())
        }
        Report::State(_) | Report::Progress { .. } => None,
        other => panic!("unexpected: {other:?}"),
    });
}

/// 500 points of 20 ms each with a round-trip time of 20 ms, in fragmented messages: all are executed, the queue is
/// never empty, and the arm does not stop.
#[test]
fn five_hundred_points_at_20_ms_round_trip_run_without_a_stop() {
    let (server, mut link) = served("seed=3,delay=10ms,fragment");
    open(&mut link, 0.15);
    let back_and_forth = |index: usize| {
        let column = if (index / 40).is_multiple_of(2) { index % 40 } else { 39 - index % 40 };
        let mut point = pass(41, 3.0, false)[column];
        point.pose.y_mm += 3.0 * (index / 40) as f64;
        (point.pose.z_mm, point.blend_mm) = (-10.0, if index == 499 { 0.0 } else { 1.2 });
        point
    };
    let last = link.send_path((0..500).map(back_and_forth).collect()).expect("a good path");
    path_done(&mut link, last);
    server.handle().with_controller(|controller| {
        assert_eq!(
            (controller.executed_motions().len(), controller.underrun_count(), controller.program_stops().len()),
            (500, 0, 0)
        );
    });
}

/// The cable is unplugged in contact: both ends stop automatically, and the client reconnects automatically without
/// moving the arm.
#[test]
fn a_half_open_connection_is_noticed_on_both_ends() {
    let (server, mut link) = served("");
    open(&mut link, 0.1);
    link.send(Command::SetDigout(Signal { number: TOOL_OUTPUT, on: true })).expect("good");
    link.send_path(pass(200, 1.0, true)).expect("a good path");
    wait(&mut link, |report| matches!(report, Report::Progress { done } if done.0 > 30).then_some(()));
    server.handle().with_controller(|controller| controller.apply_fault(Fault::Unplug { for_ms: Some(2_500) }));
    wait(&mut link, |report| matches!(report, Report::WatchdogExpired { .. }).then_some(()));
    let why = wait(&mut link, |report| match report {
        Report::LinkLost { why } => Some(why.clone()),
        _ => None,
    });
    // The unanswered abort ends the connections before the time limit for silence.
    assert!(matches!(why, LinkLoss::AbortNotAnswered { waited_ms: 400..900 }), "{why}");
    wait(&mut link, |report| matches!(report, Report::Connected { .. }).then_some(()));
    let executed = server.handle().with_controller(|controller| {
        let stop = controller.program_stops()[0].clone();
        assert_eq!((stop.cause, stop.contact), (Stop::Watchdog, true));
        assert!(super::cell::height_mm(controller) > 40.0 && !controller.outputs()[&TOOL_OUTPUT]);
        controller.executed_motions().len()
    });
    for _ in 0..10 {
        wait(&mut link, |report| matches!(report, Report::State(_)).then_some(()));
    }
    server.handle().with_controller(|controller| assert_eq!(controller.executed_motions().len(), executed));
    assert_eq!(link.send(speed(0.1)), Err(QueueError::NoEpoch));
}

/// A client that keeps the connection but reads no reports does not supervise the robot: the robot stops, with or
/// without heartbeats.
#[test]
fn a_link_that_is_not_read_ends_its_epoch() {
    let (server, mut link) = served("");
    open(&mut link, 0.02);
    link.send_path(pass(200, 1.0, true)).expect("a good path");
    wait(&mut link, |report| matches!(report, Report::Progress { done } if done.0 > 5).then_some(()));
    std::thread::sleep(Duration::from_millis(1_600));
    server.handle().with_controller(|controller| assert_eq!(controller.program_stops()[0].cause, Stop::Abort));
    let cause = wait(&mut link, |report| match report {
        Report::Interrupted { cause } => Some(*cause),
        _ => None,
    });
    assert_eq!(cause, StopCause::Unattended);
}
