//! Tests of the link over the loopback interface: its reports about a missing controller, and paths with the mock
//! controller.

use super::*;
use crate::mock::{self, MockServer};
use panelprep_base::geometry::{Base, Flange, Joints, KukaPose, Tool};
use panelprep_kuka::eki::{
    CELLCMD, CELLSTAT, Channel, ClockMode, Command, CommandId, LinkLimits, LinkLoss, MoveJ, MoveLin, QueueError,
    Report, SetAccSpeed, SetTcp, TcpKind,
};
use std::io::Write;
use std::net::TcpListener;
use std::time::Duration;

fn address(command: &TcpListener, state: &TcpListener) -> Address {
    let port = |listener: &TcpListener| listener.local_addr().expect("bound").port();
    Address { host: "127.0.0.1".to_owned(), command_port: port(command), state_port: port(state) }
}

fn listener() -> TcpListener {
    TcpListener::bind("127.0.0.1:0").expect("a free port")
}

fn first_loss(address: Address) -> LinkLoss {
    let mut link = BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts");
    let report = link.next(Duration::from_secs(5));
    assert_eq!(link.open_epoch(), Err(QueueError::NotConnected));
    let Some(Report::LinkLost { why }) = report else { panic!("{report:?}") };
    assert_eq!(link.next(Duration::from_millis(500)), None, "the same trouble is reported once");
    why
}

#[test]
fn a_port_without_a_listener_is_reported_as_refused() {
    let address = address(&listener(), &listener());
    let why = first_loss(address);
    assert!(matches!(why, LinkLoss::Refused { channel: Channel::Command, .. }), "{why}");
}

#[test]
fn a_controller_that_sends_nothing_is_reported_as_silent() {
    let (command, state) = (listener(), listener());
    let why = first_loss(address(&command, &state));
    assert!(matches!(why, LinkLoss::Silent { channel: Channel::State, silence_ms: 1_000..1_500 }), "{why}");
}

#[test]
fn a_controller_that_closes_at_once_has_another_client() {
    let (command, state) = (listener(), listener());
    let address = address(&command, &state);
    let server = std::thread::spawn(move || {
        let connection = state.accept().map(|(stream, _)| stream);
        std::thread::sleep(Duration::from_millis(50));
        drop((connection, state, command));
    });
    let why = first_loss_of_any(address);
    server.join().expect("ends");
    assert!(matches!(why, LinkLoss::Occupied { .. }) && why.to_string().contains("another client"), "{why}");
}

fn first_loss_of_any(address: Address) -> LinkLoss {
    let mut link = BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts");
    let report = link.next(Duration::from_secs(5));
    let Some(Report::LinkLost { why }) = report else { panic!("{report:?}") };
    why
}

/// Starts a mock controller with this clock mode, and a link to it.
fn cell(pace: ClockMode) -> (MockServer, BlockingLink) {
    let [commands, states] =
        [CELLCMD, CELLSTAT].map(|text| mock::ChannelFile::parse(text).expect("a shipped file"));
    let clock = if pace == ClockMode::Wall { mock::Clock::Free } else { mock::Clock::LockStep };
    let setup = mock::Setup { clock, ..mock::Setup::new(commands, states) };
    let controller = mock::Controller::new(setup, Box::new(mock::UnconnectedWorld)).expect("fits");
    let server = MockServer::start(controller, mock::Ports::free_ports()).expect("starts");
    let address = Address {
        host: "127.0.0.1".to_owned(),
        command_port: server.command_address().port(),
        state_port: server.state_address().port(),
    };
    let link = BlockingLink::start(address, LinkLimits::default(), pace).expect("starts");
    (server, link)
}

/// Waits for the first report for which `found` returns a value. Reports of state and progress before it are ignored.
fn wait<T>(link: &mut BlockingLink, found: impl Fn(&Report) -> Option<T>) -> T {
    for _ in 0..2_000 {
        let report = link.next(Duration::from_secs(20)).expect("the controller continues");
        if let Some(found) = found(&report) {
            return found;
        }
        let passes = matches!(report, Report::State(_) | Report::Progress { .. });
        assert!(passes, "unexpected: {report:?}");
    }
    panic!("two thousand reports and not the one");
}

/// Sets base and tool at the arm's position, and moves the arm once around a circle with a radius of 40 mm.
fn circle(pace: ClockMode, points: usize, speed_m_s: f64) -> (Vec<mock::ExecutedMotion>, i32, Vec<CommandId>) {
    let (server, mut link) = cell(pace);
    let state = wait(&mut link, |report| match report {
        Report::Connected { state } => Some(**state),
        _ => None,
    });
    link.open_epoch().expect("connected");
    wait(&mut link, |report| matches!(report, Report::EpochOpened { .. }).then_some(()));
    let flange_from_tool = KukaPose { z_mm: 100.0, ..KukaPose::default() };
    let tip = state.base_from_tcp.to_rigid::<Base, Flange>() * flange_from_tool.to_rigid::<Flange, Tool>();
    let tip = KukaPose::from_rigid(&tip);
    let base = KukaPose { a_deg: 0.0, b_deg: 0.0, c_deg: 0.0, ..tip };
    let speed =
        SetAccSpeed { speed_m_s, acceleration_m_s2: 1.0, axis_speed_percent: 30, axis_acceleration_percent: 30 };
    link.send(Command::SetBase(base)).expect("good");
    link.send(Command::SetTcp(SetTcp { flange_from_tool, kind: TcpKind::Other })).expect("good");
    link.send(Command::SetAccSpeed(speed)).expect("good");
    let point = |index: usize| {
        let turn = std::f64::consts::TAU * (index + 1) as f64 / points as f64;
        let (y_mm, z_mm) = (40.0 * turn.sin(), 40.0 * (1.0 - turn.cos()));
        MoveLin { pose: KukaPose { x_mm: 0.0, y_mm, z_mm, ..tip }, blend_mm: 0.2, contact: false, speed_m_s: None }
    };
    let last = link.send_path((0..points).map(point).collect()).expect("a good path");
    let mut progress = Vec::new();
    loop {
        let report = link.next(Duration::from_secs(20)).expect("the controller continues");
        match report {
            Report::State(_) => {}
            Report::Progress { done } => progress.push(done),
            Report::PathDone { last: done } => break assert_eq!(done, last),
            other => panic!("unexpected: {other:?}"),
        }
    }
    server.handle().with_controller(|controller| {
        (controller.executed_motions().to_vec(), controller.underrun_count(), progress)
    })
}

/// The pause is longer than the timeout of a silent controller. During a computation the virtual time does not advance
/// and nothing is requested, so the pause is no silence.
#[test]
fn a_pause_between_two_requests_is_no_silence_in_lock_step() {
    let (_server, mut link) = cell(ClockMode::LockStep);
    let mut heard = |count: usize| {
        (0..count).for_each(|_| {
            let report = link.next(Duration::from_secs(30));
            assert!(matches!(report, Some(Report::Connected { .. } | Report::State(_))), "{report:?}");
        });
    };
    heard(3);
    std::thread::sleep(Duration::from_millis(10_300));
    heard(3);
}

/// Sends base, tool, speed and 500 points: each point is executed once, in order, without an underrun, and acknowledged
/// once.
#[test]
fn five_hundred_points_are_executed_once_in_lock_step() {
    let (executed, underruns, progress) = circle(ClockMode::LockStep, 500, 0.04);
    let ids: Vec<i32> = executed.iter().map(|step| step.id).collect();
    assert_eq!(ids, (4..=503).collect::<Vec<i32>>());
    assert_eq!(underruns, 0);
    assert!(progress.is_sorted_by(|one, next| one < next) && progress.last() == Some(&CommandId(503)));
    // Expected time, calculated by hand: 2π·40 mm = 251.3 mm at 40 mm/s take 6.28 s, minus the first point, plus
    // acceleration and braking at the ends.
    let took_ms = executed[499].time_ms - executed[0].time_ms;
    assert!((6_200..6_500).contains(&took_ms), "{took_ms} ms");
    // In virtual time a second run is equal bit for bit, regardless of the speed of the computer.
    assert_eq!(circle(ClockMode::LockStep, 500, 0.04).0, executed);
}

/// A circle on the wall clock: 63 points at a spacing of 4 mm and 200 mm/s take 1.3 s. Heartbeats and watchdog use the
/// computer's clock.
#[test]
fn a_path_runs_on_the_wall_clock() {
    let (executed, underruns, progress) = circle(ClockMode::Wall, 63, 0.2);
    assert_eq!(executed.iter().map(|step| step.id).collect::<Vec<i32>>(), (4..=66).collect::<Vec<i32>>());
    assert_eq!((underruns, progress.last()), (0, Some(&CommandId(66))));
}

#[test]
fn an_abort_on_the_path_ends_in_standstill() {
    let (server, mut link) = cell(ClockMode::LockStep);
    wait(&mut link, |report| matches!(report, Report::Connected { .. }).then_some(()));
    link.open_epoch().expect("connected");
    wait(&mut link, |report| matches!(report, Report::EpochOpened { .. }).then_some(()));
    let joints = Joints { a1_deg: 60.0, a2_deg: -90.0, a3_deg: 90.0, a4_deg: 0.0, a5_deg: 60.0, a6_deg: 0.0 };
    link.send(Command::MoveJ(MoveJ { joints, axis_speed_percent: 20.0 })).expect("good");
    wait(&mut link, |report| match report {
        Report::State(state) => state.moving.then_some(()),
        _ => None,
    });
    link.abort().expect("connected");
    let done = wait(&mut link, |report| match report {
        Report::Standstill { done } => Some(*done),
        _ => None,
    });
    assert_eq!(done, CommandId(0));
    server.handle().with_controller(|controller| {
        assert!(controller.executed_motions().is_empty() && !controller.is_moving());
        assert!(controller.joints().a1_deg.abs() > 0.1, "it had begun");
    });
}

/// The controller's programs restart while a path is queued: the link reconnects automatically and nothing moves.
#[test]
fn a_reconnected_link_moves_nothing() {
    let (server, mut link) = cell(ClockMode::LockStep);
    wait(&mut link, |report| matches!(report, Report::Connected { .. }).then_some(()));
    link.open_epoch().expect("connected");
    wait(&mut link, |report| matches!(report, Report::EpochOpened { .. }).then_some(()));
    let joints = Joints { a1_deg: 60.0, a2_deg: -90.0, a3_deg: 90.0, a4_deg: 0.0, a5_deg: 60.0, a6_deg: 0.0 };
    for _ in 0..3 {
        link.send(Command::MoveJ(MoveJ { joints, axis_speed_percent: 20.0 })).expect("good");
    }
    server.handle().with_controller(|controller| controller.disconnect(mock::Channel::Command));
    // Each channel has its own socket, so the state channel may report the stop before the end of the command channel
    // is detected.
    wait(&mut link, |report| matches!(report, Report::LinkLost { .. } | Report::Interrupted { .. }).then_some(()));
    while !matches!(link.next(Duration::from_secs(20)).expect("the controller continues"), Report::Connected { .. })
    {
    }
    for _ in 0..20 {
        wait(&mut link, |report| matches!(report, Report::State(_)).then_some(()));
    }
    server
        .handle()
        .with_controller(|controller| assert!(controller.executed_motions().is_empty() && !controller.is_moving()));
    assert_eq!(link.send(Command::CallSubroutine { index: 0 }), Err(QueueError::NoEpoch));
}

/// A controller reports its state but reads nothing. The unanswered abort ends the connections, which stops a real
/// controller.
#[test]
fn an_abort_to_a_peer_that_does_not_read_ends_the_link() {
    let (command, state) = (listener(), listener());
    let address = address(&command, &state);
    let server = std::thread::spawn(move || {
        let (Ok((_commands, _)), Ok((mut states, _))) = (command.accept(), state.accept()) else { return };
        for sequence in 1..200 {
            let pose = |name: &str| {
                format!("<{name} X=\"0.0\" Y=\"0.0\" Z=\"0.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\"></{name}>")
            };
            let text = format!(
                "<St T=\"{sequence}\" Seq=\"{sequence}\" Re=\"1\" Ep=\"6\" Boot=\"1\" Sum=\"5\" Mode=\"4\" Flags=\"23\" In=\"0\" \
                 Out=\"0\" Done=\"0\" Under=\"0\" Ov=\"100\"><J A1=\"0.0\" A2=\"-90.0\" A3=\"90.0\" A4=\"0.0\" A5=\"0.0\" A6=\"0.0\"></J>{}{}{}</St>",
                pose("Tcp"),
                pose("Base"),
                pose("Tool")
            );
            if states.write_all(text.as_bytes()).is_err() {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    });
    let mut link = BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts");
    let wait = |link: &mut BlockingLink, found: &dyn Fn(&Report) -> bool| loop {
        let report = link.next(Duration::from_secs(5)).expect("something is reported");
        if found(&report) {
            return report;
        }
    };
    wait(&mut link, &|report| matches!(report, Report::Connected { .. }));
    let asked = std::time::Instant::now();
    link.abort().expect("connected");
    let lost = wait(&mut link, &|report| matches!(report, Report::LinkLost { .. }));
    let waited = asked.elapsed();
    assert!(matches!(lost, Report::LinkLost { why: LinkLoss::AbortNotAnswered { .. } }), "{lost:?}");
    assert!(waited < Duration::from_millis(900), "{waited:?}");
    server.join().expect("ends");
}
