//! A minimal controller for the other end of a link: it replies to every request at once, and withholds
//! acknowledgements when requested.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Nice value of the peer's threads: above the bench's loads, and equal to that of the link itself.
const INSTRUMENT_NICE: i32 = -10;

#[derive(Default)]
struct Inside {
    epoch: u32,
    received: u32,
    sequence: u32,
    loses: bool,
    stopped: Option<Instant>,
}

/// A peer that listens until the program ends and serves one client at a time.
pub struct Peer {
    ports: (u16, u16),
    inside: Arc<Mutex<Inside>>,
}

impl Peer {
    pub fn start() -> Self {
        let inside = Arc::new(Mutex::new(Inside::default()));
        let listen = |serve: fn(&Mutex<Inside>, TcpStream) -> std::io::Result<()>| {
            let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
            let port = listener.local_addr().expect("bound").port();
            let inside = inside.clone();
            std::thread::spawn(move || {
                // The measurement should not contain the peer's own delays. If the priority is not permitted, it does
                // contain them.
                let _ = rustix::process::setpriority_process(None, INSTRUMENT_NICE);
                for stream in listener.incoming().map_while(Result::ok) {
                    // An error ends the connection with a client; the client connects again.
                    let _ = serve(&inside, stream);
                }
            });
            port
        };
        Peer { ports: (listen(commands), listen(requests)), inside }
    }

    /// Returns the ports of the command channel and of the state channel.
    pub fn ports(&self) -> (u16, u16) {
        self.ports
    }

    /// Withholds all acknowledgements until the next epoch.
    pub fn lose_acknowledgements(&self) {
        let mut inside = self.inside.lock().expect("whole");
        (inside.loses, inside.stopped) = (true, None);
    }

    /// Forgets the abort that has arrived, so that the next abort is measured.
    pub fn forget(&self) {
        self.inside.lock().expect("whole").stopped = None;
    }

    /// Returns the time at which the abort arrived.
    pub fn stopped(&self) -> Option<Instant> {
        self.inside.lock().expect("whole").stopped
    }
}

/// Calls `act` with the values of each document, which are the numbers between its quotes, and sends the reply.
fn documents(mut stream: TcpStream, end: &str, mut act: impl FnMut(&[u32]) -> String) -> std::io::Result<()> {
    stream.set_nodelay(true)?;
    let (mut text, mut bytes) = (String::new(), [0; 16_384]);
    loop {
        let count = stream.read(&mut bytes)?;
        if count == 0 {
            return Ok(());
        }
        text += &String::from_utf8_lossy(&bytes[..count]);
        let mut answers = String::new();
        while let Some(at) = text.find(end) {
            let document: String = text.drain(..at + end.len()).collect();
            let values = document.split('"').skip(1).step_by(2).take(4);
            let values: Vec<u32> = values.map(|value| value.parse().unwrap_or(0)).collect();
            answers += &act(&values);
        }
        stream.write_all(answers.as_bytes())?;
    }
}

fn commands(inside: &Mutex<Inside>, stream: TcpStream) -> std::io::Result<()> {
    documents(stream, "</Cmd>", |values| {
        let mut inside = inside.lock().expect("whole");
        if inside.loses || values[1] != inside.epoch {
            return String::new();
        }
        inside.received = values[0];
        let (received, epoch) = (inside.received, inside.epoch);
        format!(
            "<Ack Rx=\"{received}\" Done=\"{received}\" Free=\"100\" Err=\"0\" ErrId=\"0\" Ep=\"{epoch}\"></Ack>"
        )
    })
}

fn requests(inside: &Mutex<Inside>, stream: TcpStream) -> std::io::Result<()> {
    documents(stream, "</Req>", |values| {
        let mut inside = inside.lock().expect("whole");
        let [id, _, operation, number] = values[..] else { return String::new() };
        if operation == 11 {
            inside.stopped.get_or_insert_with(Instant::now);
        }
        if matches!(operation, 11 | 12) && number > inside.epoch {
            (inside.epoch, inside.received) = (number, 0);
            inside.loses &= operation == 11;
        }
        inside.sequence += 1;
        let Inside { epoch, sequence, received, .. } = *inside;
        let frame =
            |name: &str| format!("<{name} X=\"0.0\" Y=\"0.0\" Z=\"0.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\"></{name}>");
        format!(
            "<St T=\"1\" Seq=\"{sequence}\" Re=\"{id}\" Ep=\"{epoch}\" Boot=\"1\" Sum=\"1\" Mode=\"4\" Flags=\"23\" In=\"1\" \
             Out=\"0\" Done=\"{received}\" Under=\"0\" Ov=\"100\"><J A1=\"0.0\" A2=\"-90.0\" A3=\"90.0\" A4=\"0.0\" A5=\"0.0\" A6=\"0.0\"></J>\
             {}{}{}</St>",
            frame("Tcp"),
            frame("Base"),
            frame("Tool")
        )
    })
}
