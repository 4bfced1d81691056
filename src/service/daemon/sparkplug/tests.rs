//! Tests with faulty brokers: the connection ends with a reason, and the cell receives no request.

use super::session::{
    BrokerConnection, FAILED_TASK_MESSAGE, HostRequests, SessionEnd, SessionParts, run_connection,
};
use crate::daemon::alarms::Alarms;
use crate::daemon::gateway::Gateway;
use crate::daemon::people::AccountService;
use crate::daemon::request_queue::{RequestQueue, request_queue};
use panelprep_base::verdict::Reason;
use panelprep_cell::cell::{NodeCommands, SparkplugNode};
use panelprep_interfaces::sparkplug::{CellIds, CellView, EdgeNode, Metric, NodeSetup, Payload, WireType};
use prost::Message as _;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{oneshot, watch};

/// Test bench: a node with the cell's state, and the results of its requests.
struct Edge {
    parts: SessionParts,
    broker: BrokerConnection,
    node: EdgeNode,
    queue: RequestQueue,
    listener: TcpListener,
    runtime: Runtime,
    _tell: watch::Sender<Option<CellView>>,
    _folder: TempDir,
}

impl Edge {
    fn new() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let settings = SparkplugNode {
            broker: "127.0.0.1".to_owned(),
            port: listener.local_addr().expect("its address").port(),
            tls: None,
            login: None,
            group_id: "G".to_owned(),
            edge_node_id: "cell".to_owned(),
            primary_host_id: None,
            commands: NodeCommands::Operator,
            aliases: true,
        };
        let folder = tempfile::tempdir().expect("a folder");
        let (sender, queue) = request_queue();
        let gateway = Gateway::without_cell(sender, Reason::new("bad_input", "no cell here"));
        let people = Arc::new(AccountService::new(folder.path().to_owned()));
        let alarms = Arc::new(Alarms::new(people.clone()));
        let asking = HostRequests { gateway, people, origin: "a broker".to_owned() };
        let (tell, view) = watch::channel(Some(CellView::default()));
        let broker = BrokerConnection::read(&settings).expect("no file is named");
        let parts = SessionParts {
            host_requests: asking,
            view,
            started: Instant::now(),
            address: "a broker".to_owned(),
            alarms,
        };
        let ids = CellIds { group_id: "G".to_owned(), edge_node_id: "cell".to_owned(), primary_host_id: None };
        let node = EdgeNode::new(NodeSetup { ids, commands_allowed: true, aliases: true });
        let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
        Edge { parts, broker, node, queue, listener, runtime, _tell: tell, _folder: folder }
    }

    /// Runs one connection to a broker that calls `broker` and then closes the connection. Returns the reason for the
    /// end, and the bytes that the node sent.
    fn run_with_broker(&mut self, broker: impl FnOnce(&mut TcpStream) + Send + 'static) -> (String, Vec<u8>) {
        let listener = self.listener.try_clone().expect("the same");
        let plays = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().expect("the node comes");
            stream.set_read_timeout(Some(Duration::from_secs(5))).expect("set");
            let mut bytes = vec![0; 4_096];
            let count = stream.read(&mut bytes).expect("it asks for a connection");
            bytes.truncate(count);
            broker(&mut stream);
            bytes
        });
        let (_end, mut leave) = oneshot::channel();
        let ended = self.runtime.block_on(run_connection((&self.parts, &self.broker), &mut self.node, &mut leave));
        let SessionEnd::Lost(why) = ended else { panic!("it did not end so") };
        (why, plays.join().expect("it ends"))
    }

    fn was_asked(&self) -> Vec<String> {
        std::iter::from_fn(|| self.queue.next(Duration::from_millis(50)))
            .map(|one| format!("{:?}", one.what))
            .collect()
    }
}

/// The MQTT packet that accepts a connection: no session, return code 0.
const CONNACK: [u8; 4] = [0x20, 2, 0, 0];

/// Returns an MQTT message of the broker, with these flags in its first byte.
fn message(flags: u8, topic: &str, payload: &[u8]) -> Vec<u8> {
    let body = [&(topic.len() as u16).to_be_bytes()[..], topic.as_bytes(), payload].concat();
    let mut head = vec![0x30 | flags];
    let mut left = body.len();
    loop {
        let more = left > 127;
        head.push((left % 128) as u8 | if more { 128 } else { 0 });
        left /= 128;
        if !more {
            break;
        }
    }
    [head, body].concat()
}

fn stop() -> Vec<u8> {
    let (name, value) = (Some("Node Control/Stop".to_owned()), Some(WireType::Boolean(true)));
    let metric = Metric { name, value, ..Metric::default() };
    Payload { timestamp: Some(1), metrics: vec![metric], seq: None }.encode_to_vec()
}

/// The CONNECT packet requests a clean session, and has a last will with quality of service 1 that is not retained.
#[test]
fn the_connection_has_a_will() {
    let mut edge = Edge::new();
    let (why, connect) = edge.run_with_broker(|_| {});
    assert!(!why.is_empty() && why != FAILED_TASK_MESSAGE, "{why}");
    assert_eq!(&connect[2..9], b"\x00\x04MQTT\x04", "MQTT 3.1.1");
    // Expected flags: clean session 02, will 04, quality of service 1 of the will 08; not set: retained (20), user (80)
    // and password (40).
    assert_eq!(connect[9], 0x0e);
    let is_there = |part: &[u8]| connect.windows(part.len()).any(|window| window == part);
    assert!(is_there(b"spBv1.0/G/NDEATH/cell") && is_there(b"bdSeq") && is_there(b"G/cell"));
}

#[test]
fn a_broker_that_refuses_is_reported_in_words() {
    let mut edge = Edge::new();
    let (why, _) = edge.run_with_broker(|stream| stream.write_all(&[0x20, 2, 0, 5]).expect("sent"));
    assert!(why.contains("refuses the user or the password"), "{why}");
    let (why, _) = edge.run_with_broker(|stream| {
        stream.write_all(&CONNACK).expect("sent");
        let _ = stream.read(&mut [0; 4_096]);
        stream.write_all(&[0x90, 3, 0, 1, 0x80]).expect("sent");
        let _ = stream.read(&mut [0; 4_096]);
    });
    assert!(why.contains("refuses the subscription to spBv1.0/G/NCMD/cell"), "{why}");
}

/// A stop is executed immediately, but a retained stop is not; a message on a topic without subscription has no effect.
#[test]
fn messages_of_the_broker_are_checked() {
    let mut edge = Edge::new();
    let topic = "spBv1.0/G/NCMD/cell";
    edge.run_with_broker(move |stream| {
        let kept = message(1, topic, &stop());
        let strange = message(0, "spBv1.0/G/DCMD/cell/tool", &stop());
        stream.write_all(&[&CONNACK[..], &kept, &strange, &message(0, "", &stop())].concat()).expect("sent");
        std::thread::sleep(Duration::from_millis(300));
    });
    assert_eq!(edge.was_asked(), Vec::<String>::new());
    edge.run_with_broker(move |stream| {
        stream.write_all(&[&CONNACK[..], &message(0, topic, &stop())].concat()).expect("sent");
        std::thread::sleep(Duration::from_millis(300));
    });
    assert_eq!(edge.was_asked(), ["stop"]);
}

/// For bytes that are not valid MQTT, the connection always ends with a reason, no code panics, and the cell receives
/// no request. The topic of commands has another name here, so that random bytes cannot form a stop.
#[test]
fn invalid_bytes_of_a_broker_end_the_connection() {
    let mut edge = Edge::new();
    let mut draw = Pcg64::seed_from_u64(7);
    let packets = [
        CONNACK.to_vec(),
        vec![0x90, 3, 0, 1, 1],
        vec![0x90, 3, 0, 1, 0x80],
        vec![0x40, 2, 0, 1],
        vec![0x50, 2, 0, 1],
        vec![0x62, 2, 0, 1],
        vec![0x70, 2, 0, 1],
        vec![0xd0, 0],
        vec![0xe0, 0],
        vec![0x82, 9, 0, 1, 0, 4, b'a', b'/', b'b', b'/', 1],
        vec![0x10, 4, 0, 4, b'M', b'Q'],
        message(0, "spBv1.0/G/NCMD/other", &stop()),
        message(6, "spBv1.0/STATE/scada", b"{\"online\":false}"),
        vec![0x30, 0xff, 0xff, 0xff, 0x7f],
        vec![0xff; 12],
        vec![0; 12],
    ];
    for round in 0..400 {
        let mut bytes = if round % 4 == 0 { vec![] } else { CONNACK.to_vec() };
        for _ in 0..draw.random_range(1..8) {
            let mut packet = packets[draw.random_range(0..packets.len())].clone();
            for _ in 0..draw.random_range(0..3) {
                let at = draw.random_range(0..packet.len());
                packet[at] = draw.random();
            }
            bytes.extend(packet);
        }
        let shown = bytes.clone();
        let (why, _) = edge.run_with_broker(move |stream| {
            // The node may have closed the connection already.
            let _ = stream.write_all(&bytes);
        });
        assert!(!why.is_empty() && why != FAILED_TASK_MESSAGE, "{why}: {shown:02x?}");
    }
    assert_eq!(edge.was_asked(), Vec::<String>::new());
}
