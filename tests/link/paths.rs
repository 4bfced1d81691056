//! Tests whole paths: long paths without a stop, a slow robot, a lost base, numbers at the end of their range.

use super::cell::{BASE, Blind, Cell, pass, sanding_tool, setup, speed};
use panelprep::devices::mock::{Clock, Fault, Setup, StopCause};
use panelprep::eki::{Command, EchoMismatch, LinkLimits, MoveLin, Report};
use panelprep::geometry::KukaPose;

/// Returns points back and forth over 120 mm in steps of 3 mm at 150 mm/s: 20 ms per step, which equals the round-trip
/// time.
fn meander(points: usize) -> Vec<MoveLin> {
    let point = |index: usize| {
        let (row, column) = (index / 40, index % 40);
        let column = if row % 2 == 0 { column } else { 39 - column };
        let x_mm = 3.0 * column as f64 - 60.0;
        let y_mm = 3.0 * (row % 20) as f64 + if column % 2 == 0 { 0.0 } else { 0.3 };
        MoveLin {
            pose: KukaPose { x_mm, y_mm, ..KukaPose::default() },
            blend_mm: 1.2,
            contact: false,
            speed_m_s: None,
        }
    };
    let mut points: Vec<MoveLin> = (0..points).map(point).collect();
    if let Some(last) = points.last_mut() {
        last.blend_mm = 0.0;
    }
    points
}

/// 10,000 points with a round-trip time of 20 ms: the controller never runs out of points, and the arm does not stop
/// before the end.
#[test]
fn ten_thousand_points_run_without_a_stop() {
    let mut cell = Cell::ready(setup(Clock::Free), 0.15);
    cell.delay_ms = (10, 10);
    let last = cell.session.queue_path(&meander(10_000)).expect("a good path");
    let mut stood = 0;
    let mut before = cell.controller.joints();
    while cell.executed().len() < 10_000 {
        cell.run(12, &mut Blind);
        let now = cell.controller.joints();
        stood += usize::from(now == before && !cell.executed().is_empty() && cell.executed().len() < 10_000);
        before = now;
        assert!(cell.controller.program_stops().is_empty(), "{:?}", cell.controller.program_stops());
        assert!(cell.now_ms < 400_000, "{} points in 400 s", cell.executed().len());
    }
    assert_eq!((cell.controller.underrun_count(), stood), (0, 0));
    assert!(cell.until(200, |report| *report == Report::PathDone { last }));
    // Expected value, calculated by hand: 10,000 · 3.015 mm at 150 mm/s take 201 s. Corners are cut, and rows change
    // within 3 mm.
    let took_ms = cell.executed()[9_999].time_ms - cell.executed()[0].time_ms;
    assert!((190_000..206_000).contains(&took_ms), "{took_ms} ms");
}

/// At a fifth of its speed the robot is only late: all points are executed once, the queue is never empty, and no time
/// limit is exceeded.
#[test]
fn a_slow_robot_is_waited_for() {
    let mut cell = Cell::ready(setup(Clock::Free), 0.15);
    cell.controller.apply_fault(Fault::Slow { percent: 20, for_ms: None });
    let last = cell.session.queue_path(&pass(60, 3.0, true)).expect("a good path");
    assert!(cell.until(20_000, |report| *report == Report::PathDone { last }));
    assert_eq!(
        (cell.executed().len(), cell.controller.underrun_count(), cell.controller.program_stops().len()),
        (60, 0, 0)
    );
    // Expected value, calculated by hand: 57 steps and the ends at 30 mm/s take slightly more than 6 s.
    assert!(cell.now_ms > 6_000);
}

/// At a fiftieth of its speed a point takes 1 s instead of 20 ms. In contact, the epoch is ended and the pad leaves the
/// panel. In the air, the delay is reported and the client waits.
#[test]
fn a_robot_that_is_too_slow_in_contact_leaves_the_panel() {
    for in_contact in [true, false] {
        let mut cell = Cell::ready(setup(Clock::Free), 0.15);
        let last = cell.session.queue_path(&pass(60, 3.0, in_contact)).expect("a good path");
        cell.run(900, &mut Blind);
        cell.controller.apply_fault(Fault::Slow { percent: 2, for_ms: Some(3_000) });
        let lingers = |report: &Report| matches!(report, Report::Slow { contact, .. } if *contact == in_contact);
        assert!(cell.until(1_500, lingers), "in contact: {in_contact}");
        if in_contact {
            assert!(cell.until(8_000, |report| matches!(report, Report::Standstill { .. })));
            assert!(super::cell::height_mm(&cell.controller) > 40.0 && cell.executed().len() < 60);
        } else {
            assert!(cell.until(8_000, |report| *report == Report::PathDone { last }));
            assert_eq!((cell.executed().len(), cell.controller.program_stops().len()), (60, 0));
        }
    }
}

/// If the client is too slow in contact, the controller stops automatically, away from the panel.
#[test]
fn the_controller_does_not_wait_for_a_client_that_stalls_in_contact() {
    let mut cell = Cell::ready(setup(Clock::Free), 0.1);
    cell.session.queue_path(&pass(80, 3.0, true)).expect("a good path");
    cell.run(600, &mut Blind);
    cell.client_stalls_until_ms = cell.now_ms + 3_000;
    cell.run(1_500, &mut Blind);
    let causes: Vec<StopCause> = cell.controller.program_stops().iter().map(|stop| stop.cause).collect();
    assert_eq!(causes, [StopCause::Watchdog]);
    assert!(super::cell::height_mm(&cell.controller) > 40.0);
}

/// If a `set_base` were lost, the arm would execute plausible but wrong lines. No line is sent, and the epoch ends.
#[test]
fn no_line_follows_a_base_that_was_lost_or_is_wrong() {
    for fault in [Fault::LoseBase, Fault::WrongBase, Fault::LoseTool] {
        let mut cell = Cell::new(setup(Clock::Free), LinkLimits::default(), 1);
        cell.delay_ms = (10, 10);
        assert!(cell.until(8_000, |report| matches!(report, Report::Connected { .. })));
        cell.session.open_epoch().expect("connected");
        assert!(cell.until(1_000, |report| matches!(report, Report::EpochOpened { .. })));
        cell.controller.apply_fault(fault);
        for command in [Command::SetBase(BASE), sanding_tool(), speed(0.1)] {
            cell.session.queue(command).expect("good");
        }
        cell.session.queue_path(&pass(20, 3.0, true)).expect("a good path");
        let mismatch = |report: &Report| match report {
            Report::EchoMismatch(mismatch) => match **mismatch {
                EchoMismatch::NotSet { .. } => fault != Fault::WrongBase,
                EchoMismatch::Differs { distance_mm, .. } => {
                    fault == Fault::WrongBase && (distance_mm - 1.0).abs() < 1e-3
                }
            },
            _ => false,
        };
        assert!(cell.until(1_000, mismatch), "{fault:?}");
        cell.run(2_000, &mut Blind);
        assert!(cell.executed().is_empty() && cell.session.epoch().is_none(), "{fault:?}");
    }
}

/// Counters of 32 bits end: the number of a state continues from 0; an epoch number at the end of its range is an error
/// and does not continue from 0.
#[test]
fn a_states_number_continues_from_zero() {
    let mut cell = Cell::new(Setup { first_state: i32::MAX - 20, ..setup(Clock::Free) }, LinkLimits::default(), 1);
    cell.open(0.15);
    let last = cell.session.queue_path(&pass(60, 3.0, true)).expect("a good path");
    assert!(cell.until(4_000, |report| *report == Report::PathDone { last }));
    cell.run(3_000, &mut Blind);
    assert!(cell.session.epoch().is_some() && cell.controller.program_stops().is_empty());
}

/// Message fragments of any size and a jitter of 2 to 25 ms change only the duration.
#[test]
fn pieces_and_jitter_change_nothing() {
    for seed in 0..20 {
        let mut cell = Cell::new(setup(Clock::Free), LinkLimits::default(), seed);
        cell.delay_ms = (2, 25);
        cell.fragment = true;
        cell.open(0.15);
        let last = cell.session.queue_path(&pass(60, 3.0, true)).expect("a good path");
        assert!(cell.until(4_000, |report| *report == Report::PathDone { last }), "seed {seed}");
        assert_eq!((cell.executed().len(), cell.controller.underrun_count()), (60, 0), "seed {seed}");
    }
}
