//! The link over loopback, without a controller behind it: what it says about a controller that is not there.

use super::*;
use crate::eki::Channel;
use std::net::TcpListener;

fn address(command: &TcpListener, state: &TcpListener) -> Address {
    let port = |listener: &TcpListener| listener.local_addr().expect("bound").port();
    Address { host: "127.0.0.1".to_owned(), command_port: port(command), state_port: port(state) }
}

fn listener() -> TcpListener {
    TcpListener::bind("127.0.0.1:0").expect("a free port")
}

fn first_loss(address: Address) -> LinkLoss {
    let mut link = BlockingLink::start(address, LinkLimits::default(), Pace::Wall).expect("starts");
    let report = link.next(Duration::from_secs(5));
    assert_eq!(link.open_epoch(), Err(QueueError::NotConnected));
    let Some(Report::LinkLost { why }) = report else { panic!("{report:?}") };
    assert_eq!(link.next(Duration::from_millis(500)), None, "the same trouble is told once");
    why
}

#[test]
fn nothing_that_listens_is_told_as_refused() {
    let address = address(&listener(), &listener());
    let why = first_loss(address);
    assert!(matches!(why, LinkLoss::Refused { channel: Channel::State, .. }), "{why}");
}

#[test]
fn a_controller_that_says_nothing_is_told_as_silent() {
    let (command, state) = (listener(), listener());
    let why = first_loss(address(&command, &state));
    assert!(matches!(why, LinkLoss::Silent { channel: Channel::State, silence_ms: 1_000..1_500 }), "{why}");
}

#[test]
fn a_controller_that_hangs_up_is_told_as_closed() {
    let (command, state) = (listener(), listener());
    let address = address(&command, &state);
    let server = std::thread::spawn(move || {
        let connection = state.accept().map(|(stream, _)| stream);
        std::thread::sleep(Duration::from_millis(50));
        drop((connection, state, command));
    });
    let why = first_loss_of_any(address);
    server.join().expect("ends");
    let channel = LinkLoss::Closed { channel: Channel::State };
    assert!(why == channel || matches!(why, LinkLoss::System { .. }), "{why}");
}

fn first_loss_of_any(address: Address) -> LinkLoss {
    let mut link = BlockingLink::start(address, LinkLimits::default(), Pace::Wall).expect("starts");
    let report = link.next(Duration::from_secs(5));
    let Some(Report::LinkLost { why }) = report else { panic!("{report:?}") };
    why
}
