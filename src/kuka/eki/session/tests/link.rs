//! Tests the connection: restarts of the controller, invalid data, reconnection, refused commands, lock step.

use super::*;

#[test]
fn a_restart_ends_the_epoch_and_its_number_is_not_used_again() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    (cell.controller.boot, cell.controller.sequence) = (78, 0);
    cell.controller.begin(0);
    cell.pass(200);
    // An abort is sent for the old epoch, in case the controller has not really restarted.
    assert!(
        matches!(cell.events()[..], [.., Report::Rebooted { .. }, Report::Standstill { .. }]),
        "{:?}",
        cell.events()
    );
    assert_eq!(cell.session.queue(speed(0.1)), Err(QueueError::NoEpoch));
    assert_eq!(cell.session.open_epoch(), Ok(Epoch(8)));
}

/// The response to the request for an epoch was lost with the link, and the controller counts from zero again. The
/// epoch that it may have opened is not opened a second time.
#[test]
fn an_epoch_that_was_requested_but_not_confirmed_is_never_used_again() {
    let mut cell = Cell::ready();
    cell.pass(200);
    cell.controller.silent = true;
    let asked = cell.session.open_epoch().expect("it stands");
    cell.pass(50);
    assert_eq!(cell.controller.epoch, asked.0, "the controller has opened it");
    cell.session.disconnected(LinkLoss::Closed { channel: Channel::State });
    while cell.session.poll_transmit(Time::from_ms(cell.now_ms)).is_some() {}
    cell.controller.begin(0);
    (cell.controller.boot, cell.controller.sequence, cell.controller.answered) = (78, 0, 0);
    cell.controller.silent = false;
    cell.session.connected(Time::from_ms(cell.now_ms));
    cell.pass(200);
    let next = cell.session.open_epoch().expect("connected");
    assert!(next > asked, "{next:?} after {asked:?}");
}

/// A malformed message arrives during a path: the abort is still sent, then the link is closed.
#[test]
fn an_invalid_message_aborts_and_closes_the_link() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.session.push_state_bytes(b"<!DOCTYPE x>", Time::from_ms(cell.now_ms));
    assert!(!cell.session.is_connected());
    let transmitted = std::iter::from_fn(|| cell.session.poll_transmit(Time::from_ms(cell.now_ms)));
    let last = transmitted.map(|(_, bytes)| String::from_utf8(bytes).expect("ASCII")).last();
    assert!(last.as_deref().is_some_and(|text| text.contains("Op=\"11\" N1=\"8\"")), "{last:?}");
    let report = cell.session.poll_report();
    let Some(Report::LinkLost { why: LinkLoss::Frame { channel, error } }) = report else { panic!("{report:?}") };
    assert!(matches!((channel, error), (Channel::State, FrameError::Declaration { .. })), "{error}");
}

/// On a new connection only the state is requested, even if commands were queued before.
#[test]
fn a_reconnection_moves_nothing() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.session.disconnected(LinkLoss::Closed { channel: Channel::Command });
    let left = std::iter::from_fn(|| cell.session.poll_transmit(Time::from_ms(cell.now_ms)));
    assert!(left.into_iter().all(|(channel, _)| channel == Channel::State), "a command after the link was lost");
    cell.controller.begin(7);
    cell.controller.answered = 0;
    let executed = cell.controller.executed.len();
    cell.session.connected(Time::from_ms(cell.now_ms));
    cell.pass(2_000);
    assert_eq!(cell.controller.executed.len(), executed);
    assert!(matches!(cell.events()[..], [.., Report::LinkLost { .. }, Report::Connected { .. }]));
    assert_eq!(cell.session.epoch(), None);
    assert_eq!(cell.session.queue(speed(0.1)), Err(QueueError::NoEpoch));
}

#[test]
fn commands_that_cannot_be_executed_are_refused_when_queued() {
    let mut cell = Cell::ready();
    assert_eq!(cell.session.queue_path(&[]), Err(QueueError::EmptyPath));
    let mut bad = path(3, 2.0);
    bad[2].pose.y_mm = f64::NAN;
    assert!(matches!(cell.session.queue_path(&bad), Err(QueueError::Command(_))));
    let input = Command::SetDigin(Signal { number: 3, on: true });
    let read_only = QueueError::Command(CommandError::InputReadOnly { number: 3 });
    assert_eq!(cell.session.queue(input), Err(read_only));
    let mapped_inputs = MappedInputs::new([3]).expect("one");
    cell.session.limits = LinkLimits { mapped_inputs, ..LinkLimits::default() };
    let unmapped = Command::SetDigin(Signal { number: 4, on: true });
    assert!(matches!(cell.session.queue(unmapped), Err(QueueError::Command(_))));
    // None of the refused commands was queued: the next id follows those of base, tool and speed.
    assert_eq!(cell.session.queue_path(&path(1, 2.0)), Ok(CommandId(4)));
    assert_eq!(cell.session.queue(input), Ok(CommandId(5)));
    assert_eq!(cell.session.open_epoch(), Err(QueueError::NotStanding));
    let mut offline = Session::new(wire(), LinkLimits::default(), ClockMode::Wall);
    assert_eq!(offline.queue(speed(0.1)), Err(QueueError::NotConnected));
    assert_eq!(offline.open_epoch(), Err(QueueError::NotConnected));
}

/// In lock step there is no deadline, and a reply to a heartbeat shows that the commands it names have arrived.
#[test]
fn in_lock_step_only_heartbeats_advance_the_time() {
    let mut cell = Cell::new();
    cell.session = Session::new(wire(), LinkLimits::default(), ClockMode::LockStep);
    cell.session.connected(Time::from_ms(0));
    cell.exchange();
    cell.session.open_epoch().expect("connected");
    cell.exchange();
    assert_eq!(cell.session.deadline(), None);
    cell.controller.silent = true;
    cell.session.queue(speed(0.1)).expect("good");
    cell.exchange();
    cell.session.time_passed(Time::from_ms(60_000));
    assert!(cell.session.is_connected() && cell.session.epoch().is_some());
    assert!(!cell.session.awaits_answer());
    cell.session.heartbeat(Time::from_ms(0));
    assert!(cell.session.awaits_answer());
}

/// A state message that begins at 300 ms and has not ended at 500 ms is treated as never ending; one that ends in time
/// is accepted.
#[test]
fn a_message_has_200_ms_from_its_first_byte_to_its_last() {
    let mut cell = Cell::ready();
    cell.pass(100);
    let now_ms = cell.now_ms;
    cell.session.push_command_bytes(b"<Ack Rx=\"0\"", Time::from_ms(now_ms));
    let at = |session: &Session| session.deadline().expect("connected").since_start().as_millis() as u64;
    assert!(at(&cell.session) <= now_ms + 200);
    cell.session.time_passed(Time::from_ms(now_ms + 199));
    assert!(cell.session.is_connected());
    cell.session.time_passed(Time::from_ms(now_ms + 200));
    cell.exchange();
    let unfinished = LinkLoss::Unfinished { channel: Channel::Command, waited_ms: 200 };
    assert_eq!(cell.events().last(), Some(&&Report::LinkLost { why: unfinished }));
}

/// Request 2³¹ − 1 is the last one: the connection ends, and the next connection counts from 1.
#[test]
fn request_numbers_do_not_wrap() {
    let mut cell = Cell::ready();
    cell.pass(100);
    cell.session.asked = LAST_NUMBER;
    cell.session.heartbeat(Time::from_ms(cell.now_ms));
    assert!(!cell.session.is_connected());
    let exhausted = LinkLoss::RequestsExhausted { most: LAST_NUMBER };
    assert_eq!(cell.session.poll_report(), Some(Report::LinkLost { why: exhausted }));
    cell.session.connected(Time::from_ms(cell.now_ms));
    let (_, request) = cell.session.poll_transmit(Time::from_ms(cell.now_ms)).expect("asks");
    assert!(request.starts_with(b"<Req Id=\"1\""));
}

/// An acknowledgement with the epoch of another client ends the epoch of this client. The number in the abort is above
/// the other client's epoch.
#[test]
fn an_epoch_of_another_client_is_reported_and_exceeded() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(500);
    let foreign = "<Ack Rx=\"0\" Done=\"0\" Free=\"100\" Err=\"0\" ErrId=\"0\" Ep=\"20\"></Ack>";
    cell.session.push_command_bytes(foreign.as_bytes(), Time::from_ms(cell.now_ms));
    cell.pass(300);
    assert!(matches!(
        cell.events()[2..],
        [Report::SequenceError(SequenceError::Epoch { .. }), Report::Standstill { .. }]
    ));
    assert_eq!(cell.controller.epoch, 21);
}

/// If a channel is closed before the first message, another client is connected; if it receives a message of the other
/// channel, the ports are exchanged. After a first message, both are reported as they are: a closed channel and an
/// invalid message.
#[test]
fn the_end_of_a_connection_before_its_first_message_has_its_own_cause() {
    let losses = |after_a_word: bool| {
        let closed = LinkLoss::Closed { channel: Channel::State };
        let mut first = Cell::new();
        let mut second = Cell::new();
        for cell in [&mut first, &mut second] {
            cell.session.connected(Time::from_ms(0));
            if after_a_word {
                cell.pass(200);
            }
        }
        first.session.disconnected(closed);
        second.session.push_state_bytes(
            b"<Ack Rx=\"0\" Done=\"0\" Free=\"100\" Err=\"0\" ErrId=\"0\" Ep=\"0\"></Ack>",
            Time::from_ms(second.now_ms),
        );
        [first, second].map(|mut cell| {
            let reports = std::iter::from_fn(|| cell.session.poll_report()).chain(cell.reports.clone());
            let losses = reports.filter_map(|report| match report {
                Report::LinkLost { why } => Some(why),
                _ => None,
            });
            losses.last().expect("lost")
        })
    };
    let channel = Channel::State;
    assert_eq!(losses(false), [LinkLoss::Occupied { channel }, LinkLoss::PortsExchanged { channel }]);
    let [first, second] = losses(true);
    assert!(
        first == LinkLoss::Closed { channel } && matches!(second, LinkLoss::Message { .. }),
        "{first} {second}"
    );
}
