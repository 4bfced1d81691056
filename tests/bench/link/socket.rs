//! From a client's abort at the service's socket to the frame at the controller, while two hundred clients do harm.

use super::peer::Peer;
use crate::clients::harass;
use panelprep::cell::Cell;
use panelprep::daemon::{
    self, CellSetup, Computing, Gateway, LinkedRobot, LiveView, LoopStart, NoCameras, Ports, RecordingSwitch,
    Request, RequestHandler, ServiceParts, Socket, StoreRecord, WrittenPage,
};
use panelprep::devices::robot::{Address, BlockingLink, link_limits};
use panelprep::eki::Pace;
use panelprep::store::Store;
use panelprep::supervision::Supervisor;
use panelprep::tape::Begin;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

pub const CLIENTS: usize = 200;
const PATIENCE: Duration = Duration::from_secs(20);
const CELL: &str = "[poses]\npark = { a1_deg = 0, a2_deg = -90, a3_deg = 90, a4_deg = 0, a5_deg = 0, a6_deg = 0 }\n\
     [limits]\nbox_min_mm = [-2000, -2000, -2000]\nbox_max_mm = [2000, 2000, 2000]\n\
     [io.outputs]\nlight = 1\nspray = 2\nlens_shutter = 3\nextraction = 4\ntool = 5\n\
     [io.feedbacks]\nwater_off = 1\nlens_shut = 2\nextraction_flow = 3\ntool_running = 4\n";

/// What a request is answered; empty where it was not.
fn ask(socket: &Path, word: &str) -> String {
    let mut answer = String::new();
    if let Ok(mut stream) = UnixStream::connect(socket) {
        stream.set_read_timeout(Some(PATIENCE)).expect("set");
        let line = format!("{{\"ask\":\"{word}\"}}\n");
        let _ = stream.write_all(line.as_bytes()).and_then(|()| stream.read_to_string(&mut answer));
    }
    answer
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let since = Instant::now();
    while !done() {
        assert!(since.elapsed() < PATIENCE, "{what} never came");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// How long each abort took, and how much the clients did meanwhile.
pub fn aborts(trials: usize) -> (Vec<Duration>, usize) {
    let folder = tempfile::tempdir().expect("a folder");
    let (store, socket) = (folder.path().join("store"), folder.path().join("socket"));
    let cell = Cell::check("cell.toml", CELL).expect("a good cell");
    let (peer, supervisor) = (Peer::start(), Supervisor::default());
    let (command_port, state_port) = peer.ports();
    let address = Address { host: "127.0.0.1".to_owned(), command_port, state_port };
    let link = BlockingLink::start(address, link_limits(&cell), Pace::Wall).expect("a link");
    let (sender, queue) = daemon::request_queue();
    let loader: Arc<daemon::Loader> = Arc::new(|_| Err(vec![]));
    let gateway = Gateway::new(sender.clone(), loader, None);
    let _socket = Socket::listen(&socket, gateway, &supervisor).expect("a socket");
    let service = {
        let supervisor = supervisor.clone();
        std::thread::spawn(move || {
            let mut robot = LinkedRobot::new(link, Pace::Wall);
            let store_folder = store;
            let mut store = Store::create(&store_folder).expect("a store");
            let keep = daemon::keeper(&store).expect("writable");
            let mut record = StoreRecord::new(&mut store, None);
            let (pages, _) = mpsc::channel();
            let parts = ServiceParts {
                recording: RecordingSwitch::new(&store_folder, false),
                supervisor: supervisor.clone(),
                pages,
                written: WrittenPage::default(),
                cameras: None,
            };
            let parts_of_computing = (Box::new(NoCameras) as _, Box::new(Vec::new) as _, keep);
            let computing = Computing::on_thread(parts_of_computing, false, &supervisor, LiveView::default())
                .expect("a thread");
            let ports = Ports {
                robot: &mut robot,
                record: &mut record,
                requests: &mut RequestHandler::new(queue, None, parts),
                computing,
                lock_step: false,
            };
            let cell = Arc::new(CellSetup::new(&cell).expect("whole"));
            let state = panelprep::cycle::State::NEW;
            daemon::run(LoopStart { cell, cycle: None, state, before: Begin::Boot }, ports).map(drop)
        })
    };
    let (ends, done) = (AtomicBool::new(false), AtomicUsize::new(0));
    let mut found = Vec::with_capacity(trials);
    std::thread::scope(|scope| {
        for kind in 0..CLIENTS {
            let (socket, ends, done) = (&socket, &ends, &done);
            scope.spawn(move || harass(socket, kind, ends, done));
        }
        for _ in 0..trials {
            until("a clear", || {
                ask(&socket, "clear").contains("\"stopped\"") || ask(&socket, "state").contains("\"stopped\"")
            });
            peer.forget();
            let asked = Instant::now();
            let answer = ask(&socket, "abort");
            until("the frame", || peer.stopped().is_some());
            found.push(peer.stopped().map_or(PATIENCE, |stopped| stopped - asked));
            assert!(answer.contains("\"done\""), "{answer}");
        }
        ends.store(true, Ordering::Relaxed);
    });
    sender.send(Request::signal()).expect("it serves");
    service.join().expect("no panic").expect("no fault");
    (found, done.load(Ordering::Relaxed))
}
