//! Base and tool: no line is sent before the state shows both as they were set.

use super::*;

/// Linear motions wait until the state shows base and tool; nothing else releases them.
#[test]
fn no_line_is_sent_before_base_and_tool_are_seen() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(3, 2.0)).expect("a good path");
    cell.pass(90);
    // Executed and acknowledged, but no state has come since.
    assert_eq!((cell.controller.done, cell.controller.received), (3, 3));
    cell.pass(200);
    assert_eq!(cell.controller.done, 6);
}

#[test]
fn a_base_that_did_not_arrive_ends_the_epoch_before_any_line() {
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

/// The echo applies for the whole epoch: a person who changes the base on the pendant ends the epoch.
#[test]
fn a_base_that_changes_on_the_way_ends_the_epoch() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(100, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.controller.frames[0].as_mut().expect("set")[3] = "30.002000".to_owned();
    cell.pass(300);
    assert!(matches!(cell.events()[..], [.., Report::EchoMismatch(_), Report::Standstill { .. }]));
    assert!(cell.controller.executed.len() < 103);
}
