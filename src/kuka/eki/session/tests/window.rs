//! Tests the limits of the commands that are sent and not executed: their number, their duration, the free entries of
//! the ring buffer, and the number of bytes. Also tests a robot that is slower than planned, and that no linear motion
//! is sent before the state shows base and tool as they were set.

use super::*;

/// 200 points at a spacing of 1 mm and a speed of 100 mm/s take 10 ms each, so a window of a second has room for 100 of
/// them. The limit of 50 commands applies first: never more than 50 are sent ahead.
#[test]
fn two_hundred_points_are_each_executed_once_within_the_window() {
    let mut cell = Cell::ready();
    let last = cell.session.queue_path(&path(200, 1.0)).expect("a good path");
    assert_eq!(last, CommandId(203));
    cell.pass(6_000);
    assert!(matches!(
        cell.events()[..],
        [Report::Connected { .. }, Report::EpochOpened { .. }, Report::PathDone { last: CommandId(203) }]
    ));
    let expected: Vec<(u32, u32)> = (1..=203).map(|id| (7, id)).collect();
    assert_eq!(cell.controller.executed, expected);
    let most = cell.controller.most_in_ring;
    assert!((49..=50).contains(&most), "{most} commands in the ring");
    let told: Vec<u32> = cell
        .reports
        .iter()
        .filter_map(|report| if let Report::Progress { done } = report { Some(done.0) } else { None })
        .collect();
    assert!(told.is_sorted() && told.last() == Some(&203));
}

/// The arm is already at the first point, so this point needs no time. Each further point, 10 mm at 100 mm/s, takes 0.1
/// s: ten of them fit into the window of one second.
#[test]
fn the_window_also_limits_the_duration() {
    let mut cell = Cell::ready();
    cell.pass(200);
    cell.controller.ms_per_command = 100;
    cell.session.queue_path(&path(60, 10.0)).expect("a good path");
    cell.pass(8_000);
    assert_eq!((cell.controller.most_in_ring, cell.controller.done), (11, 63));
}

/// Each point, 100 mm at 100 mm/s, takes one second. Five points are still sent ahead, so that the controller can
/// blend.
#[test]
fn a_few_points_are_sent_ahead_whatever_their_duration() {
    let mut cell = Cell::ready();
    cell.pass(200);
    cell.controller.ms_per_command = 1_000;
    cell.session.queue_path(&path(12, 100.0)).expect("a good path");
    cell.pass(8_000);
    assert_eq!(cell.controller.most_in_ring, 5);
}

/// A ring buffer with eight free entries never receives a ninth command, however large the window is.
#[test]
fn the_free_places_of_the_ring_are_not_exceeded() {
    let mut cell = Cell::ready();
    cell.controller.ring_places = 8;
    cell.pass(300);
    cell.session.queue_path(&path(100, 2.0)).expect("a good path");
    cell.pass(4_000);
    assert_eq!((cell.controller.most_in_ring, cell.controller.done), (8, 103));
}

/// Only the permitted part of a path is sent, even if the window has room for more. When more points are permitted,
/// they are sent, and so are the commands after the path.
#[test]
fn commands_that_are_not_permitted_wait() {
    let mut cell = Cell::ready();
    let last = cell.session.queue_path_within(&path(40, 1.0), 16).expect("a good path");
    assert_eq!(last, CommandId(43));
    cell.pass(3_000);
    assert_eq!(cell.controller.done, 3 + 16);
    cell.session.permit_commands(Some(CommandId(30))).expect("open");
    cell.pass(3_000);
    assert_eq!(cell.controller.done, 30);
    cell.session.permit_commands(None).expect("open");
    let after = cell.session.queue(speed(0.1)).expect("a good command");
    cell.pass(3_000);
    assert_eq!((cell.controller.done, after), (44, CommandId(44)));
}

/// Without an acknowledgement at most 8 KiB are in transit. In lock step a reply to a heartbeat acknowledges the
/// commands that the heartbeat names; then the window fills to its 50 commands.
#[test]
fn the_bytes_not_yet_received_are_limited() {
    let mut cell = Cell::ready_at(ClockMode::LockStep);
    cell.pass(300);
    let mut points = path(200, 1.0);
    for MoveLin { pose, .. } in &mut points {
        // Ten full rotations give the same orientation, but the text is longer.
        (pose.a_deg, pose.b_deg, pose.c_deg) = (-3_600.0, -3_600.0, -3_600.0);
    }
    cell.session.queue_path(&points).expect("a good path");
    let now = Time::from_ms(cell.now_ms);
    let send = |session: &mut Session| -> Vec<usize> {
        std::iter::from_fn(|| session.poll_transmit(now)).map(|(_, bytes)| bytes.len()).collect()
    };
    let first = send(&mut cell.session);
    let bytes: usize = first.iter().sum();
    assert!((8 * 1024 - 250..=8 * 1024).contains(&bytes) && first.len() < 50, "{bytes} bytes");
    cell.session.heartbeat(now);
    let (_, request) = cell.session.poll_transmit(now).expect("a heartbeat");
    cell.controller.receive(&request);
    cell.session.push_state_bytes(&std::mem::take(&mut cell.controller.state_bytes), now);
    assert_eq!(first.len() + send(&mut cell.session).len(), 50);
}

/// A point, 10 mm at 100 mm/s, takes 0.1 s. A time of up to 0.7 s is tolerated; a longer time is reported. Without
/// contact it is reported once, in contact it ends the epoch.
#[test]
fn a_robot_far_behind_its_plan_is_reported_and_stopped_in_contact() {
    for (ms, contact, told) in [(650, true, 0), (800, true, 1), (800, false, 1)] {
        let mut cell = Cell::ready();
        cell.pass(200);
        cell.controller.ms_per_command = ms;
        let points = path(12, 10.0).into_iter().map(|point| MoveLin { contact, ..point });
        cell.session.queue_path(&points.collect::<Vec<_>>()).expect("a good path");
        cell.pass(6_000);
        let slow: Vec<&Report> = cell.reports.iter().filter(|it| matches!(it, Report::Slow { .. })).collect();
        assert_eq!(slow.len(), told, "{ms} ms, {slow:?}");
        if let Some(Report::Slow { contact: found, waited, .. }) = slow.first() {
            let waited_ms = waited.as_millis();
            assert!(*found == contact && (701..=801).contains(&waited_ms), "{waited_ms} ms");
        }
        assert_eq!(cell.session.epoch().is_none(), contact && told == 1, "{ms} ms");
    }
}

/// Linear motions wait until the state shows base and tool; an acknowledgement does not release them.
#[test]
fn no_linear_motion_is_sent_before_base_and_tool_are_confirmed() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(3, 2.0)).expect("a good path");
    cell.pass(90);
    // The commands are executed and acknowledged, but no state message has arrived since.
    assert_eq!((cell.controller.done, cell.controller.received), (3, 3));
    cell.pass(200);
    assert_eq!(cell.controller.done, 6);
}

#[test]
fn a_base_that_was_not_set_ends_the_epoch_before_any_linear_motion() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(3, 2.0)).expect("a good path");
    cell.pass(70);
    cell.controller.frames[0].as_mut().expect("set")[0] = "400.002000".to_owned();
    cell.pass(300);
    let events = cell.events();
    let [.., Report::EchoMismatch(mismatch), Report::Standstill { done }] = events[..] else {
        panic!("{events:?}")
    };
    let EchoMismatch::Differs { frame, id, distance_mm, .. } = **mismatch else { panic!("{mismatch}") };
    assert_eq!((frame, id, *done), ("base", CommandId(1), CommandId(3)));
    assert!((distance_mm - 0.002).abs() < 1e-6);
    assert_eq!(cell.controller.executed.len(), 3);
}

#[test]
fn a_base_that_was_lost_ends_the_epoch() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(3, 2.0)).expect("a good path");
    cell.pass(70);
    cell.controller.frames[0] = None;
    cell.pass(300);
    let mismatch = EchoMismatch::NotSet { frame: "base", id: CommandId(1) };
    assert!(cell.reports.contains(&Report::EchoMismatch(Box::new(mismatch))));
    assert_eq!(cell.controller.executed.len(), 3);
}

/// Base and tool are compared during the whole epoch: if a person changes the base on the pendant, the epoch ends.
#[test]
fn a_base_that_changes_during_a_path_ends_the_epoch() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(100, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.controller.frames[0].as_mut().expect("set")[3] = "30.002000".to_owned();
    cell.pass(300);
    assert!(matches!(cell.events()[..], [.., Report::EchoMismatch(_), Report::Standstill { .. }]));
    assert!(cell.controller.executed.len() < 103);
}
