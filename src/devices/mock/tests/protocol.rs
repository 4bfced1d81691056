//! Tests of the messages: documents, epochs, refusals, the ring buffer, lock step; and of the controller over TCP with
//! a hand-written client.

use super::*;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// Expected state, derived by hand: boot id 1, checksum 1, mode EXT, flags 1 + 2 + 4 + 16 = drives on, no emergency
/// stop, guard closed, motion possible.
#[test]
fn the_first_state_is_as_agreed() {
    let mut rig = Rig::before_reset(Clock::LockStep);
    rig.ask(9, 0);
    let expected = "<St T=\"0\" Seq=\"1\" Re=\"1\" Ep=\"0\" Boot=\"1\" Sum=\"1\" Mode=\"4\" Flags=\"23\" In=\"0\" Out=\"0\" \
                    Done=\"0\" Under=\"0\" Ov=\"100\"><J A1=\"0.000000\" A2=\"-90.000000\" A3=\"90.000000\" A4=\"0.000000\" \
                    A5=\"90.000000\" A6=\"0.000000\"></J><Tcp X=\"390.000000\"";
    assert!(rig.states.starts_with(expected), "{}", rig.states);
    let base =
        "<Base X=\"0.000000\" Y=\"0.000000\" Z=\"0.000000\" A=\"0.000000\" B=\"0.000000\" C=\"0.000000\"></Base>";
    assert!(rig.states.contains(base) && rig.states.ends_with("</Tool></St>"), "{}", rig.states);
}

/// Expected values, calculated by hand: the first 100 ms are 8 ticks of 12 ms with a rest of 4 ms. With the second 100
/// ms, 104 ms are 8 ticks with a rest of 8 ms. With the third, 108 ms are 9 ticks.
#[test]
fn a_heartbeat_grants_100_ms_and_keeps_the_remainder() {
    let mut rig = Rig::new(Clock::LockStep);
    let times = [96, 192, 300].map(|_: i32| {
        rig.beat();
        rig.state("T")
    });
    assert_eq!(times, [96, 192, 300]);
    assert!(rig.acks.starts_with("<Ack Rx=\"0\" Done=\"0\" Free=\"100\" Err=\"0\" ErrId=\"0\" Ep=\"1\"></Ack>"));
    assert_eq!(rig.acks.matches("<Ack").count(), 1, "nothing changed: {}", rig.acks);
    rig.beats(5);
    assert_eq!(rig.acks.matches("<Ack").count(), 2, "half a second passed: {}", rig.acks);
}

#[test]
fn a_heartbeat_waits_for_the_commands_that_it_names() {
    let mut rig = Rig::new(Clock::LockStep);
    let documents: Vec<String> = (0..2).map(|_| rig.document(6, [1, 1], [0.0; 2], [0.0; 6])).collect();
    rig.beat();
    assert_eq!(rig.controller.time_ms(), 0);
    rig.controller.command_bytes(documents[0].as_bytes());
    assert_eq!(rig.controller.time_ms(), 0);
    rig.controller.command_bytes(documents[1].as_bytes());
    assert_eq!(rig.controller.time_ms(), 96);
    // If the channel was lost before, the heartbeat does not wait for it.
    let mut lost = Rig::new(Clock::LockStep);
    lost.id = 7;
    lost.beat();
    lost.controller.disconnect(Channel::Command);
    assert_eq!(lost.controller.time_ms(), 96);
    // A command after the one that the heartbeat names is not read.
    let (early, id) = (rig.document(6, [1, 0], [0.0; 2], [0.0; 6]), rig.id);
    rig.controller.command_bytes(early.as_bytes());
    rig.ask(10, id - 1);
    assert_eq!((rig.ack("Rx"), rig.ack("Done")), (2, 2));
    rig.beat();
    assert_eq!((rig.ack("Rx"), rig.ack("Done")), (3, 3));
}

/// If the state channel is opened before the command channel, a heartbeat waits for the command channel.
#[test]
fn a_heartbeat_waits_for_a_channel_that_is_not_yet_open() {
    let mut rig = Rig::before_reset(Clock::LockStep);
    rig.controller.disconnect(Channel::Command);
    rig.controller.disconnect(Channel::State);
    rig.controller.connect(Channel::State);
    rig.open();
    let document = rig.document(6, [1, 1], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert_eq!(rig.controller.time_ms(), 0);
    rig.controller.connect(Channel::Command);
    rig.controller.command_bytes(document.as_bytes());
    rig.listen();
    assert_eq!((rig.controller.time_ms(), rig.ack("Done")), (96, 1));
}

/// On the wall clock a state message is sent without a request at least every 100 ms, with the last request in Re.
#[test]
fn states_are_sent_unrequested_in_wall_clock_time() {
    let mut rig = Rig::new(Clock::Free);
    rig.controller.advance_ms(1000);
    rig.listen();
    let times: Vec<&str> = rig.states.split(" T=\"").skip(1).map(|rest| &rest[..rest.find('"').unwrap()]).collect();
    assert_eq!(times, ["12", "108", "204", "300", "396", "492", "588", "684", "780", "876", "972"]);
    assert_eq!(rig.state("Re"), 1);
}

/// Eight commands are read per tick. 100 commands that cannot be executed fill the ring buffer, and the next command is
/// refused.
#[test]
fn the_ring_refuses_when_it_is_full() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(8, [0, 0], [0.0; 2], [0.0; 6]);
    for _ in 0..7 {
        rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
    }
    rig.controller.advance_ms(12);
    rig.listen();
    assert_eq!((rig.ack("Rx"), rig.ack("Done"), rig.ack("Free")), (11, 3, 92));
    for _ in 0..93 {
        rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
    }
    rig.controller.advance_ms(84); // seven ticks: 56 of the 93, and the subroutine runs for 100 ms
    rig.listen();
    assert_eq!((rig.ack("Rx"), rig.ack("Free")), (67, 36));
    let mut full = Rig::ready(Clock::LockStep);
    full.controller.setup.subroutines_ms = vec![10_000];
    full.command(8, [0, 0], [0.0; 2], [0.0; 6]);
    for _ in 0..100 {
        full.command(6, [1, 1], [0.0; 2], [0.0; 6]);
    }
    full.beats(3);
    assert_eq!((full.ack("Err"), full.ack("ErrId"), full.ack("Rx")), (3, 104, 103));
    assert_eq!(full.causes(), [StopCause::Refused(Refusal::RingFull)]);
}

#[test]
fn each_wrong_command_is_refused_with_its_number() {
    let home = START_DEG;
    let cases: [(Refusal, i32, [i32; 2], [f64; 2], [f64; 6]); 16] = [
        (Refusal::UnknownOperation, 9, [0, 0], [0.0; 2], [0.0; 6]),
        (Refusal::ReadOnly, 7, [1, 1], [0.0; 2], [0.0; 6]),
        (Refusal::OutOfRange, 1, [0, 0], [0.0, 0.0], home),
        (Refusal::OutOfRange, 1, [0, 0], [10.0, 5.0], home),
        (Refusal::OutOfRange, 2, [0, 2], [0.0; 2], [0.0; 6]),
        (Refusal::OutOfRange, 4, [2, 0], [0.0; 2], [0.0; 6]),
        (Refusal::OutOfRange, 5, [100, 100], [2.1, 1.0], [0.0; 6]),
        (Refusal::OutOfRange, 5, [0, 100], [0.1, 1.0], [0.0; 6]),
        (Refusal::OutOfRange, 6, [0, 1], [0.0; 2], [0.0; 6]),
        (Refusal::OutOfRange, 6, [9, 1], [0.0; 2], [0.0; 6]), // it is not listed
        (Refusal::OutOfRange, 6, [1, 1], [0.5, 0.0], [0.0; 6]),
        (Refusal::OutOfRange, 8, [1, 0], [0.0; 2], [0.0; 6]),
        (Refusal::Unreachable, 1, [0, 0], [10.0, 0.0], [0.0, 45.5, 0.0, 0.0, 0.0, 0.0]),
        (Refusal::Unreachable, 2, [0, 0], [0.0; 2], [0.0, 900.0, 0.0, 0.0, 0.0, 0.0]),
        (Refusal::NoBaseOrTool, 2, [0, 0], [0.0; 2], [0.0; 6]),
        (Refusal::NoMotion, 1, [0, 0], [10.0, 0.0], home),
    ];
    for (refusal, operation, n, r, p) in cases {
        let bare = refusal == Refusal::NoBaseOrTool;
        let mut rig = if bare { Rig::new(Clock::LockStep) } else { Rig::ready(Clock::LockStep) };
        if refusal == Refusal::NoMotion {
            rig.controller.set_guard(false);
            rig.open();
        }
        let id = rig.command(operation, n, r, p);
        rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
        rig.beat();
        assert_eq!((rig.ack("Err"), rig.ack("ErrId")), (refusal as i32, id), "operation {operation}");
        assert!(rig.flag(7) && !rig.controller.outputs().contains_key(&1), "nothing behind it is executed");
        assert!(rig.ids().is_empty());
    }
}

#[test]
fn only_commands_of_the_present_epoch_are_executed() {
    let mut rig = Rig::before_reset(Clock::LockStep);
    rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert_eq!((rig.ack("Err"), rig.ack("ErrId")), (2, 1), "no epoch was opened");
    rig.open();
    rig.beat();
    assert_eq!((rig.ack("Err"), rig.ack("Ep")), (0, 1), "a new epoch forgets");
    // A gap in the ids ends the epoch.
    rig.command(6, [1, 1], [0.0; 2], [0.0; 6]);
    rig.id += 1;
    let gap = rig.command(6, [2, 1], [0.0; 2], [0.0; 6]);
    let after = rig.command(6, [3, 1], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert_eq!((rig.ack("Err"), rig.ack("ErrId"), rig.ack("Rx")), (1, gap, 1));
    assert_eq!((gap, after), (3, 4));
    assert!(
        rig.flag(7) && !rig.controller.outputs().contains_key(&2) && !rig.controller.outputs().contains_key(&3)
    );
    // A command that is in transit when its epoch ends is dropped and does not affect the new epoch. A command of a
    // future epoch is refused.
    rig.open();
    rig.controller.command_bytes(command(1, 2, 6, [1, 1], [0.0; 2], [0.0; 6]).as_bytes());
    rig.beat();
    assert_eq!((rig.controller.stale_commands(), rig.ack("Err"), rig.state("Out")), (1, 0, 0));
    rig.controller.command_bytes(command(9, 1, 6, [1, 1], [0.0; 2], [0.0; 6]).as_bytes());
    rig.epoch = 9;
    rig.id = 1;
    rig.beat();
    assert_eq!((rig.ack("Err"), rig.state("Out"), rig.state("Ep")), (2, 0, 2));
    // An epoch is not opened twice, and a lower epoch is not opened.
    rig.ask(12, 2);
    rig.ask(12, 1);
    assert_eq!((rig.state("Ep"), rig.ack("Err")), (2, 2));
}

/// During the epoch, base and tool are reported as they were set. After the epoch they are no longer set.
#[test]
fn a_new_epoch_has_neither_base_nor_tool() {
    let mut rig = Rig::ready(Clock::LockStep);
    assert!(rig.flag(5) && rig.flag(6));
    let base =
        "<Base X=\"390.000000\" Y=\"0.000000\" Z=\"570.000000\" A=\"180.000000\" B=\"0.000000\" C=\"180.000000\">";
    assert!(rig.states.rfind(base) > rig.states.rfind("<St "), "{}", rig.states);
    rig.open();
    assert!(!rig.flag(5) && !rig.flag(6) && !rig.flag(7));
    rig.line(1, 1, false);
    rig.beat();
    assert_eq!(rig.ack("Err"), Refusal::NoBaseOrTool as i32);
}

/// Outputs act on the world, and the world's inputs are reported: bit 4 of Out is output 5, bit 3 of In is input 4.
#[test]
fn outputs_reach_the_world_and_inputs_come_back() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.command(6, [5, 1], [0.0; 2], [0.0; 6]);
    rig.controller.set_input(1, true);
    rig.beat();
    assert_eq!((rig.state("Out"), rig.state("In")), (1 << 4, 1 << 3 | 1));
    assert_eq!(rig.wires.changes(), [(5, true, 108)]);
}

/// TIMEOUT in server mode: a client that connects after the timeout is not accepted, and the channel is not opened
/// again.
#[test]
fn a_channel_with_a_timeout_does_not_listen_for_ever() {
    let with =
        include_str!("../../../../config/kuka/CELLSTAT.xml").replace("<ALIVE", "<TIMEOUT Connect=\"2000\"/><ALIVE");
    let states = ChannelFile::parse(&with).expect("read");
    let mut controller =
        Controller::new(Setup { states, ..setup(Clock::Free) }, Box::new(UnconnectedWorld)).expect("started");
    controller.advance_ms(1_992);
    assert!(controller.connect(Channel::State));
    controller.disconnect(Channel::State);
    controller.advance_ms(2_100);
    assert!(!controller.connect(Channel::State));
    assert_eq!(controller.close_reason(Channel::State), Some(EkiFault::TimeLimit));
}

/// The cell's programs read flag 870 instead of input 12; `In` still reports the value of $IN.
#[test]
fn a_mapped_input_sets_its_flag() {
    let mut rig = Rig::ready(Clock::LockStep);
    rig.controller.setup.mapped_inputs.insert(12, 870);
    rig.command(7, [12, 1], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert_eq!((rig.controller.flags().get(&870), rig.state("In"), rig.ack("Done")), (Some(&true), 0, rig.id));
    rig.command(7, [12, 2], [0.0; 2], [0.0; 6]);
    rig.beat();
    assert_eq!(rig.ack("Err"), Refusal::OutOfRange as i32);
}

#[test]
fn an_unreadable_value_closes_the_channel() {
    let mut rig = Rig::new(Clock::LockStep);
    rig.controller.command_bytes(b"<Cmd Id=\"1\"></Cmd>"); // lacks the rest
    rig.id = 1;
    rig.beat();
    assert_eq!(rig.controller.close_reason(Channel::Command), Some(EkiFault::Unread(EkiError::Empty)));
    assert!(!rig.controller.is_connected(Channel::Command));
    assert_eq!(rig.controller.time_ms(), 96, "and nothing waits for it");
    rig.controller.state_bytes(b"<Req Id=\"x\"></Req>");
    assert_eq!(rig.controller.close_reason(Channel::State), Some(EkiFault::Malformed));
}

#[test]
fn a_file_without_an_element_that_the_program_reads_is_refused() {
    let states = ChannelFile::parse(include_str!("../../../../config/kuka/CELLSTAT.xml")).expect("read");
    let swapped = Setup { commands: states, ..setup(Clock::Free) };
    let Err(MockError::File { channel, problem }) = Controller::new(swapped, Box::new(UnconnectedWorld)) else {
        panic!("started");
    };
    assert_eq!((channel, problem), ("CELLCMD", FileProblem::NotReceived("Cmd/@R1")));
}

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

    /// Sends a request and waits for the reply.
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

/// In lock step the results over sockets equal the results without sockets, bit for bit.
#[test]
fn a_path_over_tcp_equals_the_path_without_tcp() {
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
fn a_second_client_is_refused_and_a_later_one_accepted() {
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
fn malformed_bytes_close_the_connection() {
    let server = serve(Clock::LockStep);
    let mut client = Client::new(&server);
    client.ask(0, 9, 0);
    client.state.write_all(b"HTTP/1.1").expect("sent");
    assert!(!matches!(client.state.read(&mut [0; 8]), Ok(count) if count > 0));
    let fault = server.handle().with_controller(|controller| controller.close_reason(Channel::State));
    assert_eq!(fault, Some(EkiFault::Malformed));
}

/// On the wall clock state messages are sent without a request, and the loss of the link stops a moving arm.
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
fn dropping_the_server_closes_connections_and_frees_ports() {
    let server = serve(Clock::LockStep);
    let mut client = Client::new(&server);
    client.ask(0, 9, 0);
    let (address, handle) = (server.state_address(), server.handle());
    drop(server);
    let gone = client.state.read(&mut [0; 8]);
    assert!(matches!(gone, Ok(0)) || gone.is_err_and(|error| error.kind() == ErrorKind::ConnectionReset));
    assert!(TcpStream::connect(address).is_err());
    // The controller can still be inspected after its server was dropped.
    assert_eq!(handle.with_controller(|controller| controller.epoch()), 0);
}
