//! Measures the time from an abort at one of the service's front ends to the frame at the controller. The abort comes
//! through the socket while two hundred hostile clients use it, or from the operator's page while others watch it.

use super::peer::Peer;
use crate::clients::harass;
use panelprep::cell::{self, Cell};
use panelprep::daemon::{
    self, AccountService, Alarms, Computing, DaemonError, Gateway, InterfaceContext, LastWrittenPage, LinkedRobot,
    LiveView, LoopPorts, LoopStart, NoCameras, OperatorPage, PageParts, Port, RecordAnswer, RecordCommand,
    RecordError, RecordTransfers, RecordingSwitch, Request, RequestHandler, RequestSender, ServiceParts, Socket,
    StoreRecord,
};
use panelprep::devices::robot::{Address, BlockingLink, link_limits};
use panelprep::eki::ClockMode;
use panelprep::setup::{CellSetup, testing::write_cell};
use panelprep::store::Store;
use panelprep::supervision::Supervisor;
use panelprep::tape::LoopMemoryStart;
use panelprep::verdict::Reason;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub const CLIENTS: usize = 200;
const TIMEOUT: Duration = Duration::from_secs(20);
const CELL: &str = "[poses]\npark = { a1_deg = 0, a2_deg = -90, a3_deg = 90, a4_deg = 0, a5_deg = 0, a6_deg = 0 }\n\
     [limits]\nbox_min_mm = [-2000, -2000, -2000]\nbox_max_mm = [2000, 2000, 2000]\n\
     [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
     [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\n";

/// Sends a request to the socket and returns the reply; empty without a reply. A `clear` contains the number of the
/// step that the state showed immediately before.
fn ask(socket: &Path, word: &str) -> String {
    let mut line = json!({ "ask": word });
    if word == "clear" {
        let state: Value = serde_json::from_str(&ask(socket, "state")).unwrap_or_default();
        line["step"] = state["step"].clone();
    }
    let mut answer = String::new();
    if let Ok(mut stream) = UnixStream::connect(socket) {
        stream.set_read_timeout(Some(TIMEOUT)).expect("set");
        let line = format!("{line}\n");
        let _ = stream.write_all(line.as_bytes()).and_then(|()| stream.read_to_string(&mut answer));
    }
    answer
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let since = Instant::now();
    while !done() {
        assert!(since.elapsed() < TIMEOUT, "{what} never came");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A journal on a disk that hangs once per request.
struct Hanging<'s> {
    record: StoreRecord<'s>,
    hangs: Arc<AtomicBool>,
}

/// Time for which the disk hangs.
pub const HANG_TIME: Duration = Duration::from_secs(5);

impl Port<RecordCommand> for Hanging<'_> {
    fn perform(&mut self, command: RecordCommand) -> Result<RecordAnswer, RecordError> {
        if matches!(command, RecordCommand::Event(_)) && self.hangs.swap(false, Ordering::Relaxed) {
            std::thread::sleep(HANG_TIME);
        }
        self.record.perform(command)
    }
}

/// A service whose controller is a peer in this process.
struct Served {
    peer: Peer,
    hangs: Arc<AtomicBool>,
    sender: RequestSender,
    gateway: Gateway,
    folder: TempDir,
    supervisor: Supervisor,
    service: JoinHandle<Result<(), DaemonError>>,
}

impl Served {
    fn start() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store_folder = folder.path().join("store");
        let cell = Cell::check("cell.toml", CELL).expect("a good cell");
        let (peer, supervisor) = (Peer::start(), Supervisor::default());
        let (command_port, state_port) = peer.ports();
        let address = Address { host: "127.0.0.1".to_owned(), command_port, state_port };
        let link = BlockingLink::start(address, link_limits(&cell), ClockMode::Wall).expect("a link");
        let (sender, queue) = daemon::request_queue();
        sender.set_urgent_line(link.stop_line());
        let hangs = Arc::new(AtomicBool::new(false));
        let hung = hangs.clone();
        let gateway = Gateway::without_cell(sender.clone(), Reason::new("bad_input", "no cell here"));
        // The server of a page reads the store, which must exist before the service runs.
        drop(Store::create(&store_folder).expect("a store"));
        let watched = supervisor.clone();
        let service = std::thread::spawn(move || {
            let mut robot = LinkedRobot::new(link, ClockMode::Wall);
            let mut store = Store::create(&store_folder).expect("a store");
            let keep = daemon::picture_store(&store).expect("writable");
            let mut record = Hanging { record: StoreRecord::new(&mut store, None), hangs: hung };
            let (pages, _) = mpsc::channel();
            let parts = ServiceParts {
                recording: RecordingSwitch::new(&store_folder, false),
                supervisor: watched.clone(),
                pages,
                written: LastWrittenPage::default(),
                cameras: None,
                view: LiveView::default(),
            };
            let parts_of_computing = (Box::new(NoCameras) as _, Box::new(Vec::new) as _, keep);
            let computing =
                Computing::on_thread(parts_of_computing, false, &watched, LiveView::default()).expect("a thread");
            let ports = LoopPorts {
                robot: &mut robot,
                tool: &mut daemon::LinkedTool::default(),
                record: &mut record,
                requests: &mut RequestHandler::new(queue, None, parts),
                computing,
                lock_step: false,
            };
            let cell = Arc::new(CellSetup::new(&cell).expect("whole"));
            let state = panelprep::cycle::State::INITIAL;
            daemon::run(LoopStart { cell, cycle: None, state, before: LoopMemoryStart::Boot }, ports).map(drop)
        });
        Served { peer, hangs, sender, gateway, folder, supervisor, service }
    }

    /// Measures the time of each abort until its frame arrives; `ask` sends a request to a front end and returns the
    /// reply.
    fn timed(&self, trials: usize, ask: impl Fn(&str) -> String, is_done: impl Fn(&str) -> bool) -> Vec<Duration> {
        let mut found = Vec::with_capacity(trials);
        for _ in 0..trials {
            until("a clear", || ask("clear").contains("\"stopped\"") || ask("state").contains("\"stopped\""));
            self.peer.forget();
            let asked = Instant::now();
            let answer = ask("abort");
            until("the frame", || self.peer.stopped().is_some());
            found.push(self.peer.stopped().map_or(TIMEOUT, |stopped| stopped - asked));
            assert!(is_done(&answer), "{answer}");
        }
        found
    }

    fn end(self) {
        self.sender.send(Request::signal()).expect("it serves");
        self.service.join().expect("no panic").expect("no fault");
    }
}

/// Returns the time of each abort at the socket, and the number of requests that the clients sent during this time.
pub fn aborts(trials: usize) -> (Vec<Duration>, usize) {
    let served = Served::start();
    let path = served.folder.path().join("socket");
    let socket = Socket::listen(&path, None, served.gateway.clone(), &served.supervisor).expect("a socket");
    let (ends, done) = (AtomicBool::new(false), AtomicUsize::new(0));
    let found = std::thread::scope(|scope| {
        for kind in 0..CLIENTS {
            let (path, ends, done) = (&path, &ends, &done);
            scope.spawn(move || harass(path, kind, ends, done));
        }
        let found = served.timed(trials, |word| ask(&path, word), |answer| answer.contains("\"done\""));
        ends.store(true, Ordering::Relaxed);
        found
    });
    drop(socket);
    served.end();
    (found, done.load(Ordering::Relaxed))
}

/// Returns the time of each abort at the socket while the disk hangs during the writing of the abort's line to the
/// journal.
pub fn aborts_on_a_hanging_disk(trials: usize) -> Vec<Duration> {
    let served = Served::start();
    let path = served.folder.path().join("socket");
    let socket = Socket::listen(&path, None, served.gateway.clone(), &served.supervisor).expect("a socket");
    let ask = |word: &str| {
        served.hangs.store(word == "abort", Ordering::Relaxed);
        ask(&path, word)
    };
    let found = served.timed(trials, ask, |answer| answer.contains("\"done\""));
    drop(socket);
    served.end();
    found
}

/// Sends a request to the page; returns the answer up to the end of the connection.
fn http(address: &str, method: &str, path: &str) -> String {
    let mut answer = String::new();
    if let Ok(mut stream) = TcpStream::connect(address) {
        stream.set_read_timeout(Some(TIMEOUT)).expect("set");
        let request = format!(
            "{method} {path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\nsec-fetch-site: same-origin\r\n\
             content-type: application/json\r\ncontent-length: 2\r\n\r\n{{}}"
        );
        let _ = stream.write_all(request.as_bytes()).and_then(|()| stream.read_to_string(&mut answer));
    }
    answer
}

/// Returns the time of each abort on the page while this number of clients watch it; one more opens a connection and
/// reads nothing.
pub fn aborts_on_the_page(trials: usize, viewers: usize) -> Vec<Duration> {
    let served = Served::start();
    let page = cell::Page {
        listen: Some(([127, 0, 0, 1], 0).into()),
        certificate: None,
        recipes: served.folder.path().to_owned(),
        translations: None,
        idle_min: 30,
        sessions: 3,
    };
    let (folder, gateway) = (served.folder.path().join("store"), served.gateway.clone());
    let setup = write_cell(served.folder.path(), "", &[]);
    let people = Arc::new(AccountService::new(folder.clone()));
    let alarms = Arc::new(Alarms::new(people.clone()));
    let view = LiveView::default();
    let front = InterfaceContext { gateway, people, alarms, setup, transfers: RecordTransfers::default() };
    let parts = PageParts { page, folder, front, view };
    let page = OperatorPage::serve(parts).expect("served").expect("an address");
    let address = page.url.trim_start_matches("http://").trim_end_matches('/').to_owned();
    // Only a person may clear; a request at the socket is treated as a person's request.
    let path = served.folder.path().join("socket");
    let socket = Socket::listen(&path, None, served.gateway.clone(), &served.supervisor).expect("a socket");
    let events = format!("GET /events HTTP/1.1\r\nhost: {address}\r\n\r\n");
    let reads_nothing =
        TcpStream::connect(&address).and_then(|mut stream| stream.write_all(events.as_bytes()).map(|()| stream));
    let (ends, seen) = (AtomicBool::new(false), AtomicUsize::new(0));
    let found = std::thread::scope(|scope| {
        for _ in 0..viewers {
            let (events, address, ends, seen) = (&events, &address, &ends, &seen);
            scope.spawn(move || {
                let mut stream = TcpStream::connect(address).expect("it listens");
                stream.write_all(events.as_bytes()).expect("sent");
                stream.set_read_timeout(Some(Duration::from_secs(5))).expect("set");
                let mut bytes = [0; 4_096];
                while !ends.load(Ordering::Relaxed) && stream.read(&mut bytes).is_ok_and(|count| count > 0) {
                    seen.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        let ask_page = |word: &str| match word {
            "abort" => http(&address, "POST", "/request/abort"),
            word => ask(&path, word),
        };
        let found = served.timed(trials, ask_page, |answer| answer.starts_with("HTTP/1.1 200"));
        ends.store(true, Ordering::Relaxed);
        found
    });
    assert!(seen.load(Ordering::Relaxed) > viewers, "they saw what happened");
    drop((reads_nothing, page, socket));
    served.end();
    found
}
