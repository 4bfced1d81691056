//! The handshake over the robot's link, with a controller that executes its own programs: the line's inputs and
//! outputs are the controller's.

use super::handshake_thread::{LineFront, LineParts};
use crate::daemon::camera_lease::LastState;
use crate::daemon::gateway::Gateway;
use crate::daemon::people::AccountService;
use crate::daemon::reply::{Reply, RequestResult};
use crate::daemon::request::{RequestKind, StartRequest};
use crate::daemon::request_queue::{RequestQueue, request_queue};
use panelprep_base::verdict::{Reason, Verdict};
use panelprep_cell::cell::{Line, LineSignal};
use panelprep_cell::cycle;
use panelprep_cell::line::LineSignals;
use panelprep_devices::mock::{self, MockServer, Programs};
use panelprep_devices::robot::{Address, BlockingLink};
use panelprep_kuka::eki::{CELLCMD, CELLSTAT, ClockMode, LinkLimits, Report};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Long enough for a busy machine.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Numbers of the inputs part present and start request, and of the six outputs.
const INPUTS: [u16; 2] = [30, 31];
const OUTPUTS: [u16; 6] = [40, 41, 42, 43, 44, 45];

/// A controller, the link to it, and a loop that only answers requests.
struct Bench {
    server: MockServer,
    /// The state and verdict that the loop reports.
    state: Arc<Mutex<(&'static str, Option<Verdict>)>>,
    starts: mpsc::Receiver<StartRequest>,
    resets: mpsc::Receiver<()>,
    front: Option<LineFront>,
    is_over: Arc<AtomicBool>,
    link: Option<JoinHandle<()>>,
    _folder: tempfile::TempDir,
}

impl Drop for Bench {
    fn drop(&mut self) {
        drop(self.front.take());
        self.is_over.store(true, Ordering::Relaxed);
    }
}

impl Bench {
    fn new() -> Self {
        let [commands, states] = [CELLCMD, CELLSTAT].map(|text| mock::ChannelFile::parse(text).expect("shipped"));
        let setup = mock::Setup {
            clock: mock::Clock::Free,
            inputs: vec![17, INPUTS[0], INPUTS[1]],
            line_outputs: OUTPUTS,
            programs: Some(Programs::shipped().expect("right")),
            ..mock::Setup::new(commands, states)
        };
        let controller = mock::Controller::new(setup, Box::new(mock::UnconnectedWorld)).expect("fits");
        let server = MockServer::start(controller, mock::Ports::free_ports()).expect("starts");
        let address = Address {
            host: "127.0.0.1".to_owned(),
            command_port: server.command_address().port(),
            state_port: server.state_address().port(),
        };
        let link = BlockingLink::start(address, LinkLimits::default(), ClockMode::Wall).expect("starts");
        let (last, outputs) = (LastState::default(), link.line());
        let is_over = Arc::new(AtomicBool::new(false));
        let link = std::thread::spawn({
            let (last, is_over) = (last.clone(), is_over.clone());
            move || receive_reports(link, &last, &is_over)
        });
        let folder = tempfile::tempdir().expect("a folder");
        let recipe = folder.path().join("door.toml");
        std::fs::write(&recipe, "panel = \"door\"\n").expect("written");
        let (sender, queue) = request_queue();
        let (tell_start, starts) = mpsc::channel();
        let loader = move |start: StartRequest| {
            let _ = tell_start.send(start);
            Err(vec![Reason::new("bad_input", "not here")])
        };
        let gateway = Gateway::new(sender, Arc::new(loader), None);
        let state = Arc::new(Mutex::new(("idle", None)));
        let (tell_reset, resets) = mpsc::channel();
        let (reported, over) = (state.clone(), is_over.clone());
        std::thread::spawn(move || answer((&queue, &over), &reported, &tell_reset));
        let line = Line { recipe, serial: None, order: Some("WO 7".to_owned()), operator: None };
        let people = Arc::new(AccountService::new(folder.path().to_owned()));
        let parts = LineParts { line, inputs: [1, 2], last, outputs, gateway, people };
        let front = Some(LineFront::serve(parts).expect("a thread"));
        Bench { server, state, starts, resets, front, is_over, link: Some(link), _folder: folder }
    }

    fn line_sets(&self, part_present: bool, start_request: bool) {
        self.server.handle().with_controller(|controller| {
            controller.set_input(INPUTS[0], part_present);
            controller.set_input(INPUTS[1], start_request);
        });
    }

    fn cell_is(&self, state: &'static str, verdict: Option<Verdict>) {
        *self.state.lock().expect("whole") = (state, verdict);
    }

    /// Waits until the line reads exactly these outputs.
    fn line_reads(&self, signals: &[LineSignal]) {
        let (wanted, since) = (LineSignals::from_signals(signals), Instant::now());
        loop {
            let outputs = self.server.handle().with_controller(|controller| controller.outputs().clone());
            let on = |number: &u16| outputs.get(number) == Some(&true);
            let read =
                OUTPUTS.iter().enumerate().filter(|(_, number)| on(number)).map(|(place, _)| 1 << place).sum();
            if LineSignals(read) == wanted {
                return;
            }
            assert!(since.elapsed() < TIMEOUT, "{signals:?}: found {read:06b}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// The loop's part of the link: it reads reports and stores the last state.
fn receive_reports(mut link: BlockingLink, last: &LastState, is_over: &AtomicBool) {
    while !is_over.load(Ordering::Relaxed) {
        match link.next(Duration::from_millis(20)) {
            Some(Report::State(state) | Report::Connected { state }) => last.is(Some(&state)),
            Some(Report::LinkLost { .. }) => last.is(None),
            _ => {}
        }
    }
}

/// The loop's part of requests: it reports its state, and a reset leads to idle.
fn answer(
    (queue, is_over): (&RequestQueue, &AtomicBool),
    state: &Mutex<(&'static str, Option<Verdict>)>,
    resets: &mpsc::Sender<()>,
) {
    while !is_over.load(Ordering::Relaxed) {
        let Some(request) = queue.next(Duration::from_millis(50)) else { continue };
        if let RequestKind::Table(cycle::Request::Reset) = request.what {
            *state.lock().expect("whole") = ("idle", None);
            let _ = resets.send(());
        }
        let (word, verdict) = *state.lock().expect("whole");
        let reply = Reply { state: Some(word.to_owned()), verdict, ..Reply::refused(RequestResult::Done, vec![]) };
        if let Some(waits) = request.reply {
            let _ = waits.send(reply);
        }
    }
}

/// Tests three sequences: a start by a signal edge with the recipe and order of the cell's file, which is refused and
/// reported; a completed cycle, whose part is then removed, and a reset; and a fault once no thread maintains the
/// link.
#[test]
fn a_line_leads_the_cell_by_signals() {
    use LineSignal::{CycleDone, Fail, Fault, Pass, Ready};
    let mut bench = Bench::new();
    bench.line_sets(true, true);
    bench.line_reads(&[Ready]);
    std::thread::sleep(Duration::from_millis(500));
    assert!(bench.starts.try_recv().is_err(), "the request was high from the start");

    bench.line_sets(true, false);
    std::thread::sleep(Duration::from_millis(500));
    bench.line_sets(true, true);
    let start = bench.starts.recv_timeout(TIMEOUT).expect("an edge asks");
    assert_eq!(start.text, "panel = \"door\"\n");
    assert_eq!(start.part.and_then(|part| part.order).as_deref(), Some("WO 7"));
    bench.line_reads(&[Fault]);
    bench.line_sets(true, false);
    bench.line_reads(&[Ready]);
    assert!(bench.starts.try_recv().is_err(), "one edge asks once");

    bench.cell_is("execute", None);
    bench.line_reads(&[]);
    bench.cell_is("complete", Some(Verdict::Fail));
    bench.line_reads(&[CycleDone, Fail]);
    bench.cell_is("complete", Some(Verdict::Pass));
    bench.line_reads(&[CycleDone, Pass]);
    std::thread::sleep(Duration::from_millis(500));
    assert!(bench.resets.try_recv().is_err(), "the part is still there");
    bench.line_sets(false, false);
    bench.resets.recv_timeout(TIMEOUT).expect("the part is gone");
    bench.line_reads(&[Ready]);

    // The program ends: the controller's own program informs the line.
    drop(bench.front.take());
    bench.is_over.store(true, Ordering::Relaxed);
    bench.link.take().expect("it runs").join().expect("it ends");
    bench.line_reads(&[Fault]);
}
