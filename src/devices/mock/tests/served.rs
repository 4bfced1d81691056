//! The controller over TCP, with a hand-written client.

use super::*;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

struct Client {
    command: TcpStream,
    state: TcpStream,
    request: i32,
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).expect("connected");
    stream.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
    stream
}

impl Client {
    fn new(server: &MockServer) -> Self {
        Client { command: connect(server.command_address()), state: connect(server.state_address()), request: 0 }
    }

    /// Sends a request and waits for its answer.
    fn ask(&mut self, epoch: i32, operation: i32, n1: i32) -> String {
        self.request += 1;
        self.state.write_all(request(self.request, epoch, operation, n1).as_bytes()).expect("sent");
        let (mut heard, mut bytes) = (String::new(), [0; 4096]);
        let answer = format!(" Re=\"{}\"", self.request);
        while !(heard.contains(&answer) && heard.ends_with("</St>")) {
            let count = self.state.read(&mut bytes).expect("answered");
            assert!(count > 0, "hung up");
            heard += std::str::from_utf8(&bytes[..count]).expect("text");
        }
        heard
    }
}

fn serve(clock: Clock) -> MockServer {
    let controller = Controller::new(setup(clock), Box::new(UnconnectedWorld)).expect("started");
    MockServer::start(controller, Ports::free_ports()).expect("listening")
}

fn path() -> Vec<String> {
    let mut documents = vec![
        command(1, 1, 3, [0, 0], [0.0; 2], [BASE_MM[0], BASE_MM[1], BASE_MM[2], 180.0, 0.0, 180.0]),
        command(1, 2, 4, [1, 0], [0.0; 2], [0.0, 0.0, TOOL_MM, 0.0, 0.0, 0.0]),
    ];
    documents.extend((1..=20).map(|point: i32| {
        let p = [5.0 * f64::from(point), 0.0, 0.0, 0.0, 0.0, 0.0];
        command(1, 2 + point, 2, [20 - point, 0], [2.0, 0.0], p)
    }));
    documents
}

/// Over sockets in lock step the controller gives the same results to the bit as without sockets.
#[test]
fn a_path_over_tcp_is_the_path_without_it() {
    let server = serve(Clock::LockStep);
    let mut client = Client::new(&server);
    assert_eq!(last(&client.ask(0, 9, 0), "Ep"), "0");
    assert_eq!(last(&client.ask(0, 12, 1), "Ep"), "1");
    client.command.write_all(path().concat().as_bytes()).expect("sent");
    let mut state = String::new();
    for _ in 0..15 {
        state = client.ask(1, 10, 22);
    }
    assert_eq!((last(&state, "Done"), last(&state, "T")), ("22", "1500"));
    let mut acks = [0; 4096];
    let count = client.command.read(&mut acks).expect("acknowledged");
    assert!(
        std::str::from_utf8(&acks[..count]).expect("text").starts_with("<Ack Rx=\"8\""),
        "the first tick reads 8"
    );

    let mut alone = Rig::new(Clock::LockStep);
    alone.controller.command_bytes(path().concat().as_bytes());
    alone.id = 22;
    alone.beats(15);
    let there = server.handle().with_controller(|controller| controller.executed_motions().to_vec());
    assert_eq!(there, alone.controller.executed_motions());
    assert_eq!(server.handle().flange_pose(), alone.controller.flange_pose());
}

#[test]
fn a_second_client_is_turned_away_and_the_next_one_is_not() {
    let server = serve(Clock::LockStep);
    let mut first = Client::new(&server);
    first.ask(0, 9, 0);
    let mut second = connect(server.state_address());
    assert!(matches!(second.read(&mut [0; 8]), Ok(0)) || second.read(&mut [0; 8]).is_err());
    assert_eq!(last(&first.ask(0, 9, 0), "Seq"), "2");
    drop(first);
    let until = Instant::now() + Duration::from_secs(10);
    let any = |server: &MockServer| {
        server.handle().with_controller(|controller| {
            controller.is_connected(Channel::Command) || controller.is_connected(Channel::State)
        })
    };
    while any(&server) {
        assert!(Instant::now() < until, "still there");
        std::thread::sleep(Duration::from_millis(1));
    }
    assert_eq!(last(&Client::new(&server).ask(0, 9, 0), "Seq"), "3");
}

#[test]
fn malformed_bytes_hang_up() {
    let server = serve(Clock::LockStep);
    let mut client = Client::new(&server);
    client.ask(0, 9, 0);
    client.state.write_all(b"HTTP/1.1").expect("sent");
    assert!(!matches!(client.state.read(&mut [0; 8]), Ok(count) if count > 0));
    let fault = server.handle().with_controller(|controller| controller.close_reason(Channel::State));
    assert_eq!(fault, Some(EkiFault::Malformed));
}

/// On the wall clock time passes by itself: states are sent unrequested, and a lost link stops a moving arm.
#[test]
fn on_the_wall_clock_a_cut_link_stops_the_arm() {
    let server = serve(Clock::Free);
    let mut client = Client::new(&server);
    client.ask(0, 12, 1);
    client.command.write_all(path().concat().as_bytes()).expect("sent");
    let until = Instant::now() + Duration::from_secs(10);
    while server.handle().with_controller(|controller| controller.executed_motions().is_empty()) {
        assert!(Instant::now() < until, "it never moved");
        client.ask(1, 10, 22);
    }
    drop(client);
    while server
        .handle()
        .with_controller(|controller| controller.program_stops().is_empty() || controller.is_moving())
    {
        assert!(Instant::now() < until, "it never stopped");
        std::thread::sleep(Duration::from_millis(2));
    }
    let (cause, executed) = server
        .handle()
        .with_controller(|controller| (controller.program_stops()[0].cause, controller.executed_motions().len()));
    assert!(cause == StopCause::LinkLost && executed < 20, "{cause:?} {executed}");
}

#[test]
fn dropping_the_server_hangs_up_and_frees_its_ports() {
    let server = serve(Clock::LockStep);
    let mut client = Client::new(&server);
    client.ask(0, 9, 0);
    let (address, handle) = (server.state_address(), server.handle());
    drop(server);
    let gone = client.state.read(&mut [0; 8]);
    assert!(matches!(gone, Ok(0)) || gone.is_err_and(|error| error.kind() == ErrorKind::ConnectionReset));
    assert!(TcpStream::connect(address).is_err());
    // The controller can still be inspected.
    assert_eq!(handle.with_controller(|controller| controller.epoch()), 0);
}
