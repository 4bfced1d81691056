//! The session against a scripted controller, in virtual time, without a socket.

use super::*;
use crate::eki::fixture::wire;
use crate::eki::{
    EchoMismatch, FrameError, Refusal, SequenceError, SetAccSpeed, SetTcp, Signal, StopCause, TcpKind,
};
use crate::geometry::KukaPose;

/// A controller as the wire's description has it, as small as it can be: it executes so many commands a second
/// and answers at once.
struct Controller {
    now_ms: u64,
    epoch: u32,
    received: u32,
    done: u32,
    refused: Option<(u32, u32)>,
    ring: VecDeque<Vec<String>>,
    executed: Vec<(u32, u32)>,
    discarded: usize,
    frames: [Option<[String; 6]>; 2],
    sequence: u32,
    answered: u32,
    /// Added to what it says it answered.
    answers_ahead: u32,
    flags: u32,
    boot: u32,
    ms_per_command: u64,
    busy_until_ms: u64,
    ring_places: usize,
    silent: bool,
    deaf_to_commands: bool,
    most_in_ring: usize,
    command_bytes: Vec<u8>,
    state_bytes: Vec<u8>,
}

/// Drives on, no emergency stop, guard closed, motion possible.
const READY: u32 = 1 + 2 + 4 + 16;

impl Controller {
    fn new() -> Self {
        Controller {
            now_ms: 0,
            epoch: 6,
            received: 0,
            done: 0,
            refused: None,
            ring: VecDeque::new(),
            executed: Vec::new(),
            discarded: 0,
            frames: [None, None],
            sequence: 40,
            answered: 0,
            answers_ahead: 0,
            flags: READY,
            boot: 77,
            ms_per_command: 20,
            busy_until_ms: 0,
            ring_places: 100,
            silent: false,
            deaf_to_commands: false,
            most_in_ring: 0,
            command_bytes: Vec::new(),
            state_bytes: Vec::new(),
        }
    }

    /// The values between quotes of one document.
    fn take(&mut self, bytes: &[u8]) {
        let text = std::str::from_utf8(bytes).expect("ASCII");
        let values: Vec<String> = text.split('"').skip(1).step_by(2).map(str::to_owned).collect();
        let number = |index: usize| values[index].parse::<u32>().expect("a number");
        if text.starts_with("<Req ") {
            self.answered = number(0);
            match number(2) {
                11 | 12 if number(3) > self.epoch => self.begin(number(3)),
                _ => {}
            }
            self.send_state();
            return;
        }
        if self.deaf_to_commands || number(1) != self.epoch {
            return;
        }
        if number(0) != self.received + 1 {
            self.refused = Some((1, number(0)));
        } else {
            self.received += 1;
            self.ring.push_back(values);
            self.most_in_ring = self.most_in_ring.max(self.ring.len());
        }
        self.send_ack();
    }

    fn begin(&mut self, epoch: u32) {
        (self.epoch, self.received, self.done, self.refused) = (epoch, 0, 0, None);
        self.frames = [None, None];
        self.discarded += self.ring.len();
        self.ring.clear();
    }

    fn pass(&mut self, ms: u64) {
        self.now_ms += ms;
        while self.now_ms >= self.busy_until_ms
            && let Some(values) = self.ring.pop_front()
        {
            let number = |index: usize| values[index].parse::<u32>().expect("a number");
            if let (3 | 4, Some(frame)) = (number(2), values[7..].first_chunk::<6>()) {
                self.frames[number(2) as usize - 3] = Some(frame.clone());
            }
            self.done = number(0);
            self.executed.push((self.epoch, self.done));
            self.busy_until_ms = self.now_ms + self.ms_per_command;
            self.send_ack();
        }
        if self.now_ms.is_multiple_of(100) {
            self.send_state();
        }
    }

    fn send_ack(&mut self) {
        let (error, error_id) = self.refused.unwrap_or((0, 0));
        let free = self.ring_places - self.ring.len();
        let Controller { received, done, epoch, .. } = self;
        self.command_bytes.extend_from_slice(
            format!("<Ack Rx=\"{received}\" Done=\"{done}\" Free=\"{free}\" Err=\"{error}\" ErrId=\"{error_id}\" Ep=\"{epoch}\"></Ack>")
                .as_bytes(),
        );
    }

    fn send_state(&mut self) {
        self.sequence += 1;
        let bit = |frame: &Option<_>, bit: u32| if frame.is_some() { 1 << bit } else { 0 };
        let flags = self.flags + bit(&self.frames[0], 5) + bit(&self.frames[1], 6);
        let zero = [const { String::new() }; 6].map(|_| "0.000000".to_owned());
        let pose = |name: &str, numbers: &[String; 6]| {
            let [x, y, z, a, b, c] = numbers;
            format!("<{name} X=\"{x}\" Y=\"{y}\" Z=\"{z}\" A=\"{a}\" B=\"{b}\" C=\"{c}\"></{name}>")
        };
        let [base, tool] = [0, 1].map(|index: usize| self.frames[index].clone().unwrap_or(zero.clone()));
        let Controller { now_ms, sequence, epoch, boot, done, .. } = self;
        let answered = self.answered + self.answers_ahead;
        self.state_bytes.extend_from_slice(
            format!(
                "<St T=\"{now_ms}\" Seq=\"{sequence}\" Re=\"{answered}\" Ep=\"{epoch}\" Boot=\"{boot}\" Sum=\"5\" Mode=\"4\" \
                 Flags=\"{flags}\" In=\"0\" Out=\"0\" Done=\"{done}\" Under=\"0\"><J A1=\"0.0\" A2=\"-90.0\" A3=\"90.0\" \
                 A4=\"0.0\" A5=\"0.0\" A6=\"0.0\"></J>{}{}{}</St>",
                pose("Tcp", &zero),
                pose("Base", &base),
                pose("Tool", &tool)
            )
            .as_bytes(),
        );
    }
}

/// Session and controller, ten milliseconds at a time.
struct Cell {
    session: Session,
    controller: Controller,
    now_ms: u64,
    reports: Vec<Report>,
}

impl Cell {
    fn new() -> Self {
        let session = Session::new(wire(), LinkLimits::default(), Pace::Wall);
        Cell { session, controller: Controller::new(), now_ms: 0, reports: Vec::new() }
    }

    /// Connected, in an epoch, with base, tool and speed queued.
    fn ready() -> Self {
        Cell::ready_at(Pace::Wall)
    }

    fn ready_at(pace: Pace) -> Self {
        let mut cell = Cell::new();
        cell.session = Session::new(wire(), LinkLimits::default(), pace);
        cell.session.connected(Time::at_ms(0));
        cell.pass(100);
        cell.open();
        cell
    }

    fn open(&mut self) {
        let epoch = self.session.open_epoch().expect("connected");
        self.pass(100);
        assert!(self.reports.contains(&Report::EpochOpened { epoch }), "{:?}", self.events());
        for command in [base(400.0), tool(), speed(0.1)] {
            self.session.queue(command).expect("good");
        }
    }

    fn pass(&mut self, ms: u64) {
        for _ in 0..ms / 10 {
            self.exchange();
            self.now_ms += 10;
            self.controller.pass(10);
            self.exchange();
        }
    }

    fn exchange(&mut self) {
        let now = Time::at_ms(self.now_ms);
        if self.session.deadline().is_some_and(|at| at <= now) {
            self.session.time_passed(now);
        }
        while let Some((_, bytes)) = self.session.poll_transmit(now) {
            self.controller.take(&bytes);
        }
        let (command, state) =
            (std::mem::take(&mut self.controller.command_bytes), std::mem::take(&mut self.controller.state_bytes));
        if !self.controller.silent {
            self.session.push_command_bytes(&command, now);
            self.session.push_state_bytes(&state, now);
        }
        while let Some(report) = self.session.poll_report() {
            self.reports.push(report);
        }
    }

    /// What was told, without the states and the progress.
    fn events(&self) -> Vec<&Report> {
        let is_event = |report: &&Report| !matches!(report, Report::State(_) | Report::Progress { .. });
        self.reports.iter().filter(is_event).collect()
    }
}

fn base(x_mm: f64) -> Command {
    Command::SetBase(KukaPose { x_mm, a_deg: 30.0, ..KukaPose::default() })
}

fn tool() -> Command {
    let flange_from_tool = KukaPose { z_mm: 120.0, ..KukaPose::default() };
    Command::SetTcp(SetTcp { flange_from_tool, kind: TcpKind::Sanding })
}

fn speed(speed_m_s: f64) -> Command {
    Command::SetAccSpeed(SetAccSpeed {
        speed_m_s,
        acceleration_m_s2: 1.0,
        axis_speed_percent: 30,
        axis_acceleration_percent: 30,
    })
}

/// A straight path of points so far apart.
fn path(points: usize, step_mm: f64) -> Vec<MoveLin> {
    let point = |index: usize| {
        let pose = KukaPose { x_mm: step_mm * index as f64, ..KukaPose::default() };
        MoveLin { pose, blend_mm: 1.0, contact: true, speed_m_s: None }
    };
    (0..points).map(point).collect()
}

/// 200 points 1 mm apart at 100 mm/s are 10 ms each, 100 of them a second: 50 commands are ahead and never more.
#[test]
fn two_hundred_points_are_executed_once_inside_the_window() {
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

/// The arm stands on the first point, which takes no time; 10 mm at 100 mm/s are 0.1 s: ten more are a second.
#[test]
fn the_window_is_also_time() {
    let mut cell = Cell::ready();
    cell.pass(200);
    cell.controller.ms_per_command = 100;
    cell.session.queue_path(&path(60, 10.0)).expect("a good path");
    cell.pass(8_000);
    assert_eq!((cell.controller.most_in_ring, cell.controller.done), (11, 63));
}

/// 100 mm at 100 mm/s are a second each, and still five are ahead, so that the controller can blend.
#[test]
fn a_few_points_are_ahead_whatever_they_last() {
    let mut cell = Cell::ready();
    cell.pass(200);
    cell.controller.ms_per_command = 1_000;
    cell.session.queue_path(&path(12, 100.0)).expect("a good path");
    cell.pass(8_000);
    assert_eq!(cell.controller.most_in_ring, 5);
}

/// A free ring of eight places never holds a ninth command, whatever the window says.
#[test]
fn the_rings_free_places_are_kept() {
    let mut cell = Cell::ready();
    cell.controller.ring_places = 8;
    cell.pass(300);
    cell.session.queue_path(&path(100, 2.0)).expect("a good path");
    cell.pass(4_000);
    assert_eq!((cell.controller.most_in_ring, cell.controller.done), (8, 103));
}

/// Without an acknowledgement no more than 8 KiB are under way. In lock step an answered heartbeat is one for the
/// commands that it names: then the window fills to its 50.
#[test]
fn bytes_not_yet_received_are_bounded() {
    let mut cell = Cell::ready_at(Pace::LockStep);
    cell.pass(300);
    let mut points = path(200, 1.0);
    for MoveLin { pose, .. } in &mut points {
        // Ten whole turns: the same place in more bytes.
        (pose.a_deg, pose.b_deg, pose.c_deg) = (-3_600.0, -3_600.0, -3_600.0);
    }
    cell.session.queue_path(&points).expect("a good path");
    let now = Time::at_ms(cell.now_ms);
    let send = |session: &mut Session| -> Vec<usize> {
        std::iter::from_fn(|| session.poll_transmit(now)).map(|(_, bytes)| bytes.len()).collect()
    };
    let first = send(&mut cell.session);
    let bytes: usize = first.iter().sum();
    assert!((8 * 1024 - 250..=8 * 1024).contains(&bytes) && first.len() < 50, "{bytes} bytes");
    cell.session.heartbeat(now);
    let (_, request) = cell.session.poll_transmit(now).expect("a heartbeat");
    cell.controller.take(&request);
    cell.session.push_state_bytes(&std::mem::take(&mut cell.controller.state_bytes), now);
    assert_eq!(first.len() + send(&mut cell.session).len(), 50);
}

/// Straight lines wait until the state shows base and tool, and not for less.
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

/// The echo holds for as long as the epoch: somebody who changes the base on the pendant ends it.
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

/// Aborted, the queue is gone on both sides, and a new epoch begins with nothing.
#[test]
fn an_abort_discards_and_nothing_of_the_old_epoch_moves_again() {
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
fn standstill_is_told_only_when_the_robot_stands() {
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

/// The last state is of 1,200 ms; 400 ms later the abort is on the wire, and after a second the link is given up.
#[test]
fn silence_with_a_path_underway_aborts_and_then_gives_up() {
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
    assert!(matches!(cell.events()[..], [.., Report::LinkLost { why: LinkLoss::Silent { .. } }]));
    assert!(!cell.session.is_connected());
}

#[test]
fn silence_of_an_idle_robot_is_only_a_lost_link() {
    let mut cell = Cell::ready();
    cell.pass(300);
    cell.controller.silent = true;
    cell.pass(950);
    assert_eq!(cell.events().len(), 2);
    cell.pass(100);
    let silent = LinkLoss::Silent { channel: Channel::State, silence_ms: 1_000 };
    assert_eq!(cell.events()[2..], [&Report::LinkLost { why: silent }]);
}

/// States keep coming, but the commands are swallowed: the robot would run dry without a word.
#[test]
fn commands_that_are_not_acknowledged_abort() {
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

#[test]
fn wrong_counts_end_the_epoch() {
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
    cell.session.push_command_bytes(late.as_bytes(), Time::at_ms(400));
    assert_eq!(cell.session.stale_messages(), 1);
    let own = late.replace("Ep=\"5\"", "Ep=\"7\"").replace("Rx=\"90\"", "Rx=\"2\"");
    assert!(cell.session.poll_report().is_none());
    cell.session.push_command_bytes(own.as_bytes(), Time::at_ms(400));
    assert!(
        matches!(cell.session.poll_report(), Some(Report::SequenceError(_))),
        "the same of our epoch is a fault"
    );
}

#[test]
fn an_emergency_stop_on_the_way_ends_the_epoch() {
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

#[test]
fn another_boot_ends_the_epoch_and_no_number_comes_again() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    (cell.controller.boot, cell.controller.sequence) = (78, 0);
    cell.controller.begin(0);
    cell.pass(200);
    assert!(matches!(cell.events()[..], [.., Report::Rebooted { .. }]), "{:?}", cell.events());
    assert_eq!(cell.session.queue(speed(0.1)), Err(QueueError::NoEpoch));
    assert_eq!(cell.session.open_epoch(), Ok(Epoch(8)));
}

/// A malformed message with a path underway: the abort still goes out, then the link is closed.
#[test]
fn a_broken_stream_aborts_and_closes() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.session.push_state_bytes(b"<!DOCTYPE x>", Time::at_ms(cell.now_ms));
    assert!(!cell.session.is_connected());
    let transmitted = std::iter::from_fn(|| cell.session.poll_transmit(Time::at_ms(cell.now_ms)));
    let last = transmitted.map(|(_, bytes)| String::from_utf8(bytes).expect("ASCII")).last();
    assert!(last.as_deref().is_some_and(|text| text.contains("Op=\"11\" N1=\"8\"")), "{last:?}");
    let report = cell.session.poll_report();
    let Some(Report::LinkLost { why: LinkLoss::Frame { channel, error } }) = report else { panic!("{report:?}") };
    assert!(matches!((channel, error), (Channel::State, FrameError::Declaration { .. })), "{error}");
}

/// A new connection asks for the state and nothing else, whatever was queued before.
#[test]
fn a_reconnection_moves_nothing() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(1_000);
    cell.session.disconnected(LinkLoss::Closed { channel: Channel::Command });
    let left = std::iter::from_fn(|| cell.session.poll_transmit(Time::at_ms(cell.now_ms)));
    assert!(left.into_iter().all(|(channel, _)| channel == Channel::State), "a command after the link was lost");
    cell.controller.begin(7);
    cell.controller.answered = 0;
    let executed = cell.controller.executed.len();
    cell.session.connected(Time::at_ms(cell.now_ms));
    cell.pass(2_000);
    assert_eq!(cell.controller.executed.len(), executed);
    assert!(matches!(cell.events()[..], [.., Report::LinkLost { .. }, Report::Connected { .. }]));
    assert_eq!(cell.session.epoch(), None);
    assert_eq!(cell.session.queue(speed(0.1)), Err(QueueError::NoEpoch));
}

#[test]
fn what_cannot_be_executed_is_refused_where_it_is_queued() {
    let mut cell = Cell::ready();
    assert_eq!(cell.session.queue_path(&[]), Err(QueueError::EmptyPath));
    let mut bad = path(3, 2.0);
    bad[2].pose.y_mm = f64::NAN;
    assert!(matches!(cell.session.queue_path(&bad), Err(QueueError::Command(_))));
    let input = Command::SetDigin(Signal { number: 3, on: true });
    let read_only = QueueError::Command(CommandError::InputReadOnly { number: 3 });
    assert_eq!(cell.session.queue(input), Err(read_only));
    // Nothing of the three was queued: the next id follows on base, tool and speed.
    assert_eq!(cell.session.queue_path(&path(1, 2.0)), Ok(CommandId(4)));
    assert_eq!(cell.session.open_epoch(), Err(QueueError::NotStanding));
    let mut offline = Session::new(wire(), LinkLimits::default(), Pace::Wall);
    assert_eq!(offline.queue(speed(0.1)), Err(QueueError::NotConnected));
    assert_eq!(offline.open_epoch(), Err(QueueError::NotConnected));
}

/// In lock step there is no deadline, and an answered heartbeat says that what it named has arrived.
#[test]
fn in_lock_step_only_heartbeats_pass_time() {
    let mut cell = Cell::new();
    cell.session = Session::new(wire(), LinkLimits::default(), Pace::LockStep);
    cell.session.connected(Time::at_ms(0));
    cell.exchange();
    cell.session.open_epoch().expect("connected");
    cell.exchange();
    assert_eq!(cell.session.deadline(), None);
    cell.controller.silent = true;
    cell.session.queue(speed(0.1)).expect("good");
    cell.exchange();
    cell.session.time_passed(Time::at_ms(60_000));
    assert!(cell.session.is_connected() && cell.session.epoch().is_some());
    assert!(!cell.session.awaits_answer());
    cell.session.heartbeat(Time::at_ms(0));
    assert!(cell.session.awaits_answer());
}

/// A state that begins at 300 ms and has not ended at 500 never will; one that ends in time is one.
#[test]
fn a_message_has_200_ms_from_its_first_byte_to_its_last() {
    let mut cell = Cell::ready();
    cell.pass(100);
    let now_ms = cell.now_ms;
    cell.session.push_command_bytes(b"<Ack Rx=\"0\"", Time::at_ms(now_ms));
    let at = |session: &Session| session.deadline().expect("connected").since_start().as_millis() as u64;
    assert!(at(&cell.session) <= now_ms + 200);
    cell.session.time_passed(Time::at_ms(now_ms + 199));
    assert!(cell.session.is_connected());
    cell.session.time_passed(Time::at_ms(now_ms + 200));
    cell.exchange();
    let unfinished = LinkLoss::Unfinished { channel: Channel::Command, waited_ms: 200 };
    assert_eq!(cell.events().last(), Some(&&Report::LinkLost { why: unfinished }));
}

/// Request 2³¹ − 1 is the last: the connection ends, and the next one counts from 1.
#[test]
fn requests_do_not_wrap() {
    let mut cell = Cell::ready();
    cell.pass(100);
    cell.session.asked = LAST_NUMBER;
    cell.session.heartbeat(Time::at_ms(cell.now_ms));
    assert!(!cell.session.is_connected());
    let exhausted = LinkLoss::RequestsExhausted { most: LAST_NUMBER };
    assert_eq!(cell.session.poll_report(), Some(Report::LinkLost { why: exhausted }));
    cell.session.connected(Time::at_ms(cell.now_ms));
    let (_, request) = cell.session.poll_transmit(Time::at_ms(cell.now_ms)).expect("asks");
    assert!(request.starts_with(b"<Req Id=\"1\""));
}

/// An acknowledgement of an epoch that is not ours ends ours, and the abort's number is above it.
#[test]
fn another_clients_epoch_is_told_and_left_behind() {
    let mut cell = Cell::ready();
    cell.session.queue_path(&path(200, 2.0)).expect("a good path");
    cell.pass(500);
    let foreign = "<Ack Rx=\"0\" Done=\"0\" Free=\"100\" Err=\"0\" ErrId=\"0\" Ep=\"20\"></Ack>";
    cell.session.push_command_bytes(foreign.as_bytes(), Time::at_ms(cell.now_ms));
    cell.pass(300);
    assert!(matches!(
        cell.events()[2..],
        [Report::SequenceError(SequenceError::Epoch { .. }), Report::Standstill { .. }]
    ));
    assert_eq!(cell.controller.epoch, 21);
}
