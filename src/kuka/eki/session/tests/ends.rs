//! Tests that each fault ends the epoch, and that no command of the ended epoch moves the robot afterwards.

use super::*;

#[test]
fn a_refusal_ends_the_epoch_and_names_the_command() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(100, 2.0)).expect("a good path");
    cell.pass(1_000);
    let executed = cell.controller.executed.len();
    cell.controller.refused = Some((8, 30));
    cell.controller.send_ack();
    cell.pass(300);
    let [.., refused, Report::Standstill { done }] = cell.events()[..] else { panic!("{:?}", cell.events()) };
    assert_eq!(refused, &Report::Refused { id: CommandId(30), refusal: Refusal::NotReachable });
    assert!(cell.controller.executed.len() <= executed + 1 && cell.controller.discarded > 10);
    assert_eq!(done.0 as usize, cell.controller.executed.len());
    assert_eq!(cell.controller.epoch, 8);
}

/// After an abort the queue is empty on both sides, and a new epoch begins without commands of the old one.
#[test]
fn after_an_abort_no_command_of_the_old_epoch_is_executed() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.session.abort().expect("connected");
    cell.session.abort().expect("a second one changes nothing");
    let executed = cell.controller.executed.len();
    cell.pass(2_000);
    assert_eq!(cell.controller.executed.len(), executed);
    assert!(matches!(cell.events()[..], [.., Report::Standstill { .. }]));
    assert_eq!(cell.session.queue(speed(0.1)), Err(QueueError::NoEpoch));
    let epoch = cell.session.open_epoch().expect("connected");
    cell.pass(100);
    assert_eq!((epoch, cell.session.epoch()), (Epoch(9), Some(Epoch(9))));
    let no_base = Err(QueueError::FramesNotSet { missing: "the base" });
    assert_eq!(cell.session.queue_path(&path(2, 2.0)), no_base);
    cell.pass(1_000);
    assert_eq!(cell.controller.executed.len(), executed);
}

#[test]
fn standstill_is_reported_only_when_the_robot_is_at_rest() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.session.abort().expect("connected");
    cell.controller.flags = READY + 8;
    cell.pass(500);
    assert_eq!(cell.session.open_epoch(), Err(QueueError::NotStanding));
    assert!(!matches!(cell.events()[..], [.., Report::Standstill { .. }]));
    cell.controller.flags = READY;
    cell.pass(200);
    assert!(matches!(cell.events()[..], [.., Report::Standstill { .. }]));
}

/// The last state message arrives at 1200 ms. The abort is sent 400 ms later, and the link is closed one second after
/// the last message.
#[test]
fn silence_during_a_path_aborts_and_then_closes_the_link() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.controller.silent = true;
    cell.pass(390);
    assert_eq!(cell.controller.epoch, 7);
    cell.pass(10);
    assert_eq!(cell.controller.epoch, 8);
    let silence = Duration::from_millis(400);
    let expired = Report::WatchdogExpired { channel: Channel::State, silence };
    assert_eq!(cell.events()[2..], [&expired]);
    cell.pass(700);
    // The controller did not respond to the abort either.
    let unanswered = LinkLoss::AbortNotAnswered { waited_ms: 400 };
    assert_eq!(cell.events().last(), Some(&&Report::LinkLost { why: unanswered }));
    assert!(!cell.session.is_connected());
}

#[test]
fn silence_of_an_idle_robot_only_closes_the_link() {
    let mut cell = Cell::ready();
    cell.pass(300);
    cell.controller.silent = true;
    cell.pass(950);
    assert_eq!(cell.events().len(), 2);
    cell.pass(100);
    let silent = LinkLoss::Silent { channel: Channel::State, silence_ms: 1_000 };
    assert_eq!(cell.events()[2..], [&Report::LinkLost { why: silent }]);
}

/// State messages arrive, but the commands are lost. Without the abort, the robot would run out of commands without any
/// message.
#[test]
fn commands_without_acknowledgement_cause_an_abort() {
    let mut cell = Cell::ready();
    cell.pass(300);
    cell.controller.deaf_to_commands = true;
    cell.session.queue(speed(0.2)).expect("good");
    cell.pass(390);
    assert_eq!(cell.events().len(), 2);
    cell.pass(100);
    let silence = Duration::from_millis(400);
    let expired = Report::WatchdogExpired { channel: Channel::Command, silence };
    assert_eq!(cell.events()[2..4], [&expired, &Report::Standstill { done: CommandId(3) }]);
}

/// After a disturbance, half a message in the controller's memory swallows every command until the channel is opened
/// again. The second such epoch in sequence ends the connections. One acknowledged command resets the count.
#[test]
fn two_epochs_without_acknowledgement_close_the_connections() {
    let swallowed = |cell: &mut Cell| {
        cell.controller.deaf_to_commands = true;
        cell.session.queue(speed(0.2)).expect("good");
        cell.pass(500);
        cell.controller.deaf_to_commands = false;
    };
    let mut cell = Cell::ready();
    for _ in 0..3 {
        cell.pass(300);
        swallowed(&mut cell);
        assert!(cell.session.is_connected(), "once may be a disturbance");
        cell.pass(300);
        cell.open();
        cell.session.queue(speed(0.2)).expect("good");
    }
    cell.pass(300);
    swallowed(&mut cell);
    cell.pass(300);
    cell.open();
    swallowed(&mut cell);
    let why = LinkLoss::NotAcknowledged { epochs: 2 };
    assert!(!cell.session.is_connected());
    assert!(cell.events().contains(&&Report::LinkLost { why }), "{:?}", cell.events());
}

#[test]
fn impossible_numbers_end_the_epoch() {
    type Fault = fn(&mut Controller);
    let cases: [(Fault, SequenceError); 5] = [
        (|controller| controller.sequence += 1, SequenceError::State { last: 0, found: 2 }),
        (|controller| controller.sequence -= 1, SequenceError::State { last: 0, found: 0 }),
        (|controller| controller.answers_ahead = 100, SequenceError::Answer { found: 0, first: 0, last: 0 }),
        (
            |controller| controller.received += 90,
            SequenceError::Command {
                what: "received",
                found: CommandId(0),
                first: CommandId(0),
                last: CommandId(0),
            },
        ),
        (|controller| controller.epoch += 3, SequenceError::Epoch { found: Epoch(10), ours: Epoch(7) }),
    ];
    for (fault, expected) in cases {
        let mut cell = Cell::ready();
        cell.session.queue_path(&path(200, 2.0)).expect("a good path");
        cell.pass(1_000);
        fault(&mut cell.controller);
        cell.pass(100);
        let found = cell
            .reports
            .iter()
            .find_map(|report| if let Report::SequenceError(error) = report { Some(*error) } else { None });
        let found = found.unwrap_or_else(|| panic!("{expected}: {:?}", cell.events()));
        assert_eq!(std::mem::discriminant(&found), std::mem::discriminant(&expected), "{found}");
        assert!(cell.session.epoch().is_none(), "{found}");
    }
}

#[test]
fn messages_of_ended_epochs_are_dropped_and_counted() {
    let mut cell = Cell::ready();
    cell.pass(300);
    let late = "<Ack Rx=\"90\" Done=\"80\" Free=\"1\" Err=\"8\" ErrId=\"81\" Ep=\"5\"></Ack>";
    cell.session.push_command_bytes(late.as_bytes(), Time::from_ms(400));
    assert_eq!(cell.session.stale_messages(), 1);
    let own = late.replace("Ep=\"5\"", "Ep=\"7\"").replace("Rx=\"90\"", "Rx=\"2\"");
    assert!(cell.session.poll_report().is_none());
    cell.session.push_command_bytes(own.as_bytes(), Time::from_ms(400));
    assert!(
        matches!(cell.session.poll_report(), Some(Report::SequenceError(_))),
        "the same of our epoch is a fault"
    );
}

#[test]
fn an_emergency_stop_during_a_path_ends_the_epoch() {
    let cases = [(2, StopCause::EmergencyStop), (4, StopCause::GuardOpen), (1, StopCause::DrivesOff)];
    for (bit, cause) in cases {
        let mut cell = Cell::ready();
        cell.session.queue_path(&path(200, 2.0)).expect("a good path");
        cell.pass(1_000);
        cell.controller.flags = READY - bit;
        cell.pass(300);
        assert!(cell.reports.contains(&Report::Interrupted { cause }), "{cause}");
        assert_eq!(cell.controller.epoch, 8);
    }
}
